"""Build acceleration structures on a device."""
