"""Animations of glTF files: curves in closed form, skins and morph targets at a time, frames with one camera."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike
from support.meshes import gltf_box, write

import wrt
from wrt.cli import main
from wrt.io.gltf.animation import interpolated
from wrt.io.load_mesh import load_file
from wrt.studio.reach import reach_of

POINTS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
FACES = np.array([[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4]])
FACES = np.concatenate([FACES, [[2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]])
HALF = math.sqrt(0.5)
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

Channel = tuple[int, str, str, ArrayLike, ArrayLike]
"""Node, property, interpolation, times, values."""


def add(tree: dict, values: ArrayLike, kind: str = "<f4") -> int:
    """Add an accessor of an array to a file, and return its number."""
    rows = np.asarray(values, kind)
    data = rows.tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    tree["buffers"].append({"uri": uri, "byteLength": len(data)})
    tree["bufferViews"].append({"buffer": len(tree["buffers"]) - 1, "byteLength": len(data)})
    tree["accessors"].append(
        {
            "bufferView": len(tree["bufferViews"]) - 1,
            "componentType": {"<f4": 5126, "<u2": 5123, "<i2": 5122}[kind],
            "type": KINDS[1 if rows.ndim == 1 else rows.shape[1]],
            "count": len(rows),
        }
    )
    return len(tree["accessors"]) - 1


def animated(*channels: Channel, tree: dict | None = None) -> dict:
    """Return a box, or the given file, with an animation."""
    tree = gltf_box(POINTS, FACES) if tree is None else tree
    samplers = [
        {"input": add(tree, times), "output": add(tree, values), "interpolation": method}
        for _, _, method, times, values in channels
    ]
    targets = [{"sampler": k, "target": {"node": node, "path": name}} for k, (node, name, *_) in enumerate(channels)]
    tree["animations"] = [{"samplers": samplers, "channels": targets}]
    return tree


def saved(folder: Path, tree: dict) -> Path:
    return write(folder, "moving.gltf", json.dumps(tree))


def corners(path: Path, time: float | None) -> np.ndarray:
    """Return (8, 3) the corners of the box at a time, in the file's order."""
    (shape,) = load_file(path, time=time, smooth_degrees=None).shapes
    triangles = shape.mesh.vertices[shape.mesh.faces].astype(float)
    found = np.full((8, 3), np.nan)
    found[FACES] = triangles
    return found


TIMES = np.array([1.0, 2.0, 4.0])
VALUES = np.array([[0.0, 1.0], [2.0, 1.0], [6.0, -3.0]])


@pytest.mark.parametrize(
    ("seconds", "linear", "step"),
    [
        (0.0, [0, 1], [0, 1]),
        (1.0, [0, 1], [0, 1]),
        (1.25, [0.5, 1], [0, 1]),
        (2.0, [2, 1], [2, 1]),
        (3.0, [4, -1], [2, 1]),
        (4.0, [6, -3], [6, -3]),
        (99.0, [6, -3], [6, -3]),
    ],
)
def test_lines_and_steps(seconds: float, linear: list[float], step: list[float]) -> None:
    np.testing.assert_allclose(interpolated(TIMES, VALUES[:, None], "LINEAR", seconds), linear, atol=1e-12)
    np.testing.assert_allclose(interpolated(TIMES, VALUES[:, None], "STEP", seconds), step, atol=1e-12)


def test_a_cubic_spline_follows_the_cubic_that_made_it() -> None:
    def cubic(t: ArrayLike) -> np.ndarray:
        return np.polynomial.polynomial.polyval(t, [1.0, -2.0, 0.5, 0.25])

    slope = np.polynomial.polynomial.polyval(TIMES, [-2.0, 1.0, 0.75])
    keys = np.stack([slope, cubic(TIMES), slope], axis=1)[:, :, None]
    for seconds in (1.0, 1.3, 1.9, 2.0, 2.5, 3.99, 4.0):
        found = interpolated(TIMES, keys, "CUBICSPLINE", seconds)
        np.testing.assert_allclose(found, [cubic(seconds)], atol=1e-12)
    np.testing.assert_allclose(interpolated(TIMES, keys, "CUBICSPLINE", 0.0), [cubic(1.0)])
    np.testing.assert_allclose(interpolated(TIMES, keys, "CUBICSPLINE", 5.0), [cubic(4.0)])
    # Tangents that differ on both sides of a key: in-tangent first.
    bent = np.array([[[9.0], [0.0], [1.0]], [[-1.0], [0.0], [9.0]]])
    np.testing.assert_allclose(interpolated(np.array([0.0, 2.0]), bent, "CUBICSPLINE", 1.0), [0.5])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rotations_have_a_steady_speed_along_the_shorter_arc(sign: float) -> None:
    def about_z(degrees: float) -> np.ndarray:
        return np.array([0.0, 0.0, math.sin(math.radians(degrees) / 2), math.cos(math.radians(degrees) / 2)])

    keys = np.stack([about_z(10.0), sign * about_z(130.0)])[:, None]
    for part in (0.0, 0.2, 0.5, 0.9):
        found = interpolated(np.array([0.0, 1.0]), keys, "LINEAR", part, rotation=True)
        np.testing.assert_allclose(found, about_z(10.0 + 120.0 * part), atol=1e-12)
    near = np.stack([about_z(0.0), about_z(0.01)])[:, None]
    found = interpolated(np.array([0.0, 1.0]), near, "LINEAR", 0.5, rotation=True)
    np.testing.assert_allclose(found, about_z(0.005), atol=1e-12)
    tangents = np.zeros((2, 4))
    spline = np.stack([tangents, keys[:, 0], tangents], axis=1)
    found = interpolated(np.array([0.0, 1.0]), spline, "CUBICSPLINE", 0.5, rotation=True)
    assert np.linalg.norm(found) == pytest.approx(1.0)


def test_nodes_move_turn_and_grow(tmp_path: Path) -> None:
    tree = gltf_box(POINTS, FACES)
    tree["nodes"] = [{"children": [1], "scale": [1, 1, 1]}, {"mesh": 0}]
    tree["scenes"] = [{"nodes": [0]}]
    path = saved(
        tmp_path,
        animated(
            (0, "translation", "LINEAR", [0, 2], [[0, 0, 0], [4, 0, 0]]),
            (0, "rotation", "LINEAR", [0, 1], [[0, 0, 0, 1], [0, HALF, 0, HALF]]),
            (1, "scale", "STEP", [0, 0.5], [[1, 1, 1], [1, 2, 3]]),
            tree=tree,
        ),
    )
    np.testing.assert_allclose(corners(path, 0.0), POINTS, atol=1e-6)
    x, y, z = (POINTS * [1, 2, 3]).T
    np.testing.assert_allclose(corners(path, 1.0), np.stack([z + 2, y, -x], axis=1), atol=1e-6)
    c, s = math.cos(math.radians(67.5)), math.sin(math.radians(67.5))
    turned = np.stack([c * x + s * z + 1.5, y, c * z - s * x], axis=1)
    np.testing.assert_allclose(corners(path, 0.75), turned, atol=1e-6)


def test_cameras_and_lights_move_with_their_nodes(tmp_path: Path) -> None:
    tree = gltf_box(POINTS, FACES)
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    tree["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    tree["nodes"].append({"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}})
    path = saved(tmp_path, animated((1, "translation", "LINEAR", [0, 1], [[0, 0, 5], [2, 0, 5]]), tree=tree))
    scene = wrt.load(path, time=0.5)
    assert scene.camera is not None
    assert scene.camera.origin == pytest.approx((1, 0, 5))
    (light,) = scene.lights
    assert isinstance(light, wrt.PointLight)
    assert light.position == pytest.approx((1, 0, 5))


def test_morph_targets_follow_their_weights(tmp_path: Path) -> None:
    tree = gltf_box(POINTS, FACES)
    up, out = POINTS * [0, 1, 0], POINTS * [0, 0, 2]
    tree["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": add(tree, each)} for each in (up, out)]
    path = saved(tmp_path, animated((0, "weights", "LINEAR", [0, 1], [0.0, 0.0, 1.0, 0.5]), tree=tree))
    np.testing.assert_allclose(corners(path, 0.0), POINTS)
    np.testing.assert_allclose(corners(path, 0.5), POINTS + 0.5 * up + 0.25 * out, atol=1e-6)
    np.testing.assert_allclose(corners(path, 1.0), POINTS + up + 0.5 * out, atol=1e-6)
    flat = np.zeros((2, 3, 2))
    flat[:, 1] = [[0, 0], [1, 0.5]]
    path = saved(tmp_path, animated((0, "weights", "CUBICSPLINE", [0, 1], flat.ravel()), tree=tree))
    share = 3 * 0.25**2 - 2 * 0.25**3
    np.testing.assert_allclose(corners(path, 0.25), POINTS + share * (up + 0.5 * out), atol=1e-6)


def test_a_skin_bends_with_its_joints(tmp_path: Path) -> None:
    tree = gltf_box(POINTS, FACES)
    shares = np.zeros((8, 4))
    shares[:, 1] = POINTS[:, 1] * 0.75  # the upper corners follow joint 1 by three quarters
    shares[:, 0] = 1.0 - shares[:, 1]
    joints = np.tile([0, 1, 0, 0], (8, 1))
    tree["meshes"][0]["primitives"][0]["attributes"] |= {
        "JOINTS_0": add(tree, joints, "<u2"),
        "WEIGHTS_0": add(tree, shares),
    }
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[1, 3, :3] = (0, -1, 0)  # columns first
    tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": add(tree, inverse.reshape(2, 16))}]
    tree["nodes"] = [{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 1, 0]}]
    tree["scenes"] = [{"nodes": [0, 1]}]
    turn = (2, "rotation", "LINEAR", [0, 1], [[0, 0, 0, 1], [0, 0, HALF, HALF]])
    path = saved(tmp_path, animated(turn, tree=tree))
    np.testing.assert_allclose(corners(path, 0.0), POINTS, atol=1e-6)
    x, y, z = POINTS.T
    turned = np.stack([1 - y, x + 1, z], axis=1)  # a quarter about z through (0, 1, 0)
    expected = shares[:, :1] * POINTS + shares[:, 1:2] * turned
    np.testing.assert_allclose(corners(path, 1.0), expected, atol=1e-6)
    np.testing.assert_allclose(corners(path, None), POINTS, atol=1e-6)


SLIDE: Channel = (0, "translation", "LINEAR", [0, 1], [[0, 0, 0], [6, 0, 0]])


@pytest.mark.parametrize("up", [None, "z"])
def test_camera_and_studio_stay(tmp_path: Path, up: str | None) -> None:
    path = saved(tmp_path, animated((0, "translation", "LINEAR", [0, 1], [[0, 0, 0], [0, 0, -6]])))
    scenes = [wrt.load(path, time=time, up=up) for time in (0.0, 0.5, 1.0)]
    assert len({scene.camera for scene in scenes}) == 1
    for scene in scenes[1:]:
        for shape, first in zip(scene.shapes[1:], scenes[0].shapes[1:], strict=True):
            np.testing.assert_array_equal(shape.mesh.vertices, first.mesh.vertices)
    lows = [scene.shapes[0].bounds[0] for scene in scenes]
    step = [0, 0, -3] if up is None else [0, -3, 0]
    np.testing.assert_allclose(np.diff(lows, axis=0), [step] * 2, atol=1e-5)
    assert scenes[0].shapes[1].bounds[0][1] == pytest.approx(min(low[1] for low in lows))  # the ground is below all
    assert scenes[0].camera != wrt.load(path, up=up).camera  # which frames the box alone


def test_the_reach_of_a_round_shape_is_nearly_its_own() -> None:
    ball = wrt.sphere(radius=2.0, subdivisions=5)
    assert len(ball.vertices) > 10_000
    reach = reach_of([wrt.Scene([wrt.Shape(ball)])])
    assert len(reach.points) <= 256
    np.testing.assert_allclose(reach.bounds, ball.bounds, atol=1e-12)
    directions = np.random.default_rng(1).normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    seen = (directions @ reach.points.T).max(axis=1)
    assert seen.min() > 1.96  # 1 % of its size
    assert seen.max() < 2.001


def test_a_camera_of_the_file_is_kept_or_not_for_all_times(tmp_path: Path) -> None:
    tree = gltf_box(POINTS, FACES)
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    tree["nodes"].append({"camera": 0, "translation": [3, 0, 12]})
    path = saved(tmp_path, animated(SLIDE, tree=tree))
    for time in (0.0, 0.5, 1.0):
        camera = wrt.load(path, time=time).camera
        assert camera is not None
        assert camera.origin == pytest.approx((3, 0, 12))
    tree["nodes"][1]["translation"] = [3, 0, 90]
    path = saved(tmp_path, tree)
    with pytest.warns(UserWarning, match="framed anew"):
        cameras = {wrt.load(path, time=time).camera for time in (0.0, 1.0)}
    assert len(cameras) == 1


def test_lights_without_a_camera_are_framed_once(tmp_path: Path) -> None:
    tree = gltf_box(POINTS, FACES)
    tree["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    tree["nodes"].append({"translation": [3, 5, 5], "extensions": {"KHR_lights_punctual": {"light": 0}}})
    path = saved(tmp_path, animated(SLIDE, tree=tree))
    first, last = (wrt.load(path, time=time).camera for time in (0.0, 1.0))
    assert first is not None
    assert first == last


def frame_at(path: Path, time: float) -> np.ndarray:
    return wrt.render(wrt.load(path, time=time, aspect=24 / 18), width=24, height=18, spp=1)


def test_frames_of_a_file_are_its_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = saved(tmp_path, animated(SLIDE))
    small = ["--size", "24x18", "--spp", "1", "--quiet", "--fps", "4"]
    assert main(["render", path.name, "--frames", "0-2", "-o", "box_%d.exr", *small]) == 0
    frames = [wrt.load_image(tmp_path / f"box_{number}.exr") for number in range(3)]
    for number, frame in enumerate(frames):
        np.testing.assert_array_equal(frame, frame_at(path, number / 4))
    kept = (tmp_path / "box_1.exr").stat().st_mtime_ns
    assert main(["render", path.name, "--frames", "0-3", "-o", "box_%d.exr", *small, "--resume"]) == 0
    assert (tmp_path / "box_1.exr").stat().st_mtime_ns == kept
    assert (tmp_path / "box_3.exr").exists()
    assert main(["render", path.name, "--frames", "4-4", "-o", "box_%d.exr", *small, "--resume"]) == 0  # one more
    np.testing.assert_array_equal(wrt.load_image(tmp_path / "box_4.exr"), frame_at(path, 4 / 4))


def test_what_moves_in_the_picture_is_the_box(tmp_path: Path) -> None:
    path = saved(tmp_path, animated(SLIDE))
    columns = []
    for time in (0.0, 0.5, 1.0):
        scene = wrt.load(path, time=time, transparent=True, view="front", aspect=2.0)
        covered = wrt.render(scene, width=32, height=16, spp=4)[..., 3].sum(axis=0)
        columns.append(float(covered @ np.arange(32) / covered.sum()))
    assert 2.0 < columns[0] < 8.0
    assert columns[1] == pytest.approx(15.5, abs=0.5)
    np.testing.assert_allclose(np.diff(columns, 2), 0.0, atol=0.6)


def scene_file(folder: Path) -> Path:
    return write(folder, "plain.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")


def test_sources_without_animations_have_no_times(tmp_path: Path) -> None:
    plain = saved(tmp_path, gltf_box(POINTS, FACES))
    for source in (plain, scene_file(tmp_path)):
        with pytest.raises(wrt.InputError, match=rf"{source.name}: it has no animation, so there is no time to choose"):
            wrt.load(source, time=0.0)
    sources: Sequence[object] = ("cornell-box", wrt.Scene(), wrt.sphere())
    for each in sources:
        with pytest.raises(wrt.InputError, match="a time is for glTF files with an animation"):
            wrt.load(each, time=0.0)
    with pytest.raises(wrt.InputError, match="time must be"):
        wrt.load(saved(tmp_path, animated(SLIDE)), time=math.nan)
    with pytest.raises(wrt.InputError, match=r"none\.glb: no such file"):
        wrt.load(tmp_path / "none.glb", time=0.0)


@pytest.mark.parametrize(
    ("channel", "words"),
    [
        ((0, "translation", "LINEAR", [1, 0], [[0, 0, 0], [6, 0, 0]]), "do not increase"),
        ((0, "translation", "LINEAR", [0, math.inf], [[0, 0, 0], [6, 0, 0]]), "do not increase"),
        ((0, "translation", "LINEAR", [0, 1], [[0, 0, 0], [math.nan, 0, 0]]), "are not finite"),
        ((0, "translation", "BEZIER", [0, 1], [[0, 0, 0], [6, 0, 0]]), "interpolated by 'BEZIER'"),
        ((0, "rotation", "LINEAR", [0, 1], [[0, 0, 0], [6, 0, 0]]), "do not have 4 numbers"),
        ((0, "translation", "CUBICSPLINE", [0, 1], [[0, 0, 0], [6, 0, 0]]), "do not have 3 numbers"),
        ((7, "translation", "LINEAR", [0, 1], [[0, 0, 0], [6, 0, 0]]), "damaged or not as specified"),
    ],
)
def test_damaged_animations_are_told(tmp_path: Path, channel: Channel, words: str) -> None:
    path = saved(tmp_path, animated(channel))
    with pytest.raises(wrt.InputError, match=words) as caught:
        wrt.load(path, time=0.5)
    assert str(caught.value).startswith(f"{path}: ")
    wrt.load(path)  # at rest it does not matter


def test_a_node_placed_by_a_matrix_is_not_animated(tmp_path: Path) -> None:
    tree = animated(SLIDE)
    tree["nodes"][0]["matrix"] = np.eye(4).ravel().tolist()
    with pytest.raises(wrt.InputError, match="node 0 is animated, but placed by a matrix, which glTF forbids"):
        load_file(saved(tmp_path, tree), time=0.5)


def test_a_pointer_is_left_out_with_a_warning(tmp_path: Path) -> None:
    tree = animated(SLIDE)
    target = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/materials/0/alphaCutoff"}}}
    tree["animations"][0]["channels"].append({"sampler": 0, "target": target})
    with pytest.warns(UserWarning, match="KHR_animation_pointer stays as it is at rest"):
        load_file(saved(tmp_path, tree), time=0.5)
