"""A file that is not what its name says is told by what it looks to be; one that is damaged, by its damage."""

from __future__ import annotations

import io
import json
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.meshes import SQUARE, gltf_box, write
from test_cli import without_progress

import wrt
from wrt.cli import main
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_file

ASSETS = Path(__file__).resolve().parent.parent.parent / "shared" / "assets"
needs_assets = pytest.mark.skipif(not ASSETS.is_dir(), reason="the test assets are not beside this checkout")

TREE = json.dumps(gltf_box(np.eye(3), np.array([[0, 1, 2]]))).encode()


def image(kind: str) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (8, 8)).save(buffer, kind)
    return buffer.getvalue()


def glb() -> bytes:
    text = TREE + b" " * (-len(TREE) % 4)
    return b"glTF" + struct.pack("<IIII", 2, 20 + len(text), len(text), 0x4E4F534A) + text


KINDS: dict[str, tuple[bytes, str]] = {
    "png": (image("PNG"), "a PNG image"),
    "jpg": (image("JPEG"), "a JPEG image"),
    "tif": (image("TIFF"), "a TIFF image"),
    "glb": (glb(), "a GLB file; rename it to end in .glb"),
    "gltf": (TREE, "a glTF file; rename it to end in .gltf"),
    "obj": (b"\n# by hand\n\n" + SQUARE.encode() + b"f 1 2 3\n", "an OBJ file; rename it to end in .obj"),
    "ply": (b"ply\nformat ascii 1.0\nend_header\n", "a PLY file; rename it to end in .ply"),
    "off": (b"# by hand\nOFF\n3 1 0\n", "an OFF file; rename it to end in .off"),
    "stl": (b"solid a\n facet normal 0 0 1\n", "an STL file; rename it to end in .stl"),
    "binary.stl": (b"a header".ljust(80) + struct.pack("<I", 1) + bytes(50), "a binary STL file; rename it to end in"),
    "xml": (
        b'<?xml version="1.0"?>\n<!-- a -->\n<scene version="3.0.0">',
        "a scene file of Mitsuba; rename it to end in .xml",
    ),
    "dae": (b'<?xml version="1.0"?>\n<COLLADA><scene/></COLLADA>', "a COLLADA file; rename it to end in .dae"),
    "toml": (b"# by hand\n[camera]\norigin = [0, 0, 1]\n", "a scene file; rename it to end in .toml"),
    "html": (b"\xef\xbb\xbf\n<!DOCTYPE html>\n<html>", "a web page"),
    "zip": (b"PK\x03\x04" + bytes(30), "a ZIP archive; unpack it"),
    "gz": (b"\x1f\x8b\x08" + zlib.compress(b"v 0 0 0"), "a compressed file; unpack it"),
    "fbx": (b"Kaydara FBX Binary  \0", "an FBX file; export it as glTF"),
    "lfs": (b"version https://git-lfs.github.com/spec/v1\n", "a Git LFS pointer to a file that has not been fetched"),
}
NAMES = ("a.obj", "a.ply", "a.STL", "a.off", "a.gltf", "a.glb", "a.npz", "a.toml", "a.xml", "a.txt", "a.jpeg2", "a")


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_file_looks_to_be_is_told(tmp_path, kind):
    data, words = KINDS[kind]
    for name in NAMES:
        suffix = Path(name).suffix[1:].lower()
        if suffix == kind.split(".")[-1] or {suffix, kind} == {"glb", "gltf"}:
            continue
        path = write(tmp_path, name, data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            with pytest.raises(wrt.InputError) as caught:
                wrt.load(path)
        assert str(caught.value).startswith(f"{path}: "), name
        assert f"it looks to be {words}" in str(caught.value), name


def test_images_go_into_scene_files(tmp_path):
    with pytest.raises(
        wrt.InputError, match=r"a\.png: not a known mesh format; .*it is an image, which a scene file can name"
    ):
        wrt.load(write(tmp_path, "a.png", image("PNG")))


def test_what_is_right_needs_no_right_name(tmp_path):
    """Both forms of glTF are told apart by what is in them."""
    assert len(load_file(write(tmp_path, "a.gltf", glb())).shapes) == 1
    assert len(load_file(write(tmp_path, "a.glb", TREE)).shapes) == 1


@pytest.mark.parametrize("kind", ["obj", "ply", "off", "stl", "gltf", "xml", "toml"])
def test_damage_is_told_as_such(tmp_path, kind):
    path = write(tmp_path, f"a.{kind}", KINDS[kind][0][:30] + b"\xff\xfe")
    with pytest.raises(wrt.InputError) as caught:
        wrt.load(path)
    assert "looks to be" not in str(caught.value)


@needs_assets
@pytest.mark.parametrize("path", sorted((ASSETS / "broken").glob("*")), ids=lambda p: p.name)
def test_broken_files_give_a_picture_and_a_warning_or_one_line(path, tmp_path, capsys):
    output = tmp_path / "picture.png"
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        status = main(["render", str(path), "-o", str(output), "--size", "16x12", "--spp", "1"])
    told = [line for line in without_progress(capsys.readouterr().err).splitlines() if line.startswith("wrt: ")]
    assert output.exists() == (status == 0)
    if status == 0:
        assert told
        assert all(line.startswith(f"wrt: warning: {path}: ") for line in told)
    else:
        assert status == 2
        assert len(told) == 1
        assert told[0].startswith(f"wrt: error: {path}: ")
