"""Derivatives of pictures by the values of a scene."""
