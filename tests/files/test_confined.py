"""A scene may refer to files anywhere; reading confined to its folder refuses files outside."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import struct
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.meshes import gltf_box

import wrt
from wrt.cli import main
from wrt.errors import InputWarning
from wrt.io.safe_read import confined_to, read_file

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
TRIANGLE = struct.pack("<9f3H", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)

Writer = Callable[[Path, str], str]
"""Writes a scene to a folder, which refers to a file of another one; returns its name."""


def image(path: Path) -> None:
    Image.new("RGB", (4, 4), (10, 200, 30)).save(path)


def obj(library: str, texture: str = "") -> Writer:
    def write(folder: Path, outside: str) -> str:
        (folder / "a.obj").write_text(f"mtllib {library.format(outside)}\n{OBJ}")
        if texture:
            (folder / "a.mtl").write_text(f"newmtl m\nmap_Kd {texture.format(outside)}\n")
        return "a.obj"

    return write


def gltf(picture: str, buffer: str = "", *, escaped: bool = False) -> Writer:
    def write(folder: Path, outside: str) -> str:
        if escaped:
            outside = outside.replace("..", "%2e%2e").replace("/", "%2F")
        image(folder / "a.png")
        tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float), np.array([[0, 1, 2]]))
        tree["accessors"].append({"bufferView": 0, "componentType": 5126, "type": "VEC2", "count": 3})
        tree["meshes"][0]["primitives"][0] |= {"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "material": 0}
        tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        tree |= {"textures": [{"source": 0}], "images": [{"uri": picture.format(outside)}]}
        if buffer:
            tree["buffers"][0]["uri"] = buffer.format(outside)
        (folder / "a.gltf").write_text(json.dumps(tree))
        return "a.gltf"

    return write


def toml(text: str) -> Writer:
    def write(folder: Path, outside: str) -> str:
        shape = "" if "[[shapes]]" in text else '[[shapes]]\ntype = "box"\n'
        (folder / "a.toml").write_text(text.replace("{}", outside) + shape)
        return "a.toml"

    return write


def xml(text: str) -> Writer:
    def write(folder: Path, outside: str) -> str:
        shape = "" if "<shape" in text else '<shape type="cube"/>'
        (folder / "a.xml").write_text(f'<scene version="3.0.0">{text.format(outside)}{shape}</scene>')
        return "a.xml"

    return write


MESH = '[[shapes]]\ntype = "mesh"\nfile = '
PAINTED = '[materials.m]\ntype = "principled"\nbase_color = { texture = "{}/a.png" }\n'
CASES: dict[str, Writer] = {
    "OBJ's material": obj("{}/a.mtl"),
    "OBJ's texture": obj("a.mtl", "{}/a.png"),
    "glTF's buffer": gltf("a.png", "{}/a.bin"),
    "glTF's image": gltf("{}/a.png"),
    "glTF's image, escaped": gltf("{}/a.png", escaped=True),
    "TOML's mesh": toml(MESH + '"{}/a.ply"\n'),
    "TOML's arrays": toml(MESH + '"{}/a.npz"\n'),
    "TOML's texture": toml(PAINTED + '[[shapes]]\ntype = "box"\nmaterial = "m"\n'),
    "TOML's environment": toml('[environment]\ntype = "image"\nfile = "{}/a.exr"\n'),
    "TOML's places": toml('[[shapes]]\ntype = "box"\ninstances = "{}/a.npy"\n'),
    "Mitsuba's include": xml('<include filename="{}/b.xml"/>'),
    "Mitsuba's mesh": xml('<shape type="ply"><string name="filename" value="{}/a.ply"/></shape>'),
    "Mitsuba's path": xml('<path value="{}"/><shape type="ply"><string name="filename" value="a.ply"/></shape>'),
    "Mitsuba's environment": xml('<emitter type="envmap"><string name="filename" value="{}/a.exr"/></emitter>'),
    "Mitsuba's texture": xml(
        '<shape type="cube"><bsdf type="diffuse"><texture name="reflectance" type="bitmap">'
        '<string name="filename" value="{}/a.png"/></texture></bsdf></shape>'
    ),
    "Mitsuba's spectrum": xml(
        '<shape type="cube"><bsdf type="diffuse"><spectrum name="reflectance" filename="{}/a.spd"/></bsdf></shape>'
    ),
}


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Return the folder of a scene, and one beside it with every kind of file that a scene may refer to."""
    scene, outside = tmp_path / "scene", tmp_path / "outside"
    scene.mkdir()
    outside.mkdir()
    image(outside / "a.png")
    (outside / "a.mtl").write_text("newmtl m\nKd 1 0 0\n")
    (outside / "a.bin").write_bytes(TRIANGLE)
    (outside / "a.spd").write_text("400 0.1\n700 0.9\n")
    (outside / "b.xml").write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    (outside / "a.ply").write_text(PLY)
    np.savez(outside / "a.npz", vertices=np.eye(3), faces=np.array([[0, 1, 2]]))
    np.save(outside / "a.npy", np.eye(4)[None])
    wrt.save_image(outside / "a.exr", np.full((4, 8, 3), 0.5))
    return scene, outside


@pytest.mark.parametrize("name", CASES)
def test_files_may_lie_anywhere_or_in_the_folder_of_the_scene_alone(name, folders, recwarn):
    """A refusal does not tell whether the file is there; a warning would show that it was left out."""
    scene, outside = folders
    (scene / "link").symlink_to(outside)
    told = {}
    for way in ("../outside", str(outside), "link", "../none"):
        path = scene / CASES[name](scene, way)
        if way != "../none":
            assert wrt.load(path).shapes
            assert not [str(warning.message) for warning in recwarn], way
        with pytest.raises(wrt.InputError, match="outside the scene's folder") as caught:
            wrt.load(path, confined=True)
        escaped = way.replace("..", "%2e%2e").replace("/", "%2F")
        told[way] = str(caught.value).replace(way, "").replace(escaped, "")
        recwarn.clear()
    assert told["../none"] == told["../outside"]
    (scene / "link").unlink()
    outside.rename(scene / "inside")
    assert wrt.load(scene / CASES[name](scene, "inside"), confined=True).shapes
    assert not [str(warning.message) for warning in recwarn]


def test_links_among_the_files_themselves(folders):
    scene, outside = folders
    (scene / "a.ply").symlink_to(outside / "a.ply")
    assert wrt.load(scene / "a.ply").shapes
    with pytest.raises(wrt.InputError, match="outside the scene's folder"):
        wrt.load(scene / "a.ply", confined=True)
    (scene / "b.ply").write_text(PLY)
    (scene / "c.ply").symlink_to("b.ply")
    assert wrt.load(scene / "c.ply", confined=True).shapes
    assert wrt.load("cornell-box", confined=True).shapes  # a built-in scene is nobody's upload


@pytest.mark.parametrize("command", ["render", "info", "convert"])
def test_the_command_line_confines(command, folders, tmp_path, monkeypatch, capsys):
    scene, _ = folders
    monkeypatch.chdir(tmp_path)
    path = str(scene / CASES["TOML's mesh"](scene, "../outside"))
    more = {"render": ["--size", "8x8", "-o", "a.png"], "info": [], "convert": ["a.toml"]}[command]
    assert main([command, path, *more, "--confined"]) == 2
    assert "outside the scene's folder" in capsys.readouterr().err.splitlines()[-1]
    assert not list(tmp_path.glob("a.*"))


def test_a_link_that_is_changed_between_look_and_opening_is_noticed(folders, monkeypatch):
    scene, outside = folders
    (scene / "a.txt").write_text("mine")
    (scene / "link").symlink_to("a.txt")
    opened = os.open

    def swapped(path, *arguments, **options):
        (scene / "link").unlink()
        (scene / "link").symlink_to(outside / "a.mtl")
        return opened(path, *arguments, **options)

    with confined_to(scene):
        assert read_file(scene / "link") == b"mine"
    monkeypatch.setattr(os, "open", swapped)
    with pytest.raises(wrt.InputError, match="outside"), confined_to(scene):
        read_file(scene / "link")


def test_a_place_that_is_only_guessed_is_left_out_where_it_is_outside(tmp_path):
    """Images of an OBJ file are looked for in ../textures, too; in confinement no file was named there."""
    scene = tmp_path / "scene"
    scene.mkdir()
    path = scene / obj("a.mtl", "a.png")(scene, "")
    (tmp_path / "textures").mkdir()
    image(tmp_path / "textures" / "a.png")
    with pytest.warns(InputWarning, match=r"a\.png', which it refers to, is not there; '.*textures/a\.png' is taken"):
        assert wrt.load(path).shapes
    with pytest.warns(InputWarning, match=r"a\.png', which it refers to: no such file"):
        assert wrt.load(path, confined=True).shapes
    (tmp_path / "textures").rename(scene / "textures")
    with pytest.warns(InputWarning, match=r"'.*textures/a\.png' is taken"):
        assert wrt.load(path, confined=True).shapes


@pytest.mark.parametrize("is_there", [True, False])
def test_a_mitsuba_scene_does_not_learn_which_files_there_are_outside(is_there, folders):
    """A file is looked for in several folders; one outside that is there would be found first, and refused."""
    scene, outside = folders
    (scene / "sub").mkdir()
    (scene / "a.ply").write_text(PLY)
    if is_there:
        (outside.parent / "a.ply").write_text(PLY)
    text = '<path value="sub"/><shape type="ply"><string name="filename" value="../a.ply"/></shape>'
    assert wrt.load(scene / xml(text)(scene, ""), confined=True).shapes


def test_nothing_is_downloaded(folders, tmp_path, monkeypatch):
    """A server that nobody asks: not for what a scene names, nor for the scene itself."""
    scene, _ = folders
    monkeypatch.chdir(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        address = f"http://127.0.0.1:{server.getsockname()[1]}"
        for case in CASES.values():
            with contextlib.suppress(wrt.InputError), warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)
                wrt.load(scene / case(scene, address))
        for name in ("a.toml", "a.xml", "a.obj", "a.glb", "a.usda", "a.png"):
            with pytest.raises(wrt.InputError):
                wrt.load(f"{address}/{name}")
            with pytest.raises(wrt.InputError):
                wrt.load_image(f"{address}/{name}")
        with pytest.raises(BlockingIOError):
            server.accept()
