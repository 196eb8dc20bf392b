"""Other renderers, given the scenes of wrt: what tests and benchmarks share."""
