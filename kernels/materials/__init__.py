"""Materials at a point: choosing one in a mixture, and its BSDF."""
