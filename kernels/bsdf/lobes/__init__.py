"""Lobes and functions that reflection models share."""
