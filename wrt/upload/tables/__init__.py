"""Compute the tables that reflection models read."""
