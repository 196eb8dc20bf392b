"""The light tree holds all lights, chooses each as often as it says, and leaves none out that could be seen.

Pictures are the same whichever way lights are chosen.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from support.covering_kernels import covering, render_with
from support.irradiance import EVERY_LIGHT, check, floor_scene, irradiance, pixel_mean
from support.kernels import uniforms, upload
from support.media import mean_and_error, render
from support.statistics import chi_square_test, image_z_test

import wrt
import wrt.upload.lights.choice
from wrt.backend.device import Device
from wrt.kernels.geometry.rays import RECEIVES_ANYWHERE, RECEIVES_BOTH, RECEIVES_FRONT
from wrt.kernels.lights.tree import (
    FAR_LIGHT,
    LightTree,
    far_light_probability,
    light_tree_probability,
    sample_light_tree,
)
from wrt.upload.lights.bounds import LightBounds
from wrt.upload.lights.tree import WIDTH, build_light_tree
from wrt.upload.lights.tree import LightTree as HostTree
from wrt.upload.scene_data import build_scene

SIDES = {"anywhere": int(RECEIVES_ANYWHERE), "front": int(RECEIVES_FRONT), "both": int(RECEIVES_BOTH)}


@wp.kernel(enable_backward=False)
def draw_lights(
    tree: LightTree,
    position: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    receives: int,
    u: wp.array(dtype=wp.vec2),
    light_out: wp.array2d(dtype=int),
    probability_out: wp.array2d(dtype=float),
    rest_out: wp.array2d(dtype=wp.vec2),
):
    i, j = wp.tid()
    choice = sample_light_tree(tree, position[i], normal[i], receives, u[j])
    light_out[i, j] = choice.light
    probability_out[i, j] = choice.probability
    rest_out[i, j] = wp.vec2(choice.rest, choice.more)


@wp.kernel(enable_backward=False)
def probabilities_of_lights(
    tree: LightTree,
    position: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    receives: int,
    probability_out: wp.array2d(dtype=float),
):
    i, j = wp.tid()
    if j < tree.places.shape[0]:
        probability_out[i, j] = light_tree_probability(tree, j, position[i], normal[i], receives)
    else:
        probability_out[i, j] = far_light_probability(tree, position[i], normal[i], receives)


def on_device(tree: HostTree, device: str, far: float = 0.0) -> LightTree:
    result = LightTree()
    result.nodes = upload(tree.nodes.ravel(), float, device)
    result.parents = upload(tree.parents, int, device)
    result.places = upload(tree.places, int, device)
    result.scale = tree.scale
    result.far = far
    return result


def drawn(
    tree: HostTree, position: NDArray, normal: NDArray, receives: int, u: NDArray, device: str, far: float = 0.0
) -> tuple[NDArray, NDArray, NDArray]:
    """Return (points, samples) lights, their probabilities and what is left of the numbers."""
    shape = (len(position), len(u))
    out = [wp.empty(shape, dtype=dtype, device=device) for dtype in (int, float, wp.vec2)]
    arrays = [upload(position, wp.vec3, device), upload(normal, wp.vec3, device), receives, upload(u, wp.vec2, device)]
    wp.launch(draw_lights, shape, [on_device(tree, device, far), *arrays], out, device=device)
    return out[0].numpy(), out[1].numpy(), out[2].numpy()


def probabilities(
    tree: HostTree, position: NDArray, normal: NDArray, receives: int, device: str, far: float = 0.0
) -> NDArray:
    """Return (points, lights) probabilities, or (points, lights + 1) where there are far lights, these last."""
    out = wp.empty((len(position), len(tree.places) + (far > 0.0)), dtype=float, device=device)
    arrays = [upload(position, wp.vec3, device), upload(normal, wp.vec3, device), receives]
    wp.launch(probabilities_of_lights, out.shape, [on_device(tree, device, far), *arrays], [out], device=device)
    return out.numpy().astype(np.float64)


# --- Lights ---------------------------------------------------------------------------------------


def unit(v: NDArray) -> NDArray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def triangles(n: int, seed: int, size: float = 0.1) -> NDArray:
    rng = np.random.default_rng(seed)
    return (rng.random((n, 1, 3)) * [4.0, 1.0, 4.0] + size * rng.normal(size=(n, 3, 3))).astype(np.float32)


def points_of(position: ArrayLike, power: ArrayLike) -> LightBounds:
    """Return point lights."""
    return LightBounds.of(np.asarray(position)[:, None], (0.0, 1.0, 0.0), power, cos_spread=-1.0)


def triangles_of(corners: ArrayLike, power: ArrayLike, two_sided: ArrayLike = False) -> LightBounds:
    """Return triangles that shine."""
    c = np.asarray(corners, np.float64)
    normal = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    axis = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return LightBounds.of(c, axis, power, two_sided=two_sided)


def spots(n: int, seed: int) -> LightBounds:
    """Return narrow beams from single points."""
    rng = np.random.default_rng(seed)
    axis = unit(rng.normal(size=(n, 3)))
    return LightBounds.of(rng.random((n, 1, 3)) * 4.0, axis, rng.random(n), cos_falloff=0.9)


def some_lights(name: str) -> LightBounds:
    rng = np.random.default_rng(7)
    if name == "one":
        return triangles_of(triangles(1, 1), 1.0)
    if name == "all at one point":
        return points_of(np.ones((100, 3)), 1.0)
    if name == "the same triangle":
        return triangles_of(np.repeat(triangles(1, 2), 50, axis=0), 1.0)
    if name == "ever nearer":  # the deepest of trees
        return points_of(0.5 ** np.arange(100.0)[:, None] * [1.0, 1.0, 1.0], 1.0)
    if name == "some without power":
        return triangles_of(triangles(200, 3), np.where(rng.random(200) < 0.5, 0.0, rng.random(200)))
    if name == "uneven powers":
        return triangles_of(triangles(200, 3), 10.0 ** rng.uniform(-20.0, 20.0, 200))
    if name == "degenerate triangles":
        return triangles_of(np.repeat(triangles(20, 3)[:, :1], 3, axis=1), 1.0)
    if name == "tiny":
        return triangles_of(triangles(100, 4) * 1e-9, 1.0)
    if name == "huge":
        return triangles_of(triangles(100, 4) * 1e9, 1.0)
    if name == "in a plane":
        flat = triangles(400, 5) * [1.0, 0.0, 1.0]
        normal = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
        return triangles_of(np.where(normal[:, 1:2, None] > 0.0, flat, flat[:, ::-1]), 1.0)  # all upwards
    mixed = triangles_of(triangles(300, 5), rng.random(300), rng.random(300) < 0.3)
    return LightBounds.joined([mixed, points_of(rng.random((50, 3)), rng.random(50)), spots(50, 6)])


KINDS = ("one", "all at one point", "the same triangle", "ever nearer", "some without power", "uneven powers")
KINDS += ("degenerate triangles", "tiny", "huge", "in a plane", "mixed")


def points_and_normals(lights: LightBounds) -> tuple[NDArray, NDArray]:
    """Return points among the lights, on them, in a plane with them, behind them and far away."""
    rng = np.random.default_rng(9)
    low, high = lights.center.min(axis=0), lights.center.max(axis=0)
    size = max(float((high - low).max()), float(lights.radius.max()), 1e-12)
    some = rng.integers(0, len(lights), 6)
    points = np.concatenate(
        [
            low + rng.random((8, 3)) * (high - low),
            lights.center[some],
            lights.center[some] + size * np.cross(lights.axis[some], unit(rng.normal(size=(6, 3)))),
            lights.center[some] - 0.1 * size * lights.axis[some],
            low + 1e4 * size * unit(rng.normal(size=(4, 3))),
        ]
    )
    normals = unit(rng.normal(size=(len(points), 3)))
    normals[3:6] = [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]
    normals[8:11] = lights.axis[some[:3]]
    return points.astype(np.float32), normals.astype(np.float32)


# --- The tree -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_hold_what_is_below_them(kind: str) -> None:
    lights = some_lights(kind)
    tree = build_light_tree(lights)
    children = tree.nodes[:, -1].view(np.int32)
    powers = tree.nodes[:, -2].astype(np.float64)
    below: dict[int, list[int]] = {}
    for node in reversed(range(len(tree.nodes))):
        below[node] = []
        sums = []
        for k in np.flatnonzero(powers[node] > 0.0):
            child = children[node, k]
            place = WIDTH * node + k
            assert (tree.parents[child] if child >= 0 else tree.places[-1 - child]) == place
            leaves = below[child] if child >= 0 else [-1 - child]
            below[node] += leaves
            sums.append(lights.facing_power[leaves].sum())
            assert_holds(tree.nodes[node, :, k].astype(np.float64), lights.take(np.array(leaves)))
        share = powers[node][powers[node] > 0.0]
        np.testing.assert_allclose(share / share.max(), np.maximum(np.divide(sums, max(sums)), 1e-30), rtol=1e-6)
    assert sorted(below[0]) == np.flatnonzero(lights.power > 0.0).tolist()
    assert (tree.places[lights.power == 0.0] == -1).all()
    assert tree.parents[0] == -1


def assert_holds(child: NDArray, lights: LightBounds) -> None:
    """Check one child's numbers against all lights below it."""
    center, half, radius, axis = child[:3], child[3:6], abs(child[6]), child[7:10]
    assert (np.abs(lights.center - center) + lights.half <= half).all()
    assert (np.linalg.norm(lights.center - center, axis=1) + lights.radius <= radius).all()
    cosine = lights.axis @ axis
    cosine = np.where(lights.two_sided & (child[6] < 0.0), np.abs(cosine), cosine)
    spread = np.arccos(np.clip(cosine, -1.0, 1.0)) + np.arccos(lights.cos_spread)
    assert (np.arccos(np.clip(child[10], -1.0, 1.0)) >= np.minimum(spread, np.pi) - 1e-6).all()
    assert (child[11] <= lights.cos_falloff).all()
    assert (child[6] < 0.0) == lights.two_sided.any()
    # The cosine is rounded to 6e-8 of itself, the sine then by that over the sine.
    assert abs(child[12] - np.sqrt(max(0.0, 1.0 - child[10] ** 2))) <= 1e-6 + 1e-7 / max(child[12], 1e-4)
    along = np.abs((lights.center - center) @ axis)
    assert (child[13] >= along + np.minimum(lights.depth, lights.radius) * np.abs(cosine) - 1e-6 * radius).all()


def test_nothing_shines() -> None:
    tree = build_light_tree(points_of(np.zeros((3, 3)), 0.0))
    assert tree.nodes.shape[0] == 0
    assert (tree.places == -1).all()
    assert len(build_light_tree(points_of(np.zeros((0, 3)), 0.0)).places) == 0


def test_nodes_are_well_filled() -> None:
    tree = build_light_tree(triangles_of(triangles(20_000, 1, size=0.01), 1.0))
    assert (tree.nodes[:, -2] > 0.0).sum(axis=1).mean() >= 5.0


# --- The choice -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("receives", SIDES.values(), ids=SIDES)
def test_lights_are_drawn_as_often_as_said(kind: str, receives: int, device: str) -> None:
    lights = some_lights(kind)
    tree = build_light_tree(lights)
    position, normal = points_and_normals(lights)
    said = probabilities(tree, position, normal, receives, device)
    assert np.isfinite(said).all()
    assert (said >= 0.0).all()
    assert (said.sum(axis=1) <= 1.0 + 1e-5).all()
    if receives != SIDES["front"] and not (lights.cos_falloff > 0.0).any() and lights.cos_spread.max() == -1.0:
        np.testing.assert_allclose(said.sum(axis=1), 1.0, rtol=1e-5)
    u = uniforms(2**14, 2, seed=3)
    light, probability, _ = drawn(tree, position, normal, receives, u, device)
    chosen = light >= 0
    assert (probability[~chosen] == 0.0).all()
    # The walk up gives what the walk down gave, bit for bit.
    rows = np.nonzero(chosen)[0]
    assert (said.astype(np.float32)[rows, light[chosen]] == probability[chosen]).all()
    tests = len(position) * len(KINDS) * len(SIDES)
    for i in range(len(position)):
        counts = np.append(np.bincount(light[i][chosen[i]], minlength=len(lights)), (~chosen[i]).sum())
        expected = len(u) * np.append(said[i], 1.0 - said[i].sum())
        if expected.max() > len(u) - 10.0:  # no two cells to compare
            assert len(u) - counts[np.argmax(expected)] < 40
            assert counts[expected == 0.0].sum() == 0
            continue
        # Rounding may leave a little for no light where there always is one.
        expected[-1] = expected[-1] if expected[-1] > 0.1 else 0.0
        result = chi_square_test(counts, expected, tests=tests)
        assert result.passed, f"point {i}: {result.message}"


@pytest.mark.parametrize("far", [1e-6, 1e6])
def test_far_lights_have_a_share(far: float, device: str, report: Report) -> None:
    lights = some_lights("mixed")
    tree = build_light_tree(lights)
    position, normal = points_and_normals(lights)
    said = probabilities(tree, position, normal, SIDES["front"], device, far)
    u = uniforms(2**14, 2, seed=3)
    light, probability, rest = drawn(tree, position, normal, SIDES["front"], u, device, far)
    report("shares, least and greatest", f"{said[:, -1].min():.3f} {said[:, -1].max():.3f}", "0.2 to 0.8, or 1")
    alone = said[:, -1] == 1.0
    assert alone.any()
    assert (said[alone, :-1] == 0.0).all()
    assert ((said[~alone, -1] > 0.1999) & (said[~alone, -1] < 0.8001)).all()
    is_far = light == int(FAR_LIGHT)
    assert (probability[is_far] == said.astype(np.float32)[np.nonzero(is_far)[0], -1]).all()
    for i in range(len(position)):
        found = np.where(is_far[i], len(lights), light[i])
        counts = np.bincount(found[found >= 0], minlength=len(lights) + 1)
        if said[i, -1] < 1.0:
            result = chi_square_test(counts, len(u) * said[i], samples=len(u), tests=len(position), total_tolerance=2.0)
            assert result.passed, result.message
    # What is left of the numbers is uniform, whatever was chosen.
    for chosen in (is_far[0], light[0] >= 0):
        counts, _, _ = np.histogram2d(*rest[0][chosen].T, bins=8, range=[[0.0, 1.0], [0.0, 1.0]])
        result = chi_square_test(counts, np.full((8, 8), chosen.sum() / 64.0), tests=2)
        assert result.passed, result.message


def test_lights_rarer_than_a_float_can_choose(device: str, report: Report) -> None:
    """Lights that share 1024 of the 2^24 values of the first number, unevenly: the second number tells them apart."""
    rng = np.random.default_rng(0)
    n = 1024
    lights = points_of(rng.random((n + 1, 3)), np.r_[rng.random(n) * 2.0**-23, 1.0])
    tree = build_light_tree(lights)
    far = np.array([[0.0, 1000.0, 0.0]], np.float32)
    said = probabilities(tree, far, far, SIDES["anywhere"], device)[0]
    assert 2.0**-15 < said[:-1].sum() < 2.0**-13
    # The bright light has a run of values; those before and behind it belong to the others.
    values = np.r_[0:1100, 2**24 - 1100 : 2**24].astype(np.float32) / np.float32(2**24)
    both = [drawn(tree, far, far, 0, np.stack([values, np.full_like(values, x)], 1), device)[0][0] for x in (0, 0.9999)]
    values = values[(both[0] < n) & (both[1] < n)]
    assert 900 < len(values) < 1100
    u = uniforms(2**18, 2, seed=1)
    u[:, 0] = values[rng.integers(0, len(values), len(u))]
    light, _, _ = drawn(tree, far, far, SIDES["anywhere"], u, device)
    assert light.max() < n
    counts = np.bincount(light[0], minlength=n)
    expected = len(u) * said[:-1] / (len(values) / 2**24)
    wrong = np.flatnonzero(np.abs(counts - expected) > 5.0 * np.sqrt(expected) + 1.0)
    report("rare lights that do not get their share", len(wrong), "2 at most, beside the bright one")
    assert len(wrong) <= 2


@pytest.mark.parametrize("receives", SIDES.values(), ids=SIDES)
def test_no_light_that_reaches_a_point_is_left_out(receives: int, device: str, report: Report) -> None:
    """Small scenes of all kinds, with many points each, half of them close to some light."""
    reached = missed = 0
    for seed in range(16):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 60))
        corners = triangles(n, seed, size=float(10.0 ** rng.uniform(-4, 0.5)))
        if seed % 3 == 0:
            corners[:, :, rng.integers(3)] = 0.5
        corners = (corners + np.float32(10.0 ** rng.uniform(-1, 2))).astype(np.float32)
        two_sided = rng.random(n) < (seed % 2) * 0.5
        lights = triangles_of(corners, 10.0 ** rng.uniform(-3, 3, n), two_sided)
        points = corners[rng.integers(0, n, 300), rng.integers(0, 3, 300)]
        points[:150] += (rng.normal(size=(150, 3)) * 10.0 ** rng.uniform(-3, 1, (150, 1))).astype(np.float32)
        normals = unit(rng.normal(size=points.shape)).astype(np.float32)
        normals[::5] = lights.axis[rng.integers(0, n, 60)]
        said = probabilities(build_light_tree(lights), points, normals, receives, device)
        sees = reaches(corners.astype(np.float64), two_sided, points, normals, receives)
        reached += int(sees.sum())
        missed += int((said[sees] == 0.0).sum())
    report("pairs of points and lights, left out", f"{reached}, {missed}", 0)
    assert reached > 40_000
    assert missed == 0


@pytest.mark.parametrize("widest", ["narrow", "wide"])
def test_no_beam_that_reaches_a_point_is_left_out(widest: str, device: str) -> None:
    """Points just inside the edges of beams, from less than a degree to 90: roots in the kernel may be of 14 bits."""
    rng = np.random.default_rng(4)
    n = 200
    position, axis = rng.random((n, 3)) * 4.0, unit(rng.normal(size=(n, 3)))
    cos_falloff = 1.0 - 10.0 ** rng.uniform(-6.0, -1.0, n)
    if widest == "wide":
        cos_falloff = np.cos(np.radians(rng.uniform(50.0, 90.0, n)))
    lights = LightBounds.of(position[:, None], axis, 1.0, cos_falloff=cos_falloff)
    tree = build_light_tree(lights)
    for _ in range(10):
        angle = 0.99 * np.arccos(cos_falloff)
        aside = unit(np.cross(axis, rng.normal(size=(n, 3))))
        way = axis * np.cos(angle)[:, None] + aside * np.sin(angle)[:, None]
        points = (position + way * 10.0 ** rng.uniform(-1.0, 3.0, (n, 1))).astype(np.float32)
        said = probabilities(tree, points, -way.astype(np.float32), SIDES["front"], device)
        assert (np.diagonal(said) > 0.0).all()


def reaches(
    corners: NDArray, two_sided: NDArray, points: NDArray, normals: NDArray, receives: int
) -> NDArray[np.bool_]:
    """Return (points, lights) whether any point of a triangle lights a point."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    in_front = ((points[:, None] - corners[None, :, 0]) * normal).sum(axis=2)
    shines = (in_front > 0.0) | (two_sided & (in_front < 0.0))
    if receives != SIDES["front"]:
        return shines
    heights = ((corners[None] - points[:, None, None]) * normals[:, None, None]).sum(axis=3)
    return shines & (heights.max(axis=2) > 0.0)


def test_points_without_a_normal_ignore_it(device: str) -> None:
    lights = some_lights("mixed")
    tree = build_light_tree(lights)
    position, normal = points_and_normals(lights)
    a, b = (probabilities(tree, position, n, SIDES["anywhere"], device) for n in (normal, np.full_like(normal, np.nan)))
    assert (a == b).all()
    c, d = (probabilities(tree, position, n, SIDES["both"], device) for n in (normal, -normal))
    np.testing.assert_array_equal(c, d)


def test_near_lights_and_those_that_face_the_point_are_preferred(report: Report, device: str) -> None:
    """The variance of unshadowed light over that of the choice by power, for lights of a large room."""
    rng = np.random.default_rng(0)
    corners = triangles(2000, 11, size=0.02) * np.float32(5.0)
    lights = triangles_of(corners, rng.lognormal(size=2000))
    points = (rng.random((50, 3)) * [20.0, 5.0, 20.0]).astype(np.float32)
    normals = unit(rng.normal(size=points.shape)).astype(np.float32)
    said = probabilities(build_light_tree(lights), points, normals, SIDES["front"], device)
    way = lights.center - points[:, None]
    distance2 = (way**2).sum(axis=2)
    cosines = np.maximum((way * normals[:, None]).sum(axis=2), 0.0) * np.maximum(-(way * lights.axis).sum(axis=2), 0.0)
    arriving = lights.power * cosines / distance2**2
    total = arriving.sum(axis=1) ** 2

    def variance(p: NDArray) -> float:
        second = np.divide(arriving**2, p, out=np.zeros_like(arriving), where=arriving > 0.0).sum(axis=1)
        return float(np.mean(second / total - 1.0))

    by_tree, by_power = variance(said), variance(np.broadcast_to(lights.power / lights.power.sum(), said.shape))
    report("relative variance by tree, by power", f"{by_tree:.2f}, {by_power:.2f}")
    assert by_tree < 0.05 * by_power


# --- Pictures -------------------------------------------------------------------------------------


def test_wide_spots_among_many_lights(device: str, report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    """Spots of up to 90 degrees to their axes, turned every way: the floor has the sum of I f(θ) cosθ' / r²."""
    render_with([EVERY_LIGHT], monkeypatch)
    rng = np.random.default_rng(5)
    scene = floor_scene()
    places, axes = rng.uniform([-2.0, 0.6, -2.0], [2.0, 2.0, 2.0], (60, 3)), unit(rng.normal(size=(60, 3)))
    inner, outer = rng.uniform(20.0, 60.0, 60), rng.uniform(70.0, 90.0, 60)
    for place, axis, a, b in zip(places, axes, inner, outer, strict=True):
        cone = {"inner_degrees": a, "outer_degrees": b, "falloff": "linear"}
        scene.add_light(wrt.SpotLight(tuple(place), tuple(axis), intensity=1.0, **cone))
    assert build_scene(scene, Device("cpu"), light_choice="tree").features.light_tree
    where, measured, variance = irradiance(scene, device, 1024, light_choice="tree")

    def exact(x: NDArray, z: NDArray) -> NDArray:
        total = np.zeros_like(x)
        for place, axis, a, b in zip(places, axes, inner, outer, strict=True):
            way = np.stack([x - place[0], np.full_like(x, -place[1]), z - place[2]])
            r = np.linalg.norm(way, axis=0)
            angle = np.degrees(np.arccos(np.einsum("k,k...->...", axis, way) / r))
            total += np.clip((b - angle) / (b - a), 0.0, 1.0) * place[1] / r**3
        return total

    check("wide spots", measured, variance, pixel_mean(exact, where), 1024, report)


FOG = replace(covering("diffuse"), media="scattering")


def test_fog_with_many_lights(device: str, report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over a floor in fog, the light tree and the choice by power have one mean, at surfaces and in the air."""
    render_with([FOG], monkeypatch)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.2, 5.5), (0.0, 0.8, 0.0), fov_degrees=40.0))
    scene.medium = wrt.Medium(absorption=(0.02, 0.05, 0.1), scattering=(0.2, 0.15, 0.1), g=0.4)
    scene.add(wrt.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), material=wrt.Diffuse(0.6))
    scene.add(lamps(80, 1), material=wrt.Diffuse(0.2), emission=(0.9, 0.6, 0.3))
    scene.add_light(wrt.SpotLight((1.0, 1.9, 1.0), (-0.4, -1.0, -0.5), intensity=0.6, outer_degrees=100.0))
    scene.add_light(wrt.SphereLight((-1.0, 0.5, 0.8), 0.2, radiance=(0.5, 0.1, 0.1)))
    options = {"size": (24, 24), "spp": 512, "max_depth": 6}
    found = {
        choice: mean_and_error(render(scene, device, light_choice=choice, seed=seed, **options))
        for seed, choice in enumerate(("tree", "power"))
    }
    (tree, tree_error), (power, power_error) = found.values()
    report("tree, power", str(tree.round(5)), str(power.round(5)))
    error = np.hypot(tree_error, power_error)
    assert (np.abs(tree - power) < 3.5 * error).all()
    assert (3.5 * error < 0.06 * power).all()


def lamps(n: int, seed: int, size: float = 0.12) -> wrt.Mesh:
    """Return small triangles in a room, each a mesh's own corners."""
    rng = np.random.default_rng(seed)
    points = rng.random((n, 1, 3)) * [3.6, 1.8, 3.6] + [-1.8, 0.1, -1.8] + size * rng.normal(size=(n, 3, 3))
    return wrt.Mesh(
        points.reshape(-1, 3).clip([-1.95, 0.02, -1.95], [1.95, 1.98, 1.95]), np.arange(3 * n).reshape(n, 3)
    )


def room(*, glass: bool) -> wrt.Scene:
    """Return a room open to the sky, with all kinds of lights, glass and a wall that lets some light through."""
    image = np.full((8, 16, 3), 0.02, np.float32)
    image[1, 3] = (6.0, 5.0, 4.0)
    scene = wrt.Scene(environment=wrt.ImageEnvironment(image))
    scene.camera = wrt.PerspectiveCamera((0.0, 1.2, 5.5), (0.0, 0.8, 0.0), fov_degrees=40.0)
    scene.settings.max_depth = 4
    scene.add(wrt.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), material=wrt.Diffuse(0.6))
    metal = wrt.RoughConductor(0.3, metal="copper") if glass else wrt.Diffuse((0.7, 0.4, 0.2))
    scene.add(wrt.quad((-2, 0, -2), (4, 0, 0), (0, 2, 0)), material=metal)
    half = wrt.Diffuse((0.3, 0.5, 0.7), opacity=0.6)
    scene.add(wrt.quad((-2, 0, 2), (0, 0, -4), (0, 2, 0)), material=half)
    scene.add(lamps(120, 1), material=wrt.Diffuse(0.2), emission=(0.9, 0.6, 0.3))
    scene.add(lamps(60, 2), material=wrt.Diffuse(0.2), emission=(0.3, 0.6, 0.9), two_sided_emission=True)
    if glass:
        ball = wrt.sphere((0.6, 0.5, 0.8), 0.45)
        scene.add(ball, material=wrt.RoughDielectric(alpha=0.3))
    for k in range(4):
        scene.add_light(wrt.PointLight((k - 1.5, 1.5, 0.3), intensity=(0.05, 0.02 * k, 0.03)))
    scene.add_light(wrt.SpotLight((1.0, 1.9, 1.0), (-0.4, -1.0, -0.5), intensity=0.6, outer_degrees=25.0))
    scene.add_light(wrt.SphereLight((-1.0, 0.5, 0.8), 0.2, radiance=(0.5, 0.1, 0.1)))
    scene.add_light(wrt.RectangleLight((0.0, 1.2, -1.5), (0.6, 0, 0), (0, 0.4, 0), radiance=(0.2, 0.8, 0.2)))
    scene.add_light(wrt.DirectionalLight((0.5, -1.0, -0.3), irradiance=0.4))
    return scene


GLOSSY = covering("diffuse", "rough-conductor", "rough-dielectric", opacity=True)


@functools.cache
def rendered(choice: str, strategy: str, device: str, seed: int, glass: bool) -> tuple[NDArray, NDArray]:
    options = {"light_choice": choice, "strategy": strategy, "device": device, "seed": seed}
    renderer = wrt.Renderer(room(glass=glass), width=32, height=32, sampler="independent", **options)
    for _ in renderer.passes(spp=1024 if glass else 256):
        pass
    assert not renderer.film.rejected
    return renderer.image(), renderer.variance()


@pytest.mark.parametrize(
    ("strategy", "glass"),
    [("mis", False), *(pytest.param(s, True, marks=pytest.mark.slow) for s in ("mis", "light", "bsdf"))],
)
def test_the_tree_shows_what_power_shows(
    strategy: str, glass: bool, device: str, report: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against the choice by power, with each estimator: their densities must be those of their samples."""
    render_with([GLOSSY if glass else EVERY_LIGHT], monkeypatch)
    tree = rendered("tree", strategy, device, 1, glass)
    power = rendered("power", "mis", device, 2, glass)
    spp = 1024 if glass else 256
    test = image_z_test(*tree, *power, n_a=spp, n_b=spp)
    report(f"{strategy}: mean variance, of power's", float(tree[1].mean() / power[1].mean()))
    report(f"{strategy}: worst block", test.message, p=test.block_p)
    assert test.agrees(), test.message
    if strategy == "mis":  # a share that is five per cent wrong is noticed
        assert not image_z_test(tree[0] * np.float32(1.05), tree[1] * 1.05**2, *power, n_a=spp, n_b=spp).agrees()


def features(scene: wrt.Scene, choice: str = "auto") -> bool:
    return build_scene(scene, Device("cpu"), light_choice=choice).features.light_tree


def test_the_tree_is_for_many_lights() -> None:
    assert not features(wrt.load("cornell-box"))
    assert features(room(glass=False))
    assert not features(room(glass=False), "power")
    few = wrt.Scene()
    few.add(lamps(wrt.upload.lights.choice.FEW_LIGHTS, 1), emission=1.0)
    assert not features(few)
    assert features(few, "tree")
    few.add(lamps(1, 2), emission=1.0)
    assert features(few)
    # Lights that are infinitely far away, or black, are not in it.
    far = wrt.Scene(lights=[wrt.DirectionalLight((0, -1, 0), 1.0)] * 100)
    far.add(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    assert not features(far, "tree")


def test_another_choice_is_another_render(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    render_with([EVERY_LIGHT], monkeypatch)
    scene = room(glass=False)
    options = {"width": 4, "height": 4, "sampler": "independent"}
    renderer = wrt.Renderer(scene, light_choice="tree", **options)
    next(renderer.passes(spp=1))
    renderer.save_checkpoint(tmp_path / "a.wrt")
    assert wrt.Renderer.resume(tmp_path / "a.wrt", scene).light_choice == "tree"
    with pytest.raises(wrt.InputError, match="light_choice"):
        wrt.Renderer(scene, light_choice="power", **options).load_checkpoint(tmp_path / "a.wrt")
    with pytest.raises(wrt.InputError, match="light_choice must be one of"):
        wrt.Renderer(scene, light_choice="best", **options)
