"""Build the tables from which lights are selected and sampled."""
