"""Images over a surface: every way to lay, repeat, filter and cut them, against NumPy in double precision."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from PIL import Image
from support.kernels import upload

import wrt
from wrt.backend.device import Device
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.textures.textures import make_slot_color
from wrt.scene.textures import TEXTURE_FILTERS, WRAPS
from wrt.upload.materials import describe_materials

N = 20_000
PIXELS = np.random.default_rng(1).random((5, 7, 3)).astype(np.float32)
TINT = (0.25, 0.5, 1.0)
"""The vertex colour at every point."""


slot_color = make_slot_color()


@wp.kernel(enable_backward=False)
def look_up(scene: SceneData, slot: int, uvs: wp.array(dtype=wp.vec2), out: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    out[i] = slot_color(scene, scene.slots[slot], uvs[i], wp.vec4(), wp.vec3(0.25, 0.5, 1.0))


def looked_up(texture: wrt.ImageTexture, uvs: NDArray[np.float32], device: str) -> NDArray[np.float32]:
    """Return (N, 3) what a material reads of a texture. Another image and a constant lie before it in the tables."""
    before = wrt.Diffuse(wrt.ImageTexture(np.full((3, 2, 3), 9.0)))
    table = describe_materials([before, wrt.Diffuse(0.5), wrt.Diffuse(texture)])
    data = SceneData()
    table.upload(data, Device(device))
    out = wp.empty(len(uvs), dtype=wp.vec3, device=device)
    wp.launch(look_up, len(uvs), [data, 2, upload(uvs, wp.vec2, device)], [out], device=device)
    return out.numpy()


def beyond(i: NDArray[np.int64], n: int, wrap: str) -> NDArray[np.int64]:
    """Return which texel stands at place i of an image n wide that goes on for ever."""
    if wrap == "repeat":
        return i % n
    if wrap == "clamp":
        return np.clip(i, 0, n - 1)
    j = i % (2 * n)
    return np.where(j < n, j, 2 * n - 1 - j)


def expected(texture: wrt.ImageTexture, uvs: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return (N, 3) values, and where they are sure: not within rounding of where the nearest texel changes."""
    height, width = texture.pixels.shape[:2]
    u, v = texture.placement @ np.column_stack([uvs.astype(np.float64), np.ones(len(uvs))]).T
    if texture.wrap[0] == "clamp":
        u = np.clip(u, 0.0, 1.0)
    if texture.wrap[1] == "clamp":
        v = np.clip(v, 0.0, 1.0)
    x, y = u * width - 0.5, (1.0 - v) * height - 0.5
    sure = np.ones(len(uvs), bool)
    if texture.filter == "nearest":
        sure = inside_texel(x, u, texture.wrap[0]) & inside_texel(y, v, texture.wrap[1])
        x, y = np.floor(x + 0.5), np.floor(y + 0.5)
    total = np.zeros((len(uvs), 3))
    for dx, dy in itertools.product((0, 1), (0, 1)):
        i, j = np.floor(x).astype(int) + dx, np.floor(y).astype(int) + dy
        share = (1.0 - np.abs(x - i)) * (1.0 - np.abs(y - j))
        total += share[:, None] * texture.pixels[beyond(j, height, texture.wrap[1]), beyond(i, width, texture.wrap[0])]
    return total, sure


def inside_texel(x: NDArray[np.float64], u: NDArray[np.float64], wrap: str) -> NDArray[np.bool_]:
    """Return where x is not between two texels, or u is held at the image's edge."""
    return (np.abs((x + 0.5) % 1.0 - 0.5) < 0.499) | ((wrap == "clamp") & ((u == 0.0) | (u == 1.0)))


def coordinates(seed: int) -> NDArray[np.float32]:
    """Return points in and around the unit square, its edges and corners among them."""
    rng = np.random.default_rng(seed)
    uvs = rng.uniform(-2.3, 3.3, (N, 2)).astype(np.float32)
    uvs[:9] = list(itertools.product((0.0, 1.0, 2.0), (0.0, 1.0, -1.0)))
    return uvs


@pytest.mark.parametrize("filter", TEXTURE_FILTERS)
@pytest.mark.parametrize("wrap_v", WRAPS)
@pytest.mark.parametrize("wrap_u", WRAPS)
def test_wraps_and_filters(wrap_u: str, wrap_v: str, filter: str, device: str, report: Report) -> None:
    texture = wrt.ImageTexture(
        PIXELS, scale=(0.7, 1.6), rotation_degrees=33.0, offset=(0.3, -0.2), wrap=(wrap_u, wrap_v), filter=filter
    )
    uvs = coordinates(2)
    values, sure = expected(texture, uvs)
    error = np.abs(looked_up(texture, uvs, device) - values)[sure].max()
    report("largest error", float(error), "< 1e-5")
    assert sure.mean() > 0.98
    assert error < 1e-5


def test_placement_scales_then_turns_then_shifts() -> None:
    texture = wrt.ImageTexture(PIXELS, scale=(2.0, 3.0), rotation_degrees=90.0, offset=(0.5, 0.25))
    # (1, 0) scaled is (2, 0), turned counter-clockwise (0, 2).
    assert texture.placement @ (1.0, 0.0, 1.0) == pytest.approx((0.5, 2.25))
    assert texture.placement @ (0.0, 1.0, 1.0) == pytest.approx((-2.5, 0.25))


def test_factors_vertex_colors_and_channels_multiply(device: str) -> None:
    uvs = coordinates(3)
    plain = looked_up(wrt.ImageTexture(PIXELS), uvs, device)
    made = looked_up(wrt.ImageTexture(PIXELS, factor=(0.5, 0.25, 2.0), vertex_colors=True), uvs, device)
    np.testing.assert_allclose(made, plain * np.float32((0.125, 0.125, 2.0)), rtol=1e-6)
    green = looked_up(wrt.ImageTexture(PIXELS, channel="g", factor=0.5), uvs, device)
    np.testing.assert_allclose(green, 0.5 * plain[:, [1, 1, 1]], rtol=1e-6)


def test_a_cutoff_makes_a_mask(device: str) -> None:
    uvs = coordinates(4)
    plain = looked_up(wrt.ImageTexture(PIXELS, channel="r", factor=0.8), uvs, device)
    mask = looked_up(wrt.ImageTexture(PIXELS, channel="r", factor=0.8, cutoff=0.4), uvs, device)
    np.testing.assert_array_equal(mask, (plain >= np.float32(0.4)).astype(np.float32))
    assert 0.2 < mask.mean() < 0.8


def test_pixels_used_in_several_ways_are_there_once() -> None:
    textures = [wrt.ImageTexture(PIXELS, wrap=wrap) for wrap in WRAPS]
    table = describe_materials([wrt.Diffuse(texture) for texture in textures])
    data = SceneData()
    table.upload(data, Device("cpu"))
    assert len(data.texels) == PIXELS.shape[0] * PIXELS.shape[1]
    assert len(data.images) == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"wrap": "mirrored"}, "texture wood: wrap must be one of repeat, mirror, clamp, not 'mirrored' (did you mean"),
        ({"wrap": ("clamp",)}, "texture wood: wrap must be one of repeat, mirror, clamp, or two of them for u and v"),
        ({"filter": "cubic"}, "texture wood: filter must be one of bilinear, nearest, trilinear, not 'cubic'"),
        ({"scale": (1.0, 2.0, 3.0)}, "texture wood: scale must be two numbers, not (1.0, 2.0, 3.0)"),
        ({"offset": 1.0}, "texture wood: offset must be two numbers, not 1.0"),
        ({"factor": -1.0}, "texture wood: factor must be at least 0"),
        ({"cutoff": "half"}, "texture wood: cutoff must be a number, not 'half'"),
        ({"vertex_colors": 1}, "texture wood: vertex_colors must be true or false, not 1"),
    ],
)
def test_mistakes_are_named(options: dict, message: str) -> None:
    with pytest.raises(wrt.InputError) as caught:
        wrt.ImageTexture(PIXELS, "wood", **options)
    assert str(caught.value).startswith(message)
    for codes in (np.full((2, 2, 3), 200, np.uint8), Image.new("RGB", (2, 2), (200, 200, 200))):
        with pytest.raises(
            wrt.InputError, match=r"^texture wood: pixels must be linear numbers, not codes up to 200; for"
        ):
            wrt.ImageTexture(codes, "wood")
    with pytest.raises(
        wrt.InputError, match=r"^texture wood: pixels must be an array, such as wrt.load_image\('a.png'\)"
    ):
        wrt.ImageTexture("a.png", "wood")
