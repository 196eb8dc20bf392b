"""Textures with levels: few samples see their mean from afar, many see what there is without levels."""

from __future__ import annotations

import functools
import json
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.kernels import upload
from test_gltf_materials import file_with
from test_textures import coordinates
from test_textures import expected as expected_bilinear

import wrt
from wrt.backend.device import Device
from wrt.io.load_mesh import load_shapes
from wrt.kernels.scene.scene_data import SceneData
from wrt.kernels.textures.textures import filtered_color
from wrt.scene.srgb import of_codes
from wrt.upload.materials import describe_materials
from wrt.upload.scene_data import build_scene
from wrt.upload.textures.pyramid import pyramid

SIZE = 512
BLACK, WHITE = 40, 220
"""Codes of a checkerboard's squares, of a texel each."""
VALUES = of_codes(linear=False)[[BLACK, WHITE]].astype(np.float64)
MEAN = VALUES.mean()


@functools.cache
def checker() -> NDArray[np.float32]:
    codes = np.where(np.indices((SIZE, SIZE)).sum(axis=0) % 2, WHITE, BLACK)
    return np.repeat(of_codes(linear=False)[codes][..., None], 3, axis=2)


@functools.cache
def clouds() -> NDArray[np.float32]:
    """Return an image that varies at all scales, as photographs do: its spectrum falls with the frequency."""
    f = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None])
    f[0, 0] = 1.0
    waves = np.fft.rfft2(np.random.default_rng(4).normal(size=(SIZE, SIZE))) / f
    values = np.fft.irfft2(waves, s=(SIZE, SIZE))
    codes = np.clip(128.0 + 50.0 * (values - values.mean()) / values.std(), 0.0, 255.0).astype(np.uint8)
    return np.repeat(of_codes(linear=False)[codes][..., None], 3, axis=2)


def floor(pixels: NDArray[np.float32], camera: wrt.Camera, **options: Any) -> wrt.Scene:
    """Return a square of 8 m in even light, on which an image lies once: what is seen of it is its colour."""
    mesh = wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8))
    mesh = wrt.Mesh(mesh.vertices, mesh.faces, uvs=np.float32([[0, 0], [1, 0], [1, 1], [0, 1]]))
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(1.0))
    scene.add(mesh, material=wrt.Diffuse(wrt.ImageTexture(pixels, **options)))
    return scene


ABOVE = wrt.OrthographicCamera((0.1, 3, 0.1), (0.1, 0, 0.1), up=(0, 0, -1), view_height=6.0)
ALONG = wrt.PerspectiveCamera((0.0, 0.5, 3.5), (0.0, 0.0, 0.0), fov_degrees=25.0)


def picture(scene: wrt.Scene, device: str, spp: int, size: int = 24, **options: Any) -> NDArray[np.float64]:
    renderer = wrt.Renderer(scene, width=size, height=size, device=device, max_depth=2, **options)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer.image()[..., 1].astype(np.float64)


# --- What a point sees -------------------------------------------------------------------------------


@wp.kernel(enable_backward=False)
def look_up(
    scene: SceneData, uvs: wp.array(dtype=wp.vec2), footprints: wp.array(dtype=wp.vec4),
    color_out: wp.array(dtype=wp.vec3),
):  # fmt: skip
    i = wp.tid()
    color_out[i] = filtered_color(scene, scene.images[0], uvs[i], footprints[i])


@pytest.mark.parametrize("pixels", [clouds()[:40, :28], np.random.default_rng(3).random((9, 13, 3), np.float32)])
def test_two_levels_are_mixed_by_the_narrower_axis(pixels: NDArray[np.float32], device: str, report: Report) -> None:
    """Against NumPy in double precision, by ellipses of all forms in a texture that is scaled and turned."""
    texture = wrt.ImageTexture(
        pixels, scale=(0.7, 1.6), rotation_degrees=33.0, wrap=("mirror", "clamp"), filter="trilinear"
    )
    data = SceneData()
    describe_materials([wrt.Diffuse(texture)]).upload(data, Device(device))
    levels = [pixels, *pyramid(pixels)]
    assert levels[-1].shape[:2] == (1, 1)
    uvs = coordinates(8)
    rng = np.random.default_rng(9)
    # Two axes of an ellipse, in texture coordinates.
    axes = rng.normal(size=(len(uvs), 2, 2)) * 2.0 ** rng.uniform(-8.0, 2.0, (len(uvs), 1, 1))
    k = axes @ axes.transpose(0, 2, 1)
    root = np.abs(np.linalg.det(axes))
    footprints = np.stack([k[:, 0, 0], k[:, 1, 1], k[:, 0, 1], root], axis=1).astype(np.float32)
    footprints[:100] = 0.0
    out = wp.empty(len(uvs), dtype=wp.vec3, device=device)
    arrays = upload(uvs, wp.vec2, device), upload(footprints, wp.vec4, device)
    wp.launch(look_up, len(uvs), [data, *arrays], [out], device=device)

    texels = np.diag([pixels.shape[1], pixels.shape[0]]) @ texture.placement[:, :2] @ axes
    narrow = np.where(np.arange(len(uvs)) < 100, 0.0, np.linalg.svd(texels, compute_uv=False)[:, 1])
    level = np.clip(np.log2(np.maximum(narrow, 1e-9)), 0.0, len(levels) - 1.0)
    assert (level == 0.0).mean() > 0.1
    assert (level == len(levels) - 1.0).mean() > 0.02
    colors = []
    for each in levels:
        flat = wrt.ImageTexture(
            each,
            scale=texture.scale,
            rotation_degrees=33.0,
            wrap=("mirror", "clamp"),  # type: ignore[arg-type]
        )
        colors.append(expected_bilinear(flat, uvs)[0])
    lower = np.minimum(level.astype(int), len(levels) - 2)
    share = (level - lower)[:, None]
    rows = np.arange(len(uvs))
    expected = np.stack(colors)[lower, rows] * (1.0 - share) + np.stack(colors)[lower + 1, rows] * share
    error = np.abs(out.numpy() - expected).max()
    report("largest error", float(error), "< 1e-4")
    assert error < 1e-4


# --- Pictures ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["path", "whitted"])
def test_one_sample_sees_the_mean_of_what_is_far_smaller_than_a_pixel(
    integrator: str, device: str, report: Report
) -> None:
    """The mean of light, of which a checkerboard is a closed form; that of the codes would be a quarter darker."""
    found = picture(floor(checker(), ABOVE, filter="trilinear"), device, 1, integrator=integrator)
    report("mean", float(found.mean()), MEAN)
    np.testing.assert_allclose(found, MEAN, rtol=1e-5)
    assert abs(float(of_codes(linear=False)[(BLACK + WHITE) // 2]) / MEAN - 1.0) > 0.2
    if integrator == "path":
        points = picture(floor(checker(), ABOVE), device, 1)
        report("spread without levels", float(points.std() / MEAN), "> 0.3")
        assert points.std() / MEAN > 0.3


@pytest.mark.slow
def test_few_samples_have_less_noise_and_many_see_the_same(device: str, report: Report) -> None:
    """Along a floor that goes from magnified to much smaller than pixels, and is seen at an angle."""
    level = {name: floor(clouds(), ALONG, filter=name) for name in ("bilinear", "trilinear")}
    true = picture(level["bilinear"], device, 4096, 32, seed=7)
    error = {
        (name, spp): float(np.sqrt(((picture(scene, device, spp, 32) - true) ** 2).mean()) / true.mean())
        for name, scene in level.items()
        for spp in (1, 4, 1024)
    }
    for spp in (1, 4, 1024):
        report(f"{spp} samples: error with levels, without", error["trilinear", spp], error["bilinear", spp])
    assert error["trilinear", 1] < 0.9 * error["bilinear", 1]
    assert error["trilinear", 4] < 0.9 * error["bilinear", 4]
    # The first sample alone, were it repeated, would leave the texture blurred.
    blurred = np.mean([picture(level["trilinear"], device, 1, 32, seed=seed) for seed in range(64)], axis=0)
    left = float(np.sqrt(((blurred - true) ** 2).mean()) / true.mean())
    report("the first sample of 64 seeds", left)
    assert error["trilinear", 1024] < 0.005
    assert left > 3.0 * error["trilinear", 1024]


def test_close_up_nothing_changes(device: str) -> None:
    near = wrt.OrthographicCamera((0.1, 3, 0.1), (0.1, 0, 0.1), up=(0, 0, -1), view_height=24 * 8.0 / SIZE * 0.9)
    bilinear = picture(floor(checker(), near), device, 3)
    np.testing.assert_array_equal(picture(floor(checker(), near, filter="trilinear"), device, 3), bilinear)
    assert bilinear.std() > 0.05


@pytest.mark.slow
def test_passes_leave_no_trace_and_layers_see_the_same(device: str) -> None:
    scene = floor(clouds(), ALONG, filter="trilinear")
    layers = ("albedo", "alpha")
    renderer = wrt.Renderer(scene, width=16, height=16, device=device, max_depth=2, layers=layers)
    for spp in (1, 2, 8):
        for _ in renderer.passes(spp=spp):
            pass
    np.testing.assert_array_equal(renderer.image()[..., 1], picture(scene, device, 8, 16, layers=layers))
    seen = renderer.layers()["alpha"] == 1.0
    assert seen.sum() > 100
    # The way to the sky is free everywhere.
    np.testing.assert_allclose(renderer.layers()["albedo"][seen], renderer.image()[seen], rtol=1e-5)


# --- Who has levels ----------------------------------------------------------------------------------


def test_kernels_look_for_levels_only_where_there_are_some() -> None:
    def mipmapped(**options: Any) -> bool:
        return bool(build_scene(floor(checker(), ABOVE, **options), Device("cpu")).features.mipmapped)

    assert mipmapped(filter="trilinear")
    assert not mipmapped()
    assert not mipmapped(filter="nearest")
    assert not mipmapped(filter="trilinear", cutoff=0.5)  # the mean of a mask is no mask


def test_levels_take_a_third_of_the_texels_and_are_there_once() -> None:
    data = SceneData()
    textures = [wrt.ImageTexture(clouds(), filter="trilinear", scale=scale) for scale in (1.0, 2.0)]
    describe_materials([wrt.Diffuse(texture) for texture in textures]).upload(data, Device("cpu"))
    assert len(data.texel_codes) == SIZE * SIZE
    assert len(data.texels) == (SIZE * SIZE - 1) // 3
    # Without levels another record reads the same texels.
    plain = wrt.ImageTexture(clouds())
    describe_materials([wrt.Diffuse(texture) for texture in (*textures, plain)]).upload(data, Device("cpu"))
    assert len(data.texel_codes) == SIZE * SIZE


@pytest.mark.parametrize(
    ("sampler", "filter"),
    [
        ({}, "bilinear"),
        ({"minFilter": 9729, "magFilter": 9729}, "bilinear"),
        ({"minFilter": 9987, "magFilter": 9729}, "trilinear"),
        ({"minFilter": 9985}, "trilinear"),
        ({"minFilter": 9987, "magFilter": 9728}, "nearest"),
    ],
)
def test_gltf_files_say_whether_they_want_levels(tmp_path: Any, sampler: dict[str, int], filter: str) -> None:
    tree = file_with({"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}})
    tree["samplers"] = [sampler]
    (tmp_path / "one.gltf").write_text(json.dumps(tree))
    (shape,) = load_shapes(tmp_path / "one.gltf")
    assert shape.material.base_color.filter == filter  # type: ignore[attr-defined]
