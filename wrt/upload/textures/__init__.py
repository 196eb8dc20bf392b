"""Prepare images for the kernels."""
