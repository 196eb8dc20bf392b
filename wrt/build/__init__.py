"""From a scene's description to the arrays that kernels read."""
