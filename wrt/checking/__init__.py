"""Checks of reflection models: those of users by `wrt.check_bsdf`, and built-in ones by the tests."""
