"""The metalness workflow in double precision, with the choices that renderers differ in as names.

`value` evaluates one skeleton,

    metallic · metal + (1 − metallic) · (dielectric reflection + diffuse under it + transmission), then sheen and coat,

whose parts are those of glTF's appendix B, of wrt or of Mitsuba's `principled`, so that every difference between two of
them is a field of `Choices`.
"""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from conftest import ROOT
from numpy.typing import NDArray

import wrt

Array = NDArray[np.float64]
Albedo = Callable[[Array, tuple[float, float]], tuple[Array, Array]]


@dataclass(frozen=True)
class Choices:
    """What is chosen for each part.

    Attributes:
        masking: G: "separable" G1 G1, or "correlated" heights (Heitz 2014, eq. 99).
        fresnel: of the dielectric: "schlick", or "exact" for a smooth boundary.
        diffuse: what the dielectric's reflection leaves: "half-vector" 1 − F(wo·m), as in appendix B; "coupled" by its
            albedo, (1 − E(θo)) (1 − E(θi)) / (1 − E_avg) (Kulla and Conty 2017); "burley", which knows nothing of
            it but has the retro-reflection of rough surfaces (Burley 2012).
        tint: power of the base colour by which each boundary colours light that it transmits.
        coat: "layer", GGX that leaves the base min(1 − E); "appendix", likewise but the base has 1 − F(θo); "gtr1",
            added as it is and without 1 / (4 cosθi cosθo).
        sheen: "charlie", of fibres, under which the base has min(1 − E), or "schlick", (1 − wi·m)⁵ added as it is.
        grain: α along both axes: "stretch" (α + (1 − α) s², α), or "aspect" (α / √(1 − 0.9 s), α √(1 − 0.9 s)).
    """

    masking: str
    fresnel: str
    diffuse: str
    tint: float
    coat: str
    sheen: str
    grain: str


APPENDIX_B = Choices("separable", "schlick", "half-vector", 1.0, "appendix", "charlie", "stretch")
WRT = Choices("correlated", "schlick", "coupled", 1.0, "layer", "charlie", "stretch")
MITSUBA = Choices("separable", "exact", "burley", 0.5, "gtr1", "schlick", "aspect")


@dataclass(frozen=True)
class Albedos:
    """Albedos of layers, for directions (N, 3).

    Attributes:
        facets: (w, (αu, αv)) -> W and G of GGX: f0 (W − G) + f90 G is reflected by Schlick's Fresnel.
        average: (αu, αv) -> 2 ∫ (W, G) μ dμ.
        sheen: (w, roughness) -> albedo of white sheen.
    """

    facets: Albedo
    average: Callable[[tuple[float, float]], tuple[float, float]]
    sheen: Callable[[Array, float], Array]


def dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=-1))


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def schlick(cos: Array, f0: Array, f90: float) -> Array:
    """Return (N, 3) f0 + (f90 − f0)(1 − cosθ)⁵."""
    return f0 + (f90 - f0) * (1.0 - np.clip(cos, 0.0, 1.0))[:, None] ** 5


def exact(cos: Array, eta: float) -> Array:
    """Return the reflectance of a smooth boundary, eta = n_t / n_i (Cook and Torrance's form in g and c)."""
    g2 = eta**2 - 1.0 + cos**2
    g = np.sqrt(np.maximum(g2, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        f = 0.5 * ((g - cos) / (g + cos)) ** 2 * (1.0 + ((cos * (g + cos) - 1.0) / (cos * (g - cos) + 1.0)) ** 2)
    return np.where(g2 <= 0.0, 1.0, f)


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


def facets(wo: Array, wi: Array, alpha: tuple[float, float], kind: str) -> Array:
    """Return D G / (4 cosθi cosθo)."""
    return ggx(unit(wo + wi), alpha) * masking(wo, wi, alpha, kind) / (4.0 * wo[:, 2] * wi[:, 2])


def grain(p: wrt.Principled, choices: Choices) -> tuple[float, float]:
    """Return α along x and y."""
    alpha, strength = max(p.roughness**2, 1e-4), p.anisotropy
    if choices.grain == "stretch":
        return alpha + (1.0 - alpha) * strength**2, alpha
    aspect = np.sqrt(1.0 - 0.9 * strength)
    return max(p.roughness**2 / aspect, 1e-3), max(p.roughness**2 * aspect, 1e-3)


def turned(w: Array, angle: float) -> Array:
    """Return directions in a frame turned counter-clockwise about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * w[:, 0] + s * w[:, 1], c * w[:, 1] - s * w[:, 0], w[:, 2]], axis=1)


def dielectric_f0(p: wrt.Principled) -> tuple[Array, float]:
    """Return f0 and f90 by KHR_materials_ior and KHR_materials_specular."""
    f0 = np.minimum(((p.ior - 1.0) / (p.ior + 1.0)) ** 2 * np.array(p.specular_color), 1.0) * p.specular
    return f0, float(p.specular)


def boundary(p: wrt.Principled, choices: Choices, cos: Array, front: bool, body: bool) -> Array:
    """Return (N, 3) the dielectric's Fresnel; of a body seen from inside by the angle outside."""
    if choices.fresnel == "exact":
        return np.repeat(exact(cos, p.ior if front else 1.0 / p.ior)[:, None], 3, axis=1)
    f0, f90 = dielectric_f0(p)
    if front or not body:
        return schlick(cos, f0, f90)
    cos2 = 1.0 - (1.0 - cos**2) * p.ior**2
    return np.where((cos2 > 0.0)[:, None], schlick(np.sqrt(np.maximum(cos2, 0.0)), f0, f90), 1.0)


def diffuse(
    p: wrt.Principled, choices: Choices, wo: Array, wi: Array, alpha: tuple[float, float], albedos: Albedos
) -> Array:
    """Return (N, 3) what the dielectric's body reflects diffusely, without its colour."""
    f0, f90 = dielectric_f0(p)
    if choices.diffuse == "half-vector":
        cos = dot(wo, unit(wo + wi))
        return (1.0 - schlick(cos, f0, f90).max(axis=1, keepdims=True)) / np.pi
    if choices.diffuse == "burley":
        o, i = (1.0 - wo[:, 2]) ** 5, (1.0 - wi[:, 2]) ** 5
        r = 2.0 * p.roughness * dot(wi, unit(wo + wi)) ** 2
        smooth = (1.0 - 0.5 * o) * (1.0 - 0.5 * i)
        return ((smooth + r * (o + i + o * i * (r - 1.0))) / np.pi)[:, None]

    def left(white: Any, grazing: Any) -> Any:
        return 1.0 - (f0.max() * (white - grazing) + f90 * grazing)

    both = left(*albedos.facets(wo, alpha)) * left(*albedos.facets(wi, alpha))
    return (both / left(*albedos.average(alpha)) / np.pi)[:, None]


def refraction(wo: Array, wi: Array, eta: float, alpha: tuple[float, float]) -> tuple[Array, Array]:
    """Return Walter's (2007) eq. 21 times |cosθi|, without 1 − F and scaled for radiance, and the cosine wo·m."""
    m = -unit(wo + eta * wi) if eta > 1.0 else unit(wo + eta * wi)
    o, i = dot(wo, m), dot(wi, m)
    seen = (o > 0.0) & (i < 0.0) & (m[:, 2] > 0.0)
    value = (
        np.abs(o * i) * ggx(m, alpha) * masking(wo, -wi, alpha, "separable") / (np.abs(wo[:, 2]) * (o + eta * i) ** 2)
    )
    # eta² of eq. 21 and 1 / eta² of radiance cancel.
    return np.where(seen, value, 0.0), np.where(seen, o, 1.0)


def base_value(p: wrt.Principled, choices: Choices, wo: Array, wi: Array, front: bool, albedos: Albedos) -> Array:
    """Return (N, 3) f |cosθi| of what lies under sheen and coat, directions all on one side."""
    alpha = grain(p, choices)
    wo, wi = turned(wo, p.anisotropy_rotation), turned(wi, p.anisotropy_rotation)
    color, t, body = np.array(p.base_color), p.transmission, p.transmission > 0.0 and not p.thin_walled
    dielectric = 1.0 - p.metallic
    if wi[0, 2] > 0.0:
        cos = dot(wo, unit(wo + wi))
        f = (1.0 - t) * boundary(p, choices, cos, True, body) + t * boundary(p, choices, cos, front, body)
        total = p.metallic * schlick(cos, color, 1.0) + dielectric * f
        if choices == MITSUBA and not front:  # metal and diffuse are black from inside
            total = dielectric * t * boundary(p, choices, cos, front, body)
        value = total * facets(wo, wi, alpha, choices.masking)[:, None]
        if choices != MITSUBA or front:
            value = value + dielectric * (1.0 - t) * color * diffuse(p, choices, wo, wi, alpha, albedos)
        return value * wi[:, 2:]
    amount = dielectric * t * color**choices.tint
    if p.thin_walled:
        mirrored = wi * np.array([1.0, 1.0, -1.0])
        f = boundary(p, choices, dot(wo, unit(wo + mirrored)), front, body).max(axis=1)
        return amount * ((1.0 - f) * facets(wo, mirrored, alpha, choices.masking) * mirrored[:, 2])[:, None]
    shape, cos = refraction(wo, wi, p.ior if front else 1.0 / p.ior, alpha)
    f = boundary(p, choices, cos, front, body).max(axis=1)
    return amount * ((1.0 - f) * shape)[:, None]


def charlie(wo: Array, wi: Array, roughness: float) -> Array:
    """Return sheen after Estevez and Kulla (2017), as KHR_materials_sheen prints it."""

    def l_curve(x: Array, a_g: float) -> Array:
        k = (1.0 - a_g) * (1.0 - a_g)
        a, b, c, d, e = (
            (1.0 - k) * p0 + k * p1
            for p0, p1 in [
                (21.5473, 25.3245),
                (3.82987, 3.32435),
                (0.19823, 0.16801),
                (-1.97760, -1.27393),
                (-4.32054, -4.85967),
            ]
        )
        return a / (1.0 + b * x**c) + d * x + e

    def lambda_sheen(cos: Array, a_g: float) -> Array:
        half = np.array(0.5)
        return np.where(
            cos < 0.5,
            np.exp(l_curve(np.minimum(cos, 0.5), a_g)),
            np.exp(2.0 * l_curve(half, a_g) - l_curve(np.minimum(1.0 - cos, 0.5), a_g)),
        )

    alpha = roughness * roughness
    sin2 = 1.0 - unit(wo + wi)[:, 2] ** 2
    distribution = (2.0 + 1.0 / alpha) * sin2 ** (0.5 / alpha) / (2.0 * np.pi)
    o, i = wo[:, 2], wi[:, 2]
    return distribution / ((1.0 + lambda_sheen(o, alpha) + lambda_sheen(i, alpha)) * (4.0 * o * i))


def gtr1(m: Array, alpha: float) -> Array:
    """Return the distribution of Burley's clearcoat (2012, eq. 4)."""
    a2 = alpha**2
    return (a2 - 1.0) / (np.pi * np.log(a2) * (1.0 + (a2 - 1.0) * m[:, 2] ** 2))


def value(p: wrt.Principled, choices: Choices, wo: Array, wi: Array, albedos: Albedos, *, front: bool = True) -> Array:
    """Return (N, 3) f |cosθi|.

    Args:
        p: constants only.
        choices: of the parts.
        wo: (N, 3) towards the viewer, above the surface.
        wi: (N, 3) towards the light, all above or all below it.
        albedos: of layers.
        front: whether the viewer is outside of a transparent body.
    """
    result = base_value(p, choices, wo, wi, front, albedos)
    above = wi[0, 2] > 0.0
    body = p.transmission > 0.0 and not p.thin_walled
    sides = (np.ones(len(wo)) if front or not body else 0.0, np.ones(len(wi)) if not body or front == above else 0.0)
    m = unit(wo + wi)
    up = wi * np.array([1.0, 1.0, 1.0 if above else -1.0])
    color = np.array(p.sheen_color)
    if color.any():
        if choices.sheen == "schlick":
            fresnel = (1.0 - dot(wi, m)) ** 5
            result = result + (1.0 - p.metallic) * color * (fresnel * wi[:, 2])[:, None]
        else:
            o, i = (side * albedos.sheen(w, p.sheen_roughness) for side, w in zip(sides, (wo, up), strict=True))
            most = np.maximum(o, i)
            result = result * (1.0 - color.max() * np.minimum(most, 1.0))[:, None]
            if above and np.all(sides[0]):
                fibres = charlie(wo, wi, p.sheen_roughness) * wi[:, 2] / np.maximum(most, 1.0)
                result = result + color * fibres[:, None]
    if not p.coat:
        return result
    if choices.coat == "gtr1":
        quarter = (0.25, 0.25)
        lobe = gtr1(m, 0.1 + (0.001 - 0.1) * (1.0 - p.coat_roughness)) * masking(wo, wi, quarter, "separable")
        fresnel = schlick(dot(wo, m), np.full(3, 0.04), 1.0)[:, 0]
        return result + (0.25 * p.coat * fresnel * lobe * np.abs(wi[:, 2]))[:, None]
    alpha = max(p.coat_roughness**2, 1e-4)
    if choices.coat == "appendix":
        taken = p.coat * schlick(wo[:, 2], np.full(3, 0.04), 1.0)[:, 0]
        lobe = taken * facets(wo, wi, (alpha, alpha), choices.masking)
        return result * (1.0 - taken)[:, None] + (lobe * wi[:, 2])[:, None]
    o, i = (
        side * p.coat * (0.04 * (white - grazing) + grazing)
        for side, (white, grazing) in zip(sides, (albedos.facets(w, (alpha, alpha)) for w in (wo, up)), strict=True)
    )
    result = result * (1.0 - np.maximum(o, i))[:, None]
    if above and np.all(sides[0]):
        fresnel = schlick(dot(wo, m), np.full(3, 0.04), 1.0)[:, 0]
        lobe = p.coat * fresnel * facets(wo, wi, (alpha, alpha), choices.masking)
        result = result + (lobe * wi[:, 2])[:, None]
    return result


def mitsuba_density(p: wrt.Principled, wo: Array, wi: Array) -> Array:
    """Return the density of Mitsuba's sampling for a viewer outside, without a coat: a lobe as often as its weight."""
    alpha = grain(p, MITSUBA)
    above = wi[0, 2] > 0.0
    m = unit(wo + wi) if above else -unit(wo + p.ior * wi)
    o, i = dot(wo, m), dot(wi, m)
    f = exact(o, p.ior)
    through = (1.0 - p.metallic) * p.transmission * (1.0 - f)
    mirrored, spread = 1.0 - through, (1.0 - p.metallic) * (1.0 - p.transmission)
    visible = ggx(m, alpha) * np.maximum(o, 0.0) / (wo[:, 2] * (1.0 + smith(wo, alpha)))
    if above:
        density = mirrored * visible / (4.0 * o) + spread * wi[:, 2] / np.pi
    else:
        density = np.where(
            (i < 0.0) & (m[:, 2] > 0.0), through * visible * p.ior**2 * np.abs(i) / (o + p.ior * i) ** 2, 0.0
        )
    return density / (mirrored + through + spread)


@functools.cache
def load_fits() -> ModuleType:
    """Return scripts/albedo_fits.py, whose quadratures have nothing to do with the kernels."""
    spec = importlib.util.spec_from_file_location("albedo_fits_script", ROOT / "scripts" / "albedo_fits.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
