"""Render a scene to a film, pass after pass, and write it to files."""
