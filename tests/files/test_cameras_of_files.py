"""One of several cameras of a file is chosen by its name or number, and the others are named."""

from pathlib import Path

import numpy as np
import pytest
from support.mesh_files import add, saved
from support.meshes import gltf_box, write

import wrt
from wrt.cli import main

LENSES = [
    {"type": "perspective", "name": "lens", "perspective": {"yfov": 0.7, "znear": 0.1}},
    {"type": "orthographic", "orthographic": {"xmag": 3, "ymag": 2, "znear": 0.1, "zfar": 10}},
]


def two_cameras(folder: Path) -> Path:
    """Save a triangle that moves, seen by one camera from two nodes of a name, and by another, which moves along."""
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    tree["nodes"] += [
        {"name": "front", "camera": 0, "translation": [0.5, 0.5, 2]},
        {"name": "front", "camera": 0, "translation": [0.5, 0.5, 1]},
        {"camera": 1, "translation": [9, 0, 9], "rotation": [0, 0.6, 0, 0.8]},
    ]
    tree["cameras"] = LENSES
    sampler = {"input": add(tree, [0, 1]), "output": add(tree, [[9, 0, 9], [0.5, 0.5, 4]])}
    tree["animations"] = [
        {"samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": 3, "path": "translation"}}]}
    ]
    return saved(folder, tree)


def test_a_camera_is_chosen_by_name_or_number(tmp_path, capsys):
    path = two_cameras(tmp_path)
    with pytest.warns(UserWarning, match="of its cameras, 0 'front', 1 'front_1', 2 'camera', the first is taken"):
        scene = wrt.load(path, strict=True)  # a warning, but not an error: nothing is wrong with the file
    assert [camera.origin for camera in scene.cameras.values()] == [(0.5, 0.5, 2.0), (0.5, 0.5, 1.0), (9.0, 0.0, 9.0)]
    assert scene.camera is scene.cameras["front"]
    for choice, name in ((1, "front_1"), ("1", "front_1"), ("front_1", "front_1"), ("camera", "camera"), (0, "front")):
        assert wrt.load(path, camera=choice).camera == scene.cameras[name]
    far = wrt.load(path, camera=2)  # it shows the mesh small, and is kept because it was chosen
    assert isinstance(far.camera, wrt.OrthographicCamera)
    far.environment = None
    wrt.save_scene(tmp_path / "out.glb", far)  # the one that is taken is the first, as readers take that
    with pytest.warns(UserWarning, match="of its cameras, 0 'camera', 1 'front', 2 'front_1', the first"):
        wrt.load(tmp_path / "out.glb", frame=False)
    for choice in ("fronts", 3, -1):
        with pytest.raises(
            wrt.InputError, match=r"a\.gltf: there is no camera .*; it has 0 'front', 1 'front_1', 2 'c"
        ):
            wrt.load(path, camera=choice)
    with pytest.raises(wrt.InputError, match="choose a view or a camera"):
        wrt.load(path, camera=1, view="front")
    with pytest.raises(wrt.InputError, match="cornell-box: a camera is chosen in files that may have several"):
        wrt.load("cornell-box", camera=1)
    with pytest.raises(wrt.InputError, match="it has none"):
        wrt.load(write(tmp_path, "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), camera=0)
    assert main(["info", str(path)]) == 0
    assert "\n  1 front_1  PerspectiveCamera: origin (0.5, 0.5, 1)" in capsys.readouterr().out


def test_a_chosen_camera_moves_with_its_animation(tmp_path):
    path = two_cameras(tmp_path)
    assert wrt.load(path, camera="camera", time=1.0).camera.origin == (0.5, 0.5, 4.0)
    assert wrt.load(path, camera="camera", time=0.5).camera.origin == (4.75, 0.25, 6.5)
    # The studio's lamp stands on the side of that camera, as it does at rest.
    lamps = [wrt.load(path, camera="camera", time=time).shapes[-1].mesh.vertices for time in (None, 0.0, 1.0)]
    np.testing.assert_allclose(lamps[1:], [lamps[0]] * 2, atol=0.1)


def test_cameras_of_usd_have_the_names_of_their_prims(tmp_path):
    pytest.importorskip("pxr")
    mesh = "point3f[] points = [(0,0,0), (1,0,0), (0,1,0)]\nint[] faceVertexCounts = [3]\n"
    cameras = 'def Camera "left" {}\ndef Camera "right" {\ntoken projection = "orthographic"\n}\n'
    text = f'#usda 1.0\ndef Mesh "m" {{\n{mesh}int[] faceVertexIndices = [0, 1, 2]\n}}\n{cameras}'
    scene = wrt.load(write(tmp_path, "a.usda", text), camera="right")
    assert list(scene.cameras) == ["left", "right"]
    assert isinstance(scene.camera, wrt.OrthographicCamera)
