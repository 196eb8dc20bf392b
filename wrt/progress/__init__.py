"""Progress of a render on the terminal."""
