"""Mesh files, and trimesh objects."""
