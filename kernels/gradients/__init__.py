"""Derivatives of a path-traced picture by path replay."""
