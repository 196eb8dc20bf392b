"""The scene's device data."""
