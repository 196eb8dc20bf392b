"""Helpers shared by the tests: statistics, and a bridge to an independent renderer."""
