"""A camera, lights and a floor around a bare mesh."""
