"""Upload a scene: from its description to the device arrays that kernels read."""
