"""Descriptions of scenes and materials, for the command line and the schema."""
