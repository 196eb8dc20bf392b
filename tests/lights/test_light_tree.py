"""The light tree chooses each light as often as it says, and leaves none out that could be seen.

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
from support.irradiance import EVERY_LIGHT
from support.kernels import uniforms, upload
from support.media import render
from support.ray_trees import unit
from support.statistics import chi_square_test, image_z_test

import wrt
from wrt.backend.device import Device
from wrt.kernels.core.rays import RECEIVES_ANYWHERE, RECEIVES_BOTH, RECEIVES_FRONT
from wrt.kernels.core.scene_data import LightTree
from wrt.kernels.lights.choice import far_light_probability, light_tree_probability, sample_light_tree
from wrt.upload.lights.bounds import LightBounds
from wrt.upload.lights.choice import FEW_LIGHTS
from wrt.upload.lights.tree import LightTree as HostTree
from wrt.upload.lights.tree import build_light_tree
from wrt.upload.scene_data import SceneUpload

ANYWHERE, FRONT, BOTH = (int(r) for r in (RECEIVES_ANYWHERE, RECEIVES_FRONT, RECEIVES_BOTH))


@wp.struct
class Receivers:
    position: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    receives: int


@wp.kernel(enable_backward=False)
def draw_lights(tree: LightTree, at: Receivers, u: wp.array(dtype=wp.vec2), choice_out: wp.array2d(dtype=wp.vec4)):
    i, j = wp.tid()
    choice = sample_light_tree(tree, at.position[i], at.normal[i], at.receives, u[j])
    choice_out[i, j] = wp.vec4(float(choice.light), choice.probability, choice.u[0], choice.u[1])


@wp.kernel(enable_backward=False)
def probabilities_of_lights(tree: LightTree, at: Receivers, probability_out: wp.array2d(dtype=float)):
    i, j = wp.tid()
    if j < tree.places.shape[0]:
        probability_out[i, j] = light_tree_probability(tree, j, at.position[i], at.normal[i], at.receives)
    else:
        probability_out[i, j] = far_light_probability(tree, at.position[i], at.normal[i], at.receives)


class Queries:
    """A tree on a device, asked by points with normals."""

    def __init__(self, tree: HostTree, at: tuple[NDArray, NDArray], receives: int, device: str, far: float = 0.0):
        self.tree, self.at, self.device = LightTree(), Receivers(), device
        self.tree.nodes = upload(tree.nodes.ravel(), float, device)
        self.tree.parents, self.tree.places = (upload(a, int, device) for a in (tree.parents, tree.places))
        self.tree.scale, self.tree.far = tree.scale, far
        self.at.position, self.at.normal = (upload(a, wp.vec3, device) for a in at)
        self.at.receives = receives
        self.shape = (len(at[0]), len(tree.places) + (far > 0.0))

    def drawn(self, u: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return (points, samples) lights, their probabilities and what is left of the numbers.

        The number of a light in the tree, after those the number of all far ones, and −1 for none.
        """
        out = wp.empty((self.shape[0], len(u)), dtype=wp.vec4, device=self.device)
        wp.launch(
            draw_lights, out.shape, [self.tree, self.at, upload(u, wp.vec2, self.device)], [out], device=out.device
        )
        values = out.numpy()
        light = values[..., 0].astype(int)
        return np.where(light < -1, len(self.tree.places), light), values[..., 1], values[..., 2:]

    def probabilities(self) -> NDArray:
        """Return (points, lights) probabilities, or (points, lights + 1) where there are far lights, these last."""
        out = wp.empty(self.shape, dtype=float, device=self.device)
        wp.launch(probabilities_of_lights, out.shape, [self.tree, self.at], [out], device=self.device)
        return out.numpy().astype(np.float64)


def triangles(n: int, seed: int, size: float = 0.1) -> NDArray:
    rng = np.random.default_rng(seed)
    return (rng.random((n, 1, 3)) * [4.0, 1.0, 4.0] + size * rng.normal(size=(n, 3, 3))).astype(np.float32)


def points_of(position: ArrayLike, power: ArrayLike) -> LightBounds:
    return LightBounds.of(np.asarray(position)[:, None], (0.0, 1.0, 0.0), power, cos_spread=-1.0)


def triangles_of(corners: ArrayLike, power: ArrayLike = 1.0, two_sided: ArrayLike = False) -> LightBounds:
    c = np.asarray(corners, np.float64)
    normal = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    axis = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return LightBounds.of(c, axis, power, two_sided=two_sided)


def uneven_powers() -> NDArray:
    rng = np.random.default_rng(7)
    return np.where(rng.random(200) < 0.3, 0.0, 10.0 ** rng.uniform(-20.0, 20.0, 200))


def mixed() -> LightBounds:
    rng = np.random.default_rng(7)
    surfaces = triangles_of(triangles(300, 5), rng.random(300), rng.random(300) < 0.3)
    axis = unit(rng.normal(size=(50, 3)))
    beams = LightBounds.of(rng.random((50, 1, 3)) * 4.0, axis, rng.random(50), cos_falloff=0.9)
    return LightBounds.joined([surfaces, points_of(rng.random((50, 3)), rng.random(50)), beams])


LIGHTS = {
    "one": triangles_of(triangles(1, 1)),
    "all at one point": points_of(np.ones((200, 3)), np.random.default_rng(1).random(200)),
    "ever nearer, in the deepest of trees": points_of(0.5 ** np.arange(100.0)[:, None] * [1.0, 1.0, 1.0], 1.0),
    "uneven powers": triangles_of(triangles(200, 3), uneven_powers()),
    "degenerate triangles": triangles_of(np.repeat(triangles(20, 3)[:, :1], 3, axis=1)),
    "tiny": triangles_of(triangles(100, 4) * 1e-9),
    "huge": triangles_of(triangles(100, 4) * 1e9),
    "mixed": mixed(),
}


def receivers(lights: LightBounds) -> tuple[NDArray, NDArray]:
    """Return points, and normals, among the lights, on them, in a plane with them, behind them and far away."""
    rng = np.random.default_rng(9)
    low, high = lights.center.min(axis=0), lights.center.max(axis=0)
    size = max(float((high - low).max()), float(lights.radius.max()), 1e-12)
    some = rng.integers(0, len(lights), 6)
    center, axis = lights.center[some], lights.axis[some]
    points = [low + rng.random((8, 3)) * (high - low), center, center - 0.1 * size * axis]
    points += [
        center + size * np.cross(axis, unit(rng.normal(size=(6, 3)))),
        low + 1e4 * size * unit(rng.normal(size=(4, 3))),
    ]
    position = np.concatenate(points)
    normals = unit(rng.normal(size=position.shape))
    normals[3:6] = [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]
    normals[8:11] = axis[:3]
    return position.astype(np.float32), normals.astype(np.float32)


CASES = [
    *((kind, FRONT, 0.0) for kind in LIGHTS),
    *((kind, receives, 0.0) for kind in ("all at one point", "mixed") for receives in (ANYWHERE, BOTH)),
    *(("mixed", FRONT, far) for far in (1e-6, 1e6)),
]
"""Lights, what the receiver receives, and the irradiance of lights that are infinitely far away."""


@pytest.mark.parametrize(("kind", "receives", "far"), CASES)
def test_lights_are_drawn_as_often_as_said(kind: str, receives: int, far: float, device: str) -> None:
    lights, n = LIGHTS[kind], 2**14
    at = receivers(lights)
    queries = Queries(build_light_tree(lights), at, receives, device, far)
    probabilities = queries.probabilities()
    assert (probabilities >= 0.0).all()
    assert (probabilities.sum(axis=1) <= 1.0 + 1e-5).all()
    if kind == "all at one point" and receives != FRONT:  # nothing tells them apart but their power
        np.testing.assert_allclose(
            probabilities, np.broadcast_to(lights.power / lights.power.sum(), probabilities.shape), rtol=1e-4
        )
    if receives == ANYWHERE:  # normals do not count
        unknown = (at[0], np.full_like(at[1], np.nan))
        np.testing.assert_array_equal(
            Queries(build_light_tree(lights), unknown, receives, device).probabilities(), probabilities
        )
    light, probability, leftover = queries.drawn(uniforms(n, 2, seed=3))
    chosen = light >= 0
    assert (probability[~chosen] == 0.0).all()
    # The walk up gives what the walk down gave, bit for bit.
    assert (probabilities.astype(np.float32)[np.nonzero(chosen)[0], light[chosen]] == probability[chosen]).all()
    for i in range(len(probabilities)):
        counts = np.append(np.bincount(light[i][chosen[i]], minlength=probabilities.shape[1]), (~chosen[i]).sum())
        expected = n * np.append(probabilities[i], 1.0 - probabilities[i].sum())
        if expected.max() > n - 10.0:  # no two cells to compare
            assert n - counts[np.argmax(expected)] < 40
            assert counts[expected == 0.0].sum() == 0
            continue
        # Rounding may leave a little for no light where there always is one.
        expected[-1] = expected[-1] if expected[-1] > 0.1 else 0.0
        result = chi_square_test(counts, expected, tests=len(probabilities) * len(CASES))
        assert result.passed, f"point {i}: {result.message}"
    if far:
        share = probabilities[:, -1]
        assert (share == 1.0).any()
        assert ((share > 0.1999) & (share < 0.8001) | (share == 1.0)).all()
        # What is left of the numbers is uniform, whatever was chosen.
        is_far = light[0] == len(lights)
        for some in (is_far, chosen[0] & ~is_far):
            counts, _, _ = np.histogram2d(*leftover[0][some].T, bins=8, range=[[0.0, 1.0], [0.0, 1.0]])
            result = chi_square_test(counts, np.full((8, 8), some.sum() / 64.0), tests=2)
            assert result.passed, result.message


@pytest.mark.parametrize("receives", [FRONT, BOTH], ids=["front", "both"])
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
        probabilities = Queries(build_light_tree(lights), (points, normals), receives, device).probabilities()
        # A point of the triangle is in front of it, and above the receiver's horizon.
        c = corners.astype(np.float64)
        in_front = ((points[:, None] - c[None, :, 0]) * np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])).sum(axis=2)
        is_reached = (in_front > 0.0) | (two_sided & (in_front < 0.0))
        if receives == FRONT:
            is_reached &= ((c[None] - points[:, None, None]) * normals[:, None, None]).sum(axis=3).max(axis=2) > 0.0
        reached += int(is_reached.sum())
        missed += int((probabilities[is_reached] == 0.0).sum())
    report("pairs of points and lights, left out", f"{reached}, {missed}", 0)
    assert reached > 40_000
    assert missed == 0


WIDEST = 175.0
"""Degrees from their axes to which beams of these tests reach."""


@pytest.mark.parametrize("is_wide", [False, True], ids=["narrow", "wide"])
def test_no_beam_that_reaches_a_point_is_left_out(is_wide: bool, device: str) -> None:
    """Points just inside the edges of beams, from less than a degree on: roots in the kernel may be of 14 bits."""
    rng = np.random.default_rng(4)
    n = 200
    position, axis = rng.random((n, 3)) * 4.0, unit(rng.normal(size=(n, 3)))
    wide, narrow = np.cos(np.radians(rng.uniform(50.0, WIDEST, n))), 1.0 - 10.0 ** rng.uniform(-6.0, -1.0, n)
    cosine = wide if is_wide else narrow
    tree = build_light_tree(LightBounds.of(position[:, None], axis, 1.0, cos_falloff=cosine))
    for _ in range(10):
        angle = 0.99 * np.arccos(cosine)[:, None]
        direction = axis * np.cos(angle) + unit(np.cross(axis, rng.normal(size=(n, 3)))) * np.sin(angle)
        points = (position + direction * 10.0 ** rng.uniform(-1.0, 3.0, (n, 1))).astype(np.float32)
        assert (
            np.diagonal(Queries(tree, (points, -direction.astype(np.float32)), FRONT, device).probabilities()) > 0.0
        ).all()


def test_near_lights_and_those_that_face_the_point_are_preferred(report: Report, device: str) -> None:
    """Unshadowed light in a large room has far less variance than with the choice by power."""
    rng = np.random.default_rng(0)
    lights = triangles_of(triangles(2000, 11, size=0.02) * np.float32(5.0), rng.lognormal(size=2000))
    points = (rng.random((50, 3)) * [20.0, 5.0, 20.0]).astype(np.float32)
    normals = unit(rng.normal(size=points.shape)).astype(np.float32)
    probabilities = Queries(build_light_tree(lights), (points, normals), FRONT, device).probabilities()
    offset = lights.center - points[:, None]
    cosines = np.maximum((offset * normals[:, None]).sum(axis=2), 0.0) * np.maximum(
        -(offset * lights.axis).sum(axis=2), 0.0
    )
    arriving = lights.power * cosines / (offset**2).sum(axis=2) ** 2

    def variance(p: NDArray) -> float:
        second = np.divide(arriving**2, p, out=np.zeros_like(arriving), where=arriving > 0.0).sum(axis=1)
        return float(np.mean(second / arriving.sum(axis=1) ** 2 - 1.0))

    by_tree, by_power = (
        variance(probabilities),
        variance(np.broadcast_to(lights.power / lights.power.sum(), probabilities.shape)),
    )
    report("relative variance by tree, by power", f"{by_tree:.2f}, {by_power:.2f}")
    assert by_tree < 0.05 * by_power


def lamps(n: int, seed: int) -> wrt.Mesh:
    """Return small triangles in a room, each a mesh's own corners."""
    rng = np.random.default_rng(seed)
    points = rng.random((n, 1, 3)) * [3.6, 1.8, 3.6] + [-1.8, 0.1, -1.8] + 0.12 * rng.normal(size=(n, 3, 3))
    inside = points.reshape(-1, 3).clip([-1.95, 0.02, -1.95], [1.95, 1.98, 1.95])
    return wrt.Mesh(inside, np.arange(3 * n).reshape(n, 3))


def room(kind: str = "matt") -> wrt.Scene:
    """Return a room with all kinds of lights and a wall that lets some light through, open to the sky or in fog.

    Args:
        kind: "matt"; "glass", with metal and rough glass; or "fog", which has no end, and so no sky around it.
    """
    glass = kind == "glass"
    image = np.full((8, 16, 3), 0.02, np.float32)
    image[1, 3] = (6.0, 5.0, 4.0)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.2, 5.5), (0.0, 0.8, 0.0), fov_degrees=40.0))
    scene.settings.max_depth = 4
    scene.add(wrt.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), material=wrt.Diffuse(0.6))
    metal = wrt.RoughConductor(0.3, metal="copper") if glass else wrt.Diffuse((0.7, 0.4, 0.2))
    scene.add(wrt.quad((-2, 0, -2), (4, 0, 0), (0, 2, 0)), material=metal)
    scene.add(wrt.quad((-2, 0, 2), (0, 0, -4), (0, 2, 0)), material=wrt.Diffuse((0.3, 0.5, 0.7), opacity=0.6))
    scene.add(lamps(120, 1), material=wrt.Diffuse(0.2), emission=(0.9, 0.6, 0.3))
    scene.add(lamps(60, 2), material=wrt.Diffuse(0.2), emission=(0.3, 0.6, 0.9), two_sided_emission=True)
    if glass:
        scene.add(wrt.sphere((0.6, 0.5, 0.8), 0.45), material=wrt.RoughDielectric(alpha=0.3))
    for k in range(4):
        scene.add_light(wrt.PointLight((k - 1.5, 1.5, 0.3), intensity=(0.05, 0.02 * k, 0.03)))
    scene.add_light(wrt.SpotLight((1.0, 1.9, 1.0), (-0.4, -1.0, -0.5), intensity=0.6, outer_degrees=25.0))
    scene.add_light(wrt.SphereLight((-1.0, 0.5, 0.8), 0.2, radiance=(0.5, 0.1, 0.1)))
    scene.add_light(wrt.RectangleLight((0.0, 1.2, -1.5), (0.6, 0, 0), (0, 0.4, 0), radiance=(0.2, 0.8, 0.2)))
    if kind == "fog":
        scene.medium = wrt.Medium(absorption=(0.02, 0.05, 0.1), scattering=(0.2, 0.15, 0.1), g=0.4)
    else:
        scene.environment = wrt.ImageEnvironment(image)
        scene.add_light(wrt.DirectionalLight((0.5, -1.0, -0.3), irradiance=0.4))
    return scene


KERNELS = [
    EVERY_LIGHT,
    covering("diffuse", "rough_conductor", "rough_dielectric", composite="holes"),
    replace(EVERY_LIGHT, media="scattering"),
]


@functools.cache
def rendered(choice: str, strategy: str, device: str, seed: int, kind: str, spp: int) -> tuple[NDArray, NDArray]:
    options = {"light_choice": choice, "strategy": strategy, "seed": seed, "size": (24, 24), "spp": spp}
    renderer = render(room(kind), device, **options)
    assert not renderer.film.rejected
    return renderer.image(), renderer.variance()


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("strategy", "kind", "spp"),
    [
        ("mis", "matt", 448),
        *(pytest.param(strategy, "glass", 1792, marks=SLOW) for strategy in ("mis", "light", "bsdf")),
        pytest.param("mis", "fog", 384, marks=SLOW),
    ],
)
def test_the_tree_shows_what_power_shows(
    strategy: str, kind: str, spp: int, device: str, report: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against the choice by power, with each estimator: their densities must be those of their samples."""
    render_with(KERNELS, monkeypatch)
    tree, power = (
        rendered("tree", strategy, device, 1, kind, spp),
        rendered("power", "mis", device, 2, kind, spp),
    )
    test = image_z_test(*tree, *power, n_a=spp, n_b=spp)
    report(f"{strategy}: worst block", test.message, p=test.block_p)
    assert test.agrees(), test.message
    if strategy == "mis":  # a share that is five per cent wrong is noticed
        assert not image_z_test(tree[0] * np.float32(1.05), tree[1] * 1.05**2, *power, n_a=spp, n_b=spp).agrees()


def test_the_tree_is_for_many_lights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def has_tree(scene: wrt.Scene, choice: str = "auto") -> bool:
        return SceneUpload(scene, Device("cpu"), light_choice=choice).features.light_tree

    few_lamps, many_lamps = wrt.Scene(), wrt.Scene()
    few_lamps.add(lamps(FEW_LIGHTS, 1), emission=1.0)
    many_lamps.add(lamps(FEW_LIGHTS + 1, 1), emission=1.0)
    assert not has_tree(few_lamps)
    assert has_tree(few_lamps, "tree")
    assert has_tree(many_lamps)
    assert not has_tree(many_lamps, "power")
    # Lights that are infinitely far away are not in it.
    far = wrt.Scene(lights=[wrt.DirectionalLight((0, -1, 0), 1.0)] * 100)
    far.add(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    assert not has_tree(far, "tree")

    render_with(KERNELS, monkeypatch)
    render(room(), "cpu", light_choice="tree").save_checkpoint(tmp_path / "a.wrt")
    assert wrt.Renderer.resume(tmp_path / "a.wrt", room()).light_choice == "tree"
    options = {"width": 2, "height": 2, "sampler": "independent", "filter": "box"}
    with pytest.raises(wrt.InputError, match="light_choice"):
        wrt.Renderer(room(), light_choice="power", **options).load_checkpoint(tmp_path / "a.wrt")
    with pytest.raises(wrt.InputError, match="light_choice must be one of"):
        wrt.Renderer(room(), light_choice="best", **options)
