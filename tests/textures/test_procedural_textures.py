"""Procedural textures: their functions by closed forms and brute force, and the same in scenes as images."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from support.small_scenes import image_of
from support.wide_scenes import differences, needs_lanes

import wrt
from wrt.backend.warp_start import initialize_warp
from wrt.kernels.core.bsdf import slot_values
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.textures.noise import MEAN_DISTANCE, cells, clouds, perlin, worley
from wrt.kernels.textures.patterns import checkers, wall

Array = NDArray[Any]


@functools.cache
def kernel() -> wp.Kernel:
    @wp.kernel(enable_backward=False)
    def look_up(
        which: int,
        values: slot_values,
        place: wp.array(dtype=wp.vec3),
        footprint: wp.array(dtype=wp.vec4),
        out: wp.array(dtype=wp.vec3),
    ):
        i = wp.tid()
        surface = Surface()
        surface.position = place[i]
        surface.uv = wp.vec2(place[i][0], place[i][1])
        surface.footprint = footprint[i]
        if which == 0:
            out[i] = checkers(values, surface)
        elif which == 1:
            out[i] = wall(values, surface)
        elif which == 2:
            out[i] = clouds(values, surface)
        elif which == 3:
            out[i] = cells(values, surface)
        elif which == 4:
            out[i] = wp.vec3(perlin(place[i]))
        elif which == 5:
            out[i] = wp.vec3(worley(place[i], True))
        else:
            out[i] = wp.vec3(worley(place[i], False))

    return look_up


KINDS = (wrt.Checkerboard, wrt.Bricks, wrt.PerlinNoise, wrt.WorleyNoise)


def looked_up(texture: Any, places: Array, device: str, width: float = 0.0) -> Array:
    """Return (N,) reds at positions, whose x and y are texture coordinates, in a round footprint of this width.

    `texture` is a texture, or "perlin", "worley" in space, or "plane".
    """
    initialize_warp()
    values = np.zeros(slot_values._shape_, np.float32)
    if isinstance(texture, str):
        which = 4 + ("perlin", "worley", "plane").index(texture)
    else:
        which = KINDS.index(type(texture))
        for k, value in enumerate(texture.slots):
            values[k] = value
    footprints = np.tile(np.float32([width * width, width * width, 0.0, width * width]), (len(places), 1))
    out = wp.empty(len(places), dtype=wp.vec3, device=device)
    arrays = [wp.array(np.float32(x), dtype=t, device=device) for x, t in ((places, wp.vec3), (footprints, wp.vec4))]
    wp.launch(kernel(), len(places), [which, slot_values(*values.ravel().tolist()), *arrays, out], device=device)
    return np.float64(out.numpy()[:, 0])


def points(n: int, extent: float, seed: int = 1) -> Array:
    return np.float64(np.float32(np.random.default_rng(seed).uniform(-extent, extent, (n, 3))))


def hashed(cell: Array) -> Array:
    """Return (N, 3) random numbers of (N, 3) cells: pcg3d by whole numbers of 64 bits."""
    mask = np.uint64(0xFFFFFFFF)
    v = [(np.int64(cell[:, k]).astype(np.uint64) * np.uint64(1664525) + np.uint64(1013904223)) & mask for k in range(3)]
    for turn in range(2):
        for k in range(3):
            v[k] = (v[k] + v[(k + 1) % 3] * v[(k + 2) % 3]) & mask
        if turn == 0:
            v = [each ^ (each >> np.uint64(16)) for each in v]
    return np.stack([each >> np.uint64(8) for each in v], axis=-1) / 2.0**24


def brute_force(places: Array, *, solid: bool) -> Array:
    """Return the distance to the nearest of the points of all cells up to three away."""
    cell = np.floor(places)
    best = np.full(len(places), np.inf)
    for offset in np.ndindex(*((7, 7, 7) if solid else (7, 7, 1))):
        near = cell + np.array(offset) - np.array((3, 3, 3 if solid else 0))
        away = near + hashed(near) - places
        best = np.minimum(best, np.linalg.norm(away if solid else away[:, :2], axis=1))
    return best


@pytest.mark.slow
def test_patterns_are_their_closed_forms(device: str) -> None:
    uv = points(4000, 3.0)
    x, y = uv[:, 0], uv[:, 1]
    board = wrt.Checkerboard(0.9, 0.1, scale=(3.0, 5.0))
    even = (np.floor(np.float32(3.0) * np.float32(x)) + np.floor(np.float32(5.0) * np.float32(y))) % 2 == 0
    np.testing.assert_allclose(looked_up(board, uv, device), np.where(even, 0.9, 0.1), atol=1e-6)
    solid = wrt.Checkerboard(0.9, 0.1, solid=True)
    even = np.floor(uv).sum(axis=1) % 2 == 0
    np.testing.assert_allclose(looked_up(solid, uv, device), np.where(even, 0.9, 0.1), atol=1e-6)
    bricks = wrt.Bricks(1.0, 0.0, scale=(2.0, 4.0), mortar=0.2)
    course = np.floor(4.0 * y)
    across, up = (2.0 * x + 0.5 * (course % 2)) % 1.0, (4.0 * y) % 1.0
    expected = (np.abs(across - 0.5) < 0.45) & (np.abs(up - 0.5) < 0.4)
    clear = (np.abs(np.abs(across - 0.5) - 0.45) > 1e-5) & (np.abs(np.abs(up - 0.5) - 0.4) > 1e-5)
    np.testing.assert_array_equal(looked_up(bricks, uv, device)[clear], expected[clear])


@pytest.mark.slow
@pytest.mark.parametrize("width", [0.02, 0.1, 0.3])
def test_filtered_patterns_are_means_over_the_footprint(width: float, device: str) -> None:
    uv = points(300, 3.0)
    n = 64
    step = (np.arange(n) + 0.5) / n - 0.5
    offsets = np.stack([*np.meshgrid(step, step), np.zeros((n, n))], axis=-1).reshape(-1, 3) * width
    around = (uv[:, None] + offsets).reshape(-1, 3)
    texture = wrt.Checkerboard(0.9, 0.1, scale=(3.0, 5.0))
    mean = looked_up(texture, around, device).reshape(len(uv), -1).mean(axis=1)
    np.testing.assert_allclose(looked_up(texture, uv, device, width), mean, atol=0.8 * 2 / n)
    # In one course of bricks; across several, other courses lie otherwise than the one of the middle.
    bricks = wrt.Bricks(1.0, 0.0, scale=(2.0, 0.1), mortar=0.02)
    inside = np.abs((0.1 * uv[:, 1]) % 1.0 - 0.5) + 0.05 * width < 0.48
    mean = looked_up(bricks, around, device).reshape(len(uv), -1).mean(axis=1)
    np.testing.assert_allclose(looked_up(bricks, uv, device, width)[inside], mean[inside], atol=2 / n)


@pytest.mark.slow
@pytest.mark.parametrize("texture", [kind(0.9, 0.2, scale=(2.0, 3.0)) for kind in KINDS], ids=lambda t: t.type_name)
def test_far_away_there_is_the_mean(texture: Any, device: str) -> None:
    uv = points(200_000, 50.0)
    near = looked_up(texture, uv, device)
    far = looked_up(texture, uv[:100], device, 400.0)
    assert np.ptp(far) < 2e-3
    # Places of one cell are alike: some 30 fall into each.
    assert abs(far.mean() - near.mean()) < 2e-3 + 3.5 * near.std() * np.sqrt(30 / len(near))


@pytest.mark.slow
def test_perlin_is_zero_on_the_lattice_and_within_its_range(device: str) -> None:
    lattice = np.stack(np.meshgrid(*[np.arange(-6.0, 6.0)] * 3), axis=-1).reshape(-1, 3)
    np.testing.assert_array_equal(looked_up("perlin", lattice, device), 0.0)
    values = looked_up("perlin", points(300_000, 40.0), device)
    assert 0.8 < np.abs(values).max() <= 1.04  # its bound is 1.0363 in three dimensions
    assert abs(values.mean()) < 0.01
    # By its gradients: the slope at a lattice point is one of twelve vectors, each of length √2.
    h = 1e-3
    slopes = np.stack([looked_up("perlin", lattice + h * axis, device) / h for axis in np.eye(3)], axis=-1)
    np.testing.assert_allclose(np.sort(np.abs(slopes), axis=1), [[0.0, 1.0, 1.0]] * len(slopes), atol=2e-2)
    kinds, counts = np.unique(np.rint(slopes), axis=0, return_counts=True)
    assert len(kinds) == 12
    assert counts.min() > len(slopes) / 30


@pytest.mark.slow
def test_worley_is_the_distance_by_brute_force(device: str) -> None:
    places = points(20_000, 30.0)
    for solid, name in ((True, "worley"), (False, "plane")):
        at = places if solid else places * (1.0, 1.0, 0.0)
        np.testing.assert_allclose(looked_up(name, at, device), brute_force(at, solid=solid), atol=5e-6)
    plane = np.minimum(looked_up("plane", points(400_000, 300.0) * (1.0, 1.0, 0.0), device), 1.0)
    assert abs(plane.mean() - MEAN_DISTANCE) < 3.5 * plane.std() / np.sqrt(400_000 / 2)


def plane_of(material: wrt.Material) -> wrt.Scene:
    scene = wrt.Scene(camera=wrt.OrthographicCamera((0.0, 0.0, 3.0), view_height=2.0))
    scene.environment = wrt.ConstantEnvironment(1.0)
    scene.add(wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)), material=material)
    return scene


@pytest.mark.slow
def test_a_checkerboard_reflects_and_covers_as_its_image_does(device: str) -> None:
    """Under uniform light a Lambertian plane has the radiance of its reflectance; holes show the light behind."""
    pixels = np.float32([[0.8, 0.2], [0.2, 0.8]])[:, :, None] * np.ones(3, np.float32)
    image = wrt.ImageTexture(pixels, filter="nearest", scale=2.0)
    board = wrt.Checkerboard(0.2, 0.8, scale=4.0)
    how: dict[str, Any] = {"width": 16, "height": 16, "filter": "box", "device": device}
    for field in ("reflectance", "opacity"):
        found = [
            image_of(wrt.Renderer(plane_of(wrt.Diffuse(**{"reflectance": 0.5, field: value})), **how), 64)
            for value in (board, image)
        ]
        # Away from edges, where one is filtered, both follow from the same random numbers.
        inside = np.ix_(*[[k for k in range(16) if k % 4 in (1, 2)]] * 2)
        np.testing.assert_allclose(found[0][inside], found[1][inside], atol=2e-6)
        assert found[0].mean() == pytest.approx(found[1].mean(), abs=5e-3)
        assert found[0].std() > 0.05


ALL = tuple(kind(0.2, 0.7, scale=3.0, solid=solid) for kind in KINDS for solid in (False, True))


@needs_lanes
@pytest.mark.slow
def test_wide_kernels_have_the_bits_of_scalar_ones() -> None:
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.0, 5.0)), environment=wrt.ConstantEnvironment(0.5))
    for k, texture in enumerate(ALL):
        at = (0.8 * (k % 4) - 1.2, 0.8 * (k // 4) - 0.4, 0.0)
        material = wrt.Diffuse(texture) if k % 2 else wrt.OrenNayar(0.5, texture)  # fewer values than the textures
        scene.add(wrt.spheres([at], 0.35), material=material)
    scene.add(wrt.quad((-4, -0.8, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse(0.5, opacity=ALL[4]))
    scene.add_light(wrt.DiskLight((0.0, 3.0, 1.0), (0.0, -1.0, 0.0), 0.7, 9.0))
    assert differences(scene) == []


# --- Without kernels ----------------------------------------------------------------------------------


def test_they_are_written_and_read(tmp_path: Any) -> None:
    scene = plane_of(wrt.Diffuse(wrt.Checkerboard("red", 0.1, scale=(2, 3))))
    scene.add(wrt.box(), material=wrt.RoughConductor(wrt.PerlinNoise(0.1, 0.4, octaves=2, factor=0.5)))
    scene.add(wrt.box(), material=wrt.Mix(wrt.Mirror(), wrt.Diffuse(), wrt.Bricks(1.0, 0.0, mortar=0.2)))
    scene.add(wrt.box(), material=wrt.Principled(opacity=wrt.WorleyNoise(0.0, 1.0, solid=True)))
    wrt.save_scene(tmp_path / "a.toml", scene)
    again = wrt.load(tmp_path / "a.toml")
    assert [shape.material for shape in again.shapes] == [shape.material for shape in scene.shapes]
    with pytest.warns(wrt.InputWarning, match="cannot hold procedural textures: the mean of their colours is written"):
        wrt.save_scene(tmp_path / "a.glb", wrt.Scene(shapes=scene.shapes[:1]))
    assert wrt.load(tmp_path / "a.glb").shapes[0].material.base_color[0] == pytest.approx(0.55, abs=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: wrt.Diffuse(wrt.Checkerboard(0.5, 1.5)), r"reflectance\[0\] must be at most 1, not 1\.5"),
        (lambda: wrt.RoughConductor(wrt.PerlinNoise(0.0, 0.5)), "alpha must be at least"),
        (lambda: wrt.Shape(wrt.box(), emission=wrt.Bricks()), "a bricks texture cannot emit: lights are chosen by"),
        (lambda: wrt.Principled(anisotropy=wrt.Bricks(0.1, 0.2)), "anisotropy must be a number, or an image"),
        (lambda: wrt.Checkerboard(scale=(1, 2, 3, 4)), "scale must be three numbers"),
    ],
)
def test_what_they_cannot_be_is_refused(make: Any, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        make()


def test_an_unregistered_texture_is_named() -> None:
    unknown = type("Unknown", (wrt.Texture,), {"type_name": "unknown"})
    with pytest.raises(wrt.InputError, match="Unknown: there is no texture 'unknown'; register it"):
        wrt.Renderer(plane_of(wrt.Diffuse(unknown())), width=4, height=4)
