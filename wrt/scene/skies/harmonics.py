"""Real spherical harmonics.

Orthonormal over the sphere, in the world's x, y and z with z as the polar axis, without the Condon-Shortley sign: the
convention of Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance Environment Maps" (2001),
equation 3, and of Sloan, "Stupid Spherical Harmonics Tricks" (2008), except for his sign (−1)^m:

    Y₀₀ = 0.282095,  Y₁₋₁ = 0.488603 y,  Y₁₀ = 0.488603 z,  Y₁₁ = 0.488603 x,
    Y₂₋₂ = 1.092548 xy,  Y₂₋₁ = 1.092548 yz,  Y₂₀ = 0.315392 (3z² − 1),  Y₂₁ = 1.092548 xz,  Y₂₂ = 0.546274 (x² − y²).

The coefficient of Y_lm has the index l² + l + m.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def harmonics(degree: int, directions: Array) -> Array:
    """Return the values of all harmonics up to a degree, (N, (degree + 1)²), at unit vectors (N, 3).

    sin^m θ cos mφ and sin^m θ sin mφ are the real and the imaginary part of (x + iy)^m. The other factor of the
    associated Legendre functions is a polynomial in z, given by the usual recurrence (Sloan 2008, appendix A1).
    """
    x, y, z = np.asarray(directions, np.float64).T
    values = np.empty((len(z), (degree + 1) ** 2))
    turning = np.ones(len(z), np.complex128)
    diagonal = 1.0
    for m in range(degree + 1):
        before, legendre = np.zeros_like(z), np.full_like(z, diagonal)
        for l in range(m, degree + 1):  # noqa: E741 (the customary name)
            norm = math.sqrt((2 * l + 1) / (4.0 * math.pi) * math.factorial(l - m) / math.factorial(l + m))
            if m == 0:
                values[:, l * l + l] = norm * legendre
            else:
                values[:, l * l + l + m] = math.sqrt(2.0) * norm * legendre * turning.real
                values[:, l * l + l - m] = math.sqrt(2.0) * norm * legendre * turning.imag
            before, legendre = legendre, ((2 * l + 1) * z * legendre - (l + m) * before) / (l - m + 1)
        turning = turning * (x + 1j * y)
        diagonal *= 2 * m + 1
    return values
