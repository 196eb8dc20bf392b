"""Walter's rough glass in double precision: GGX with Smith's masking, one bounce and, as lobes, all that follow."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray
from scipy.special import beta

from support.principled_reference import dot, exact, ggx, smith, unit

Array = NDArray[np.float64]


def masking(wo: Array, wi: Array, alpha: float) -> Array:
    """Return G: Heitz 2014, eq. 99, on one side; B(1 + Λo, 1 + Λi) on both (Heitz, Hanika, d'Eon, Dachsbacher 2016)."""
    o, i = smith(wo, (alpha, alpha)), smith(wi, (alpha, alpha))
    return np.where(wo[:, 2] * wi[:, 2] > 0.0, 1.0 / (1.0 + o + i), beta(1.0 + o, 1.0 + i))


def refracted_value(wo: Array, wi: Array, alpha: float, eta: float) -> Array:
    """Return f |cosθi| of light from below, eta = n_t / n_i: Walter 2007, eq. 21, over eta² for radiance."""
    m = unit(wo + eta * wi)
    m = np.where(m[:, 2:] < 0.0, -m, m)
    o, i = dot(wo, m), dot(wi, m)
    seen = (o > 0.0) & (i < 0.0)
    scale = (1.0 - exact(np.where(seen, o, 1.0), eta)) * np.abs(o * i) / (np.abs(wo[:, 2]) * (o + eta * i) ** 2)
    return np.where(seen, scale * ggx(m, (alpha, alpha)) * masking(wo, wi, alpha), 0.0)


@functools.cache
def lost(mu: float, alpha: float, eta: float, n: int = 64) -> float:
    """Return 1 − E of light seen from an angle of cosine mu, by quadrature over visible normals.

    They are those of a hemisphere, stretched (Heitz 2018; as a cap, Dupuy and Benyoub 2023).
    """
    x, w = np.polynomial.legendre.leggauss(n)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    phi, z = np.meshgrid(np.pi * x, x, indexing="ij")
    wo = np.array([[np.sqrt(1.0 - mu * mu), 0.0, mu]])
    view = unit(wo[0] * [alpha, alpha, 1.0])
    cap = z * (1.0 + view[2]) - view[2]
    radius = np.sqrt(np.maximum(1.0 - cap * cap, 0.0))
    m = np.stack([radius * np.cos(phi), radius * np.sin(phi), cap], axis=-1).reshape(-1, 3) + view
    m = unit(m * [alpha, alpha, 1.0])
    o = dot(wo, m)
    reflectance = exact(o, eta)
    cos2 = 1.0 - (1.0 - o * o) / eta**2
    up = 2.0 * o[:, None] * m - wo
    down = m * (o / eta - np.sqrt(np.maximum(cos2, 0.0)))[:, None] - wo / eta
    kept = np.zeros(len(m))
    for wi, share, seen in (
        (up, reflectance, up[:, 2] > 0.0),
        (down, 1.0 - reflectance, (down[:, 2] < 0.0) & (cos2 > 0.0)),
    ):
        there = np.where(seen[:, None], wi, [[0.0, 0.0, 1.0]])
        of_one = 1.0 / (1.0 + smith(wo, (alpha, alpha)))
        kept += np.where(seen, share * masking(wo, there, alpha) / of_one, 0.0)
    return float(1.0 - np.outer(w, w).ravel() @ kept)


def refracted_lobe(wo: Array, wi: Array, alpha: float, eta: float) -> Array:
    """Return f |cosθi| of light from below by all further bounces, over eta² for radiance.

    Kulla and Conty 2017, with the share of `wrt.kernels.bsdf.lobes.albedo_dielectric`.
    """
    x, w = np.polynomial.legendre.leggauss(32)
    mu, weights = (0.5 * (x + 1.0)) ** 2, 0.5 * w * 2.0 * 0.5 * (x + 1.0)
    here, there = (2.0 * weights * mu @ [lost(m, alpha, e) for m in mu.tolist()] for e in (eta, 1.0 / eta))
    through = 2.0 * weights * mu @ (1.0 - exact(mu, eta))
    share = through * min(1.0, there / here)
    o = np.array([lost(m, alpha, eta) for m in np.broadcast_to(wo, wi.shape)[:, 2].tolist()])
    i = np.array([lost(-m, alpha, 1.0 / eta) for m in wi[:, 2].tolist()])
    return share * o * i / (np.pi * there) * -wi[:, 2] / eta**2
