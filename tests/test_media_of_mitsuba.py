"""Pictures with media have the same expectation as those of Mitsuba 3, an independent renderer."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
import pytest
from conftest import Report

import wrt

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.mitsuba_scene import Reference, render_reference
from support.statistics import ImageTest, image_z_test, sidak
from test_against_mitsuba import box, flat, lamp, stage

pytestmark = pytest.mark.slow

SIZE = (32, 24)
DEPTH = 200
SPP = 256
REFERENCE_SPP = 512

CHROMATIC = wrt.Medium(absorption=(0.3, 0.8, 2.0), scattering=(4.0, 2.0, 1.0))
ABSORBING = wrt.Medium((0.5, 1.5, 4.0))


def with_sky(scene: wrt.Scene) -> wrt.Scene:
    scene.environment = wrt.ConstantEnvironment((0.5, 0.6, 0.7))
    return scene


def absorbing_glass() -> wrt.Scene:
    """A smooth block and a rough one, both of coloured glass."""
    scene = with_sky(lamp(stage()))
    scene.add(box((-0.8, 0.01, -0.3), (-0.1, 0.9, 0.3)), material=wrt.Dielectric(1.5, interior=ABSORBING))
    rough = wrt.RoughDielectric(1.4, alpha=0.2, masking="smith-separable", interior=ABSORBING)
    scene.add(box((0.2, 0.01, 0.0), (0.8, 0.6, 0.6), -15.0), material=rough)
    return scene


def scattering_in_glass() -> wrt.Scene:
    """Milk and something forward in blocks that refract."""
    scene = with_sky(lamp(stage()))
    scene.add(box((-0.8, 0.01, -0.3), (-0.1, 0.9, 0.3)), material=wrt.Dielectric(1.33, interior=CHROMATIC))
    forward = dataclasses.replace(CHROMATIC, g=0.7)
    rough = wrt.RoughDielectric(1.4, alpha=0.3, masking="smith-separable", interior=forward)
    scene.add(box((0.2, 0.01, 0.0), (0.8, 0.6, 0.6), -15.0), material=rough)
    return scene


def clouds() -> wrt.Scene:
    """Two bodies without a surface, one of which throws its shadow on the other, before a wall."""
    scene = lamp(stage())
    scene.add(
        box((-0.7, 0.1, -0.3), (0.0, 0.9, 0.4)), material=wrt.Null(interior=dataclasses.replace(CHROMATIC, g=0.6))
    )
    ball = flat(wrt.sphere((0.5, 0.5, 0.4), 0.4, subdivisions=1))
    scene.add(ball, material=wrt.Null(interior=dataclasses.replace(CHROMATIC, g=-0.3)))
    return scene


def clouds_on_grids() -> wrt.Scene:
    """Two media of varying density, one with an albedo that varies too and in a box that is turned, under a lamp."""
    rng = np.random.default_rng(8)
    scene = lamp(stage())
    density = rng.random((6, 5, 7)).astype(np.float32) ** 2
    tall = wrt.DensityGrid(density, (-0.8, 0.05, -0.3), (0.0, 0.95, 0.4), factor=3.0)
    scene.add(tall.boundary, material=wrt.Null(interior=dataclasses.replace(CHROMATIC, g=0.6, density=tall)))
    place = np.eye(4)
    place[:3] = [[0.7, 0.2, 0.1, 0.2], [-0.1, 0.7, 0.0, 0.15], [-0.2, 0.1, 0.6, 0.1]]
    low = wrt.DensityGrid(density[::-1], transform=place, factor=4.0, albedo=rng.random((3, 4, 2, 3)))
    scene.add(low.boundary, material=wrt.Null(interior=dataclasses.replace(CHROMATIC, g=-0.3, density=low)))
    return scene


def fog() -> wrt.Scene:
    """Fog everywhere, but in a block of glass."""
    scene = lamp(stage())
    scene.medium = wrt.Medium(absorption=(0.02, 0.05, 0.1), scattering=(0.2, 0.15, 0.1), g=0.3)
    scene.add(box((-0.8, 0.01, -0.3), (-0.1, 0.9, 0.3)), material=wrt.Diffuse((0.7, 0.2, 0.1)))
    scene.add(box((0.2, 0.01, 0.0), (0.8, 0.6, 0.6), -15.0), material=wrt.Dielectric(1.5))
    return scene


def coloured_panes() -> wrt.Scene:
    """A coloured pane under the lamp, another before the camera."""
    scene = with_sky(lamp(stage()))
    green = wrt.ThinDielectric(1.5, specular_transmittance=(0.2, 0.8, 0.3))
    red = wrt.ThinDielectric(1.6, specular_transmittance=(0.9, 0.3, 0.2))
    scene.add(wrt.quad((-1.5, 1.4, -1.2), (1.5, 0, 0), (0, 0, 2.5)), material=green)
    scene.add(wrt.quad((0.2, 0.1, 1.0), (0.9, 0, 0.2), (0, 0.9, 0)), material=red)
    scene.add(box((-0.5, 0.0, -0.3), (0.3, 0.7, 0.3)), material=wrt.Diffuse(0.6))
    return scene


def denser(scene: wrt.Scene) -> wrt.Scene:
    """Return a scene whose media are a little denser, or whose panes are a little darker."""

    def more(medium: wrt.Medium) -> wrt.Medium:
        scattering = tuple(1.1 * x for x in medium.scattering)  # type: ignore[union-attr]
        return dataclasses.replace(medium, absorption=tuple(1.1 * x for x in medium.absorption), scattering=scattering)

    def changed(material: wrt.Material) -> wrt.Material:
        if getattr(material, "interior", None) is not None:
            return dataclasses.replace(material, interior=more(material.interior))  # type: ignore[attr-defined]
        if isinstance(material, wrt.ThinDielectric):
            tint = tuple(0.95 * x for x in material.specular_transmittance)  # type: ignore[union-attr]
            return dataclasses.replace(material, specular_transmittance=tint)
        return material

    shapes = [dataclasses.replace(shape, material=changed(shape.material)) for shape in scene.shapes]
    return dataclasses.replace(scene, shapes=shapes, medium=scene.medium and more(scene.medium))


CASES: dict[str, Callable[[], wrt.Scene]] = {
    f.__name__: f for f in (absorbing_glass, scattering_in_glass, clouds, clouds_on_grids, fog, coloured_panes)
}
SIGNIFICANCE = sidak(0.01, len(CASES))


@functools.cache
def reference(name: str) -> Reference:
    width, height = SIZE
    return render_reference(
        CASES[name](), width=width, height=height, max_depth=DEPTH, spp=REFERENCE_SPP, runs=16, seed=3
    )


def compare(scene: wrt.Scene, name: str, device: str) -> ImageTest:
    width, height = SIZE
    renderer = wrt.Renderer(
        scene,
        width=width,
        height=height,
        device=device,
        seed=2,
        max_depth=DEPTH,
        filter="box",
        sampler="independent",
    )
    for _ in renderer.passes(spp=SPP):
        pass
    expected = reference(name)
    return image_z_test(
        renderer.image(), renderer.variance(), expected.mean, expected.variance, n_a=renderer.spp, n_b=expected.runs
    )


@pytest.mark.parametrize("name", CASES)
def test_picture_agrees(name: str, device: str, report: Report) -> None:
    result = compare(CASES[name](), name, device)
    report("mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p)
    report("smallest p of 4x4 blocks; their spread", result.block_p, p=result.spread_p)
    report("share of pixels that pass", result.pass_fraction, ">= 0.995", p=result.p_min)
    assert result.agrees(significance=SIGNIFICANCE), result.message


@pytest.mark.parametrize("name", CASES)
def test_denser_media_would_be_seen(name: str, report: Report) -> None:
    result = compare(denser(CASES[name]()), name, "cpu")
    report("p", min(result.mean_p, result.spread_p, result.block_p))
    assert not result.agrees(significance=SIGNIFICANCE), result.message
