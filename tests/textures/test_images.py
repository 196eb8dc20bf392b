"""Images over a surface: every way to lay, repeat, filter and cut them, against NumPy in double precision."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from support.composites import WITH_OPACITY
from support.covering_kernels import render_with
from support.kernels import upload
from support.small_scenes import finish

import wrt
from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.textures.textures import filtered_color, make_slot_color
from wrt.scene.srgb import of_codes
from wrt.scene.textures import WRAPS
from wrt.upload.materials import MaterialTable
from wrt.upload.scene_data import SceneUpload
from wrt.upload.textures import texels
from wrt.upload.textures.pyramid import pyramid
from wrt.upload.textures.texels import Texels

Array = NDArray[np.float64]
Pixels = NDArray[np.float32]

N = 20_000
PIXELS = np.random.default_rng(1).random((5, 7, 3)).astype(np.float32)
LAID: dict[str, Any] = {"scale": (0.7, 1.6), "rotation_degrees": 33.0, "wrap": ("mirror", "clamp")}
slot_color = make_slot_color()


@wp.kernel(enable_backward=False)
def look_up(
    scene: SceneData,
    slot: int,
    uvs: wp.array(dtype=wp.vec2),
    footprints: wp.array(dtype=wp.vec4),
    color_out: wp.array(dtype=wp.vec3),
    filtered_out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    color_out[i] = slot_color(scene, scene.slots[slot], uvs[i], wp.vec4(), wp.vec3(0.25, 0.5, 1.0))
    filtered_out[i] = filtered_color(scene, scene.images[1], uvs[i], footprints[i])


def looked_up(texture: wrt.ImageTexture, uvs: Pixels, device: str, footprints: Pixels | None = None) -> Pixels:
    """Return (N, 3) values that a material reads from a texture; averaged over footprints if it has levels.

    Another image and a constant lie before it in the tables.
    """
    before = wrt.Diffuse(wrt.ImageTexture(np.full((3, 2, 3), 9.0)))
    data = uploaded(before, wrt.Diffuse(0.5), wrt.Diffuse(texture), device=device)
    out = [wp.empty(len(uvs), dtype=wp.vec3, device=device) for _ in range(2)]
    around = np.zeros((len(uvs), 4), np.float32) if footprints is None else footprints
    inputs = [data, 2, upload(uvs, wp.vec2, device), upload(around, wp.vec4, device)]
    wp.launch(look_up, len(uvs), inputs, out, device=device)
    return out[0 if footprints is None else 1].numpy()


def uploaded(*materials: wrt.Material, device: str = "cpu") -> Any:
    data = current_backend().kernels("wrt.kernels.core.scene_data").SceneData()
    MaterialTable(list(materials)).upload(data, Device(device))
    return data


BEYOND: dict[str, Any] = {"repeat": "wrap", "mirror": "symmetric", "clamp": "edge"}
"""How NumPy pads an image that goes on for ever."""


def expected(texture: wrt.ImageTexture, uvs: Pixels) -> tuple[Array, NDArray[np.bool_]]:
    """Return (N, 3) values, and where they are sure: not within rounding of where the nearest texel changes."""
    height, width = texture.pixels.shape[:2]
    u, v = texture.placement @ np.column_stack([uvs.astype(np.float64), np.ones(len(uvs))]).T
    x, y = u * width - 0.5, (1.0 - v) * height - 0.5
    around = texture.pixels.astype(np.float64)
    around = np.pad(around, ((9 * height, 9 * height), (0, 0), (0, 0)), mode=BEYOND[texture.wrap[1]])
    around = np.pad(around, ((0, 0), (9 * width, 9 * width), (0, 0)), mode=BEYOND[texture.wrap[0]])
    place, order = (y + 9 * height, x + 9 * width), 0 if texture.filter == "nearest" else 1
    values = [map_coordinates(around[..., k], place, order=order) for k in range(3)]
    sure = np.minimum(np.abs(x % 1.0 - 0.5), np.abs(y % 1.0 - 0.5)) > (0.001 if order == 0 else -1.0)
    return np.stack(values, axis=1), sure


def coordinates(seed: int) -> Pixels:
    """Return points in and around the unit square, its edges and corners among them."""
    uvs = np.random.default_rng(seed).uniform(-2.3, 3.3, (N, 2)).astype(np.float32)
    uvs[:9] = list(itertools.product((0.0, 1.0, 2.0), (0.0, 1.0, -1.0)))
    return uvs


@pytest.mark.parametrize("filter", ["bilinear", "nearest"])
@pytest.mark.parametrize("wrap", [*zip(WRAPS, (*WRAPS[1:], WRAPS[0]), strict=True)])
def test_wraps_and_filters(wrap: tuple[str, str], filter: str, device: str) -> None:
    texture = wrt.ImageTexture(PIXELS, **{**LAID, "wrap": wrap}, offset=(0.3, -0.2), filter=filter)
    uvs = coordinates(2)
    values, sure = expected(texture, uvs)
    assert sure.mean() > 0.98
    assert np.abs(looked_up(texture, uvs, device) - values)[sure].max() < 1e-5


def test_placement_scales_then_turns_then_shifts() -> None:
    texture = wrt.ImageTexture(PIXELS, scale=(2.0, 3.0), rotation_degrees=90.0, offset=(0.5, 0.25))
    # (1, 0) scaled is (2, 0), turned counter-clockwise (0, 2).
    assert texture.placement @ (1.0, 0.0, 1.0) == pytest.approx((0.5, 2.25))
    assert texture.placement @ (0.0, 1.0, 1.0) == pytest.approx((-2.5, 0.25))


def test_factors_vertex_colors_channels_and_cutoffs(device: str) -> None:
    uvs = coordinates(3)
    plain = looked_up(wrt.ImageTexture(PIXELS), uvs, device)
    made = looked_up(wrt.ImageTexture(PIXELS, factor=(0.5, 0.25, 2.0), vertex_colors=True), uvs, device)
    np.testing.assert_allclose(made, plain * np.float32((0.125, 0.125, 2.0)), rtol=1e-6)
    green = looked_up(wrt.ImageTexture(PIXELS, channel="g", factor=0.5), uvs, device)
    np.testing.assert_allclose(green, 0.5 * plain[:, [1, 1, 1]], rtol=1e-6)
    mask = looked_up(wrt.ImageTexture(PIXELS, channel="g", factor=0.5, cutoff=0.25), uvs, device)
    np.testing.assert_array_equal(mask, (green >= np.float32(0.25)).astype(np.float32))
    assert 0.2 < mask.mean() < 0.8


@pytest.mark.usefixtures("one_kernel")
def test_second_coordinates_and_alpha_are_read_as_the_first_and_colors(device: str) -> None:
    """A square by its second coordinates, or with holes by alpha, is one that has these alone, to the bit."""
    first, second, colors = (np.random.default_rng(k).random((4, n), np.float32) for k, n in ((1, 2), (2, 2), (3, 4)))
    alpha = colors[:, [3, 3, 3]]
    vertices, faces = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]]

    def shown(uvs: Pixels, colors: Pixels, reflectance: Any = 0.5, **opacity: Any) -> Pixels:
        scene = wrt.Scene(camera=wrt.PerspectiveCamera(), environment=wrt.ConstantEnvironment(0.5))
        mesh = wrt.Mesh(np.float32(vertices), faces, None, uvs, colors)
        scene.add(mesh, material=wrt.Diffuse(reflectance, **opacity))
        return rendered(scene, device, 4).image()

    texture, by_alpha = wrt.ImageTexture(PIXELS), {"vertex_alpha": True, "channel": "g"}
    two_sets = np.hstack([first, second])
    by_second = shown(two_sets, alpha, wrt.ImageTexture(PIXELS, uv_set=1))
    np.testing.assert_array_equal(by_second, shown(second, alpha, texture))
    assert (by_second != shown(two_sets, alpha, texture)).any()
    for ours, plain in (
        (wrt.VertexColor(alpha=True), wrt.VertexColor()),
        (wrt.VertexColor(alpha=True, cutoff=0.5), wrt.VertexColor(cutoff=0.5)),
        (wrt.ImageTexture(PIXELS, **by_alpha), wrt.ImageTexture(PIXELS, vertex_colors=True, channel="g")),
    ):
        of_alpha, of_grey = shown(first, colors, opacity=ours), shown(first, alpha, opacity=plain)
        np.testing.assert_array_equal(of_alpha, of_grey)
        assert (of_alpha != shown(first, alpha)).any()


# --- Texels on the device: those of 8 bits take four bytes, and not one bit of their colours changes ---

CODES = np.random.default_rng(5).integers(0, 256, (40, 33, 3), dtype=np.uint8)
COLORS = of_codes(linear=False)[CODES]
LINEAR = of_codes(linear=True)[CODES]
FLOATS = np.random.default_rng(6).random((40, 33, 3)).astype(np.float32)


def test_many_values_stay_as_they_are() -> None:
    """More than the 256 of a palette, also where the last of them comes late."""
    late = np.zeros(200_000, np.float32)
    late[-257:] = np.arange(257)
    for pixels in (FLOATS, np.repeat(late, 3).reshape(400, 500, 3)):
        found = Texels([pixels])
        assert len(found.codes) == 0
        np.testing.assert_array_equal(found.colors, pixels.reshape(-1, 3))


def test_how_many_texels_and_images_there_are_on_the_device() -> None:
    """Codes take a word a texel; equal palettes and pixels are stored once; small and float images are not coded."""
    matt = [wrt.Diffuse(wrt.ImageTexture(pixels)) for pixels in (COLORS, COLORS[::-1], COLORS[:5, :7], FLOATS)]
    coded = uploaded(*matt[:2], wrt.Principled(roughness=wrt.ImageTexture(LINEAR, channel="g")))
    assert (len(coded.texels), len(coded.texel_codes), len(coded.palettes)) == (0, 3 * 40 * 33, 2 * 3 * 256)
    plain = uploaded(*matt[2:])
    assert (len(plain.texel_codes), len(plain.texels)) == (0, 5 * 7 + 40 * 33)
    wrapped = uploaded(*(wrt.Diffuse(wrt.ImageTexture(PIXELS, wrap=wrap)) for wrap in WRAPS))
    assert (len(wrapped.texels), len(wrapped.images)) == (5 * 7, 3)


@pytest.mark.parametrize("filter", ["bilinear", "nearest"])
def test_what_materials_read_is_the_same_to_the_bit(filter: str, device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    changed = CODES.copy()
    changed[20, 20, 2] ^= 1
    texture, altered = (
        wrt.ImageTexture(of_codes(linear=False)[codes], **LAID, filter=filter) for codes in (CODES, changed)
    )
    uvs = coordinates(7)
    coded = looked_up(texture, uvs, device)
    assert (coded != looked_up(altered, uvs, device)).any()
    monkeypatch.setattr(texels, "FEWEST_TEXELS", 10**9)
    np.testing.assert_array_equal(coded, looked_up(texture, uvs, device))


# --- Levels: few samples see their mean from afar, many see what there is without levels ---------------

SIZE = 512
BLACK, WHITE = 40, 220
"""Codes of a checkerboard's squares, of a texel each."""
MEAN = float(of_codes(linear=False)[[BLACK, WHITE]].astype(np.float64).mean())


@functools.cache
def checker() -> Pixels:
    codes = np.where(np.indices((SIZE, SIZE)).sum(axis=0) % 2, WHITE, BLACK)
    return np.repeat(of_codes(linear=False)[codes][..., None], 3, axis=2)


@functools.cache
def clouds() -> Pixels:
    """Return an image that varies at all scales, as photographs do: its spectrum falls with the frequency."""
    f = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None])
    f[0, 0] = 1.0
    waves = np.fft.rfft2(np.random.default_rng(4).normal(size=(SIZE, SIZE))) / f
    values = np.fft.irfft2(waves, s=(SIZE, SIZE))
    codes = np.clip(128.0 + 50.0 * (values - values.mean()) / values.std(), 0.0, 255.0).astype(np.uint8)
    return np.repeat(of_codes(linear=False)[codes][..., None], 3, axis=2)


@pytest.mark.parametrize("pixels", [clouds()[:40, :28], np.random.default_rng(3).random((9, 13, 3), np.float32)])
def test_two_levels_are_mixed_by_the_narrower_axis(pixels: Pixels, device: str) -> None:
    """By ellipses of all forms in a texture that is scaled and turned."""
    texture = wrt.ImageTexture(pixels, **LAID, filter="trilinear")
    levels = [pixels, *pyramid(pixels)]
    assert levels[-1].shape[:2] == (1, 1)
    uvs, rng = coordinates(8), np.random.default_rng(9)
    # Two axes of an ellipse, in texture coordinates.
    axes = rng.normal(size=(N, 2, 2)) * 2.0 ** rng.uniform(-8.0, 2.0, (N, 1, 1))
    axes[:100] = 0.0
    k = axes @ axes.transpose(0, 2, 1)
    footprints = np.stack([k[:, 0, 0], k[:, 1, 1], k[:, 0, 1], np.abs(np.linalg.det(axes))], axis=1).astype(np.float32)
    in_texels = np.diag([pixels.shape[1], pixels.shape[0]]) @ texture.placement[:, :2] @ axes
    narrow = np.linalg.svd(in_texels, compute_uv=False)[:, 1]
    level = np.clip(np.log2(np.maximum(narrow, 1e-9)), 0.0, len(levels) - 1.0)
    colors = np.stack([expected(wrt.ImageTexture(each, **LAID), uvs)[0] for each in levels])
    lower, rows = np.minimum(level.astype(int), len(levels) - 2), np.arange(N)
    share = (level - lower)[:, None]
    mixed = colors[lower, rows] * (1.0 - share) + colors[lower + 1, rows] * share
    assert np.abs(looked_up(texture, uvs, device, footprints) - mixed).max() < 1e-4


def floor(pixels: Pixels, camera: wrt.Camera, **options: Any) -> wrt.Scene:
    """Return a square of 8 m in even light, on which an image lies once: what is seen of it is its colour."""
    mesh = wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8))
    mesh = wrt.Mesh(mesh.vertices, mesh.faces, uvs=np.float32([[0, 0], [1, 0], [1, 1], [0, 1]]))
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(1.0))
    scene.add(mesh, material=wrt.Diffuse(wrt.ImageTexture(pixels, **options)))
    return scene


def above(height: float) -> wrt.Camera:
    return wrt.OrthographicCamera((0.1, 3, 0.1), (0.1, 0, 0.1), up=(0, 0, -1), view_height=height)


ALONG = wrt.PerspectiveCamera((0.0, 0.5, 3.5), (0.0, 0.0, 0.0), fov_degrees=25.0)


def rendered(scene: wrt.Scene, device: str, *targets: int, size: int = 24, **options: Any) -> wrt.Renderer:
    options = {"layers": ("albedo", "alpha"), "sampler": "independent", "max_depth": 2, **options}
    return finish(wrt.Renderer(scene, width=size, height=size, device=device, **options), *targets)


def picture(scene: wrt.Scene, device: str, spp: int, **options: Any) -> Array:
    return rendered(scene, device, spp, **options).image()[..., 1].astype(np.float64)


@pytest.fixture
def one_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    render_with([WITH_OPACITY, dataclasses.replace(WITH_OPACITY, sampler="sobol")], monkeypatch)


@pytest.mark.usefixtures("one_kernel")
def test_one_sample_sees_the_mean_of_what_is_far_smaller_than_a_pixel(device: str) -> None:
    """The mean of linear light, in closed form for a checkerboard; the mean of codes would be a quarter darker."""
    found = picture(floor(checker(), above(6.0), filter="trilinear"), device, 1)
    np.testing.assert_allclose(found, MEAN, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.usefixtures("one_kernel")
def test_few_samples_have_less_noise_and_many_see_the_same(device: str, report: Report) -> None:
    """Along a floor that goes from magnified to much smaller than pixels, and is seen at an angle."""
    scenes = {name: floor(clouds(), ALONG, filter=name) for name in ("bilinear", "trilinear")}

    def seen(name: str, spp: int, seed: int = 0) -> Array:
        return picture(scenes[name], device, spp, size=32, seed=seed, sampler="sobol")

    true = seen("bilinear", 2048, 7)
    # The first sample alone, were it repeated, would leave the texture blurred.
    blurred = np.mean([seen("trilinear", 1, seed) for seed in range(64)], axis=0)
    pictures = (seen("bilinear", 1), seen("trilinear", 1), seen("trilinear", 1024), blurred)
    plain, first, converged, blur = (float(np.sqrt(((found - true) ** 2).mean()) / true.mean()) for found in pictures)
    report("one sample: error with levels, without", first, plain)
    assert first < 0.9 * plain
    assert converged < min(0.005, blur / 3.0)


@pytest.mark.usefixtures("one_kernel")
def test_close_up_nothing_changes(device: str) -> None:
    near = above(24 * 8.0 / SIZE * 0.9)
    images = [picture(floor(checker(), near, filter=name), device, 3) for name in ("bilinear", "trilinear")]
    np.testing.assert_array_equal(*images)


@pytest.mark.usefixtures("one_kernel")
def test_passes_leave_no_trace_and_layers_see_the_same(device: str) -> None:
    scene = floor(clouds(), ALONG, filter="trilinear")
    several = rendered(scene, device, 1, 2, 8)
    np.testing.assert_array_equal(several.image(), rendered(scene, device, 8).image())
    layers = several.layers()
    is_covered = layers["alpha"] == 1.0
    assert is_covered.sum() > 100
    # The way to the sky is free everywhere.
    np.testing.assert_allclose(layers["albedo"][is_covered], several.image()[is_covered], rtol=1e-5)


def test_levels_are_made_where_they_are_wanted_and_are_there_once() -> None:
    for options, has_levels in (
        ({"filter": "trilinear"}, True),
        ({"filter": "trilinear", "cutoff": 0.5}, False),  # the mean of a mask is no mask
    ):
        built = SceneUpload(floor(checker(), ALONG, **options), Device("cpu")).finish()
        assert built.features.mipmapped == has_levels
    # Levels take a third of the texels; without them another record reads the same ones.
    several = [wrt.ImageTexture(clouds(), filter="trilinear", scale=scale) for scale in (1.0, 2.0)]
    data = uploaded(*map(wrt.Diffuse, (*several, wrt.ImageTexture(clouds()))))
    assert (len(data.texel_codes), len(data.texels)) == (SIZE * SIZE, (SIZE * SIZE - 1) // 3)
