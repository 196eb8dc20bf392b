"""Rays, triangles, surfaces, and their motion."""
