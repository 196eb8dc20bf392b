"""A surface that emits by an image or by vertex colours gives the light of many small ones of one colour each."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.covering_kernels import rendering_with
from support.irradiance import EVERY_LIGHT
from support.media import render
from support.statistics import image_z_test

import wrt
from wrt.linalg import weighted_sum
from wrt.scene.scene import Shape
from wrt.upload.lights.emission import mean_emissions
from wrt.upload.lights.environment import LUMINANCE

ORIGIN, EDGE_U, EDGE_V = np.array([-0.8, 1.0, -0.6]), np.array([1.6, 0.0, 0.0]), np.array([0.0, 0.0, 1.2])
LAMP = wrt.quad(tuple(ORIGIN), tuple(EDGE_U), tuple(EDGE_V))


def picture(height: int = 3, width: int = 4) -> NDArray[np.float32]:
    """Bright and dark texels of all colours, one of them black."""
    pixels = np.random.default_rng(8).random((height, width, 3)).astype(np.float32) ** 3
    pixels[0, 0], pixels[-1, 1] = 6.0, 0.0
    return pixels


def floor() -> wrt.Scene:
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.8, 2.4), (0.0, 0.4, 0.0), fov_degrees=60.0))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse(wrt.VertexColor(0.5)))
    return scene


def screen(pixels: NDArray[np.float32]) -> wrt.Scene:
    scene = floor()
    texture = wrt.ImageTexture(pixels, filter="nearest", factor=2.0)
    scene.add(LAMP, material=wrt.Diffuse(0.0), emission=texture)
    return scene


def mosaic(pixels: NDArray[np.float32]) -> wrt.Scene:
    """The same with a quad for each texel; row 0 lies at v = 1."""
    scene = floor()
    height, width = pixels.shape[:2]
    u, v = EDGE_U / width, EDGE_V / height
    for row, column in np.ndindex(height, width):
        corner = ORIGIN + column * u + (height - 1 - row) * v
        color = tuple(2.0 * float(x) for x in pixels[row, column])
        scene.add(wrt.quad(tuple(corner), tuple(u), tuple(v)), material=wrt.Diffuse(0.0), emission=color)
    return scene


one_kernel = rendering_with(EVERY_LIGHT)


def rendered(scene: wrt.Scene, device: str, strategy: str = "mis", seed: int = 1) -> tuple[NDArray, NDArray]:
    """Return mean and variance."""
    renderer = render(scene, device, size=(24, 24), spp=1024, max_depth=2, seed=seed, strategy=strategy)
    return renderer.image(), renderer.variance()


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_a_textured_light_is_as_many_small_ones(strategy: str, device: str, report: Report) -> None:
    expected = rendered(mosaic(picture()), device, seed=2)
    result = image_z_test(*rendered(screen(picture()), device, strategy), *expected)
    report(f"{strategy}: pixels that agree", result.pass_fraction, ">= 0.995", p=result.p_min)
    if strategy == "bsdf":
        # Some pixels do not find the light at all, and know nothing of their error: only the whole can be compared.
        assert result.mean_p > 0.01, result.message
        return
    assert result.agrees(), result.message
    for mistake in (picture()[::-1], picture()[:, ::-1], 1.03 * picture()):
        assert not image_z_test(*rendered(screen(mistake), device, strategy), *expected).agrees()


@pytest.mark.slow
def test_vertex_colors_shine(device: str) -> None:
    """As does an image of two texels, between whose middles the lamp lies."""
    ramps = (
        wrt.ImageTexture(np.repeat(np.float32([[0.0, 1.0]])[..., None], 3, axis=2), factor=8.0),
        wrt.VertexColor(8.0),
    )
    pictures = []
    for seed, emission in enumerate(ramps):
        colors = np.repeat(np.float32([0, 1, 1, 0])[:, None], 3, axis=1)
        scene = floor()
        lamp = dataclasses.replace(LAMP, colors=colors, uvs=0.5 * LAMP.uvs + np.float32(0.25))
        scene.add(lamp, material=wrt.Emissive(emission))
        pictures += rendered(scene, device, seed=seed)
    assert image_z_test(*pictures).agrees()


SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)


def shape(texture: wrt.ImageTexture, uvs: NDArray = SQUARE) -> Shape:
    mesh = wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    return Shape(dataclasses.replace(mesh, uvs=np.asarray(uvs, np.float32)), emission=texture)


def test_mean_emission_of_triangles() -> None:
    """Of u and v, 2/3 and 1/3 below the diagonal and the reverse above; of whole repeats, the mean of the image."""
    places = (np.arange(64) + 0.5) / 64.0
    v, u = np.meshgrid(1.0 - places, places, indexing="ij")
    means, luminance = mean_emissions(shape(wrt.ImageTexture(np.dstack([u, v, u]), wrap="clamp", factor=(3, 6, 1.5))))
    np.testing.assert_allclose(means, [[2.0, 2.0, 1.0], [1.0, 4.0, 0.5]], rtol=0.01)
    assert (luminance >= weighted_sum(means, LUMINANCE)).all()
    assert (luminance <= weighted_sum(means, LUMINANCE) * 1.2).all()
    for uvs, wrap in ((SQUARE * 5.0 - 1.3, "repeat"), (SQUARE * 4.0 + 0.4, "mirror")):
        means, _ = mean_emissions(shape(wrt.ImageTexture(picture(7, 5), wrap=wrap), uvs))
        np.testing.assert_allclose(means.mean(axis=0), picture(7, 5).mean(axis=(0, 1)), rtol=0.02)
        second = shape(wrt.ImageTexture(picture(7, 5), wrap=wrap, uv_set=1), np.hstack([0.0 * uvs, uvs]))
        np.testing.assert_array_equal(mean_emissions(second)[0], means)


@pytest.mark.parametrize("where", [(0, 0), (700, 31)])
def test_no_triangle_that_shines_is_left_out(where: tuple[int, int]) -> None:
    """One bright texel of very many, that no point of the lattice meets: its triangle is drawn all the same."""
    pixels = np.zeros((1024, 1024, 3), np.float32)
    pixels[where] = 1e6
    texture = wrt.ImageTexture(pixels)
    means, luminance = mean_emissions(shape(texture))
    x, y = where[1] + 0.5, 1024 - where[0] - 0.5
    assert luminance[0 if y < x else 1] > 0.0  # the lower triangle has the texels below the diagonal
    assert np.isfinite(means).all()
    assert not shape(wrt.ImageTexture(pixels, factor=0.0)).emits
