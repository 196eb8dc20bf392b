"""Lights: choosing one, and sampling a direction to it."""
