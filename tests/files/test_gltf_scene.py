"""Cameras and lights of glTF files stand where their nodes have them; versions and extensions are checked."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.mesh_files import check_refused, saved
from support.meshes import gltf_box

import wrt
from wrt.io.load_mesh import load_file

HALF = math.sqrt(0.5)
CAMERAS = [
    {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1, "aspectRatio": 2.0}},
    {"type": "orthographic", "orthographic": {"xmag": 3.0, "ymag": 2.0, "znear": 0.1, "zfar": 9.0}},
]
LIGHTS = [
    {"type": "point", "intensity": 5.0, "color": [1.0, 0.5, 0.25]},
    {"type": "directional", "intensity": 2.0},
    {"type": "spot", "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.5}},
    {"type": "spot", "spot": {}},
]


def tree_with(nodes: list[dict], lights: list[dict] = LIGHTS, **more: object) -> dict:
    """Return a triangle on node 0, and further nodes."""
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    tree["nodes"] += nodes
    return tree | {"cameras": CAMERAS, "extensions": {"KHR_lights_punctual": {"lights": lights}}} | more


def light(number: int) -> dict:
    return {"extensions": {"KHR_lights_punctual": {"light": number}}}


def test_the_first_camera_is_taken_through_all_nodes_above(tmp_path):
    # Moved, then turned by 90 degrees about y: it looks along -x.
    nodes = [
        {"children": [2], "translation": [1, 2, 3]},
        {"camera": 0, "rotation": [0, HALF, 0, HALF], "scale": [2, 2, 2]},
        {"camera": 1},
    ]
    camera = load_file(saved(tmp_path, tree_with(nodes))).camera
    assert camera.origin == pytest.approx((1, 2, 3))
    assert camera.target == pytest.approx((0, 2, 3))
    assert camera.fov_degrees == pytest.approx(math.degrees(0.7))
    np.testing.assert_allclose(camera.frame()[:2], [[0, 0, -1], [0, 1, 0]], atol=1e-12)
    nodes[1]["camera"] = 1
    camera = load_file(saved(tmp_path, tree_with(nodes))).camera
    assert camera.view_height == 4.0


def test_lights(tmp_path):
    # By columns: x to y, y to -x, and moved.
    matrix = [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1]
    tilted = {"rotation": [-HALF, 0, 0, HALF], "translation": [0, 5, 0]}  # -90 degrees about x: -z becomes -y
    nodes = [light(0) | {"matrix": matrix}, light(1) | tilted, light(2) | tilted, light(3)]
    point, sun, spot, wide = load_file(saved(tmp_path, tree_with(nodes))).lights
    assert point == wrt.PointLight((7.0, 8.0, 9.0), intensity=(5.0, 2.5, 1.25))
    assert sun.direction == pytest.approx((0, -1, 0))
    assert sun.irradiance == (2.0, 2.0, 2.0)
    assert (spot.position, spot.falloff) == ((0.0, 5.0, 0.0), "gltf")
    assert spot.direction == pytest.approx((0, -1, 0))
    assert (spot.inner_degrees, spot.outer_degrees) == pytest.approx((math.degrees(0.2), math.degrees(0.5)))
    assert (wide.inner_degrees, wide.outer_degrees) == pytest.approx((0.0, 45.0))


def test_a_file_with_lights_is_rendered_as_it_is_and_others_in_the_studio(tmp_path):
    lit = saved(tmp_path, tree_with([light(0)]), "lit.gltf")
    scene = wrt.load(lit)
    assert (len(scene.shapes), len(scene.lights), scene.environment) == (1, 1, None)
    seen = saved(tmp_path, tree_with([{"camera": 0, "translation": [0.5, 0.5, 2]}]), "seen.gltf")
    scene = wrt.load(seen)
    assert len(scene.shapes) > 1
    assert scene.camera.origin == (0.5, 0.5, 2.0)
    check_refused("an up axis is for files without lights and cameras", lambda path: wrt.load(path, up="z"), seen)


def test_dark_lights_light_nothing(tmp_path):
    """Where they are all there is, the studio lights the mesh; beside meshes that shine they mean darkness."""
    off = [{"type": "point", "intensity": 0.0}, {"type": "directional", "color": [0, 0, 0]}]
    tree = tree_with([light(0), light(1)], off)
    path = saved(tmp_path, tree)
    with pytest.warns(UserWarning, match=r"a\.gltf: its lights are dark, so the studio lights it"):
        scene = wrt.load(path)
    assert len(scene.shapes) > 1
    assert not scene.lights
    assert scene.environment is not None
    tree["materials"] = [{"emissiveFactor": [1, 1, 1]}]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    scene = wrt.load(saved(tmp_path, tree))
    assert (len(scene.shapes), len(scene.lights)) == (1, 2)


def test_an_extension_that_nobody_knows_may_not_be_required(tmp_path):
    tree = tree_with([], extensionsUsed=["KHR_materials_subsurface"])
    assert load_file(saved(tmp_path, tree)).shapes
    path = saved(tmp_path, tree | {"extensionsRequired": ["KHR_materials_subsurface"]})
    check_refused("requires the glTF extension KHR_materials_subsurface, which is not supported", load_file, path)


@pytest.mark.parametrize(
    ("asset", "refused"),
    [
        ({"version": "2.3"}, None),
        ({"version": "3.0", "minVersion": "2.0"}, None),
        ({"version": "2.3", "minVersion": "2.1"}, "2.1"),
        ({"version": "1.0"}, "1.0"),
    ],
)
def test_versions(tmp_path, asset, refused):
    """Minor versions add to a major one; `minVersion` is what a file cannot be read without (section 3.2)."""
    as_in_version_1 = {"meshes": {}} if refused == "1.0" else {}
    path = saved(tmp_path, tree_with([], asset=asset, **as_in_version_1))
    if refused is None:
        assert load_file(path).shapes
    else:
        check_refused(f"a file of glTF {refused}, which is not supported", load_file, path)


@pytest.mark.parametrize("node", [{"camera": 3}, light(9), {"camera": 0, "scale": [0, 0, 0]}, light(4)])
def test_mistakes_are_told_in_one_line(tmp_path, node):
    lights = [*LIGHTS, {"type": "spot", "intensity": "much"}]
    check_refused("a.gltf: ", load_file, saved(tmp_path, tree_with([node], lights)))
