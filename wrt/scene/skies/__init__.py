"""Sky models of daylight, and spherical harmonics."""
