"""Participating media, and the bodies that they fill."""
