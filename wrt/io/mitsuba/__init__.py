"""Read scene files of Mitsuba 3, in XML (Jakob et al. 2022, mitsuba-renderer.org); docs/mitsuba.md lists what maps."""
