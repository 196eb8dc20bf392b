"""Derivatives of a path-traced picture by path replay."""

from wrt.kernels.gradients.adjoints import complete_adjoints

complete_adjoints()
