"""Rough plastics: match the internal reflectance of Mitsuba's coat.

Light bounces between a rough coat and its base, and the coat's internal diffuse reflectance brightens the base. wrt
conserves energy: light that does not leave is reflected. Mitsuba takes twice the mean of R(μ) μ over 64 cosines with
single scattering only, so masked light is lost: its bases are darker, by a tenth at a roughness of 0.1, by a third at
0.4. This module darkens the reflectance of the base by as much.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import gauss_legendre, product
from wrt.scene.textures import ColorSource, ImageTexture, Texture, VertexColor
from wrt.values import vec3

Array = NDArray[np.float64]

_NODES = 64  # cosines in Mitsuba's mean
_POINTS = 4096  # microfacet normals per cosine: accurate to 1e-4


def as_in_mitsuba(
    reflectance: ColorSource, alpha: ColorSource, distribution: str, eta: float, *, nonlinear: bool
) -> ColorSource:
    """Return the base reflectance with which a coat in wrt looks as `reflectance` does in Mitsuba.

    It is exact for a constant roughness, and for colours that are constant or not `nonlinear`. A roughness image counts
    by its mean; `nonlinear` images are converted per texel, vertex colours as if they were grey.
    """
    if isinstance(alpha, ImageTexture):
        alpha = float(np.clip((alpha.pixels[..., 0] * np.asarray(alpha.factor)[0]).mean(), 1e-4, 1.0))
    elif isinstance(alpha, (VertexColor, Texture)):
        return reflectance
    ours, theirs = internal_reflectances(distribution, float(np.mean(alpha)), eta)

    def changed(value: NDArray[Any]) -> NDArray[Any]:
        if not nonlinear:
            return value * ((1.0 - ours) / (1.0 - theirs))
        shown = value / (1.0 - value * theirs)
        return np.asarray(shown / (1.0 + shown * ours))

    if isinstance(reflectance, VertexColor) or (isinstance(reflectance, ImageTexture) and not nonlinear):
        factor = np.asarray(reflectance.factor, np.float64)
        return dataclasses.replace(reflectance, factor=vec3(factor * float(changed(np.array(0.5))) / 0.5))
    if isinstance(reflectance, ImageTexture):
        pixels = changed(reflectance.pixels * np.asarray(reflectance.factor, np.float32))
        return dataclasses.replace(reflectance, pixels=pixels, factor=1.0)
    return vec3(changed(np.broadcast_to(np.asarray(reflectance, np.float64), 3)))


def scaled(color: ColorSource, factor: float) -> ColorSource:
    """Return a colour times a factor."""
    if isinstance(color, (ImageTexture, VertexColor)):
        return dataclasses.replace(color, factor=vec3(np.asarray(color.factor, np.float64) * factor))
    return vec3(np.broadcast_to(np.asarray(color, np.float64) * factor, 3))


def diffuse_fresnel(eta: float) -> float:
    """Return the share of diffuse light that a smooth dielectric of a relative refractive index above 1 reflects."""
    node, weight = gauss_legendre(64)
    mu = 0.5 * (node + 1.0)
    return float(product(weight, _fresnel(mu, eta)[0] * mu))


def _fresnel(cosine: Array, eta: float) -> tuple[Array, Array]:
    """Return the reflectance of a smooth dielectric for unpolarised light, and the cosine of the refracted ray."""
    cos_t2 = 1.0 - (1.0 - cosine**2) / eta**2
    cos_t = np.sqrt(np.maximum(cos_t2, 0.0))
    across, along = (cosine - eta * cos_t) / (cosine + eta * cos_t), (eta * cosine - cos_t) / (eta * cosine + cos_t)
    return np.where(cos_t2 > 0.0, 0.5 * (across**2 + along**2), 1.0), cos_t


@functools.lru_cache(maxsize=256)
def internal_reflectances(distribution: str, alpha: float, eta: float) -> tuple[float, float]:
    """Return the internal diffuse reflectance of a coat of relative refractive index `eta`, in wrt and in Mitsuba.

    The distributions are "ggx", with Smith's separable masking, and "beckmann", with Walter's fit of it.
    """
    nodes = np.maximum(np.linspace(0.0, 1.0, _NODES), 1e-6)
    theirs = 2.0 * float(np.mean(_shares(distribution, alpha, 1.0 / eta, nodes)[0] * nodes))
    # Light that is not reflected leaves: 1 − R = 2 ∫ T μ dμ / η² (kernels/bsdf/lobes/coat_transmittance.py), over √μ.
    node, weight = gauss_legendre(24)
    root = 0.5 * (node + 1.0)
    reflected, refracted = _shares(distribution, alpha, eta, root**2)
    let_in = np.clip(np.minimum(refracted, 1.0 - reflected), 0.0, 1.0)
    return 1.0 - float(product(0.5 * weight, let_in * 4.0 * root**3)) / eta**2, theirs


def _shares(distribution: str, alpha: float, eta: float, cosines: Array) -> tuple[Array, Array]:
    """Return the single-scattering reflectance and transmittance per direction (Walter et al. 2007)."""
    # A Fibonacci lattice; t has a density that covers steep facets: the slope is about α / t.
    k = np.arange(_POINTS)
    t, phi = (k + 0.5) / _POINTS, 2.0 * math.pi * (k * 0.6180339887498949 % 1.0)
    tan2 = alpha**2 * ((1.0 - t**2) / t**2 if distribution == "ggx" else -2.0 * np.log(t))
    m_z = 1.0 / np.sqrt(1.0 + tan2)
    m_x = np.sqrt(tan2) * m_z * np.cos(phi)
    mu = cosines[:, None]
    cos_m = np.sqrt(1.0 - mu**2) * m_x + mu * m_z
    is_visible = cos_m > 0.0
    weight = np.where(is_visible, 2.0 * t * cos_m / (mu * m_z), 0.0) * _g1(distribution, alpha, mu)
    cos_m = np.where(is_visible, cos_m, 1.0)
    fresnel, cos_t = _fresnel(cos_m, eta)
    mirrored = 2.0 * cos_m * m_z - mu
    bent = m_z * (cos_m / eta - cos_t) - mu / eta
    reflected = np.where(mirrored > 0.0, weight * fresnel * _g1(distribution, alpha, np.abs(mirrored)), 0.0)
    refracted = np.where(bent < 0.0, weight * (1.0 - fresnel) * _g1(distribution, alpha, np.abs(bent)), 0.0)
    return reflected.mean(axis=1), refracted.mean(axis=1)


def _g1(distribution: str, alpha: float, cosine: Array) -> Array:
    """Return the masking function, the fraction of facets visible from a direction."""
    tangent = alpha * np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, 1e-12)
    if distribution == "ggx":
        return np.asarray(2.0 / (1.0 + np.sqrt(1.0 + tangent**2)))
    a = 1.0 / np.maximum(tangent, 1e-12)
    fit = (3.535 * a + 2.181 * a**2) / (1.0 + 2.276 * a + 2.577 * a**2)
    return np.asarray(np.where(a < 1.6, fit, 1.0))
