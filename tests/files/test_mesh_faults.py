"""What is wrong with a mesh file is told in one line, whatever the format."""

from __future__ import annotations

import json
import os
import struct
import warnings

import numpy as np
import pytest
from support.mesh_files import INDICES, ORDERS, XYZ, box_files, check_refused, off_binary, ply
from support.meshes import SQUARE, check_message, gltf_box, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_mesh, load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE, Part, moved

BOXES = box_files()
POINTS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
OFF = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n"
SUFFIXES = "obj", "ply", "stl", "off", "glb", "gltf"
MANY = b"element vertex 4000000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n1234"


def huge_gltf() -> str:
    tree = gltf_box(np.array(POINTS), np.array([[0, 1, 2]]))
    tree["accessors"][0]["count"] = 10**15
    return json.dumps(tree)


REFUSED: list[tuple[str, str | bytes, str]] = [
    ("a.xyz", "1 2 3", "not a known mesh format"),
    *((f"a.{suffix}", "", "the file is empty") for suffix in SUFFIXES),
    *((f"noise.{suffix}", bytes(range(256)) * 3, "noise") for suffix in (*SUFFIXES, "3mf")),
    # Cut short, or longer than any memory
    *((name, BOXES[name][:-40], "truncated") for name in BOXES if name.endswith((".stl", ".ply"))),
    ("a.off", OFF.replace("3 1", "3 2") + "3 0 1 2\n", "4 of 5 vertices and faces are there; it is truncated"),
    ("a.off", BOXES["big.off"][:-8], "not as long as its numbers"),
    ("a.off", b"OFF BINARY\n" + b"\xff" * 64, "not as long as its numbers"),
    ("a.ply", b"ply\nformat binary_little_endian 1.0\n" + MANY, "truncated"),
    ("a.gltf", huge_gltf(), "not a whole GLTF file"),
    # Places and corners
    *(
        ("a.obj", f"v 0 0 0\nv 1 {word} 0\nv 1 1 0\nf 1 2 3\n", r"a vertex is at 1 \S+ 0; positions must be finite")
        for word in ("nan", "1e39")
    ),
    ("a.obj", SQUARE + "f 1 2 9\n", r"a face names something that is not there \(index 8 is out of bounds .* size 4\)"),
    ("a.obj", SQUARE + "f 0 1 2\n", r"line 5: face corner '0' names a 'v' that is not there \(4 are\)"),
    (
        "a.obj",
        SQUARE + "vt 0 0\nf 1/1 2/0 3/1\n",
        r"line 6: face corner '2/0' names a 'vt' that is not there \(1 are\)",
    ),
    ("a.obj", SQUARE + "f -1 -2 -9\n", r"line 5: face corner '-9' names a 'v'"),
    ("a.off", "OFF\n0 1 0\n3 0 1 2\n", "a face names vertex 2, but there are 0"),
    ("a.off", OFF + "3 0 1 3\n", "names vertex 3, but there are 3"),
    ("a.off", OFF + "4 0 1 2\n", "fewer corners than it says"),
    # No triangles
    ("a.obj", SQUARE + "f 1 1 2\n", "no triangles"),
    ("a.obj", "v 0 0 0\nv 1 1 1\nl 1 2\n", "it has 2 points and no faces; only triangles are rendered"),
    ("a.ply", ply("ascii", ("vertex", XYZ, POINTS)), "it has 3 points and no faces"),
    ("a.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "3 points and no faces"),
    ("a.stl", bytes(range(128, 208)) + bytes(4), "no triangles in it"),  # its header is text in no encoding
    # Words and numbers
    ("a.obj", SQUARE + "f 1 2 three\n", "something else where a number should be"),
    ("a.obj", "v 0 0 0\nv 1 a 0\nv 1 1 0\nf 1 2 3\n", "something else where a number should be"),
    ("a.ply", "ply\nformat ascii 1.0\n\nend_header\n", r"not a whole PLY file .* not as specified \(list index"),
    ("a.off", OFF[4:] + "3 0 1 2\n", "does not begin with OFF"),
    ("a.off", "4" + OFF, "more than three coordinates"),
    ("a.off", "OFF\n", "the numbers of its vertices and faces are missing"),
    ("a.off", OFF.replace("1 0 0\n", "1 x 0\n") + "3 0 1 2\n", "not a whole OFF file"),
    ("a.off", OFF.replace("0 1 0\n", "0 1\n") + "3 0 1 2\n", "fewer than three numbers"),
]


def test_files_that_cannot_be_read_are_refused_in_one_line(tmp_path):
    for name, content, message in REFUSED:
        check_refused(message, load_mesh, write(tmp_path, name, content))
    check_refused("no such file", load_mesh, tmp_path / "none.obj")
    (tmp_path / "folder.obj").mkdir()
    check_refused("is a directory", load_mesh, tmp_path / "folder.obj")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_unreadable_file_is_refused(tmp_path):
    path = write(tmp_path, "mesh.obj", SQUARE + "f 1 2 3\n")
    path.chmod(0)
    check_refused("cannot be read: Permission denied", load_mesh, path)


@pytest.mark.parametrize("order", ORDERS[1:])
def test_a_ply_file_of_mixed_polygons_says_that_it_is_cut_short(order, tmp_path):
    elements = ("vertex", XYZ, [*POINTS, (1.0, 1.0, 0.0)]), ("face", (INDICES,), [[(0, 1, 2)], [(0, 1, 3, 2)]])
    path = write(tmp_path, "a.ply", ply(order, *elements)[:-1])
    check_refused("not as long as the PLY header says: it is truncated", load_shapes, path)


def test_broken_files_load_or_are_refused_in_one_line(assets):
    refused = set()
    for path in sorted((assets / "broken").glob("*")):
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy's among them
            warnings.simplefilter("ignore", InputWarning)
            try:
                assert all(len(shape.mesh.faces) for shape in load_shapes(path))
            except wrt.InputError as error:
                check_message(error, path)
                refused.add(path.name)
    assert refused <= {"obj_empty.obj", "obj_points.obj", "ply_empty_bin.ply", "ply_empty_header.ply"}
    with pytest.warns(InputWarning, match=r"nancolor\.obj: vertex colours are left out"):
        (shape,) = load_shapes(assets / "broken" / "nancolor.obj")
    assert (shape.mesh.colors, shape.material.reflectance) == (None, DEFAULT_REFLECTANCE)
    assert len(shape.mesh.faces) == 12


def test_faces_without_area_are_dropped(tmp_path):
    path = write(tmp_path, "mesh.obj", SQUARE + "v 0 0 0\nf 1 2 3\nf 1 1 2\nf 1 5 2\n")
    with pytest.warns(InputWarning, match=r"mesh\.obj: 2 of 3 triangles are left out: .* no area"):
        assert len(load_mesh(path).faces) == 1


def test_colors_and_normals_of_no_use_are_told(tmp_path):
    path = write(tmp_path, "a.off", f"C{OFF}3 0 1 2\n")
    with pytest.warns(InputWarning, match="vertex colours of the OFF file are left out"):
        load_mesh(path)
    assert load_mesh(write(tmp_path, "b.off", off_binary("<", POINTS, [(0, 1, 2)]))).colors is None
    text = struct.pack("<80sI", b"", 1) + struct.pack("<12fH", 0, 0, 0, *np.ravel(POINTS), 0)
    with pytest.warns(InputWarning, match=r"a\.stl: the STL file has no normals; .* the order of corners"):
        load_mesh(write(tmp_path, "a.stl", text))


def test_what_trimesh_logs_about_damaged_files_is_not_passed_on(tmp_path, caplog):
    import trimesh

    with caplog.at_level("DEBUG", logger=trimesh.constants.log.name):
        write(tmp_path, "mesh.mtl", "newmtl x\nKd a b c\nmap_Kd none.png\n")
        with pytest.warns(InputWarning, match=r"none\.png"):
            load_mesh(write(tmp_path, "mesh.obj", "mtllib mesh.mtl\n" + SQUARE + "usemtl x\nf 1 2 3 4\n"))
        check_refused("no triangles", load_mesh, write(tmp_path, "mesh.ply", "ply\nformat ascii 1.0\nend_header"))
        assert not caplog.records
        trimesh.load_scene(tmp_path / "mesh.obj")
        assert caplog.records  # it is heard again, and there was something to hear


@pytest.mark.filterwarnings("error")
def test_normals_of_any_bits_are_taken_without_a_warning_of_numpy(tmp_path):
    """Damaged files and decoders such as Draco's give signalling NaN, which NumPy warns of."""
    normals = np.full((3, 3), 0x7F800001, np.uint32).view(np.float32)
    assert np.isnan(moved(Part("part", np.eye(3), np.array([[0, 1, 2]]), normals=normals), np.eye(4)).normals).all()
    facet = normals[0].tobytes() + struct.pack("<9fH", *np.ravel(POINTS), 0)
    load_mesh(write(tmp_path, "a.stl", struct.pack("<80sI", b"", 1) + facet))
