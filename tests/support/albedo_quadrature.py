"""Albedos of layers by quadrature, which those in closed form of kernels/bsdf/lobes/albedo_fits.py approximate.

A coat must attenuate the layers below by no more than it reflects itself: its albedo E(w) for light from w. Microfacet
albedos have no closed form, but are smooth functions of the cosine μ and the roughness in suitable variables.

- GGX with Smith's height-correlated masking and Schlick's Fresnel, F = f0 + (f90 − f0)(1 − wo·m)⁵, has the albedo
  f0 (W − G) + f90 G: W is the albedo of a white surface, G the same with the weight (1 − wo·m)⁵. W is a polynomial in
  μ / (μ + α/2) and √α, as masking depends on μ/α where both are small. G/W is the fifth power of one in √α and the root
  of ½ (μ + √(μ² + α² (1 − μ²))), the mean cosine of the visible facets.
- Sheen, after Estevez and Kulla (2017): its albedo is the square of a polynomial in h / (h + r) and ln r, with r its
  roughness (the root of their r) and h = √(μ² + c²), c the cosine where its shadowing is cut.

The coefficients are those of linear programs that minimise the maximum error while the fit is nowhere below these
values, at Chebyshev points of both variables. So a coat never transmits too much, and energy is conserved. Averages are
fitted from below, since 1 − E divides.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHEEN_CUT = 0.01
"""Lower clamp of cosines in the shadowing of sheen."""


def nodes(n: int) -> tuple[Array, Array]:
    """Return the points and weights of Gauss-Legendre quadrature on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(n)
    return 0.5 * (x + 1.0), 0.5 * w


def specular_albedos(mu: float, alpha: float, n: int = 192) -> tuple[float, float]:
    """Return W and G by quadrature over the random numbers of visible-normal sampling (Dupuy and Benyoub 2023)."""
    x, w = nodes(n)
    phi, z = np.meshgrid(np.pi * x, x, indexing="ij")
    sine = np.sqrt(1.0 - mu * mu)
    view = np.array([alpha * sine, 0.0, mu]) / np.hypot(alpha * sine, mu)
    cap = z * (1.0 + view[2]) - view[2]
    radius = np.sqrt(np.maximum(1.0 - cap * cap, 0.0))
    m = np.stack([alpha * (radius * np.cos(phi) + view[0]), alpha * radius * np.sin(phi), cap + view[2]])
    m /= np.sqrt((m * m).sum(axis=0))
    cos_m = sine * m[0] + mu * m[2]
    light = 2.0 * cos_m * m[2] - mu

    def hidden(cos: Array) -> Array:
        return 0.5 * (np.sqrt(1.0 + alpha**2 * (1.0 - cos**2) / cos**2) - 1.0)

    lambda_o, lambda_i = hidden(np.array(mu)), hidden(np.where(light > 0.0, light, 1.0))
    visible = np.where(light > 0.0, (1.0 + lambda_o) / (1.0 + lambda_o + lambda_i), 0.0) * np.outer(w, w)
    return float(visible.sum()), float((visible * (1.0 - np.minimum(cos_m, 1.0)) ** 5).sum())


def sheen_lambda(cos: Array, alpha: float) -> Array:
    """Return Λ of sheen by the fit of Estevez and Kulla (2017)."""
    k = (1.0 - alpha) ** 2
    rough = np.array([21.5473, 3.82987, 0.19823, -1.97760, -4.32054])
    smooth = np.array([25.3245, 3.32435, 0.16801, -1.27393, -4.85967])
    a, b, c, d, e = rough + (smooth - rough) * k

    def curve(x: Array) -> Array:
        return np.asarray(a / (1.0 + b * x**c) + d * x + e)

    low = curve(np.minimum(cos, 0.5))
    high = 2.0 * curve(np.array(0.5)) - curve(1.0 - np.maximum(cos, 0.5))
    return np.exp(np.where(cos < 0.5, low, high))


def sheen_albedo(mu: float, roughness: float, n: int = 160) -> float:
    """Return the albedo of white sheen by quadrature over directions, densest at the horizon and around the viewer."""
    alpha = roughness**2
    x, w = nodes(n)
    cos, phi = np.meshgrid(x**3, np.pi * x**2, indexing="ij")
    weights = 2.0 * np.outer(w * 3.0 * x**2, w * 2.0 * np.pi * x)
    sine = np.sqrt(1.0 - cos**2)
    h = np.stack([sine * np.cos(phi) + np.sqrt(1.0 - mu * mu), sine * np.sin(phi), cos + mu])
    sine2_h = 1.0 - h[2] ** 2 / (h * h).sum(axis=0)
    d = (2.0 + 1.0 / alpha) * np.maximum(sine2_h, 0.0) ** (0.5 / alpha) / (2.0 * np.pi)
    o, i = np.maximum(np.array(mu), SHEEN_CUT), np.maximum(cos, SHEEN_CUT)
    visible = 1.0 / (4.0 * o * i * (1.0 + sheen_lambda(o, alpha) + sheen_lambda(i, alpha)))
    return float((weights * d * visible * cos).sum())
