"""OFF files of every kind become the same mesh: as text, as binary, with colours, normals and texture coordinates."""

import struct

import numpy as np
import pytest
from support.meshes import area_vector, write

from wrt.errors import InputError, InputWarning
from wrt.io.load_mesh import load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb

POINTS = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [1, 3, 0]], np.float32)
FACES = ((0, 1, 2, 3), (3, 2, 4))
SIZES = f"{len(POINTS)} {len(FACES)} 0"
LINES = "\n".join(" ".join(f"{x:g}" for x in point) for point in POINTS)


def only_shape(tmp_path, data):
    (shape,) = load_shapes(write(tmp_path, "a.off", data))
    return shape


def binary(order, *, colored):
    data = struct.pack(f"{order}3i", len(POINTS), len(FACES), 0) + POINTS.astype(f"{order}f4").tobytes()
    for k, face in enumerate(FACES):
        data += struct.pack(f"{order}{len(face) + 1}i", len(face), *face)
        if colored:
            data += struct.pack(f"{order}i{3 * k}f", 3 * k, *[0.5] * (3 * k))
    return b"OFF BINARY\n" + data


@pytest.mark.parametrize(
    "data",
    [
        f"OFF\n{SIZES}\n{LINES}\n4 0 1 2 3\n3 3 2 4\n",
        f"# a comment\nOFF {SIZES}\n\n{LINES}  # its last point\r\n4 0 1 2 3 255 0 0\n3 3 2 4\n",
        f"OFF\n{SIZES}\n{LINES}\n4 0 1\n2 3 3\n3 2 4\n",  # one face is not one line
        binary(">", colored=True),  # as the manual says
        binary("<", colored=False),
        binary("<", colored=True),
    ],
    ids=["plain", "comments", "stream", "big-endian", "little-endian", "little-endian-colored"],
)
def test_every_kind_is_the_same_polygons(tmp_path, data):
    shape = only_shape(tmp_path, data)
    assert len(shape.mesh.faces) == 3
    np.testing.assert_allclose(area_vector(shape.mesh), [0, 0, 4.0])
    assert shape.material.reflectance == DEFAULT_REFLECTANCE


def test_quads_alone_are_read(tmp_path):
    shape = only_shape(tmp_path, f"OFF\n4 1 0\n{LINES[: LINES.rindex(chr(10))]}\n4 0 1 2 3\n")
    np.testing.assert_allclose(area_vector(shape.mesh), [0, 0, 2.0])


def test_colors_normals_and_coordinates_of_vertices(tmp_path):
    rows = "0 0 0  0 0 1  255 0 128 255  0 0\n1 0 0  0 1 0  0 255 128 255  1 0\n0 1 0  1 0 0  0 0 128 255  0 1\n"
    shape = only_shape(tmp_path, f"STCNOFF\n3 1 0\n{rows}3 0 1 2\n")
    order = np.argsort(shape.mesh.vertices @ [1.0, 2.0, 0.0])
    codes = np.array([[255, 0, 128], [0, 255, 128], [0, 0, 128]]) / 255.0
    np.testing.assert_allclose(shape.mesh.colors[order], linear_from_srgb(codes), atol=1e-6)
    np.testing.assert_allclose(shape.mesh.normals[order], np.eye(3)[::-1], atol=1e-6)
    np.testing.assert_allclose(shape.mesh.uvs[order], [[0, 0], [1, 0], [0, 1]], atol=1e-6)
    shape = only_shape(tmp_path, "COFF\n3 1 0\n0 0 0 0.5 0 0\n1 0 0 0.5 0 0\n0 1 0 0.5 0 0\n3 0 1 2\n")
    np.testing.assert_allclose(shape.mesh.colors[0], linear_from_srgb(np.array([0.5, 0.0, 0.0])), atol=1e-6)
    with pytest.warns(InputWarning, match="vertex colours of the OFF file are left out"):
        only_shape(tmp_path, f"COFF\n{SIZES}\n{LINES}\n3 0 1 2\n3 3 2 4\n")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "does not begin with OFF"),
        (f"4OFF\n{SIZES}\n{LINES}\n", "more than three coordinates"),
        ("OFF\n", "the numbers of its vertices and faces are missing"),
        (f"OFF\n{SIZES}\n{LINES}\n4 0 1 2 3\n", "6 of 7 vertices and faces are there; it is truncated"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1\n3 0 1 2\n", "fewer than three numbers"),
        ("OFF\n3 1 0\n0 0 0\n1 x 0\n0 1 0\n3 0 1 2\n", "not a whole OFF file"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", "fewer corners than it says"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "names vertex 3, but there are 3"),
        ("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "3 points and no faces"),
        (binary(">", colored=True)[:-8], "not as long as its numbers"),
        (b"OFF BINARY\n" + b"\xff" * 64, "not as long as its numbers"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, data, message):
    with pytest.raises(InputError, match=message) as caught:
        only_shape(tmp_path, data)
    assert "\n" not in str(caught.value)
