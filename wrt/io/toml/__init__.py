"""Scene files in TOML: reading, writing, and their schema."""
