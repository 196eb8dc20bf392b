"""Corners of mesh formats that programs write and readers forget."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from support.meshes import SQUARE, area, area_vector, write

import wrt
from wrt.errors import InputWarning
from wrt.io.images import linear_from_srgb, save_image
from wrt.io.load_mesh import load_mesh, load_shapes


def test_obj_names_with_spaces(tmp_path):
    """Of the file, its folder, its materials' file, a material, and images, one of them above the folder."""
    folder = tmp_path / "my meshes"
    folder.mkdir()
    save_image(folder / "dark wood.png", np.full((2, 2, 3), 0.25))
    save_image(tmp_path / "light wood.png", np.full((2, 2, 3), 0.75))
    text = "newmtl dark red\nKd 0.5 0.1 0.1\nnewmtl dark\nKd 1 1 1\nmap_Kd dark wood.png\n"
    text += "newmtl light\nKd 1 1 1\nmap_Kd ..\\light wood.png\n"
    write(folder, "my materials.mtl", text)
    text = "mtllib my materials.mtl\no one thing\n" + SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\n"
    text += "usemtl dark red\nf 1 2 3\nusemtl dark\nf 1/1 2/2 3/3\nusemtl light\nf 1/1 3/2 4/3\n"
    shapes = load_shapes(write(folder, "my mesh.obj", text))
    found = {shape.name.partition(": ")[2]: shape.material.reflectance for shape in shapes}
    assert found["dark red"] == pytest.approx((0.5, 0.1, 0.1))
    assert found["dark"].pixels.max() == pytest.approx(0.25, abs=0.01)
    assert found["light"].pixels.max() == pytest.approx(0.75, abs=0.01)


def test_obj_negative_indices_count_back_from_where_they_stand(tmp_path):
    """Each kind from its own count, which goes on after the face."""
    text = "v 9 9 9\nvt 9 9\nvn 1 0 0\nvn 1 0 0\n" + SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
    text += "f -4/-4/-1 -3/-3/-1 -2/-2/-1\nf 2/2/-1 4/-2/3 -1/5/-1\nv 7 7 7\nvt 7 7\nvn 0 1 0\n"
    mesh = load_mesh(write(tmp_path, "mesh.obj", text))
    assert area_vector(mesh) == pytest.approx([0, 0, 1])
    np.testing.assert_allclose(mesh.uvs, mesh.vertices[:, :2])
    np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * len(mesh.vertices))


def test_obj_materials_that_nothing_describes_are_told(tmp_path):
    text = SQUARE + "usemtl steel\nf 1 2 3\nusemtl rust\nf 1 3 4\n"
    message = (
        r"mesh\.obj: it names no file \(mtllib\) that describes its materials, 'steel' and 1 more; they are left out"
    )
    with pytest.warns(InputWarning, match=message):
        assert len(load_mesh(write(tmp_path, "mesh.obj", text)).faces) == 2


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_numbers_of_all_kinds_in_any_order(tmp_path, order):
    """Quads of 16-bit indices, between numbers of other sizes that nobody asked for."""
    head = f"ply\nformat {order} 1.0\ncomment made by hand\nobj_info none\nelement vertex 4\n"
    head += "property double x\nproperty uchar flag\nproperty float y\nproperty double z\n"
    head += "property float nx\nproperty float ny\nproperty float nz\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n"
    head += "element face 1\nproperty short region\nproperty list uchar ushort vertex_indices\n"
    head += "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    points = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
    rows = [(x, 7, y, z, 0.0, 0.6, 0.8, 255, 128, 10 * k, 255) for k, (x, y, z) in enumerate(points)]
    face, edge = (-3, 4, 0, 1, 2, 3), (0, 1)
    if order == "ascii":
        body = "\n".join(" ".join(map(str, row)) for row in [*rows, face, edge]).encode()
    else:
        end = "<" if "little" in order else ">"
        body = b"".join(struct.pack(f"{end}dBfd3f4B", *row) for row in rows)
        body += struct.pack(f"{end}hB4H", *face) + struct.pack(f"{end}2i", *edge)
    shape = load_shapes(write(tmp_path, "all.ply", head.encode() + body))[0]
    assert area_vector(shape.mesh) == pytest.approx([0, 0, 2.0])
    np.testing.assert_allclose(shape.mesh.normals, [[0, 0.6, 0.8]] * 4, atol=1e-6)
    assert shape.material.reflectance == wrt.VertexColor()
    np.testing.assert_allclose(shape.mesh.colors[:, 1], linear_from_srgb(128 / 255), rtol=1e-6)
    np.testing.assert_allclose(shape.mesh.colors[:, 2], linear_from_srgb(np.arange(4) * 10 / 255), rtol=1e-5)


def facets(corners: np.ndarray, normal: str) -> str:
    text = ""
    for triangle in corners:
        text += f"facet normal {normal}\nouter loop\n"
        text += "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle.tolist()) + "endloop\nendfacet\n"
    return text


def test_a_binary_stl_of_nothing_is_told(tmp_path):
    header = bytes(range(128, 208))  # no text of any encoding
    with pytest.raises(wrt.InputError, match=r"none\.stl: no triangles in it"):
        load_mesh(write(tmp_path, "none.stl", header + bytes(4)))


def test_stl_solids_and_normals(tmp_path):
    """Several solids are several shapes; the normals are those of the triangles, whatever the file says."""
    first = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], np.float64)
    text = "".join(f"solid {name}\n{facets(first + k, '1 0 0')}endsolid {name}\n" for k, name in enumerate("ab"))
    shapes = load_shapes(write(tmp_path, "two.stl", text))
    assert [area(shape.mesh) for shape in shapes] == pytest.approx([0.5, 0.5])
    for shape in shapes:
        np.testing.assert_allclose(shape.mesh.normals, [[0, 0, 1]] * 3)
    old = load_shapes(write(tmp_path, "old.stl", text.replace("\n", "\r")))  # lines as on a Mac before 2001
    assert [area(shape.mesh) for shape in old] == pytest.approx([0.5, 0.5])
    # Capital letters and tabs, and no normals in the file.
    text = f"solid c\n{facets(first, '0 0 0')}endsolid c\n".upper().replace("VERTEX ", "\t VERTEX\t")
    with pytest.warns(InputWarning, match=r"three\.stl: the STL file has no normals; .* the order of corners"):
        assert area_vector(load_mesh(write(tmp_path, "three.stl", text))) == pytest.approx([0, 0, 0.5])


def test_off_polygons_comments_and_blank_lines(tmp_path):
    text = "# a house\nOFF\n\n5 2 0 # corners, faces\n0 0 0\n4 0 0\n4 2 0 # right\n0 2 0\n\n2 4 0\n4 0 1 2 3\n3 3 2 4\n"
    mesh = load_mesh(write(tmp_path, "house.off", text))
    assert len(mesh.faces) == 3
    assert area_vector(mesh) == pytest.approx([0, 0, 12.0])
