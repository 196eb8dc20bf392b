"""Grids of Mitsuba's volume files, and the surfaces in them."""
