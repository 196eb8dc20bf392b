"""Integrators: what the light along a camera ray is."""
