"""Random numbers, and maps from them to the domains of sampling."""
