"""Rough plastics: how much light Mitsuba's coat sends back to its base, and how much wrt's does.

Under a rough coat light goes back and forth, and what of diffuse light from below the coat sends back each time
brightens the base. wrt takes all that does not come out. Mitsuba takes twice the mean of R(μ) μ over 64 cosines, with
single reflections only, so what facets block is lost: its bases are darker, at a roughness of 0.1 by a tenth, at 0.4 by
a third. A base that is darker by as much looks the same.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.textures import ColorSource, ImageTexture, VertexColor
from wrt.values import Vec3

Array = NDArray[np.float64]

_NODES = 64
"""Cosines whose mean Mitsuba takes."""

_POINTS = 4096
"""Normals of facets for each of them: right to 1e-4."""


def as_in_mitsuba(
    reflectance: ColorSource, alpha: ColorSource, distribution: str, eta: float, *, nonlinear: bool
) -> ColorSource:
    """Return the reflectance of a base that looks in wrt as another does in Mitsuba.

    It is exact for one roughness, and for colours that do not vary or are not `nonlinear`. Where the roughness is an
    image its mean counts; `nonlinear` images are turned texel by texel, vertex colours as if they were grey.
    """
    if isinstance(alpha, ImageTexture):
        alpha = float(np.clip((alpha.pixels[..., 0] * np.asarray(alpha.factor)[0]).mean(), 1e-4, 1.0))
    elif isinstance(alpha, VertexColor):
        return reflectance
    ours, theirs = sent_back(distribution, float(np.mean(alpha)), eta)

    def changed(value: NDArray[Any]) -> NDArray[Any]:
        if not nonlinear:
            return value * ((1.0 - ours) / (1.0 - theirs))
        shown = value / (1.0 - value * theirs)
        return np.asarray(shown / (1.0 + shown * ours))

    if isinstance(reflectance, VertexColor) or (isinstance(reflectance, ImageTexture) and not nonlinear):
        factor = np.asarray(reflectance.factor, np.float64)
        return dataclasses.replace(reflectance, factor=_vec(factor * float(changed(np.array(0.5))) / 0.5))
    if isinstance(reflectance, ImageTexture):
        pixels = changed(reflectance.pixels * np.asarray(reflectance.factor, np.float32))
        return dataclasses.replace(reflectance, pixels=pixels, factor=1.0)
    return _vec(changed(np.broadcast_to(np.asarray(reflectance, np.float64), 3)))


def _vec(value: Array) -> Vec3:
    red, green, blue = (float(x) for x in value)
    return red, green, blue


@functools.lru_cache(maxsize=256)
def sent_back(distribution: str, alpha: float, eta: float) -> tuple[float, float]:
    """Return what of diffuse light from below a coat sends back, in wrt and in Mitsuba.

    Args:
        distribution: "ggx", masked by Smith's separable form, or "beckmann", by Walter's fit.
        alpha: roughness.
        eta: refractive index of the coat over that outside.
    """
    nodes = np.maximum(np.linspace(0.0, 1.0, _NODES), 1e-6)
    theirs = 2.0 * float(np.mean(_shares(distribution, alpha, 1.0 / eta, nodes)[0] * nodes))
    # What is not sent back comes out: 1 − R = 2 ∫ T μ dμ / η² (kernels/coat.py), here over √μ.
    node, weight = np.polynomial.legendre.leggauss(24)
    root = 0.5 * (node + 1.0)
    reflected, refracted = _shares(distribution, alpha, eta, root**2)
    let_in = np.clip(np.minimum(refracted, 1.0 - reflected), 0.0, 1.0)
    return 1.0 - float(0.5 * weight @ (let_in * 4.0 * root**3)) / eta**2, theirs


def _shares(distribution: str, alpha: float, eta: float, cosines: Array) -> tuple[Array, Array]:
    """Return the shares of light from directions that facets reflect and refract at once (Walter et al. 2007)."""
    # A Fibonacci lattice; t is drawn with a density that does not leave out steep facets: the slope is about α / t.
    k = np.arange(_POINTS)
    t, phi = (k + 0.5) / _POINTS, 2.0 * math.pi * (k * 0.6180339887498949 % 1.0)
    tan2 = alpha**2 * ((1.0 - t**2) / t**2 if distribution == "ggx" else -2.0 * np.log(t))
    m_z = 1.0 / np.sqrt(1.0 + tan2)
    m_x = np.sqrt(tan2) * m_z * np.cos(phi)
    mu = cosines[:, None]
    cos_m = np.sqrt(1.0 - mu**2) * m_x + mu * m_z
    seen = cos_m > 0.0
    weight = np.where(seen, 2.0 * t * cos_m / (mu * m_z), 0.0) * _g1(distribution, alpha, mu)
    cos_m = np.where(seen, cos_m, 1.0)
    cos_t2 = 1.0 - (1.0 - cos_m**2) / eta**2
    cos_t = np.sqrt(np.maximum(cos_t2, 0.0))
    across, along = (cos_m - eta * cos_t) / (cos_m + eta * cos_t), (eta * cos_m - cos_t) / (eta * cos_m + cos_t)
    fresnel = np.where(cos_t2 > 0.0, 0.5 * (across**2 + along**2), 1.0)
    mirrored = 2.0 * cos_m * m_z - mu
    bent = m_z * (cos_m / eta - cos_t) - mu / eta
    reflected = np.where(mirrored > 0.0, weight * fresnel * _g1(distribution, alpha, np.abs(mirrored)), 0.0)
    refracted = np.where(bent < 0.0, weight * (1.0 - fresnel) * _g1(distribution, alpha, np.abs(bent)), 0.0)
    return reflected.mean(axis=1), refracted.mean(axis=1)


def _g1(distribution: str, alpha: float, cosine: Array) -> Array:
    """Return the share of facets that are seen from a direction."""
    tangent = alpha * np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, 1e-12)
    if distribution == "ggx":
        return np.asarray(2.0 / (1.0 + np.sqrt(1.0 + tangent**2)))
    a = 1.0 / np.maximum(tangent, 1e-12)
    fit = (3.535 * a + 2.181 * a**2) / (1.0 + 2.276 * a + 2.577 * a**2)
    return np.asarray(np.where(a < 1.6, fit, 1.0))
