"""Pictures have the same expectation as those of Mitsuba 3, an independent renderer.

The two are compared by `image_z_test`: every pixel, blocks of pixels, and the whole. What the scenes show is small and
lit from large lights, so that the noise of a few seconds decides over a per cent or two.
Lights of all kinds, cameras, instances and materials made of others are left to closed forms.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray

import wrt

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.covering_kernels import covering, rendering_with
from support.mitsuba_scene import render_reference
from support.small_scenes import image_of
from support.statistics import sidak

pytestmark = pytest.mark.slow

KERNELS = [
    covering("conductor", "diffuse", "mirror"),
    covering("dielectric", "diffuse"),
]


few_kernels = rendering_with(*KERNELS)


CAMERA = wrt.PerspectiveCamera(origin=(1.2, 1.6, 3.4), target=(0.0, 0.45, 0.0), fov_degrees=36.0)


def stage() -> wrt.Scene:
    """A floor and a wall."""
    scene = wrt.Scene(camera=CAMERA)
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse((0.6, 0.5, 0.4)), name="floor")
    scene.add(wrt.quad((-3, 0, -1.5), (6, 0, 0), (0, 4, 0)), material=wrt.Diffuse((0.3, 0.5, 0.7)), name="wall")
    return scene


def box(low: tuple[float, float, float], high: tuple[float, float, float], degrees: float = 25.0) -> wrt.Mesh:
    return wrt.box(low, high).rotated((0, 1, 0), degrees)


def ball(center: tuple[float, float, float], radius: float, subdivisions: int = 2) -> wrt.Mesh:
    """A ball of facets."""
    mesh = wrt.sphere(center, radius, subdivisions=subdivisions)
    return wrt.Mesh(mesh.vertices, mesh.faces, uvs=mesh.uvs, name=mesh.name)


def blocks(scene: wrt.Scene) -> wrt.Scene:
    scene.add(box((-0.7, 0.0, -0.3), (-0.2, 0.9, 0.2)), material=wrt.Diffuse((0.7, 0.2, 0.1)))
    scene.add(box((0.2, 0.0, 0.0), (0.8, 0.5, 0.6), -15.0), material=wrt.Diffuse(0.8))
    return scene


def lamp(scene: wrt.Scene, sky: Any = 0.0) -> wrt.Scene:
    """A ceiling light 1.6 m wide, its front down, under a sky of one colour."""
    scene.add(wrt.quad((-0.8, 2.5, -0.8), (1.6, 0, 0), (0, 0, 1.6)), emission=(5.0, 4.5, 4.0), name="lamp")
    scene.environment = wrt.ConstantEnvironment(sky)
    return scene


def sky() -> wrt.Scene:
    """Blocks, a mirror and a copper ball with interpolated normals under a sky, turned about a slanted axis, of random
    colours with a bright patch 60 degrees wide."""
    pixels = np.random.default_rng(12).random((8, 16, 3)).astype(np.float32)
    pixels[1:3, 5:8] = (12.0, 9.0, 6.0)
    turned = wrt.ImageEnvironment(pixels, scale=0.5, rotation_degrees=37.0, rotation_axis=(0.3, 1.0, -0.2))
    scene = wrt.Scene(camera=CAMERA, environment=turned)
    scene.add(wrt.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), material=wrt.Diffuse((0.6, 0.5, 0.4)))
    scene.add(box((0.6, 0.0, -0.8), (1.0, 1.0, -0.4)), material=wrt.Mirror((0.9, 0.85, 0.8)))
    scene.add(wrt.sphere((-0.4, 1.1, 0.4), 0.4, subdivisions=3), material=wrt.Conductor())
    return blocks(scene)


def glass() -> wrt.Scene:
    """A ball of facets, and a block with a glowing one inside: light leaves a dense medium on its way to the camera."""
    scene = lamp(stage(), sky=(0.5, 0.6, 0.7))
    scene.add(ball((0.6, 0.45, 0.6), 0.45), material=wrt.Dielectric(1.5))
    scene.add(box((-0.9, 0.1, -0.6), (0.1, 1.1, 0.4)), material=wrt.Dielectric(1.8, 1.2))
    scene.add(box((-0.6, 0.4, -0.3), (-0.2, 0.8, 0.1), 60.0), material=wrt.Diffuse(0.5), emission=(1.0, 2.0, 3.0))
    return scene


def chromatic(g: float, density: wrt.DensityGrid | None = None) -> wrt.Medium:
    return wrt.Medium(absorption=(0.3, 0.8, 2.0), scattering=(4.0, 2.0, 1.0), g=g, density=density)


def media_in_glass() -> wrt.Scene:
    """A smooth block of coloured glass, one of milk, and a rough one of something forward."""
    scene = lamp(stage(), sky=(0.5, 0.6, 0.7))
    coloured = wrt.Medium((0.5, 1.5, 4.0), 0.0)
    scene.add(box((-0.8, 0.01, -0.3), (-0.3, 0.9, 0.3)), material=wrt.Dielectric(1.5, interior=coloured))
    scene.add(box((-0.2, 0.01, 0.3), (0.2, 0.5, 0.7)), material=wrt.Dielectric(1.33, interior=chromatic(0.0)))
    forward = chromatic(0.7)
    rough = wrt.RoughDielectric(1.4, alpha=0.3, masking="smith-separable", interior=forward)
    scene.add(box((0.3, 0.01, 0.0), (0.8, 0.6, 0.6), -15.0), material=rough)
    return scene


def clouds() -> wrt.Scene:
    """Bodies without a surface under a lamp: one homogeneous, one of varying density, one of varying density and albedo
    that is turned."""
    rng = np.random.default_rng(8)
    scene = lamp(stage())
    density = rng.random((6, 5, 7)).astype(np.float32) ** 2
    tall = wrt.DensityGrid(density, (-0.8, 0.05, -0.3), (-0.2, 0.95, 0.4), factor=3.0)
    scene.add(tall.boundary, material=wrt.Null(interior=chromatic(0.6, tall)))
    place = np.eye(4)
    place[:3] = [[0.7, 0.2, 0.1, 0.2], [-0.1, 0.7, 0.0, 0.15], [-0.2, 0.1, 0.6, 0.1]]
    low = wrt.DensityGrid(density[::-1], transform=place, factor=4.0, albedo=rng.random((3, 4, 2, 3)))
    scene.add(low.boundary, material=wrt.Null(interior=chromatic(-0.3, low)))
    scene.add(ball((-0.1, 0.3, 1.0), 0.25, 1), material=wrt.Null(interior=chromatic(-0.3)))
    return scene


class Case(NamedTuple):
    """What is rendered, and how much of it."""

    scene: Callable[[], wrt.Scene]
    max_depth: int
    spp: int
    reference_spp: int
    size: tuple[int, int]


CASES = {
    "sky": Case(sky, 6, 1024, 1024, (64, 48)),
    "glass": Case(glass, 10, 512, 1024, (64, 48)),
    "cornell box": Case(lambda: wrt.load("cornell-box"), 64, 2048, 2048, (32, 32)),
    "media in glass": Case(media_in_glass, 200, 256, 512, (32, 24)),
    "clouds": Case(clouds, 200, 256, 512, (32, 24)),
}


@pytest.mark.parametrize("name", CASES)
def test_picture_agrees(name: str, device: str, report: Report) -> None:
    case = CASES[name]
    options: dict[str, Any] = {"width": case.size[0], "height": case.size[1], "max_depth": case.max_depth}
    reference = render_reference(case.scene(), spp=case.reference_spp, seed=1, **options)
    options |= {"sampler": "independent", "device": device, "seed": 1, "filter": "box"}
    result = reference.compared(wrt.Renderer(case.scene(), **options), case.spp)
    report("mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p)
    report("smallest p of 4x4 blocks; their spread", result.block_p, p=result.spread_p)
    report("share of pixels that pass", result.pass_fraction, ">= 0.995", p=result.p_min)
    assert result.agrees(significance=sidak(0.01, len(CASES))), result.message


def below_a_ball() -> wrt.Scene:
    """A floor in the light that a glass ball focuses from a spot."""
    scene = stage()
    scene.add(wrt.sphere((0.0, 1.4, 0.0), 0.5, subdivisions=4), material=wrt.Dielectric(1.5))
    cone = {"inner_degrees": 13.0, "outer_degrees": 14.0, "falloff": "linear"}
    scene.add_light(wrt.SpotLight((-0.3, 4.0, 0.2), (0.3, -2.6, -0.2), 12.0, **cone))
    return scene


def before_a_mirror() -> wrt.Scene:
    """A floor in the light of a lamp of 6 cm, and under a block of copper that reflects it."""
    scene = stage()
    block = wrt.box((-0.15, -0.5, -0.5), (0.15, 0.5, 0.5)).rotated((0, 0, 1), -20.0)
    scene.add(block.translated((-0.7, 1.25, 0.0)), material=wrt.Conductor())
    lamp = wrt.quad((-0.03, 0.0, -0.03), (0.06, 0.0, 0.0), (0.0, 0.0, 0.06)).rotated((0, 0, 1), -60.0)
    scene.add(lamp.translated((1.5, 1.5, 0.0)), material=wrt.Diffuse(0.0), emission=900.0)
    return scene


@pytest.mark.parametrize("make", [below_a_ball, before_a_mirror])
def test_caustics_are_those_of_light_traced_from_its_source(make: Callable[[], wrt.Scene], report: Report) -> None:
    """By Mitsuba's `ptracer`. Paths find the point never, and the lamp seldom."""
    scene, size, seeds = make(), 32, 8
    scene.camera = wrt.PerspectiveCamera((0.5, 0.75, 1.2), (0.0, 0.0, 0.0), fov_degrees=50.0)
    options: dict[str, Any] = {"width": size, "height": size, "max_depth": 6}
    theirs = render_reference(scene, spp=16384, integrator="ptracer", **options)
    options |= {"filter": "box", "caustics": True}
    images = np.array([image_of(wrt.Renderer(scene, seed=k, **options), 64) for k in range(seeds)], np.float64)
    direct = image_of(wrt.Renderer(scene, **{**options, "max_depth": 2}), 64)
    ours, mean = images.mean(axis=0), theirs.mean
    spread = np.hypot(
        images.mean(axis=(1, 2, 3)).std(ddof=1) / np.sqrt(seeds), np.sqrt(theirs.variance.sum()) / mean.size
    )
    blocks_apart = np.abs(_blocks(ours) - _blocks(mean)).sum() / _blocks(mean).sum()
    report("mean against Mitsuba", ours.mean() / mean.mean(), 1.0)
    report("blocks of 8x8 apart", blocks_apart, 0.0)
    assert direct.mean() < 0.95 * mean.mean()
    assert abs(ours.mean() - mean.mean()) < 3.5 * spread + 0.003 * mean.mean()
    assert blocks_apart < 0.01


def _blocks(image: NDArray[np.float64]) -> NDArray[np.float64]:
    blocks: NDArray[np.float64] = image.reshape(4, 8, 4, 8, 3).sum(axis=(1, 3))
    return blocks
