"""The metalness workflow in double precision: metal and dielectric, diffuse and clear, under sheen and a coat.

By glTF's appendix B and its extensions, but with height-correlated masking, and with layers coupled by their albedos.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt
from support.albedo_quadrature import sheen_lambda
from support.kernels import map_function
from wrt.kernels.bsdf.lobes import albedo_fits

Array = NDArray[np.float64]


def dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=-1))


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def schlick(cos: Array, f0: Array, f90: float) -> Array:
    """Return (N, 3) f0 + (f90 − f0)(1 − cosθ)⁵."""
    return f0 + (f90 - f0) * (1.0 - np.clip(cos, 0.0, 1.0))[:, None] ** 5


def ggx(m: Array, alpha: tuple[float, float]) -> Array:
    """Return D(m): Walter 2007, eq. 33, anisotropic as in Burley 2012."""
    x, y = m[:, 0] / alpha[0], m[:, 1] / alpha[1]
    return 1.0 / (np.pi * alpha[0] * alpha[1] * (x * x + y * y + m[:, 2] ** 2) ** 2)


def smith(w: Array, alpha: tuple[float, float]) -> Array:
    """Return Λ(w) of GGX (Heitz 2014, eq. 72 and 86)."""
    tan2 = ((alpha[0] * w[:, 0]) ** 2 + (alpha[1] * w[:, 1]) ** 2) / w[:, 2] ** 2
    return 0.5 * (np.sqrt(1.0 + tan2) - 1.0)


def masking(wo: Array, wi: Array, alpha: tuple[float, float], kind: str) -> Array:
    """Return G(wo, wi) of directions that see the front of the facet."""
    o, i = smith(wo, alpha), smith(wi, alpha)
    return 1.0 / (1.0 + o + i) if kind == "correlated" else 1.0 / ((1.0 + o) * (1.0 + i))


def facets(wo: Array, wi: Array, alpha: tuple[float, float]) -> Array:
    """Return D G / (4 cosθi cosθo)."""
    return ggx(unit(wo + wi), alpha) * masking(wo, wi, alpha, "correlated") / (4.0 * wo[:, 2] * wi[:, 2])


def grain(p: wrt.Principled) -> tuple[float, float]:
    """Return α along x and y."""
    alpha = max(p.roughness**2, 1e-4)
    return alpha + (1.0 - alpha) * p.anisotropy**2, alpha


def turned(w: Array, angle: float) -> Array:
    """Return directions in a frame turned counter-clockwise about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * w[:, 0] + s * w[:, 1], c * w[:, 1] - s * w[:, 0], w[:, 2]], axis=1)


# The kernels' albedos of layers: test_albedo_fits.py tests them by themselves.


def facet_albedos(w: Array, alpha: tuple[float, float], device: str) -> tuple[Array, Array]:
    """Return W and G of GGX: f0 (W − G) + f90 G is reflected by Schlick's Fresnel."""
    shapes = np.broadcast_to([*alpha, 0.0], (len(w), 3))
    white, grazing = map_function(albedo_fits.facet_albedo, w, shapes, device=device).astype(np.float64).T
    return white, grazing


def average_albedos(alpha: tuple[float, float], device: str) -> tuple[float, float]:
    """Return 2 ∫ (W, G) μ dμ."""
    white, grazing = map_function(albedo_fits.average_facet_albedo, np.array([[*alpha, 0.0]]), device=device)[
        0
    ].tolist()
    return white, grazing


def sheen_albedo(w: Array, roughness: float, device: str) -> Array:
    """Return the albedo of white sheen."""
    found = map_function(albedo_fits.sheen_albedo, w[:, 2], np.full(len(w), roughness), device=device)
    return np.asarray(found, np.float64)


def dielectric_f0(p: wrt.Principled) -> tuple[Array, float]:
    """Return f0 and f90 by KHR_materials_ior and KHR_materials_specular."""
    f0 = np.minimum(((p.ior - 1.0) / (p.ior + 1.0)) ** 2 * np.array(p.specular_color), 1.0) * p.specular
    return f0, float(p.specular)


def boundary(p: wrt.Principled, cos: Array, front: bool, body: bool) -> Array:
    """Return (N, 3) the dielectric's Fresnel; of a body seen from inside by the angle outside."""
    f0, f90 = dielectric_f0(p)
    if front or not body:
        return schlick(cos, f0, f90)
    cos2 = 1.0 - (1.0 - cos**2) * p.ior**2
    return np.where((cos2 > 0.0)[:, None], schlick(np.sqrt(np.maximum(cos2, 0.0)), f0, f90), 1.0)


def diffuse(p: wrt.Principled, wo: Array, wi: Array, alpha: tuple[float, float], device: str) -> Array:
    """Return (N, 1) what the dielectric's body reflects diffusely, without its colour (Kulla and Conty 2017)."""
    f0, f90 = dielectric_f0(p)

    def left(white: Any, grazing: Any) -> Any:
        return 1.0 - (f0.max() * (white - grazing) + f90 * grazing)

    passed = left(*facet_albedos(wo, alpha, device)) * left(*facet_albedos(wi, alpha, device))
    return np.asarray((passed / left(*average_albedos(alpha, device)) / np.pi)[:, None])


def refraction(wo: Array, wi: Array, eta: float, alpha: tuple[float, float]) -> tuple[Array, Array]:
    """Return Walter's (2007) eq. 21 times |cosθi|, without 1 − F and scaled for radiance, and the cosine wo·m."""
    m = -unit(wo + eta * wi) if eta > 1.0 else unit(wo + eta * wi)
    o, i = dot(wo, m), dot(wi, m)
    visible = (o > 0.0) & (i < 0.0) & (m[:, 2] > 0.0)
    value = (
        np.abs(o * i) * ggx(m, alpha) * masking(wo, -wi, alpha, "separable") / (np.abs(wo[:, 2]) * (o + eta * i) ** 2)
    )
    # eta² of eq. 21 and 1 / eta² of radiance cancel.
    return np.where(visible, value, 0.0), np.where(visible, o, 1.0)


def base_value(p: wrt.Principled, wo: Array, wi: Array, front: bool, device: str) -> Array:
    """Return (N, 3) f |cosθi| of what lies under sheen and coat, directions all on one side."""
    alpha = grain(p)
    wo, wi = turned(wo, p.anisotropy_rotation), turned(wi, p.anisotropy_rotation)
    color, t, body = np.array(p.base_color), p.transmission, p.transmission > 0.0 and not p.thin_walled
    dielectric = 1.0 - p.metallic
    if wi[0, 2] > 0.0:
        cos = dot(wo, unit(wo + wi))
        f = (1.0 - t) * boundary(p, cos, True, body) + t * boundary(p, cos, front, body)
        total = p.metallic * schlick(cos, color, 1.0) + dielectric * f
        value = total * facets(wo, wi, alpha)[:, None]
        return (value + dielectric * (1.0 - t) * color * diffuse(p, wo, wi, alpha, device)) * wi[:, 2:]
    if p.thin_walled:
        mirrored = wi * np.array([1.0, 1.0, -1.0])
        f = boundary(p, dot(wo, unit(wo + mirrored)), front, body).max(axis=1)
        shape = facets(wo, mirrored, alpha) * mirrored[:, 2]
    else:
        shape, cos = refraction(wo, wi, p.ior if front else 1.0 / p.ior, alpha)
        f = boundary(p, cos, front, body).max(axis=1)
    return dielectric * t * color * ((1.0 - f) * shape)[:, None]


def charlie(wo: Array, wi: Array, roughness: float) -> Array:
    """Return sheen after Estevez and Kulla (2017), as KHR_materials_sheen prints it."""
    alpha = roughness * roughness
    sin2 = 1.0 - unit(wo + wi)[:, 2] ** 2
    distribution = (2.0 + 1.0 / alpha) * sin2 ** (0.5 / alpha) / (2.0 * np.pi)
    o, i = wo[:, 2], wi[:, 2]
    return distribution / ((1.0 + sheen_lambda(o, alpha) + sheen_lambda(i, alpha)) * (4.0 * o * i))


def value(p: wrt.Principled, wo: Array, wi: Array, device: str, *, front: bool = True) -> Array:
    """Return (N, 3) f |cosθi|.

    Args:
        p: constants only.
        wo: (N, 3) towards the viewer, above the surface.
        wi: (N, 3) towards the light, all above or all below it.
        device: where the kernels' albedos of layers are evaluated.
        front: whether the viewer is outside of a transparent body.
    """
    result = base_value(p, wo, wi, front, device)
    above = wi[0, 2] > 0.0
    body = p.transmission > 0.0 and not p.thin_walled
    sides = (np.ones(len(wo)) if front or not body else 0.0, np.ones(len(wi)) if not body or front == above else 0.0)
    up = wi * np.array([1.0, 1.0, 1.0 if above else -1.0])
    lit = above and np.all(sides[0])
    color = np.array(p.sheen_color)
    if color.any():
        o, i = (side * sheen_albedo(w, p.sheen_roughness, device) for side, w in zip(sides, (wo, up), strict=True))
        most = np.maximum(o, i)
        result = result * (1.0 - color.max() * np.minimum(most, 1.0))[:, None]
        if lit:
            fibres = charlie(wo, wi, p.sheen_roughness) * wi[:, 2] / np.maximum(most, 1.0)
            result = result + color * fibres[:, None]
    if p.coat:
        alpha = (max(p.coat_roughness**2, 1e-4),) * 2
        o, i = (
            side * p.coat * (0.04 * (white - grazing) + grazing)
            for side, (white, grazing) in zip(sides, (facet_albedos(w, alpha, device) for w in (wo, up)), strict=True)
        )
        result = result * (1.0 - np.maximum(o, i))[:, None]
        if lit:
            fresnel = schlick(dot(wo, unit(wo + wi)), np.full(3, 0.04), 1.0)[:, 0]
            result = result + (p.coat * fresnel * facets(wo, wi, alpha) * wi[:, 2])[:, None]
    return result
