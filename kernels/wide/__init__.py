"""Render kernels for sixteen lanes at once, on CPUs whose registers hold so many numbers."""
