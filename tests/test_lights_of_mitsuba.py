"""Lights that are exact shapes, spots, textures that shine and turned skies, against pictures of Mitsuba 3."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from conftest import Report

import wrt

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.mitsuba_scene import render_reference
from support.statistics import ImageTest, image_z_test, sidak
from test_against_mitsuba import blocks, sky, stage

pytestmark = pytest.mark.slow

SIZE = (48, 36)


def shapes(scale: float = 1.0) -> wrt.Scene:
    """A ball, a leaning disk and a rectangle among blocks; all are seen, and block one another."""
    scene = blocks(stage())
    scene.add_light(wrt.SphereLight((-1.0, 0.5, 0.5), 0.3 * scale, radiance=(6.0, 4.0, 2.0)))
    scene.add_light(wrt.DiskLight((0.3, 1.5, -0.8), (0.2, -0.6, 1.0), 0.4, radiance=(2.0, 5.0, 4.0)))
    scene.add_light(wrt.RectangleLight((1.1, 0.2, -0.6), (-0.3, 0.0, 0.8), (0.0, 0.9, 0.0), radiance=(3.0, 3.0, 6.0)))
    return scene


def spots(outer: float = 35.0) -> wrt.Scene:
    scene = blocks(stage())
    aim = {"inner_degrees": 12.0, "falloff": "linear"}
    scene.add_light(wrt.SpotLight((1.0, 2.5, 2.0), (-0.8, -2.2, -1.8), (9, 6, 3), outer_degrees=outer, **aim))
    scene.add_light(wrt.SpotLight((-1.2, 1.8, 0.8), (0.6, -1.2, -0.9), power=(3, 6, 12), outer_degrees=25.0, **aim))
    return scene


def screens(flipped: bool = False) -> wrt.Scene:
    """A coarse picture that shines, on the wall and seen."""
    scene = blocks(stage())
    pixels = np.random.default_rng(31).random((3, 4, 3)).astype(np.float32) ** 2
    texture = wrt.ImageTexture(pixels[:, ::-1] if flipped else pixels, factor=(9.0, 8.0, 7.0))
    scene.add(wrt.quad((-0.9, 0.9, -1.2), (1.6, 0, 0), (0, 1.0, 0.3)), material=wrt.Diffuse(0.0), emission=texture)
    return scene


def turned_sky(degrees: float = 70.0) -> wrt.Scene:
    scene = blocks(stage())
    scene.environment = dataclasses.replace(sky(degrees), rotation_axis=(1.0, 2.0, -1.0))
    return scene


def slides(flipped: bool = False) -> wrt.Scene:
    """A projector, one without an image, and a spot behind an image."""
    scene = blocks(stage())
    pixels = np.random.default_rng(32).random((3, 5, 3)).astype(np.float32) ** 2
    texture = wrt.ImageTexture(pixels[:, ::-1] if flipped else pixels)
    aim = {"texture": texture, "up": (0.2, 1.0, 0.1)}
    scene.add_light(wrt.ProjectorLight((0.6, 1.9, 2.2), (-0.5, -1.2, -2.4), irradiance=(30, 40, 20), **aim))
    scene.add_light(wrt.ProjectorLight((-1.5, 1.0, 1.0), (1.2, -0.4, -0.9), irradiance=2.0, fov_degrees=50.0))
    cone = {"inner_degrees": 12.0, "outer_degrees": 30.0, "falloff": "linear"}
    scene.add_light(wrt.SpotLight((1.0, 2.5, 2.0), (-0.8, -2.2, -1.8), intensity=(9, 6, 12), **aim, **cone))
    return scene


CASES: dict[str, tuple[Callable[..., wrt.Scene], object, int]] = {
    "shapes": (shapes, 1.03, 512),
    "spots": (spots, 36.0, 256),
    "slides": (slides, True, 256),
    "screens": (screens, True, 512),
    "turned sky": (turned_sky, 75.0, 1024),
}
SIGNIFICANCE = sidak(0.01, len(CASES))


@pytest.mark.parametrize("name", CASES)
def test_picture_agrees_and_a_mistake_is_seen(name: str, device: str, report: Report) -> None:
    build, mistake, spp = CASES[name]
    width, height = SIZE
    expected = render_reference(build(), width=width, height=height, max_depth=4, spp=2 * spp, seed=3)

    def compare(scene: wrt.Scene) -> ImageTest:
        renderer = wrt.Renderer(
            scene,
            width=width,
            height=height,
            device=device,
            seed=4,
            max_depth=4,
            filter="box",
            sampler="independent",
        )
        for _ in renderer.passes(spp=spp):
            pass
        mean, variance = renderer.image(), renderer.variance()
        return image_z_test(mean, variance, expected.mean, expected.variance, n_a=renderer.spp, n_b=expected.runs)

    result = compare(build())
    report(
        f"{name}: mean against Mitsuba, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p
    )
    report(f"{name}: share of pixels that pass", result.pass_fraction, ">= 0.995", p=result.p_min)
    assert result.agrees(significance=SIGNIFICANCE), result.message
    assert not compare(build(mistake)).agrees(significance=SIGNIFICANCE)
