"""Every material at the ends of its parameters: finite, nothing thrown away, no light made, no fireflies.

A ball, and a sheet seen at 89.99 degrees from its normal, under a constant sky of radiance 1 with a small lamp of
radiance 1 in it. Nothing that conserves energy is brighter than 1 there in the mean, and where samplings are good no
single sample is much brighter. What cancels where it should not shows in one or the other.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray

import wrt
from wrt.scene.materials import MATERIALS, Material

pytestmark = pytest.mark.slow

BLACK, WHITE = 0.0, 1.0
ENDS = (BLACK, WHITE)
LEAST, MOST = 1e-4, 1.0
SPP = 16
SIZE = 20


def matt() -> Iterator[Material]:
    for reflectance in ENDS:
        yield wrt.Diffuse(reflectance)
        yield wrt.Mirror(reflectance)
        for sigma in (0.0, 0.5 * math.pi):
            yield wrt.OrenNayar(reflectance, sigma)
        for side in (1e-6, 100.0):
            yield wrt.Glossy(reflectance, side)
        yield wrt.Conductor(f0=reflectance)
    yield wrt.Conductor(eta=1.0, k=0.0)
    yield wrt.Conductor(eta=1e-3, k=100.0)
    yield wrt.Emissive(1.0)


def smooth_boundaries() -> Iterator[Material]:
    """Indices the same, nearly so, common, high, and inverted; clear, and letting nothing go."""
    nothing = {"specular_reflectance": BLACK, "specular_transmittance": BLACK}
    for ior, exterior in ((1.0, 1.0), (1.0001, 1.0), (1.5, 1.0), (4.0, 1.0), (1.0, 1.5), (1.0, 4.0)):
        for make in (wrt.Dielectric, wrt.ThinDielectric):
            yield make(ior, exterior)
            yield make(ior, exterior, **nothing)
        for reflectance, nonlinear in ((BLACK, False), (WHITE, False), (WHITE, True)):
            yield wrt.Plastic(reflectance, ior, exterior, nonlinear)


def rough_metals() -> Iterator[Material]:
    for f0 in ENDS:
        for distribution in ("ggx", "beckmann"):
            for alpha in (LEAST, MOST, (LEAST, MOST), (MOST, LEAST)):
                yield wrt.RoughConductor(alpha, f0=f0, distribution=distribution)
        for alpha in (LEAST, MOST):
            yield wrt.RoughConductor(alpha, f0=f0, distribution="blinn-phong")
            yield wrt.RoughConductor(alpha, f0=f0, multiple_bounces=True)
        for shape in ((0.1, 0.0), (0.1, 100.0), (1e8, 0.0), (1e8, 1.2)):
            yield wrt.RoughConductor(shape, f0=f0, distribution="abc", masking="cook-torrance")
        for shape in ((1e-5, 0.0), (1e-5, 10.0), (10.0, 0.0), (1.0, 1.0)):
            yield wrt.RoughConductor(shape, f0=f0, distribution="sgd", masking="cook-torrance")
    yield wrt.RoughConductor(LEAST, eta=1.0, k=0.0)
    yield wrt.RoughConductor(MOST, eta=1e-3, k=100.0)


def rough_glass() -> Iterator[Material]:
    for ior, exterior in ((1.0, 1.0), (1.0011, 1.0), (1.5, 1.0), (1.0, 1.5)):
        for alpha in (LEAST, MOST):
            for distribution in ("ggx", "beckmann", "blinn-phong"):
                yield wrt.RoughDielectric(ior, exterior, alpha=alpha, distribution=distribution)
            yield wrt.RoughDielectric(ior, exterior, alpha=alpha, multiple_bounces=True)
        yield wrt.RoughDielectric(ior, exterior, alpha=(LEAST, MOST))
    yield wrt.RoughDielectric(alpha=LEAST, specular_reflectance=BLACK, specular_transmittance=BLACK)


def rough_plastic() -> Iterator[Material]:
    for ior, exterior in ((1.0, 1.0), (1.5, 1.0), (1.0, 1.5)):
        for alpha in (LEAST, MOST):
            for reflectance in ENDS:
                yield wrt.RoughPlastic(reflectance, ior, exterior, alpha=alpha)
    for alpha in (LEAST, MOST):
        yield wrt.RoughPlastic(WHITE, alpha=alpha, distribution="beckmann", nonlinear=True)
    yield wrt.RoughPlastic(WHITE, alpha=MOST, multiple_bounces=False)


def principled() -> Iterator[Material]:
    everything = {"coat": 1.0, "sheen_color": WHITE, "anisotropy": 1.0, "multiple_bounces": True}
    for color in ENDS:
        for roughness in (0.0, 1.0):
            for metallic in (0.0, 1.0):
                yield wrt.Principled(color, metallic, roughness)
                yield wrt.Principled(color, metallic, roughness, ior=1.0, coat_roughness=1.0, **everything)
            for ior in (1.0, 1.5):
                yield wrt.Principled(color, 0.0, roughness, ior=ior, transmission=1.0)
            yield wrt.Principled(color, 0.0, roughness, transmission=1.0, thin_walled=True)
            yield wrt.Principled(color, 0.0, roughness, ior=0.0, specular_color=WHITE)


def burley() -> Iterator[Material]:
    """Without `flatness`, whose published term grows without limit as both directions approach the surface."""
    everything = {
        "coat": 1.0,
        "sheen": 1.0,
        "sheen_tint": 1.0,
        "specular_tint": 1.0,
        "anisotropy": 1.0,
    }
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
    sharp, rough = wrt.RoughConductor(LEAST, f0=WHITE), wrt.RoughDielectric(alpha=LEAST)
    for weight in ENDS:
        yield wrt.Mix(sharp, wrt.Diffuse(WHITE), weight=weight)
    yield wrt.Mix(wrt.Mirror(WHITE), rough, weight=0.5)
    yield wrt.TwoSided(sharp, wrt.Mirror(WHITE, opacity=0.0))
    yield wrt.TwoSided(wrt.Diffuse(BLACK), wrt.Diffuse(WHITE))
    yield wrt.Null()
    for material in (wrt.Diffuse(WHITE), sharp, rough):
        for opacity in ENDS:
            yield dataclasses.replace(material, opacity=opacity)


GROUPS = {
    function.__name__: list(function())
    for function in (
        *(matt, smooth_boundaries, rough_metals, rough_glass, rough_plastic, principled, burley, measured),
        composites,
    )
}
"""The materials of a group are drawn by one kernel."""


def leaves(material: Material) -> Iterator[Material]:
    if not material.parts:
        yield material
    for part in material.parts:
        yield from leaves(part)


def test_every_material_is_there() -> None:
    used = {type(part) for group in GROUPS.values() for material in group for part in (material, *leaves(material))}
    assert used == set(MATERIALS.values())


def brightest(material: Material, grazing: bool) -> float:
    """Return the radiance that may be seen: 1, times n² in a body (Nicodemus 1963); the ball is seen from outside."""
    if isinstance(material, wrt.Burley):
        return 1.0 + 1.5 + 1.0  # its highlights, a white base at grazing angles, and its sheen are simply added
    if grazing and isinstance(material, (wrt.Dielectric, wrt.RoughDielectric)):
        return max(1.0, material.relative_ior**-2)
    return 1.0


def tolerance(material: Material) -> float:
    """Return by how much the mean may exceed 1 by the tables' interpolation: white surfaces are white within 1 %."""
    return 0.01 if any(part.table_key for part in leaves(material)) else 1e-4


BRIGHTEST_SAMPLE = 20.0
"""Values over densities stay below 2 for a single lobe, and below 17 where one that is seldom chosen counts much."""


class Faults(NamedTuple):
    """How much of a picture cannot be right.

    Attributes:
        thrown_away: samples that were not finite.
        negative: samples below 0 by more than rounding.
        fireflies: samples far above any good sampling's.
        pixels: those whose mean is above what energy conservation allows, by 6 standard errors.
        excess: of the whole picture's mean above that, in standard errors; 0 where there is none.
    """

    thrown_away: int
    negative: int
    fireflies: int
    pixels: int
    excess: float


def faults_of(x: NDArray[np.float64], rejected: int, limit: float, tolerance: float) -> Faults:
    """Return what is wrong with (samples, pixels, 3) radiances."""
    error = x.std(axis=0, ddof=1) / math.sqrt(len(x))
    typical = np.sqrt(np.mean(error**2, axis=0))
    above = x.mean(axis=0) - limit - tolerance
    mean_above = above.mean(axis=0)
    return Faults(
        thrown_away=rejected + int((~np.isfinite(x)).sum()),
        negative=int((x < -1e-6).sum()),
        fireflies=int((x > BRIGHTEST_SAMPLE * limit).any(axis=2).sum()),
        pixels=int((above > 6.0 * np.maximum(error, typical)).any(axis=1).sum()),
        excess=float(np.max(np.maximum(mean_above, 0.0) / np.maximum(typical / math.sqrt(x.shape[1]), 1e-9))),
    )


def scene_of(material: Material, group: list[Material], grazing: bool) -> wrt.Scene:
    """A ball; or a sheet seen from 1 m away, by rays 0.007 to 0.02 degrees above it."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    if grazing:
        height = math.tan(math.radians(0.01))
        scene.camera = wrt.PerspectiveCamera((0.0, height, 1.0), (0.0, 0.0, 0.0), fov_degrees=0.012)
        scene.add(wrt.quad((-0.5, 0.0, 0.5), (1, 0, 0), (0, 0, -1)), material=material)
        scene.add(wrt.quad((-0.05, 0.3, -0.05), (0.1, 0, 0), (0, 0, 0.1)), emission=1.0, material=wrt.Diffuse(0.0))
    else:
        scene.camera = wrt.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov_degrees=29.0)
        scene.add(wrt.sphere(subdivisions=3), material=material)
        scene.add(wrt.quad((1.2, 1.2, 0.6), (0.2, 0, 0), (0, 0, 0.2)), emission=1.0, material=wrt.Diffuse(0.0))
    # Far behind the camera a speck of each other material in the group, so that all need the same kernel.
    models = {part.model for part in leaves(material)}
    for other in (part for whole in group for part in leaves(whole)):
        if other.model not in models or other.needs_tangents:
            models.add(other.model)
            speck = wrt.quad((len(models), 0.0, 1000.0), (1e-3, 0, 0), (0, 1e-3, 0))
            scene.add(speck, material=dataclasses.replace(other, opacity=1.0 if other.opacity == 1.0 else 0.5))
    return scene


def samples(scene: wrt.Scene, device: str) -> tuple[NDArray[np.float64], int]:
    """Return (SPP, pixels, 3) radiances, and how many samples were thrown away."""
    renderer = wrt.Renderer(scene, width=SIZE, height=SIZE, device=device, seed=7, max_depth=32, filter="box")
    totals = [np.zeros((SIZE * SIZE, 3))]
    for spp in range(1, SPP + 1):
        for _ in renderer.passes(spp=spp):
            pass
        totals.append(renderer.film.state()["total"].astype(np.float64))
    return np.diff(totals, axis=0), renderer.film.rejected


@pytest.mark.parametrize("name", GROUPS)
def test_extremes(name: str, device: str, report: Report) -> None:
    wrong = {}
    largest, most, count = 0.0, 0.0, 0
    for material in GROUPS[name]:
        for grazing in (False, True):
            x, rejected = samples(scene_of(material, GROUPS[name], grazing), device)
            faults = faults_of(x, rejected, brightest(material, grazing), tolerance(material))
            count += x.shape[0] * x.shape[1]
            largest, most = max(largest, float(x.max()) / brightest(material, grazing)), max(most, faults.excess)
            if any(faults[:4]) or faults.excess > 4.0:
                wrong[f"{material}, {'grazing' if grazing else 'ball'}"] = faults
    report(f"of {count} samples the brightest; means above 1, standard errors", largest, f"{most:.2g}")
    assert not wrong, "\n".join(f"{what}: {faults}" for what, faults in wrong.items())


def test_faults_would_be_seen() -> None:
    random = np.random.default_rng(8)
    good = random.random((SPP, SIZE * SIZE, 3)) * 2.0
    assert not any(faults_of(good, 0, 1.0, 0.05))
    assert faults_of(good, 3, 1.0, 0.05).thrown_away == 3
    bright, dark = good.copy(), good.copy()
    bright[2, 7, 1] = 21.0
    dark[1, 2, 0] = -1e-3
    assert faults_of(bright, 0, 1.0, 0.05).fireflies == 1
    assert faults_of(dark, 0, 1.0, 0.05).negative == 1
    assert faults_of(good * 1.1, 0, 1.0, 0.0).excess > 4.0
    pixel = good.copy()
    pixel[:, 5] += 1.5
    assert faults_of(pixel, 0, 1.0, 0.05).pixels == 1
    # By a renderer: light that is made out of nothing, 2 % of it.
    x, rejected = samples(scene_of(wrt.Emissive(1.02), [], grazing=True), "cpu")
    found = faults_of(x, rejected, 1.0, 0.01)
    assert found.excess > 4.0
    assert found.pixels > 100
