"""Every material at the ends of its parameters: finite, no light made, no fireflies; alone and in pictures."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, assert_finite, viewer
from support.kernels import uniforms

import wrt
from wrt.scene.materials import MATERIALS, Material

ENDS = (0.0, 1.0)
LEAST, MOST = 1e-4, 1.0
SPP = 16
TILE = 8
"""Pixels along a side of what the picture gives to each material."""


def matt() -> Iterator[Material]:
    for reflectance in ENDS:
        yield wrt.Diffuse(reflectance)
        yield wrt.Mirror(reflectance)
        for sigma in (0.0, 1e-4, 0.5 * math.pi):
            yield wrt.OrenNayar(reflectance, sigma)
        for side in (1e-12, 1e-4, 100.0):
            yield wrt.Glossy(reflectance, side)
        for exponent in (0.0, 1e5):
            yield wrt.Glossy(reflectance, exponent=exponent)
        yield wrt.Conductor(f0=reflectance)
    yield wrt.Conductor(eta=1.0, k=0.0)
    yield wrt.Conductor(eta=1e-3, k=100.0)


def smooth_boundaries() -> Iterator[Material]:
    """Indices the same, nearly so, common, high, and inverted; clear, and letting nothing go."""
    nothing = {"specular_reflectance": 0.0, "specular_transmittance": 0.0}
    for ior, exterior in ((1.0, 1.0), (1.0001, 1.0), (1.5, 1.0), (4.0, 1.0), (1.0, 1.5), (1.0, 4.0)):
        for make in (wrt.Dielectric, wrt.ThinDielectric):
            yield make(ior, exterior)
            yield make(ior, exterior, **nothing)
        for reflectance, nonlinear in ((0.0, False), (1.0, False), (1.0, True)):
            yield wrt.Plastic(reflectance, ior, exterior, nonlinear)


def rough_metals() -> Iterator[Material]:
    for f0 in ENDS:
        for distribution in ("ggx", "beckmann"):
            for alpha in (LEAST, MOST, (LEAST, MOST), (MOST, LEAST)):
                yield wrt.RoughConductor(alpha, f0=f0, distribution=distribution)
        for alpha in (LEAST, MOST):
            yield wrt.RoughConductor(alpha, f0=f0, distribution="blinn-phong")
            yield wrt.RoughConductor(alpha, f0=f0, multiple_bounces=True)
        for shape in ((0.1, 0.0), (0.1, 100.0), (1e8, 0.0), (1e8, 1.2), (1e8, 3.0)):
            yield wrt.RoughConductor(shape, f0=f0, distribution="abc", masking="cook-torrance")
        for shape in ((1e-5, 0.0), (1e-5, 10.0), (10.0, 0.0), (1.0, 1.0)):
            yield wrt.RoughConductor(shape, f0=f0, distribution="sgd", masking="cook-torrance")
    yield wrt.RoughConductor(MOST, f0=1.0, distribution="beckmann", multiple_bounces=True)
    yield wrt.RoughConductor(LEAST, eta=1.0, k=0.0)
    yield wrt.RoughConductor(MOST, eta=1e-3, k=100.0)


def rough_glass() -> Iterator[Material]:
    for ior, exterior in ((1.0, 1.0), (1.0011, 1.0), (1.5, 1.0), (1.0, 1.5)):
        for alpha in (LEAST, MOST):
            for distribution in ("ggx", "beckmann", "blinn-phong"):
                yield wrt.RoughDielectric(ior, exterior, alpha=alpha, distribution=distribution)
            yield wrt.RoughDielectric(ior, exterior, alpha=alpha, multiple_bounces=True)
        yield wrt.RoughDielectric(ior, exterior, alpha=(LEAST, MOST))
    yield wrt.RoughDielectric(alpha=LEAST, specular_reflectance=0.0, specular_transmittance=0.0)


def rough_plastic() -> Iterator[Material]:
    for ior, exterior in ((1.0, 1.0), (1.5, 1.0), (1.0, 1.5)):
        for alpha in (LEAST, MOST):
            for reflectance in ENDS:
                yield wrt.RoughPlastic(reflectance, ior, exterior, alpha=alpha)
    for alpha in (LEAST, MOST):
        yield wrt.RoughPlastic(1.0, alpha=alpha, distribution="beckmann", nonlinear=True)
    yield wrt.RoughPlastic(1.0, alpha=LEAST, nonlinear=True, multiple_bounces=True)


def principled() -> Iterator[Material]:
    everything = {"coat": 1.0, "sheen_color": 1.0, "anisotropy": 1.0, "multiple_bounces": True}
    for color in ENDS:
        for roughness in (0.0, 1.0):
            for metallic in (0.0, 1.0):
                yield wrt.Principled(color, metallic, roughness)
                yield wrt.Principled(color, metallic, roughness, ior=1.0, coat_roughness=1.0, **everything)
            for ior in (1.0, 1.5):
                yield wrt.Principled(color, 0.0, roughness, ior=ior, transmission=1.0)
            yield wrt.Principled(color, 0.0, roughness, transmission=1.0, thin_walled=True)
            yield wrt.Principled(color, 0.0, roughness, ior=0.0, specular_color=1.0)
    yield wrt.Principled(1.0, sheen_color=1.0, sheen_roughness=1.0)


def burley() -> Iterator[Material]:
    """Without `flatness`, whose published term grows without limit as both directions approach the surface."""
    everything = {"coat": 1.0, "sheen": 1.0, "sheen_tint": 1.0, "specular_tint": 1.0, "anisotropy": 1.0}
    for color in ENDS:
        for roughness in (0.0, 1.0):
            for metallic in (0.0, 1.0):
                yield wrt.Burley(color, metallic, roughness)
                yield wrt.Burley(color, metallic, roughness, ior=1.0, coat_gloss=1.0, **everything)
            for ior in (1.0, 1.5):
                yield wrt.Burley(color, 0.0, roughness, ior=ior, transmission=1.0)
            yield wrt.Burley(color, 0.0, roughness, transmission=0.5, diffuse_transmission=1.0, thin_walled=True)


def measured() -> Iterator[Material]:
    """Facets that face all ways alike; black, with visible normals at one node alone and brightness at another."""
    yield wrt.Measured.example()
    tables = wrt.Measured.example().measurement
    vndf, luminance = np.zeros((1, 2, 6, 6)), np.zeros((1, 2, 2, 2))
    vndf[:, :, 3, 4], luminance[..., 1, 0] = 1.0, 1.0
    black = dataclasses.replace(tables, vndf=vndf, luminance=luminance, rgb=np.zeros_like(tables.rgb))
    yield wrt.Measured(black)
    yield wrt.Measured(dataclasses.replace(black, ndf=np.zeros_like(tables.ndf), sigma=np.zeros_like(tables.sigma)))


def composites() -> Iterator[Material]:
    """These choose among others when a ray meets them, so they are in pictures alone."""
    sharp, rough = wrt.RoughConductor(LEAST, f0=1.0), wrt.RoughDielectric(alpha=LEAST)
    for weight in ENDS:
        yield wrt.Mix(sharp, wrt.Diffuse(1.0), weight=weight)
    yield wrt.Mix(wrt.Mirror(1.0), rough, weight=0.5)
    yield wrt.TwoSided(sharp, wrt.Mirror(1.0, opacity=0.0))
    yield wrt.TwoSided(wrt.Diffuse(0.0), wrt.Diffuse(1.0))
    yield wrt.Null()
    yield wrt.Emissive(1.0)
    for material in (wrt.Diffuse(1.0), sharp, rough):
        for opacity in ENDS:
            yield dataclasses.replace(material, opacity=opacity)


MODELS = {
    function.__name__: list(function())
    for function in (
        *(matt, smooth_boundaries, rough_metals, rough_glass, rough_plastic, principled, burley),
        measured,
    )
}
ALL = [material for group in MODELS.values() for material in group] + list(composites())


def leaves(material: Material) -> Iterator[Material]:
    if not material.parts:
        yield material
    for part in material.parts:
        yield from leaves(part)


def test_every_material_is_there() -> None:
    assert {type(part) for material in ALL for part in (material, *leaves(material))} == set(MATERIALS.values())


def brightest(material: Material, *, inverted: bool) -> float:
    """Return the radiance that may be seen: 1, times n² in a body (Nicodemus 1963)."""
    if isinstance(material, wrt.Burley):
        return 1.0 + 1.5 + 1.0  # its highlights, a white base at grazing angles, and its sheen are simply added
    if inverted and isinstance(material, (wrt.Dielectric, wrt.RoughDielectric)):
        return max(1.0, material.relative_ior**-2)
    return 1.0


def tolerance(material: Material) -> float:
    """Return by how much the mean may exceed 1: tables interpolate, half vectors lose digits near the horizon."""
    return 0.01 if any(part.table_key for part in leaves(material)) else 3e-3


BRIGHTEST_SAMPLE = 20.0
"""Values over densities stay below 2 for a single lobe, and below 17 where one that is seldom chosen counts much."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "matt" else pytest.mark.slow) for name in MODELS]
)
def test_models_at_their_extremes(name: str, device: str, report: Report) -> None:
    """Energy is what is left of the weight's mean over η²; single weights are as large as good samplings have them."""
    largest = 0.0
    for material in MODELS[name]:
        body = isinstance(material, (wrt.Dielectric, wrt.RoughDielectric)) or getattr(material, "transmission", 0.0)
        for front in (True, False) if body else (True,):
            case = Case(material, front)
            assert_finite(case, device, n=4_000)
            limit = brightest(material, inverted=False)
            for degrees in (30.0, 85.0, 89.9):
                found = case.sample(viewer(degrees), uniforms(2**12, 3, seed=7), device)
                energy = found["weight"].astype(np.float64).max(axis=1) * found["eta"].astype(np.float64) ** 2
                largest = max(largest, float(energy.max()) / limit)
                error = 5.0 * energy.std() / math.sqrt(len(energy))
                assert energy.mean() <= limit + tolerance(material) + error, f"{case} at {degrees}°"
                assert energy.max() < BRIGHTEST_SAMPLE * limit, f"{case} at {degrees}°"
    report("the largest weight", largest, f"< {BRIGHTEST_SAMPLE}")


# --- Pictures ---------------------------------------------------------------------------------------

LIGHT_MADE = wrt.Emissive(1.02)
"""A planted fault, the last of the materials."""
SHOWN = [*ALL, LIGHT_MADE]
COLUMNS = 15


def balls() -> wrt.Scene:
    """A ball of each material under a sky of radiance 1, and a small lamp of the same radiance in front."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    rows = math.ceil(len(SHOWN) / COLUMNS)
    scene.camera = wrt.OrthographicCamera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), view_height=float(rows))
    for number, material in enumerate(SHOWN):
        y, x = divmod(number, COLUMNS)
        ball = wrt.sphere(radius=0.45, subdivisions=2).translated((x + 0.5 - COLUMNS / 2, rows / 2 - y - 0.5, 0.0))
        # What may be brighter than the sky would light others: Burley's materials are far away here.
        away = 1000.0 if isinstance(material, wrt.Burley) else 0.0
        scene.add(ball.translated((0.0, 0.0, away)), material=material)
    scene.add(wrt.quad((-1, 10, 1), (2, 0, 0), (0, 0, 2)), emission=1.0, material=wrt.Diffuse(0.0))
    return scene


def strips() -> wrt.Scene:
    """A strip of each material seen at 89.99° from its normal, with a lamp above them all."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    rise, width = math.radians(0.01), 1.0 / len(SHOWN)
    height = width / COLUMNS * TILE  # as many pixels as there are
    scene.camera = wrt.OrthographicCamera((0.0, 20.0 * rise, 20.0), (0.0, 0.0, 0.0), view_height=height)
    depth = 2.0 * height / rise
    for number, material in enumerate(SHOWN):
        strip = wrt.quad((number * width - 0.5, 0.0, depth), (width, 0, 0), (0, 0, -2.0 * depth))
        scene.add(strip, material=material)
    scene.add(wrt.quad((-0.2, 0.3, -0.2), (0.4, 0, 0), (0, 0, 0.4)), emission=1.0, material=wrt.Diffuse(0.0))
    return scene


def samples(scene: wrt.Scene, width: int, height: int, device: str) -> NDArray[np.float64]:
    """Return (SPP, height, width, 3) radiances; none was thrown away."""
    renderer = wrt.Renderer(
        scene, width=width, height=height, sampler="independent", device=device, seed=7, max_depth=32, filter="box"
    )
    totals = [np.zeros((height, width, 3))]
    for spp in range(1, SPP + 1):
        for _ in renderer.passes(spp=spp):
            pass
        totals.append(renderer.film.state()["total"].astype(np.float64).reshape(height, width, 3))
    assert renderer.film.rejected == 0
    return np.diff(totals, axis=0)


def check_tile(x: NDArray[np.float64], material: Material, limit: float) -> list[str]:
    """Return what is wrong with (samples, channels) radiances of one material."""
    error = x.std(axis=0, ddof=1) / math.sqrt(len(x))
    checks = {
        "infinite": np.isfinite(x).all(),
        "negative": (x >= -1e-6).all(),
        "firefly": (x <= BRIGHTEST_SAMPLE * limit).all(),
        "light made": (x.mean(axis=0) <= limit + tolerance(material) + 5.0 * error).all(),
    }
    return [f"{material}: {fault}" for fault, fine in checks.items() if not fine]


@functools.cache
def pictures(device: str) -> tuple[list[NDArray], list[NDArray]]:
    """Return (samples, 3) radiances of each material as a ball and as a strip."""
    rows = math.ceil(len(SHOWN) / COLUMNS)
    seen = samples(balls(), COLUMNS * TILE, rows * TILE, device)
    tiles = seen.reshape(SPP, rows, TILE, COLUMNS, TILE, 3).transpose(1, 3, 0, 2, 4, 5).reshape(-1, SPP * TILE**2, 3)
    flat = samples(strips(), len(SHOWN) * COLUMNS, TILE, device).reshape(SPP, TILE, len(SHOWN), COLUMNS, 3)
    return list(tiles), list(flat.transpose(2, 0, 1, 3, 4).reshape(len(SHOWN), -1, 3))


@pytest.mark.slow
@pytest.mark.parametrize("grazing", [False, True])
def test_pictures_of_the_extremes(grazing: bool, device: str, report: Report) -> None:
    shown = pictures(device)[grazing]
    wrong, largest = [], 0.0
    for x, material in zip(shown, SHOWN, strict=False):
        limit = brightest(material, inverted=grazing)
        largest = max(largest, float(x.max()) / limit)
        found = check_tile(x, material, limit)
        if material is LIGHT_MADE:
            assert found, "light that is made out of nothing is not noticed"
        else:
            wrong += found
    report(f"of {sum(map(len, shown))} samples the brightest", largest)
    assert not wrong, "\n".join(wrong)
