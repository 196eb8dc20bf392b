"""Building the ray tree."""
