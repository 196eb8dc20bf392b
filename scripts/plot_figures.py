"""The figures of scripts/plots.py: curves of the renderer's device functions, run over arrays."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from support.bsdfs import Case  # noqa: E402
from support.kernels import map_function  # noqa: E402

import wrt  # noqa: E402
from wrt.kernels.bsdf.lobes.fresnel import (  # noqa: E402
    cos_transmitted_squared,
    fresnel_conductor,
    fresnel_dielectric,
    fresnel_schlick,
)
from wrt.kernels.microfacet import make_microfacet, maskings_of  # noqa: E402
from wrt.scene.materials.microfacet import sgd_normalization  # noqa: E402
from wrt.scene.materials.presets import metal_ior  # noqa: E402

Array = NDArray[np.float64]

GLASS = 1.5
COLORS = ("#1f6fb4", "#d1495b", "#2e8b57", "#b8860b", "#6a4c93", "#444444")
CHANNELS = {"red": "#c8102e", "green": "#1a9641", "blue": "#2166ac"}


class Curve(NamedTuple):
    """A line: (N,) x in degrees, (N,) y, and its style. Without a label it is not in the legend."""

    x: Array
    y: Array
    label: str = ""
    color: str = COLORS[0]
    style: str = "-"


class Panel(NamedTuple):
    """Curves in one pair of axes; in polar plots a line marks the angle of the viewer, in degrees."""

    title: str
    curves: list[Curve]
    viewer: float | None = None


class Figure(NamedTuple):
    """One picture.

    Attributes:
        panels: in rows of `columns`.
        y_label: what all curves' values are.
        x_label: what their angles are; none in polar plots.
        columns: panels in a row.
        kind: "linear", "log"; or polar, with the normal upwards: "half" above the surface, "round" on both sides.
        limits: of y, where they are set.
    """

    panels: list[Panel]
    y_label: str
    x_label: str = "angle from the normal, degrees"
    columns: int = 3
    kind: str = "linear"
    limits: tuple[float, float] | None = None


def call(function: wp.Function, count: int, *inputs: ArrayLike) -> Array:
    """Return `count` values of a device function, whose inputs are arrays or the same number or vector for all.

    Warp takes two functions of one name for the same here: names must differ.
    """
    widths = [() if kind is float else (3,) for kind in function.input_types.values()]
    arrays = [np.broadcast_to(np.asarray(a, np.float32), (count, *w)) for a, w in zip(inputs, widths, strict=True)]
    return map_function(function, *arrays, device="cpu").astype(np.float64)


def directions(degrees: ArrayLike) -> Array:
    """Return unit vectors in the plane of incidence at signed angles from the normal, z."""
    theta = np.radians(np.atleast_1d(np.asarray(degrees, np.float64)))
    return np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=1)


@functools.cache
def distribution_of(name: str) -> wp.Function:
    """Return D(m, shape) of a distribution, under a name that no other has."""
    d = make_microfacet(name, "implicit").d

    @wp.func(name=f"plotted_{name}".replace("-", "_"))
    def distribution(m: wp.vec3, shape: wp.vec3) -> float:
        return d(m, shape)

    return distribution


def albedo(material: wrt.Material, degrees: Array, *, samples: int = 2**14) -> Array:
    """Return the (N,) albedo for light from N angles, the mean of the channels, by sampling.

    On refraction radiance is squeezed into another solid angle; that is taken out, so that energy remains.
    """
    # The additive recurrence of Roberts (2018) in three dimensions: smoother than random numbers.
    step = 1.2207440846057596 ** -np.arange(1.0, 4.0)
    u = np.minimum((0.5 + np.arange(samples)[:, None] * step) % 1.0, 1.0 - 2.0**-24)
    albedos = []
    for wo in directions(degrees):
        found = Case(material).sample(wo, u, "cpu")
        energy = found["weight"].astype(np.float64).mean(axis=1) * found["eta"].astype(np.float64) ** 2
        albedos.append(energy.mean())
    return np.array(albedos)


# --- Fresnel ---------------------------------------------------------------------------------------

INCIDENCE = np.linspace(0.0, 90.0, 361)


def fresnel_of_glass() -> Figure:
    """Return the reflectance of a boundary of glass for light from either side."""
    cos_i, count = np.cos(np.radians(INCIDENCE)), len(INCIDENCE)
    f0 = ((GLASS - 1.0) / (GLASS + 1.0)) ** 2
    cos_out = np.sqrt(np.maximum(call(cos_transmitted_squared, count, cos_i, 1.0 / GLASS), 0.0))
    panels = []
    for title, eta, cosine in (("from air", GLASS, cos_i), ("from glass", 1.0 / GLASS, cos_out)):
        exact = call(fresnel_dielectric, count, cos_i, eta)
        schlick = call(fresnel_schlick, count, cosine, [f0] * 3)[:, 0]
        curves = [Curve(INCIDENCE, exact, "exact"), Curve(INCIDENCE, schlick, "Schlick", COLORS[1], "--")]
        panels.append(Panel(f"{title}, n = 1.5", curves))
    return Figure(panels, "reflectance", "angle of incidence, degrees", columns=2, limits=(0.0, 1.02))


def fresnel_of_metals() -> Figure:
    """Return the reflectance of three metals per channel, and Schlick's approximation from normal incidence."""
    cos_i = np.cos(np.radians(INCIDENCE))
    panels = []
    for metal in ("gold", "copper", "aluminium"):
        exact = call(fresnel_conductor, len(cos_i), cos_i, *metal_ior(metal))
        schlick = call(fresnel_schlick, len(cos_i), cos_i, exact[0])
        curves = [Curve(INCIDENCE, exact[:, k], name, CHANNELS[name]) for k, name in enumerate(CHANNELS)]
        for k, (name, color) in enumerate(CHANNELS.items()):
            curves.append(Curve(INCIDENCE, schlick[:, k], "Schlick" if name == "blue" else "", color, "--"))
        panels.append(Panel(metal, curves))
    return Figure(panels, "reflectance", "angle of incidence, degrees", limits=(0.3, 1.02))


# --- Microfacets -----------------------------------------------------------------------------------

SHAPES: dict[str, list[tuple[str, tuple[float, float, float]]]] = {
    name: [(f"α {alpha:g}", (alpha, alpha, 0.0)) for alpha in (0.1, 0.3, 0.6, 1.0)]
    for name in ("ggx", "beckmann", "blinn-phong")
}
SHAPES["abc"] = [(f"B {b:g}, C {c:g}", (b, c, 0.0)) for b, c in ((200.0, 2.0), (200.0, 1.0), (10.0, 2.0), (10.0, 1.0))]
SHAPES["sgd"] = [
    (f"α {a:g}, p {p:g}", (a, p, sgd_normalization(a, p)))
    for a, p in ((0.01, 0.0), (0.01, 0.8), (0.1, 0.0), (0.1, 0.8))
]
"""Parameters that each distribution is drawn for."""


def distributions() -> Figure:
    """Return each distribution of normals for several roughnesses, and three of them together."""
    degrees = np.linspace(0.0, 89.5, 359)
    m = directions(degrees)
    panels = []
    for name, shapes in SHAPES.items():
        d = distribution_of(name)
        values = [(label, call(d, len(m), m, shape)) for label, shape in shapes]
        panels.append(Panel(name, [Curve(degrees, y, label, COLORS[i]) for i, (label, y) in enumerate(values)]))
    names = ("ggx", "beckmann", "blinn-phong")
    values = [(name, call(distribution_of(name), len(m), m, (0.3, 0.3, 0.0))) for name in names]
    panels.append(Panel("at α 0.3", [Curve(degrees, y, name, COLORS[i]) for i, (name, y) in enumerate(values)]))
    return Figure(panels, "D, 1/sr", "angle of the facet's normal, degrees", kind="log", limits=(1e-4, 1e2))


def maskings() -> Figure:
    """Return each masking on Beckmann's distribution, the viewer at 75 degrees and the light anywhere."""
    viewer = -75.0
    degrees = np.linspace(-89.5, 89.5, 359)
    wi = directions(degrees)
    wo = directions(viewer)[0]
    m = wi + wo
    m /= np.linalg.norm(m, axis=1, keepdims=True)
    panels = []
    for alpha in (0.1, 0.4, 1.0):
        curves = []
        for i, name in enumerate(maskings_of("beckmann")):
            g = make_microfacet("beckmann", name).g
            style = "--" if name == "walter" else "-"
            values = call(g, len(m), wo, wi, m, (alpha, alpha, 0.0))
            curves.append(Curve(degrees, values, name, COLORS[i], style))
        panels.append(Panel(f"α {alpha:g}, viewer at −75 degrees", curves))
    return Figure(panels, "G", "angle of the light, degrees", limits=(0.0, 1.02))


# --- Reflection models -----------------------------------------------------------------------------


def _lobes(
    title: str,
    materials: Sequence[tuple[str, wrt.Material]],
    viewer: float,
    *,
    around: bool = False,
    front: bool = True,
    scaled: bool = False,
    power: float = 1.0,
) -> Panel:
    """Return (f |cosθ|)^power of materials, on both sides if `around`, with a maximum of 1 if `scaled`."""
    degrees = np.linspace(-180.0, 180.0, 1441) if around else np.linspace(-90.0, 90.0, 721)
    curves = []
    for i, (label, material) in enumerate(materials):
        f = Case(material, front).evaluate(directions(-viewer), directions(degrees), "cpu")[0].mean(axis=1)
        curves.append(Curve(degrees, (f / f.max() if scaled else f) ** power, label, COLORS[i]))
    return Panel(title, curves, -viewer)


def lobes() -> Figure:
    """Return the lobes of opaque surfaces in the plane of incidence, for a fixed viewer."""
    metal = [(f"α {a:g}", wrt.RoughConductor(a, metal="gold")) for a in (0.1, 0.3, 0.6, 1.0)]
    clay = [("Lambert", wrt.Diffuse(0.8))] + [(f"σ {s:g}", wrt.OrenNayar(0.8, sigma=s)) for s in (0.35, 0.8)]
    fibres = [
        (f"roughness {r:g}", wrt.Principled(base_color=0.0, specular=0.0, sheen_color=1.0, sheen_roughness=r))
        for r in (0.2, 0.4, 0.8)
    ]
    paint = [
        (f"coat {coat:g}", wrt.Principled(base_color=0.5, roughness=0.9, coat=coat, coat_roughness=0.4))
        for coat in (0.0, 0.5, 1.0)
    ]
    panels = [
        _lobes("rough gold, each scaled to its maximum", metal, 45.0, scaled=True),
        _lobes("Lambert and Oren-Nayar", clay, 60.0),
        _lobes("sheen", fibres, 60.0),
        _lobes("a coat of roughness 0.4 on rough paint", paint, 45.0),
    ]
    return Figure(panels, "f cosθ, 1/sr", "", columns=2, kind="half")


def lobes_of_glass() -> Figure:
    """Return the same for rough glass, seen from either side."""
    glass = [(f"α {a:g}", wrt.RoughDielectric(alpha=a)) for a in (0.1, 0.3, 0.6)]
    # The square root: reflection is weak beside refraction.
    panels = [
        _lobes(title, glass, viewer, around=True, front=front, scaled=True, power=0.5)
        for title, viewer, front in (
            ("viewer in air", 45.0, True),
            ("viewer in glass", 30.0, False),
            ("viewer in glass, beyond the critical angle", 60.0, False),
        )
    ]
    return Figure(panels, "√(f |cosθ|), each scaled to its maximum", "", kind="round")


@functools.cache
def albedos() -> Figure:
    """Return the albedo of rough surfaces without absorption, with single and multiple bounces."""
    degrees = np.linspace(0.0, 89.0, 46)
    makers: dict[str, Callable[[float, bool], wrt.Material]] = {
        "white metal": lambda a, several: wrt.RoughConductor(a, f0=1.0, multiple_bounces=several),
        "glass, both sides together": lambda a, several: wrt.RoughDielectric(alpha=a, multiple_bounces=several),
        "white plastic": lambda a, several: wrt.RoughPlastic(1.0, alpha=a, nonlinear=True, multiple_bounces=several),
    }
    panels = []
    for title, maker in makers.items():
        curves = []
        for i, alpha in enumerate((0.1, 0.3, 0.6, 1.0)):
            curves.append(Curve(degrees, albedo(maker(alpha, False), degrees), f"α {alpha:g}", COLORS[i]))
            label = "multiple_bounces" if i == 3 else ""
            curves.append(Curve(degrees, albedo(maker(alpha, True), degrees), label, COLORS[i], "--"))
        panels.append(Panel(title, curves))
    return Figure(panels, "share of the light that goes on", "angle of incidence, degrees", limits=(0.0, 1.03))


FIGURES: dict[str, Callable[[], Figure]] = {
    "fresnel-glass": fresnel_of_glass,
    "fresnel-metals": fresnel_of_metals,
    "distributions": distributions,
    "maskings": maskings,
    "lobes": lobes,
    "lobes-of-glass": lobes_of_glass,
    "albedos": albedos,
}
"""Figures by the names of their pictures."""
