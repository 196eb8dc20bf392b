"""A scene may refer to files anywhere; reading confined to its folder refuses files outside."""

from __future__ import annotations

import base64
import json
import os
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import wrt
from wrt.cli import main
from wrt.io.safe_read import confined_to, read_file

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3\n"
TRIANGLE = struct.pack("<9f3H", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)


def image(path: Path) -> None:
    Image.new("RGB", (4, 4), (10, 200, 30)).save(path)


def obj_texture(folder: Path, outside: str) -> str:
    (folder / "a.obj").write_text(f"mtllib a.mtl\n{OBJ}usemtl m\n{FACE}")
    (folder / "a.mtl").write_text(f"newmtl m\nmap_Kd {outside}/a.png\n")
    return "a.obj"


def obj_material(folder: Path, outside: str) -> str:
    (folder / "a.obj").write_text(f"mtllib {outside}/a.mtl\n{OBJ}usemtl m\n{FACE}")
    return "a.obj"


def gltf(folder: Path, buffer: str, picture: str) -> str:
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": picture}],
        "buffers": [{"uri": buffer, "byteLength": len(TRIANGLE)}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
    }
    (folder / "a.gltf").write_text(json.dumps(tree))
    return "a.gltf"


INLINE = "data:application/octet-stream;base64," + base64.b64encode(TRIANGLE).decode()


def gltf_buffer(folder: Path, outside: str) -> str:
    image(folder / "a.png")
    return gltf(folder, f"{outside}/a.bin", "a.png")


def gltf_image(folder: Path, outside: str) -> str:
    return gltf(folder, INLINE, f"{outside}/a.png")


def gltf_escaped(folder: Path, outside: str) -> str:
    return gltf(folder, INLINE, f"{outside}/a.png".replace("..", "%2e%2e").replace("/", "%2F"))


def toml(text: str) -> Callable[[Path, str], str]:
    def write(folder: Path, outside: str) -> str:
        shape = '[[shapes]]\ntype = "box"\n'
        (folder / "a.toml").write_text(text.format(outside) + (shape if "[[shapes]]" not in text else ""))
        return "a.toml"

    return write


def xml(text: str) -> Callable[[Path, str], str]:
    def write(folder: Path, outside: str) -> str:
        shape = '<shape type="cube"/>' if "<shape" not in text else ""
        (folder / "a.xml").write_text(f'<scene version="3.0.0">{text.format(outside)}{shape}</scene>')
        return "a.xml"

    return write


COLOR = 'base_color = {{ texture = "{}/a.png" }}'
CASES: dict[str, Callable[[Path, str], str]] = {
    "OBJ's material": obj_material,
    "OBJ's texture": obj_texture,
    "glTF's buffer": gltf_buffer,
    "glTF's image": gltf_image,
    "glTF's image, escaped": gltf_escaped,
    "TOML's mesh": toml('[[shapes]]\ntype = "mesh"\nfile = "{}/a.ply"\n'),
    "TOML's arrays": toml('[[shapes]]\ntype = "mesh"\nfile = "{}/a.npz"\n'),
    "TOML's texture": toml(
        '[materials.m]\ntype = "principled"\n' + COLOR + '\n[[shapes]]\ntype = "box"\nmaterial = "m"\n'
    ),
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
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (outside / "a.ply").write_text(header + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    np.savez(outside / "a.npz", vertices=np.eye(3), faces=np.array([[0, 1, 2]]))
    np.save(outside / "a.npy", np.eye(4)[None])
    wrt.save_image(outside / "a.exr", np.full((4, 8, 3), 0.5))
    return scene, outside


def ways_out(scene: Path, outside: Path) -> list[str]:
    """Return paths from one folder to the other: with "..", absolute, and through a link."""
    (scene / "link").symlink_to(outside)
    return ["../outside", str(outside), "link"]


@pytest.mark.parametrize("name", CASES)
def test_files_may_lie_anywhere_or_in_the_scene_s_folder_alone(name, folders, recwarn):
    scene, outside = folders
    for way in ways_out(scene, outside):
        path = scene / CASES[name](scene, way)
        assert wrt.load(path).shapes
        assert not [str(warning.message) for warning in recwarn], way
        with pytest.raises(wrt.InputError, match="outside the scene's folder, and reading is confined") as caught:
            wrt.load(path, confined=True)
        assert "\n" not in str(caught.value)
        recwarn.clear()


@pytest.mark.parametrize("name", CASES)
def test_confined_scenes_read_what_lies_below_them(name, folders, recwarn):
    scene, outside = folders
    outside.rename(scene / "inside")
    path = scene / CASES[name](scene, "inside")
    assert wrt.load(path, confined=True).shapes
    assert not [str(warning.message) for warning in recwarn]


@pytest.mark.parametrize("name", CASES)
def test_a_refusal_does_not_tell_what_is_there(name, folders):
    scene, _ = folders
    told = []
    for way in ("../outside", "../none"):
        path = scene / CASES[name](scene, way)
        with pytest.raises(wrt.InputError) as caught:
            wrt.load(path, confined=True)
        told.append(str(caught.value).replace(way, "").replace(way.replace("..", "%2e%2e").replace("/", "%2F"), ""))
    assert told[0] == told[1]


def test_links_among_the_files_themselves(folders):
    scene, outside = folders
    (scene / "a.ply").symlink_to(outside / "a.ply")
    assert wrt.load(scene / "a.ply").shapes
    with pytest.raises(wrt.InputError, match="outside the scene's folder"):
        wrt.load(scene / "a.ply", confined=True)
    (scene / "b.ply").write_bytes((outside / "a.ply").read_bytes())
    (scene / "c.ply").symlink_to("b.ply")
    assert wrt.load(scene / "c.ply", confined=True).shapes


@pytest.mark.parametrize("command", ["render", "info", "convert"])
def test_the_command_line_confines(command, folders, tmp_path, monkeypatch, capsys):
    scene, _ = folders
    monkeypatch.chdir(tmp_path)
    path = str(scene / obj_texture(scene, "../outside"))
    more = {"render": ["--size", "8x8", "--spp", "1", "-o", "a.png"], "info": [], "convert": ["a.toml"]}[command]
    assert main([command, path, *more, "--confined"]) == 2
    error = capsys.readouterr().err
    assert "outside the scene's folder" in error.splitlines()[-1]
    assert not (tmp_path / "a.png").exists()
    assert not (tmp_path / "a.toml").exists()
    assert main([command, path, *more]) == 0


def test_a_built_in_scene_is_nobody_s_upload():
    assert wrt.load("cornell-box", confined=True).shapes


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
