"""Cameras: from a point on the film to a ray, and back."""
