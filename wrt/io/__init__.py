"""Readers and writers: meshes, images and scene files."""
