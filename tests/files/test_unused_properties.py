"""Every property of PLY, OFF and STL files that is found in the wild is used, excused or warned of."""

import contextlib
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from support.mesh_files import INDICES, ORDERS, XYZ, off_binary, ply
from support.meshes import write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import from_trimesh, load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb

POINTS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]
FACES = [(0, 1, 2), (1, 3, 2)]
CODE = 200, 100, 50
COLOR = linear_from_srgb(np.array(CODE) / 255.0)

NAMES = {  # properties of one element, their values, and the attribute of the mesh
    "vertex red green blue": (CODE, "colors"),
    "vertex red green blue alpha": ((*CODE, 255), "colors"),
    "vertex r g b": (CODE, "colors"),
    "vertex r g b a": ((*CODE, 255), "colors"),
    "vertex diffuse_red diffuse_green diffuse_blue": (CODE, "colors"),
    "face red green blue": (CODE, "colors"),
    "face r g b": (CODE, "colors"),
    "face diffuse_red diffuse_green diffuse_blue": (CODE, "colors"),
    "vertex nx ny nz": ((0, 1, 0), "normals"),
    "vertex normal_x normal_y normal_z": ((0, 1, 0), "normals"),
    "vertex s t": ((0, 1), "uvs"),
    "vertex u v": ((0, 1), "uvs"),
    "vertex texture_u texture_v": ((0, 1), "uvs"),
    **{f"vertex {name}": ((1,), "") for name in ("quality", "confidence", "intensity", "scalar_Height", "curvature")},
    **{f"{element} flags": ((1,), "") for element in ("vertex", "face")},
    "face quality": ((1,), ""),
    "face nx ny nz": ((0, 0, 1), ""),
    "camera view_px view_py": ((0, 1), ""),
    "vertex radius": ((1,), "vertex.radius"),
    "vertex r": ((1,), "vertex.r"),
    "vertex f_rest_0 f_rest_1": ((0, 1), r"vertex.f_rest .*\(2 times\)"),
    "vertex material_index": ((1,), "vertex.material_index"),
    "face material_index": ((1,), "face.material_index"),
    "face texnumber": ((0,), "face.texnumber"),
    "edge vertex1 vertex2": ((0, 1), r"edge.vertex .*\(2 times\)"),
    "material ambient_red": ((0,), "material.ambient_red"),
}


@pytest.mark.parametrize("names", NAMES)
def test_properties_of_ply_are_used_or_accounted_for(names, tmp_path):
    values, expected = NAMES[names]
    element, *properties = names.split()
    kinds, extra = [f"uchar {name}" for name in properties], tuple(values)
    tables = {"vertex": ([*XYZ], [*POINTS]), "face": ([INDICES], [(face,) for face in FACES])}
    own, rows = tables.get(element, ([], [()]))
    tables[element] = ([*own, *kinds], [(*row, *extra) for row in rows])
    is_used = expected in ("", "colors", "normals", "uvs")
    message = f"a.ply: {expected}.* is unknown to wrt and left out|{expected}"
    for order in ORDERS:
        path = write(tmp_path, "a.ply", ply(order, *((name, *table) for name, table in tables.items())))
        with contextlib.nullcontext() if is_used else pytest.warns(InputWarning, match=message):
            (shape,) = load_shapes(path)
        mesh = shape.mesh
        if expected == "colors":
            np.testing.assert_allclose(mesh.colors, np.broadcast_to(COLOR, mesh.vertices.shape), rtol=1e-5)
        elif expected == "normals":
            np.testing.assert_allclose(mesh.normals, [(0, 1, 0)] * 4)
        elif expected == "uvs":
            np.testing.assert_allclose(mesh.uvs, [(0, 1)] * 4)
        else:
            assert mesh.colors is mesh.uvs is None


OFF_LINES = "\n".join(f"{x} {y} {z}" for x, y, z in POINTS)
RED, GREEN, CLAY = (1, 0, 0), (0, 1, 0), DEFAULT_REFLECTANCE
GREY = tuple(linear_from_srgb(np.full(3, 128 / 255.0)))


def test_faces_of_off_have_their_colors(tmp_path):
    for faces, expected in (
        ("3 0 1 2 255 0 0\n3 1 3 2 0 255 0\n", (RED, GREEN)),
        ("3 0 1 2 1.0 0 0\n3 1 3 2\n", (RED, CLAY)),
        ("3 0 1 2 255 0 0 255\n3 1 3 2 0 255 0\n", (RED, GREEN)),
        ("3 0 1 2 0 1 0 0.5\n3 1 3 2 1 0 0 1\n", ((*GREEN, 0.5), (*RED, 1))),
        ("4 0 1 3 2 0 255 0\n3 1 3 2 255 0 0\n", (GREEN, GREEN, RED)),
    ):
        (shape,) = load_shapes(write(tmp_path, "a.off", f"OFF\n4 2 0\n{OFF_LINES}\n{faces}"))
        np.testing.assert_allclose(shape.mesh.colors[shape.mesh.faces[:, 0]], expected, atol=1e-6)
        (shape,) = load_shapes(write(tmp_path, "b.off", off_binary(">", POINTS, FACES, colors=3)))
        np.testing.assert_allclose(shape.mesh.colors, linear_from_srgb(np.full((6, 3), 0.5)), rtol=1e-5)


def test_numbers_of_off_that_are_not_used_are_warned_of(tmp_path):
    for text, message in (
        (f"OFF\n4 2 0\n{OFF_LINES}\n3 0 1 2 7\n3 1 3 2 9\n", r"the number of a face's colour in a map .*\(2 times\)"),
        (f"OFF\n4 1 0\n{OFF_LINES}\n3 0 1 2 1 0\n", "a face's colour that is not three or four numbers"),
        (f"OFF\n4 1 0\n{OFF_LINES}\n3 0 1 2\nhello world\n", "a line behind the faces"),
        ("OFF\n3 1 0\n0 0 0 9\n1 0 0 9\n0 1 0 9\n3 0 1 2\n", r"a number of a vertex beyond those .*\(3 times\)"),
        ("OFF\n3 1 0\n0 0 0 9\n1 0 0\n0 1 0\n3 0 1 2\n", "a number of a vertex that not all have"),
        ("COFF\n3 1 0\n0 0 0 9\n1 0 0 9\n0 1 0 9\n3 0 1 2\n", "vertex colours of the OFF file are left out"),
        ("NOFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "fewer numbers than its header says"),
        ("STOFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "fewer numbers than its header says"),
    ):
        with pytest.warns(InputWarning, match=message):
            load_shapes(write(tmp_path, "a.off", text))


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
        ([VALID | OF_RED, VALID | OF_GREEN, OF_GREEN], b"VisCAM", [RED, GREEN, CLAY]),
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
