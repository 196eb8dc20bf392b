"""A scene may refer to files anywhere; reading confined to its folder refuses files outside."""

import contextlib
import json
import os
import socket
import struct
import warnings
from contextlib import nullcontext
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


def gltf(picture: str, buffer: str = "") -> str:
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float), np.array([[0, 1, 2]]))
    tree["accessors"].append({"bufferView": 0, "componentType": 5126, "type": "VEC2", "count": 3})
    tree["meshes"][0]["primitives"][0] |= {"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "material": 0}
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    tree |= {"textures": [{"source": 0}], "images": [{"uri": picture}]}
    tree["buffers"][0]["uri"] = buffer or tree["buffers"][0]["uri"]
    return json.dumps(tree)


def xml(text: str) -> str:
    return f'<scene version="3.0.0">{text}</scene>'


BOX = '[[shapes]]\ntype = "box"\n'
MESH = '[[shapes]]\ntype = "mesh"\nfile = '
PAINTED = '[materials.m]\ntype = "principled"\nbase_color = { texture = "OUTSIDE/a.png" }\n'
CASES = {
    "OBJ's material": {"a.obj": f"mtllib OUTSIDE/a.mtl\n{OBJ}"},
    "OBJ's texture": {"a.obj": f"mtllib a.mtl\n{OBJ}", "a.mtl": "newmtl m\nmap_Kd OUTSIDE/a.png\n"},
    "glTF's buffer": {"a.gltf": gltf("own.png", "OUTSIDE/a.bin")},
    "glTF's image": {"a.gltf": gltf("OUTSIDE/a.png")},
    "glTF's image, escaped": {"a.gltf": gltf("ESCAPED/a.png")},
    "TOML's mesh": {"a.toml": MESH + '"OUTSIDE/a.ply"\n'},
    "TOML's texture": {"a.toml": f'{PAINTED}{BOX}material = "m"\n'},
    "TOML's environment": {"a.toml": f'[environment]\ntype = "image"\nfile = "OUTSIDE/a.exr"\n{BOX}'},
    "TOML's places": {"a.toml": BOX + 'instances = "OUTSIDE/a.npy"\n'},
    "Mitsuba's include": {"a.xml": xml('<include filename="OUTSIDE/b.xml"/>')},
    "Mitsuba's mesh": {"a.xml": xml('<shape type="ply"><string name="filename" value="OUTSIDE/a.ply"/></shape>')},
    "Mitsuba's path": {
        "a.xml": xml('<path value="OUTSIDE"/><shape type="ply"><string name="filename" value="a.ply"/></shape>')
    },
    "Mitsuba's spectrum": {
        "a.xml": xml(
            '<shape type="cube"><bsdf type="diffuse"><spectrum name="reflectance" filename="OUTSIDE/a.spd"/></bsdf>'
            "</shape>"
        )
    },
}


def escaped(path: str) -> str:
    return path.replace("..", "%2e%2e").replace("/", "%2F")


def written(name: str, folder: Path, outside: str) -> Path:
    """Write the scene of a case, which names files of another folder by its path; return the path of the scene."""
    for file, text in CASES[name].items():
        (folder / file).write_text(text.replace("OUTSIDE", outside).replace("ESCAPED", escaped(outside)))
    return folder / next(iter(CASES[name]))


@pytest.fixture
def folders(tmp_path):
    """Return the folder of a scene, and one beside it with every kind of file that a scene may refer to."""
    scene, outside = tmp_path / "scene", tmp_path / "outside"
    scene.mkdir()
    outside.mkdir()
    for picture in (scene / "own.png", outside / "a.png"):
        Image.new("RGB", (4, 4), (10, 200, 30)).save(picture)
    (outside / "a.mtl").write_text("newmtl m\nKd 1 0 0\n")
    (outside / "a.bin").write_bytes(TRIANGLE)
    (outside / "a.spd").write_text("400 0.1\n700 0.9\n")
    (outside / "b.xml").write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    (outside / "a.ply").write_text(PLY)
    np.save(outside / "a.npy", np.eye(4)[None])
    wrt.save_image(outside / "a.exr", np.full((4, 8, 3), 0.5))
    return scene, outside


@pytest.mark.parametrize("name", CASES)
def test_confinement_refuses_files_outside_the_scene_folder(name, folders, recwarn):
    """A refusal reads the same whether or not the file exists; a warning would show that it was left out."""
    scene, outside = folders
    (scene / "link").symlink_to(outside)
    messages = {}
    for prefix in ("../outside", str(outside), "link", "../none"):
        path = written(name, scene, prefix)
        if prefix != "../none":
            assert wrt.load(path).shapes
            assert not [str(warning.message) for warning in recwarn], prefix
        with pytest.raises(wrt.InputError, match="outside the scene's folder") as caught:
            wrt.load(path, confined=True)
        messages[prefix] = str(caught.value).replace(prefix, "").replace(escaped(prefix), "")
        recwarn.clear()
    assert messages["../none"] == messages["../outside"]
    (scene / "link").unlink()
    outside.rename(scene / "inside")
    assert wrt.load(written(name, scene, "inside"), confined=True).shapes
    assert not [str(warning.message) for warning in recwarn]


def test_the_command_line_confines(folders, tmp_path, monkeypatch, capsys):
    scene, _ = folders
    monkeypatch.chdir(tmp_path)
    path = str(written("TOML's mesh", scene, "../outside"))
    for command in (["render", path, "--size", "8x8", "-o", "a.png"], ["info", path], ["convert", path, "a.toml"]):
        assert main([*command, "--confined"]) == 2
        assert "outside the scene's folder" in capsys.readouterr().err.splitlines()[-1]
        assert not list(tmp_path.glob("a.*"))


def test_a_link_that_changes_before_opening_is_noticed(folders, monkeypatch):
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


def test_a_mitsuba_scene_does_not_learn_which_files_exist_outside(folders):
    """A file is searched in several folders; one that exists outside would be found first, and refused."""
    scene, outside = folders
    (scene / "sub").mkdir()
    (scene / "a.ply").write_text(PLY)
    text = '<path value="sub"/><shape type="ply"><string name="filename" value="../a.ply"/></shape>'
    (scene / "a.xml").write_text(xml(text))
    for _ in range(2):
        assert wrt.load(scene / "a.xml", confined=True).shapes
        (outside.parent / "a.ply").write_text(PLY)


def test_nothing_is_downloaded(folders, tmp_path, monkeypatch):
    """No request reaches a server, neither for files that a scene names nor for the scene itself."""
    scene, _ = folders
    monkeypatch.chdir(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        address = f"http://127.0.0.1:{server.getsockname()[1]}"
        for name in CASES:
            with contextlib.suppress(wrt.InputError), warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)
                wrt.load(written(name, scene, address))
        for name in ("a.toml", "a.xml", "a.obj", "a.glb", "a.usda", "a.png"):
            with pytest.raises(wrt.InputError):
                wrt.load(f"{address}/{name}")
            with pytest.raises(wrt.InputError):
                wrt.load_image(f"{address}/{name}")
        with pytest.raises(BlockingIOError):
            server.accept()


def test_confinement_refuses_tone_curves_in_files(tmp_path):
    """OpenColorIO would open files anywhere when a picture is developed."""
    for tone, is_refused in (
        ("ocio:config.ocio", True),
        ("ocio:,sRGB - Display", False),
        ("ocio:ocio://default,sRGB - Display", False),
    ):
        path = tmp_path / "scene.toml"
        path.write_text(f'settings = {{ tone = "{tone}" }}\n{BOX}')
        assert wrt.load(path).settings.tone == tone
        with pytest.raises(wrt.InputError, match="names a file") if is_refused else nullcontext():
            wrt.load(path, confined=True)


@pytest.mark.parametrize("prefix", ["../outside", "OUTSIDE", "link", "../none"])
def test_cameras_look_at_pictures_in_their_folder_alone(prefix, folders, capsys):
    """A frame without a size has that of its picture."""
    scene, outside = folders
    (scene / "link").symlink_to(outside)
    (scene / "a.ply").write_text(PLY)
    prefix = prefix.replace("OUTSIDE", str(outside))
    for suffix in (".png", ""):  # a name may lack it
        frames = [{"file_path": f"{prefix}/a{suffix}", "transform_matrix": np.eye(4).tolist()}]
        (scene / "t.json").write_text(json.dumps({"fl_x": 5.0, "frames": frames}))
        if prefix != "../none":
            assert wrt.load_cameras(scene / "t.json")["a"].width == 4
        for read in (wrt.load_cameras, lambda path, **options: wrt.load(scene / "a.ply", cameras=path, **options)):
            with pytest.raises(wrt.InputError, match="outside the scene's folder"):
                read(scene / "t.json", confined=True)
        assert main(["render", str(scene / "a.ply"), "--cameras", str(scene / "t.json"), "--confined"]) == 2
        assert "outside the scene's folder" in capsys.readouterr().err
    (scene / "link").unlink()
    outside.rename(scene / "inside")
    (scene / "t.json").write_text((scene / "t.json").read_text().replace(prefix, "inside"))
    assert wrt.load_cameras(scene / "t.json", confined=True)["a"].width == 4
