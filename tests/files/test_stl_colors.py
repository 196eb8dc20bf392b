"""Colours of binary STL files, by every convention there is, and words that are none."""

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from support.meshes import write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import from_trimesh, load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb

RED, GREEN, GREY = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), tuple(linear_from_srgb(np.full(3, 128 / 255.0)))
VALID, OF_RED = 1 << 15, 31 << 10
OF_GREEN, OF_BLUE = 31 << 5, 31
MESHLAB = b"COLOR=\x7f\x7f\x7f MATERIAL=\x7f\x7f\x7f \x7f\x7f\x7f \x7f\x7f\x7f "


def stl(path: Path, words: list[int], header: bytes = b"by hand") -> Path:
    data = header.ljust(80) + struct.pack("<I", len(words))
    for k, word in enumerate(words):
        data += struct.pack("<12fH", 0, 0, 1, k, 0, 0, k + 1, 0, 0, k, 1, 0, word)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("words", "header", "expected"),
    [
        ([VALID | OF_RED, VALID | OF_GREEN, OF_GREEN], b"VisCAM", [RED, GREEN, DEFAULT_REFLECTANCE]),
        ([OF_BLUE, OF_GREEN, VALID], b"COLOR=\x80\x80\x80\xff", [RED, GREEN, GREY]),
        ([OF_BLUE, OF_GREEN, VALID], b"COLOR=\0\0\0\xff,MATERIAL=\x80\x80\x80\xff" + bytes(8), [RED, GREEN, GREY]),
        ([VALID | OF_GREEN] * 3, b"a part COLOR=\x80\x80\x80\0", [GREY] * 3),
        ([0, 0, 0], b"COLOR=\x80\x80\x80\xff,MATERIAL=" + bytes(12), [GREY] * 3),
        ([VALID | OF_BLUE, VALID | OF_GREEN, VALID | OF_BLUE], MESHLAB, [RED, GREEN, RED]),
        ([0, 0, 0], MESHLAB, [tuple(linear_from_srgb(np.full(3, 127 / 255.0)))] * 3),
    ],
    ids=["viscam", "magics", "material", "whole", "no words", "meshlab", "meshlab without words"],
)
def test_faces_have_their_colors(words, header, expected, tmp_path):
    path = stl(tmp_path / "a.stl", words, header)
    loaded = trimesh.load(path, process=False)
    for (shape,) in (load_shapes(path), *([from_trimesh(loaded)] if header.isascii() else [])):
        np.testing.assert_allclose(shape.mesh.colors[shape.mesh.faces[:, 0]], expected, atol=1e-6)
        assert shape.material == wrt.Diffuse(wrt.VertexColor())


def test_a_part_may_be_translucent_and_what_is_no_color_is_warned_of_once(tmp_path):
    (shape,) = load_shapes(stl(tmp_path / "a.stl", [VALID, OF_GREEN], b"COLOR=\x80\x80\x80\x33"))
    np.testing.assert_allclose(shape.mesh.colors[shape.mesh.faces[:, 0], 3], (0.2, 1.0))
    with pytest.warns(InputWarning, match="an attribute word that is not a colour is unknown .* left out .2 times"):
        (shape,) = load_shapes(stl(tmp_path / "a.stl", [7, 0, 0x2020, 3]))
    assert shape.mesh.colors is None
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\ncolor 1 0 0\nendfacet\n"
    text = f"solid by hand\n{facet}endsolid\n"
    with pytest.warns(InputWarning, match="statement 'color' is unknown"):
        load_shapes(write(tmp_path, "b.stl", text))


def test_faces_that_all_refer_to_a_part_without_a_color_have_none(tmp_path):
    (shape,) = load_shapes(stl(tmp_path / "a.stl", [VALID] * 3))
    assert shape.mesh.colors is None
