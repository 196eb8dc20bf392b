"""Fresnel's equations in double precision, in other forms than the kernels'."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def cook_torrance(cos_i: ArrayLike, eta: ArrayLike) -> Array:
    """Return reflectance in g and c (Cook and Torrance 1982); g² < 0 is total internal reflection."""
    c = np.asarray(cos_i, np.float64)
    g2 = np.square(eta) - 1.0 + c**2
    g = np.sqrt(np.maximum(g2, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        f = 0.5 * ((g - c) / (g + c)) ** 2 * (1.0 + ((c * (g + c) - 1.0) / (c * (g - c) + 1.0)) ** 2)
    return np.where(g2 <= 0.0, 1.0, f)


def by_angles(cos_i: ArrayLike, eta: ArrayLike) -> Array:
    """Return reflectance by Snell's angles: Fresnel's sine and tangent laws."""
    theta = np.arccos(np.clip(cos_i, 0.0, 1.0 - 1e-12))
    sine = np.sin(theta) / eta
    inner = np.arcsin(np.minimum(sine, 1.0))
    r_s = np.sin(theta - inner) / np.sin(theta + inner)
    r_p = np.tan(theta - inner) / np.tan(theta + inner)
    return np.where(sine >= 1.0, 1.0, 0.5 * (r_s**2 + r_p**2))


def complex_fresnel(cos_i: ArrayLike, eta: ArrayLike, k: ArrayLike) -> Array:
    """Return reflectance from Snell's law and the amplitudes with a complex index (Born and Wolf, 1.5 and 14.2)."""
    cos_i, n = np.asarray(cos_i, np.float64), np.asarray(eta) + 1j * np.asarray(k)
    cos_t = np.sqrt(1.0 - (1.0 - cos_i**2) / n**2 + 0j)
    r_s = (cos_i - n * cos_t) / (cos_i + n * cos_t)
    r_p = (n * cos_i - cos_t) / (n * cos_i + cos_t)
    return 0.5 * (np.abs(r_s) ** 2 + np.abs(r_p) ** 2)


def schlick(cos_i: ArrayLike, f0: ArrayLike) -> Array:
    """Return F0 + (1 − F0)(1 − cosθ)⁵ (Schlick 1994)."""
    f0 = np.asarray(f0, np.float64)
    return f0 + (1.0 - f0) * (1.0 - np.asarray(cos_i, np.float64)) ** 5


def diffuse_reflectance(n: float) -> float:
    """Return 2 ∫ F cosθ d cosθ from the side of the lower index, in closed form (Walsh 1926; Duntley 1942)."""
    a, b = n * n - 1.0, n * n + 1.0
    terms = 0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) ** 2)
    terms += n**2 * a**2 / b**3 * np.log((n - 1.0) / (n + 1.0))
    terms -= 2.0 * n**3 * (n * n + 2.0 * n - 1.0) / (b * (n**4 - 1.0))
    return float(terms + 8.0 * n**4 * (n**4 + 1.0) / (b * (n**4 - 1.0) ** 2) * np.log(n))
