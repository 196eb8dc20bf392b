"""Measured reflectances: their files, and the observer that sees spectra as colours."""
