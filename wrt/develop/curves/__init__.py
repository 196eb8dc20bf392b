"""Tone curves, a file each."""
