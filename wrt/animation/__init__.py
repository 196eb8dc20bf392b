"""Turntables, animations and the videos of their frames."""
