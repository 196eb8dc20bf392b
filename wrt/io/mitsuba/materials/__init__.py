"""Read Mitsuba's BSDFs and textures as wrt's materials."""
