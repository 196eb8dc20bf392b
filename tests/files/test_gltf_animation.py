"""Animations of glTF files: curves in closed form, skins and morph targets at a time, frames with one camera."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval
from numpy.typing import ArrayLike
from support.mesh_files import add, attributes, check_refused, saved
from support.meshes import gltf_box

import wrt
from wrt.cli import main
from wrt.io.load_mesh import load_file

BOX = wrt.box((0, 0, 0), (1, 1, 1))
POINTS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
FACES = np.linalg.norm(BOX.vertices[BOX.faces][:, :, None] - POINTS, axis=3).argmin(axis=2)
HALF = math.sqrt(0.5)

Channel = tuple[int, str, str, ArrayLike, ArrayLike]
"""Node, property, interpolation, times, values."""

SLIDE: Channel = (0, "translation", "LINEAR", [0, 1], [[0, 0, 0], [6, 0, 0]])


def box(*nodes: dict, **fields: object) -> dict:
    """Return a box on node 0, and further nodes."""
    tree = gltf_box(POINTS, FACES)
    tree["nodes"] += nodes
    return tree | fields


def animated(*channels: Channel, tree: dict | None = None) -> dict:
    tree = box() if tree is None else tree
    samplers = [
        {"input": add(tree, times), "output": add(tree, values), "interpolation": method}
        for _, _, method, times, values in channels
    ]
    targets = [{"sampler": k, "target": {"node": node, "path": name}} for k, (node, name, *_) in enumerate(channels)]
    tree["animations"] = [{"samplers": samplers, "channels": targets}]
    return tree


def corners(path: Path, time: float | None) -> np.ndarray:
    """Return (8, 3) the corners of the box at a time, in the file's order."""
    (shape,) = load_file(path, time=time, smooth_degrees=0.0).shapes
    found = np.full((8, 3), np.nan)
    found[FACES] = shape.mesh.vertices[shape.mesh.faces].astype(float)
    return found


TIMES = np.array([1.0, 2.0, 4.0])


def test_lines_steps_and_cubic_splines_follow_their_formulas(tmp_path):
    values = [[0, 1, 0], [2, 1, 0], [6, -3, 0]]
    linear, step = (
        saved(tmp_path, animated((0, "translation", method, TIMES, values)), f"{method}.gltf")
        for method in ("LINEAR", "STEP")
    )
    for seconds, between, before in (
        (0.0, [0, 1, 0], [0, 1, 0]),
        (1.25, [0.5, 1, 0], [0, 1, 0]),
        (3.0, [4, -1, 0], [2, 1, 0]),
        (99.0, [6, -3, 0], [6, -3, 0]),
    ):
        np.testing.assert_allclose(corners(linear, seconds) - POINTS, [between] * 8)
        np.testing.assert_allclose(corners(step, seconds) - POINTS, [before] * 8)
    cubic, slope = [1.0, -2.0, 0.5, 0.25], polyval(TIMES, [-2.0, 1.0, 0.75])
    keys = np.zeros((3, 3, 3))
    keys[:, :, 0] = np.stack([slope, polyval(TIMES, cubic), slope], axis=1)
    path = saved(tmp_path, animated((0, "translation", "CUBICSPLINE", TIMES, keys.reshape(9, 3))))
    for seconds in (0.0, 1.3, 2.5, 5.0):
        expected = polyval(np.clip(seconds, 1.0, 4.0), cubic)
        np.testing.assert_allclose(corners(path, seconds)[:, 0] - POINTS[:, 0], expected, atol=2e-6)
    # Tangents that differ on both sides of a key: in-tangent first.
    keys = np.zeros((2, 3, 3))
    keys[:, :, 0] = [[9.0, 0.0, 1.0], [-1.0, 0.0, 9.0]]
    path = saved(tmp_path, animated((0, "translation", "CUBICSPLINE", [0, 2], keys.reshape(6, 3))))
    np.testing.assert_allclose(corners(path, 1.0)[:, 0] - POINTS[:, 0], 0.5, atol=1e-6)


@pytest.mark.parametrize(("last", "sign"), [(130.0, 1.0), (130.0, -1.0), (10.01, 1.0)])
def test_rotations_have_a_steady_speed_along_the_shorter_arc(last, sign, tmp_path):
    first, last = math.radians(10.0), math.radians(last)
    keys = np.array([[0, 0, s * math.sin(a / 2), s * math.cos(a / 2)] for a, s in ((first, 1.0), (last, sign))])
    linear = saved(tmp_path, animated((0, "rotation", "LINEAR", [0, 1], keys)), "linear.gltf")
    for part in (0.0, 0.2, 0.9):
        angle = first + (last - first) * part
        turn = np.array([[math.cos(angle), math.sin(angle), 0], [-math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
        np.testing.assert_allclose(corners(linear, part), POINTS @ turn, atol=1e-6)
    spline = np.stack([np.zeros((2, 4)), keys, np.zeros((2, 4))], axis=1).reshape(6, 4)
    found = corners(saved(tmp_path, animated((0, "rotation", "CUBICSPLINE", [0, 1], spline))), 0.5)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), np.linalg.norm(POINTS, axis=1), atol=1e-6)


def test_nodes_move_turn_and_grow_with_their_cameras_and_lights(tmp_path):
    channels = [
        (0, "translation", "LINEAR", [0, 2], [[0, 0, 0], [4, 0, 0]]),
        (0, "rotation", "LINEAR", [0, 1], [[0, 0, 0, 1], [0, HALF, 0, HALF]]),
        (1, "scale", "STEP", [0, 0.5], [[1, 1, 1], [1, 2, 3]]),
    ]
    path = saved(
        tmp_path, animated(*channels, tree=box(scenes=[{"nodes": [0]}], nodes=[{"children": [1]}, {"mesh": 0}]))
    )
    np.testing.assert_allclose(corners(path, 0.0), POINTS, atol=1e-6)
    x, y, z = (POINTS * [1, 2, 3]).T
    c, s = math.cos(math.radians(67.5)), math.sin(math.radians(67.5))
    turned = np.stack([c * x + s * z + 1.5, y, c * z - s * x], axis=1)
    np.testing.assert_allclose(corners(path, 0.75), turned, atol=1e-6)
    tree = box({"camera": 0, **LAMP}, cameras=CAMERAS, extensions=LIT)
    path = saved(tmp_path, animated((1, "translation", "LINEAR", [0, 1], [[0, 0, 5], [2, 0, 5]]), tree=tree))
    scene = wrt.load(path, time=0.5)
    assert scene.camera.origin == pytest.approx((1, 0, 5))
    assert [light.position for light in scene.lights] == [pytest.approx((1, 0, 5))]


CAMERAS = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
LIT = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
LAMP = {"extensions": {"KHR_lights_punctual": {"light": 0}}}


def test_morph_targets_follow_their_weights(tmp_path):
    tree = box()
    up, out = POINTS * [0, 1, 0], POINTS * [0, 0, 2]
    tree["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": add(tree, each)} for each in (up, out)]
    tree = animated((0, "weights", "LINEAR", [0, 1], [0.0, 0.0, 1.0, 0.5]), tree=tree)
    tree["meshes"][0]["weights"] = [0.5, 0.0]  # those at rest
    path = saved(tmp_path, tree)
    np.testing.assert_allclose(corners(path, None), POINTS + 0.5 * up, atol=1e-6)
    for time in (0.0, 0.5, 1.0):
        np.testing.assert_allclose(corners(path, time), POINTS + time * up + 0.5 * time * out, atol=1e-6)


def test_a_skin_bends_with_its_joints(tmp_path):
    """The place of its mesh does not count."""
    tree = box(nodes=[{"mesh": 0, "skin": 0, "translation": [9, 9, 9]}, {"children": [2]}, {"translation": [0, 1, 0]}])
    shares = np.zeros((8, 4))
    shares[:, 1] = POINTS[:, 1] * 0.75  # the upper corners follow joint 1 by three quarters
    shares[:, 0] = 1.0 - shares[:, 1]
    attributes(tree).update(JOINTS_0=add(tree, [[0, 1, 0, 0]] * 8, "<u2"), WEIGHTS_0=add(tree, shares))
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[1, 3, :3] = (0, -1, 0)  # columns first
    tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": add(tree, inverse.reshape(2, 16))}]
    tree["scenes"] = [{"nodes": [0, 1]}]
    turn = (2, "rotation", "LINEAR", [0, 1], [[0, 0, 0, 1], [0, 0, HALF, HALF]])
    path = saved(tmp_path, animated(turn, tree=tree))
    x, y, z = POINTS.T
    turned = np.stack([1 - y, x + 1, z], axis=1)  # a quarter about z through (0, 1, 0)
    expected = shares[:, :1] * POINTS + shares[:, 1:2] * turned
    for time, where in ((None, POINTS), (0.0, POINTS), (1.0, expected)):
        np.testing.assert_allclose(corners(path, time), where, atol=1e-6)


def test_tangents_are_morphed_and_turn_with_a_skin(tmp_path):
    tree = box(nodes=[{"mesh": 0, "skin": 0, "weights": [0.5]}, {"rotation": [0, 0, HALF, HALF]}])
    rows = {"NORMAL": [0, 0, 1], "TANGENT": [1, 0, 0, -1], "JOINTS_0": [0, 0, 0, 0], "WEIGHTS_0": [1, 0, 0, 0]}
    for name, row in rows.items():
        attributes(tree)[name] = add(tree, [row] * 8, "<u2" if name == "JOINTS_0" else "<f4")
    (primitive,) = tree["meshes"][0]["primitives"]
    primitive |= {"material": 0, "targets": [{"TANGENT": add(tree, [[0, 0, 2]] * 8)}]}
    tree["materials"] = [{"extensions": {"KHR_materials_anisotropy": {"anisotropyStrength": 0.5}}}]
    tree["skins"] = [{"joints": [1]}]
    tree["scenes"] = [{"nodes": [0, 1]}]
    (shape,) = load_file(saved(tmp_path, tree)).shapes
    np.testing.assert_allclose(shape.mesh.tangents, [[0, HALF, HALF, -1]] * 8, atol=1e-6)


@pytest.mark.parametrize("up", [None, "z"])
def test_camera_and_studio_stay(tmp_path, up):
    path = saved(tmp_path, animated((0, "translation", "LINEAR", [0, 1], [[0, 0, 0], [0, 0, -6]])))
    scenes = [wrt.load(path, time=time, up=up) for time in (0.0, 0.5, 1.0)]
    assert len({scene.camera for scene in scenes}) == 1
    studios = [[shape.mesh.vertices for shape in scene.shapes[1:]] for scene in scenes]
    for first, second in zip(studios[0], studios[-1], strict=True):
        np.testing.assert_array_equal(first, second)
    lows = [scene.shapes[0].bounds[0] for scene in scenes]
    step = [0, 0, -3] if up is None else [0, -3, 0]
    np.testing.assert_allclose(np.diff(lows, axis=0), [step] * 2, atol=1e-5)
    assert scenes[0].shapes[1].bounds[0][1] == pytest.approx(min(low[1] for low in lows))  # the ground is below all
    assert scenes[0].camera != wrt.load(path, up=up).camera  # which frames the box alone


def test_a_camera_is_kept_or_framed_anew_for_all_times(tmp_path):
    def cameras(node, **fields):
        path = saved(tmp_path, animated(SLIDE, tree=box(node, **fields)))
        return {wrt.load(path, time=time).camera for time in (0.0, 0.5, 1.0)}

    (camera,) = cameras({"camera": 0, "translation": [3, 0, 12]}, cameras=CAMERAS)
    assert camera.origin == pytest.approx((3, 0, 12))
    with pytest.warns(UserWarning, match="framed anew"):
        assert len(cameras({"camera": 0, "translation": [3, 0, 90]}, cameras=CAMERAS)) == 1
    assert len(cameras({"translation": [3, 5, 5], **LAMP}, extensions=LIT)) == 1


@pytest.mark.slow
def test_frames_of_a_file_are_its_scenes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = saved(tmp_path, animated(SLIDE))
    command = ["render", path.name, *("--size", "24x18", "--spp", "1", "--quiet", "--fps", "4", "-o", "box_%d.exr")]
    assert main([*command, "--frames", "0-1"]) == 0
    written = (tmp_path / "box_1.exr").stat().st_mtime_ns
    assert main([*command, "--frames", "0-2", "--resume"]) == 0
    assert (tmp_path / "box_1.exr").stat().st_mtime_ns == written
    for number in range(3):
        expected = wrt.render(wrt.load(path, time=number / 4, aspect=24 / 18), width=24, height=18, spp=1)
        np.testing.assert_array_equal(wrt.load_image(tmp_path / f"box_{number}.exr"), expected)


def test_damaged_animations_are_told(tmp_path):
    for channel, words in (
        ((0, "translation", "LINEAR", [1, 0], [[0, 0, 0], [6, 0, 0]]), "do not increase"),
        ((0, "translation", "BEZIER", [0, 1], [[0, 0, 0], [6, 0, 0]]), "interpolated by 'BEZIER'"),
        ((0, "translation", "CUBICSPLINE", [0, 1], [[0, 0, 0], [6, 0, 0]]), "do not have 3 numbers"),
        ((7, "translation", "LINEAR", [0, 1], [[0, 0, 0], [6, 0, 0]]), "damaged or not as specified"),
    ):
        path = saved(tmp_path, animated(channel))
        check_refused(words, lambda path: wrt.load(path, time=0.5), path)
        wrt.load(path)  # at rest it does not matter


def test_what_cannot_be_animated_is_told(tmp_path):
    tree = animated(SLIDE)
    target = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/materials/0/alphaCutoff"}}}
    tree["animations"][0]["channels"].append({"sampler": 0, "target": target})
    with pytest.warns(UserWarning, match=r"target\.extensions\.KHR_animation_pointer is unknown to wrt and left out"):
        load_file(saved(tmp_path, tree), time=0.5)
    check_refused("it has no animation", lambda path: wrt.load(path, time=0.0), saved(tmp_path, box()))
    for source in ("cornell-box", wrt.Scene(), wrt.sphere()):
        with pytest.raises(wrt.InputError, match="a time is for glTF and USD files with an animation"):
            wrt.load(source, time=0.0)
    with pytest.raises(wrt.InputError, match="time must be"):
        wrt.load(saved(tmp_path, animated(SLIDE)), time=math.nan)
