"""What distributions of microfacet normals need from the host."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray


@functools.cache
def _nodes_and_weights() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return those of Gauss and Legendre's quadrature over −1 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(128)
    return np.asarray(nodes), np.asarray(weights)


def sgd_normalization(alpha: float, p: float) -> float:
    """Return K = 1 / (α² exp(α) E_p(α)), the third number of the shape of a shifted gamma distribution.

    It makes ∫ D cosθ dω = 1 for D = K exp(−x / α) (1 + x / α²)^−p / (π cos⁴θ), x = tan²θ: the distribution of Bagher,
    Soler and Holzschuch (2012). In their terms K is exp(−α) / (α^(1 + p) Γ(1 − p, α)), where p may exceed 1.

    Args:
        alpha: α > 0; fits to measured materials have 3e-5 (chrome steel) to 0.7 (dark red paint).
        p: exponent, p ≥ 0; those fits have 0 to 1.4.

    Raises:
        ValueError: where α is not above 0 or either is not finite.
    """
    if not (math.isfinite(alpha) and math.isfinite(p) and alpha > 0.0):
        raise ValueError(f"shifted gamma distribution: alpha must be above 0 and p finite, not {alpha} and {p}")
    # exp(α) E_p(α) = ∫ exp(−αs) (1 + s)^−p ds over s ≥ 0; with 1 + s = e^y the integrand is smooth on the scale of y,
    # and below e^−50 where this interval ends.
    end = math.log1p(50.0 / alpha)
    nodes, weights = _nodes_and_weights()
    y = 0.5 * end * (nodes + 1.0)
    integral = 0.5 * end * float(np.sum(weights * np.exp(-alpha * np.expm1(y) + (1.0 - p) * y)))
    return 1.0 / (alpha * alpha * integral)
