"""Textures and normal maps."""
