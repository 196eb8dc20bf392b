"""Opacity: a share of the surface reflects, emits and casts shadows; light passes the rest as it passes air."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.composites import BLACK, WITH_OPACITY, A, assert_mean, chain, expected_shares, render, room
from support.covering_kernels import render_with
from support.irradiance import check, floor_scene, irradiance, pixel_mean, rectangle_irradiance

import wrt
from wrt.scene.materials import composite


@pytest.fixture(autouse=True)
def _one_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    render_with([WITH_OPACITY], monkeypatch)


@pytest.mark.parametrize(("strategy", "max_depth"), [("mis", 1), ("mis", 5), ("light", 2), ("bsdf", 2)])
def test_what_has_no_opacity_is_not_there(strategy: str, max_depth: int, device: str) -> None:
    """Nor does it cost any of the path's segments; in front of the camera, between surfaces, around lights."""
    empty = render(room(), device, spp=8, strategy=strategy, max_depth=max_depth).image()
    scene = room()
    ghosts = (
        wrt.Diffuse(0.5, opacity=0.0),
        wrt.Dielectric(1.5, opacity=0.0),
        wrt.Mix(wrt.Mirror(opacity=0.0), A, weight=0.0),
        wrt.Diffuse(0.5, opacity=wrt.ImageTexture(np.zeros((2, 2, 3)))),
    )
    scene.add(wrt.box((-2.0, 0.1, -2.0), (2.0, 1.0, 2.0)), material=ghosts[0])
    scene.add(wrt.sphere((0.0, 1.2, 4.0), 0.5, subdivisions=2), material=ghosts[1])
    scene.add(wrt.sphere((0.0, 2.5, 0.0), 0.9, subdivisions=2), material=ghosts[2])
    scene.add(wrt.quad((-3, 0.05, 3), (6, 0, 0), (0, 0, -6)), material=ghosts[3], emission=100.0)
    if max_depth == 1:
        image = render(scene, device, spp=8, strategy=strategy, max_depth=1).image()
        np.testing.assert_allclose(image, empty, rtol=1e-4, atol=1e-6)
        return
    # A glowing ghost would take part in the choice of lights: other numbers, the same mean.
    scene.shapes[-1] = dataclasses.replace(scene.shapes[-1], emission=0.0)
    pixels = render(scene, device, spp=8, strategy=strategy, max_depth=max_depth).image()
    # A ray that leaves a ghost is off by its rounding, so a few hit another thing; all others see the same.
    assert np.isclose(pixels, empty, rtol=1e-3, atol=1e-4).mean() > 0.995
    assert pixels.mean() == pytest.approx(empty.mean(), rel=1e-2)


def test_a_glowing_thing_that_is_not_there_gives_no_light(device: str) -> None:
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.0, 3.0)))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)))
    scene.add(wrt.sphere((0.0, 1.0, 0.0), 0.5, subdivisions=2), material=wrt.Diffuse(opacity=0.0), emission=5.0)
    for strategy in ("mis", "light", "bsdf"):
        assert render(scene, device, spp=16, strategy=strategy).image().max() == 0.0


def pane(height: float, material: wrt.Material, half: float = 9.0) -> wrt.Shape:
    """A horizontal pane over the floor whose front faces up; u grows along x and v along −z."""
    return wrt.Shape(wrt.quad((-half, height, half), (2 * half, 0.0, 0.0), (0.0, 0.0, -2 * half)), material)


def test_panes_before_a_constant_sky(device: str, report: Report) -> None:
    """Each lets 0.7 of what is behind through, and shows its reflectance times the sky's radiance in the rest."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(2.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 5.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov_degrees=20)
    scene.shapes = [pane(-0.1 * i, wrt.Diffuse(0.0, opacity=0.3), half=50.0) for i in range(3)]
    assert_mean(render(scene, device, spp=256), (2.0 * 0.7**3,) * 3, report, "sky through 3 black panes")
    scene.shapes = [pane(0.0, wrt.Diffuse((0.1, 0.5, 0.9), opacity=0.3))]
    expected = tuple(2.0 * (0.7 + 0.3 * r) for r in (0.1, 0.5, 0.9))
    assert_mean(render(scene, device, spp=256), expected, report, "sky through a coloured pane")
    scene.shapes = [pane(0.0, wrt.Emissive((1.0, 2.0, 3.0), opacity=0.3))]
    assert_mean(render(scene, device, spp=256), (1.7, 2.0, 2.3), report, "a lamp of opacity 0.3 before a sky")


PANES: dict[str, tuple[list[wrt.Material], float]] = {
    "two panes": ([wrt.Diffuse(opacity=0.4), wrt.Mirror(opacity=0.7)], 0.6 * 0.3),
    "glass, which shadow rays do not pass": ([wrt.Dielectric(1.5, opacity=0.25)], 0.75),
    "an opaque one behind": ([wrt.Diffuse(opacity=0.4), wrt.Diffuse()], 0.0),
    "a mixture": ([wrt.Mix(wrt.Diffuse(opacity=0.5), wrt.Diffuse(), weight=0.2, opacity=0.3)], 0.7 + 0.3 * 0.4),
    # Light from above is seen from below: shadow rays start at the floor and meet the back.
    "two sides": ([wrt.TwoSided(wrt.Diffuse(opacity=0.9), wrt.Diffuse(opacity=0.2))], 0.8),
    "all nested": ([chain(composite.MAX_NESTING)], expected_shares(chain(composite.MAX_NESTING))[0]),
}


@pytest.mark.parametrize("name", PANES)
def test_shadows_of_panes_are_their_share(name: str, device: str) -> None:
    """Panes multiply irradiance by the share they pass, sample by sample."""
    materials, share = PANES[name]
    images = []
    for panes in ([], materials):
        scene = floor_scene(eye=0.5)
        scene.add_light(wrt.PointLight((0.4, 1.8, -0.3), intensity=3.0))
        scene.add_light(wrt.DirectionalLight((0.3, -1.0, 0.2)))
        scene.shapes += [pane(1.0 + 0.1 * i, material, 4.0) for i, material in enumerate(panes)]
        images.append(irradiance(scene, device, 4, layers=("alpha",))[1])
    assert images[0].min() > 0.0
    np.testing.assert_allclose(images[1], share * images[0], rtol=2e-5, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_a_lamp_through_a_pane_and_one_partly_there(strategy: str, device: str, report: Report) -> None:
    """All ways to find the lamp agree: shadow rays take shares, rays that are followed choose.

    Opacity scales emission: the second lamp's left half emits fully, its right half a quarter. Between the halves,
    and at the seam of the repeated texture, opacity runs over 2 cm: less than noise.
    """
    columns = np.repeat(np.float32([1.0] * 32 + [0.25] * 32)[None, :, None], 3, axis=2)
    partly = wrt.Emissive(1.0, opacity=wrt.ImageTexture(columns))
    place = ((-0.6, 1.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8))
    through, half_there = floor_scene(eye=0.7), floor_scene(eye=0.7)
    through.add(wrt.quad(*place), material=BLACK, emission=1.0)
    through.shapes.append(pane(0.8, wrt.Diffuse(0.0, opacity=0.25), 20.0))
    half_there.add(wrt.quad(*place), material=partly)

    def halves(x: NDArray, z: NDArray) -> NDArray:
        left_half, right_half = (rectangle_irradiance(x + shift, z, 1.0, (0.3, 0.4)) for shift in (0.3, -0.3))
        return left_half + 0.25 * right_half

    def behind(x: NDArray, z: NDArray) -> NDArray:
        return 0.75 * rectangle_irradiance(x, z, 1.0, (0.6, 0.4))

    for scene, expected in ((through, behind), (half_there, halves)):
        where, measured, variance = irradiance(scene, device, 2048, strategy=strategy, layers=("alpha",))
        check(f"{expected.__name__}, {strategy}", measured, variance, pixel_mean(expected, where), 2048, report)


def test_a_ray_among_crowded_panes_comes_to_an_end(device: str) -> None:
    """Many crossing panes with no opacity, all through one line: what is behind is seen, grazing or not."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 0.0, 3.0), fov_degrees=3)
    scene.add_light(wrt.DirectionalLight((0.0, 0.0, -1.0)))
    for angle in np.random.default_rng(8).uniform(0.0, 180.0, 300):
        leaf = wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)).rotated((1.0, 0.0, 0.0), angle)
        scene.add(leaf, material=wrt.Diffuse(opacity=0.0))
    np.testing.assert_array_equal(render(scene, device, spp=16, size=8).image(), 1.0)
