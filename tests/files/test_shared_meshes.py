"""A mesh file that shows one mesh in several places keeps one copy of it, in a scene file too."""

import math
from pathlib import Path

import numpy as np
import pytest
from support.mesh_files import saved
from support.meshes import gltf_box, write

import wrt
from wrt.backend.device import Device
from wrt.io.load_mesh import load_shapes
from wrt.io.toml.reader import load_scene
from wrt.meshes.many_triangles import terrain
from wrt.upload.scene_data import SceneUpload

PLACES = [
    {"translation": [1.5, 0, 0], "scale": [0.5, 0.25, 0.5]},
    {"rotation": [0, 0.6, 0, 0.8]},
    {"scale": [-1, 1, 1], "translation": [-2, 0, -1]},
]
HEAD = """
[camera]
origin = [0.0, 3.0, 7.0]
target = [0.0, 0.0, 0.0]
[environment]
type = "constant"
[[shapes]]
type = "mesh"
file = "hills.gltf"
"""


@pytest.fixture
def hills(tmp_path):
    """Return a file of hills in three places, and a triangle in one."""
    mesh = terrain(3000)
    tree = gltf_box(mesh.vertices * np.float32(2.0 / np.ptp(mesh.bounds[:, 0])), mesh.faces)
    tree["accessors"].append(dict(tree["accessors"][1], count=3))
    tree["meshes"].append({"primitives": [dict(tree["meshes"][0]["primitives"][0], indices=2)]})
    tree["nodes"] = [{"mesh": 0, **place} for place in PLACES] + [{"mesh": 1}, {"children": [0, 1, 2, 3]}]
    tree["scenes"] = [{"nodes": [4]}]
    return saved(tmp_path, tree, "hills.gltf")


def scene_of(hills: Path, text: str = "") -> wrt.Scene:
    return load_scene(write(hills.parent, "scene.toml", HEAD + text))


def test_a_scene_file_shares_what_its_mesh_file_shares(hills, report):
    scene, copies = scene_of(hills), wrt.Scene(load_shapes(hills))
    sizes = [SceneUpload(each, Device("cpu")).finish().data.indices.size // 3 for each in (scene, copies)]
    report("triangles on the device: scene file, copies", sizes)
    count = len(scene.shapes[0].mesh.faces)
    assert sizes == [count + 1, 3 * count + 1]


PLACED = "scale = [1.0, 2.0, 0.5]\nrotate = { axis = [0, 1, 0], degrees = 30 }\ntranslate = [0.5, 0, 0]\n"
SPIN = "motion = { times = [0, 1], rotate = { axis = [1, 2, 0], degrees = 80 }, translate = [0, 1, 0] }\n"
GROWTH = "motion = { keys = [{ time = 0 }, { time = 1, scale = [1, 3, 1], translate = [1, 0, 0] }] }\n"
MOVED = [PLACED + text for text in ("instances = [{ translate = [0, 1, 0] }, { scale = 2 }]", SPIN, GROWTH)]


@pytest.mark.parametrize("text", ['material = "red"\n[materials.red]\ntype = "diffuse"\n', *MOVED])
def test_transforms_come_after_those_of_the_file(hills, text):
    """Everything is where it is if the file is read as copies, and then moved."""
    scene, copies = scene_of(hills, text), load_shapes(hills)
    meshes = 3 if GROWTH in text else 1  # stretched over time, copies are what is exact
    assert len({id(shape.mesh) for shape in scene.shapes if len(shape.mesh.faces) > 1}) == meshes
    assert "red" not in text or len({id(shape.material) for shape in scene.shapes}) == 1
    quad = '[[shapes]]\ntype = "quad"\norigin = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\n'
    quads = load_scene(write(hills.parent, "quad.toml", quad + text * (PLACED in text))).shapes
    matrix = np.eye(4)
    if PLACED in text:
        c, s = math.cos(math.pi / 6.0), math.sin(math.pi / 6.0)
        matrix[:3] = [[c, 0, 0.5 * s, 0.5], [0, 2, 0, 0], [-s, 0, 0.5 * c, 0]]
    for time in (0.0, 0.3, 1.0):
        places = [quad.transform_at(time) @ matrix for quad in quads]
        expected = [copy.mesh.transformed(place).vertices for copy in copies for place in places]
        for shape, vertices in zip(scene.shapes, expected, strict=True):
            np.testing.assert_allclose(shape.mesh_at(time).vertices, vertices, atol=1e-5)
