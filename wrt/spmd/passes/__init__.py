"""Passes over the intermediate form, one per file."""
