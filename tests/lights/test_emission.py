"""Surfaces that shine by an image or by vertex colours do so as many small ones of one colour each would."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.covering_kernels import render_with
from support.irradiance import EVERY_LIGHT
from support.kernels import upload
from support.media import render
from support.statistics import image_z_test

import wrt
from wrt.backend.device import Device
from wrt.backend.warp_backend import initialize_warp
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.textures.textures import make_slot_color
from wrt.scene.scene import Shape
from wrt.sums import weighted_sum
from wrt.upload.lights.emission import mean_emissions
from wrt.upload.lights.environment import LUMINANCE
from wrt.upload.scene_data import build_scene

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


@pytest.fixture(autouse=True)
def one_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    render_with([EVERY_LIGHT], monkeypatch)


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
LAID = {
    "mirrored": (SQUARE * 3.0 + 0.4, {"wrap": "mirror"}),
    "held at its edge": (SQUARE * 2.0 - 0.5, {"wrap": ("clamp", "repeat")}),
    "nearest texels, turned": (SQUARE, {"filter": "nearest", "rotation_degrees": 30.0, "scale": (2.0, 3.0)}),
    "a part of a texel": (SQUARE * 0.02 + 0.3, {}),
}


def shape(texture: wrt.ImageTexture, uvs: NDArray = SQUARE) -> Shape:
    mesh = wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    return Shape(dataclasses.replace(mesh, uvs=np.asarray(uvs, np.float32)), emission=texture)


slot_color = make_slot_color()


@wp.kernel(enable_backward=False)
def look_up(scene: SceneData, uv: wp.array(dtype=wp.vec2), color_out: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    color_out[i] = slot_color(scene, scene.slots[scene.shapes[0].emission_slot], uv[i], wp.vec4(), wp.vec3(1.0))


@pytest.mark.parametrize("name", LAID)
def test_mean_emission_of_triangles(name: str, device: str, report: Report) -> None:
    """Against the mean of what kernels read at many points of each triangle."""
    uvs, options = LAID[name]
    texture = wrt.ImageTexture(picture(7, 5), factor=(1.0, 2.0, 0.5), **options)  # type: ignore[arg-type]
    means, luminance = mean_emissions(shape(texture, uvs))
    assert (luminance >= weighted_sum(means, LUMINANCE)).all()
    assert (luminance <= weighted_sum(means, LUMINANCE) * 1.2 + 1e-3).all()
    initialize_warp()
    data = build_scene(wrt.Scene(shapes=[shape(texture, uvs)]), Device(device)).data
    a, b = np.random.default_rng(6).random((2, 2**18))
    flip = a + b > 1.0
    a, b = np.where(flip, 1.0 - a, a), np.where(flip, 1.0 - b, b)
    for i, corners in enumerate(([0, 1, 2], [0, 2, 3])):
        p, q, r = uvs[corners]
        points = (p + a[:, None] * (q - p) + b[:, None] * (r - p)).astype(np.float32)
        out = wp.zeros(len(points), dtype=wp.vec3, device=device)
        wp.launch(look_up, len(points), [data, upload(points, wp.vec2, device)], [out], device=device)
        seen = out.numpy().astype(np.float64)
        report(f"{name}: green of triangle {i}", float(means[i, 1]), float(seen[:, 1].mean()))
        error = seen.std(axis=0) / np.sqrt(len(seen))
        # The lattice is a quadrature of its own: good to a per cent or two of a texel's contrast.
        np.testing.assert_allclose(means[i], seen.mean(axis=0), atol=float(4.0 * error.max() + 0.02 * seen.mean()))


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
