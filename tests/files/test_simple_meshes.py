"""OBJ, PLY, STL and OFF files are read to their letter: indices, strips, polygons, colours of faces, words."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from support.mesh_files import INDICES, ORDERS, XYZ, facets, off_binary, ply
from support.meshes import SQUARE, area, area_vector, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_mesh, load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb


@pytest.mark.filterwarnings("ignore:.*it names no file .mtllib. that describes its materials")
def test_obj_reads_what_is_found_in_the_wild(tmp_path):
    quad = SQUARE + "f 1 2 3 4\n"
    cases = {
        "comments": SQUARE + "f 1 2 3 # here\n# f 1 2 4\nf 1 3 4\n",
        "relative": SQUARE + "f -4 -3 -2\nf -4 -2 -1\nv 9 9 9\n",
        "relative between": "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 1 0\nf -4 -2 -1\n",
        "mixed corners": SQUARE + "vn 0 0 1\nvt 0 0\nf 1/1/1 2//1 3\nf 1/1 3 4\n",
        "indented": "".join(f"\t {line}\n" for line in quad.splitlines()),
        "continued": SQUARE + "f 1 2 \\\n 3 4\n",
        "windows": quad.replace("\n", "\r\n"),
        "old mac": quad.replace("\n", "\r"),
        "weights": quad.replace(" 0\n", " 0 1\n"),
        "groups": SQUARE + "o one\ng a\ns 1\nf 1 2 3\ng b\nusemtl x\nf 1 3 4\nl 1 2\np 1\n",
    }
    for name, text in cases.items():
        mesh = load_mesh(write(tmp_path, "mesh.obj", text))
        assert len(mesh.faces) == 2, name
        np.testing.assert_allclose(area_vector(mesh), [0, 0, 1], err_msg=name)
        np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * len(mesh.vertices), atol=1e-6, err_msg=name)


def test_obj_negative_indices_count_back_from_where_they_stand(tmp_path):
    """Each kind from its own count, which goes on after the face."""
    text = "v 9 9 9\nvt 9 9\nvn 1 0 0\nvn 1 0 0\n" + SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
    text += "f -4/-4/-1 -3/-3/-1 -2/-2/-1\nf 2/2/-1 4/-2/3 -1/5/-1\nv 7 7 7\nvt 7 7\nvn 0 1 0\n"
    mesh = load_mesh(write(tmp_path, "mesh.obj", text))
    assert area_vector(mesh) == pytest.approx([0, 0, 1])
    np.testing.assert_allclose(mesh.uvs, mesh.vertices[:, :2])
    np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * len(mesh.vertices))


def test_obj_faces_of_different_kinds_keep_what_each_gives(tmp_path):
    """A triangle with normals, one with coordinates, and an arrowhead: trimesh mistakes each in company."""
    text = "v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nvt 0.25 0.5\nvn 0 0.6 0.8\n"
    text += "f 1//1 2//1 3//1\nf 1/1 3/1 4/1\nf 4 1 2 3\n"
    first, second, arrow = (shape.mesh for shape in load_shapes(write(tmp_path, "mesh.obj", text)))
    np.testing.assert_allclose(first.normals, [[0, 0.6, 0.8]] * 3, atol=1e-6)
    assert first.uvs is None
    np.testing.assert_allclose(second.uvs, [[0.25, 0.5]] * 3)
    assert area_vector(arrow) == pytest.approx([0, 0, 4.0])
    assert area(arrow) == pytest.approx(4.0)  # a fan from the first corner would cover more


@pytest.mark.parametrize("axis", range(3))
def test_concave_polygons_are_filled_exactly(axis, tmp_path):
    rng = np.random.default_rng(axis)
    for size in (4, 5, 7, 12, 31):
        angle = 2.0 * np.pi * (np.arange(size) + rng.uniform(-0.2, 0.2, size)) / size
        flat = rng.uniform(0.2, 1.0, (size, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points = np.insert(flat, axis, 0.5, axis=1).astype(np.float32).astype(np.float64)
        face = "f " + " ".join(str(k + 1) for k in range(size))
        text = "".join("v {!r} {!r} {!r}\n".format(*point) for point in points.tolist()) + face + "\n"
        mesh = load_mesh(write(tmp_path, "mesh.obj", text))
        newell = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)[axis] / 2.0
        # Positive parts that add up to the polygon's own area can neither overlap nor spill.
        assert len(mesh.faces) == size - 2
        assert area_vector(mesh)[axis] == pytest.approx(newell, rel=1e-5)
        assert area(mesh) == pytest.approx(abs(newell), rel=1e-5)


def test_polygons_that_cross_themselves_end(tmp_path):
    star = [(np.cos(4 * np.pi * k / 5), np.sin(4 * np.pi * k / 5)) for k in range(5)]
    text = "".join(f"v {x} {y} 0\n" for x, y in star) + "f 1 2 3 4 5\n"
    assert len(load_mesh(write(tmp_path, "star.obj", text)).faces) == 3
    with pytest.raises(wrt.InputError, match="no triangles"):
        load_mesh(write(tmp_path, "point.obj", "v 0 0 0\n" * 6 + "f 1 2 3 4 5 6\n"))


@pytest.mark.parametrize("order", ORDERS)
def test_ply_strips_keep_their_winding_and_restarts(tmp_path, order):
    """A band of four triangles, then a triangle, and further along one more, joined by none of its area."""
    band = [(x, y, 0) for x in range(3) for y in (1, 0)]
    points = [*band, (4, 0, 0), (5, 0, 0), (4, 1, 0), (7, 0, 0), (8, 0, 0), (7, 1, 0)]
    strip = [0, 1, 2, 3, 4, 5, -1, -1, 6, 7, 8, 8, 8, 9, 9, 10, 11, -1, 3]
    data = ply(order, ("vertex", XYZ, points), ("tristrips", ["list int int vertex_indices"], [[strip]]))
    mesh = load_mesh(write(tmp_path, "strip.ply", data), smooth_degrees=None)
    assert area_vector(mesh) == pytest.approx([0, 0, 3.0])
    assert area(mesh) == pytest.approx(3.0)  # so no triangle faces down, and none bridges the gaps


RGB = "uchar red", "uchar green", "uchar blue"
RED, BLUE = (255, 0, 0), (0, 0, 255)


@pytest.mark.parametrize(
    ("points", "faces"),
    [
        ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)]),
        ([(0, 0, 0), (4, 0, 0), (1, 1, 0), (0, 4, 0), (4, 4, 0)], [(3, 0, 1, 2), (2, 1, 4, 3)]),  # one is concave
        ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 2, 0)], [(0, 1, 2, 3), (3, 2, 4)]),
    ],
)
def test_ply_faces_keep_their_shape_and_color(tmp_path, points, faces):
    rows = [(face, *color) for face, color in zip(faces, (RED, BLUE), strict=True)]
    data = ply("binary_little_endian", ("vertex", XYZ, points), ("face", [INDICES, *RGB], rows))
    mesh = load_mesh(write(tmp_path, "faces.ply", data))
    places = np.array(points, np.float64)
    areas = [np.cross(places[list(f)], np.roll(places[list(f)], -1, axis=0)).sum(axis=0)[2] / 2 for f in faces]
    assert area_vector(mesh)[2] == pytest.approx(sum(areas))
    for color, expected in ((0, areas[0]), (2, areas[1])):
        of_color = mesh.faces[(mesh.colors[mesh.faces] == np.eye(3)[color]).all(axis=(1, 2))]
        assert area(wrt.Mesh(mesh.vertices, of_color)) == pytest.approx(expected)


def test_ply_coordinates_of_faces_and_an_image_by_the_word_of_meshlab(tmp_path):
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "red_A.png")
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 2, 0)]
    for order in ORDERS:
        faces = [(0, 1, 2, 3), (3, 2, 4)]
        rows = [(face, [x / 2 for k in face for x in points[k][:2]]) for face in faces]
        kinds = "list uchar int vertex_indices", "list ushort float texcoord"
        elements = ("edge", ["int vertex1"], [[3]]), ("vertex", XYZ, points), ("face", kinds, rows)
        path = write(tmp_path, "red.ply", ply(order, *elements, head="comment TextureFile <this>_A.png\n"))
        shapes = load_shapes(path)
        assert sum(area(shape.mesh) for shape in shapes) == pytest.approx(1.5)
        for shape in shapes:
            np.testing.assert_allclose(shape.mesh.uvs, shape.mesh.vertices[:, :2] / 2.0)
            np.testing.assert_array_equal(shape.material.reflectance.pixels[0, 0], (1, 0, 0))


def test_stl_words_in_capitals_and_with_tabs(tmp_path):
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    text = f"solid c\n{facets(corners)}endsolid c\n".upper().replace("VERTEX ", "\t VERTEX\t")
    with pytest.warns(InputWarning, match="the STL file has no normals"):
        assert area_vector(load_mesh(write(tmp_path, "three.stl", text))) == pytest.approx([0, 0, 0.5])


POINTS = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (1, 3, 0)]
FACES = (0, 1, 2, 3), (3, 2, 4)
LINES = "\n".join(f"{x} {y} {z}" for x, y, z in POINTS)


@pytest.mark.parametrize(
    "data",
    [
        f"# a comment\nOFF 5 2 0\n\n{LINES}  # its last point\r\n\n4 0 1 2 3 255 0 0\n3 3 2 4\n",
        f"OFF\n5 2 0\n{LINES}\n4 0 1\n2 3 3\n3 2 4\n",  # one face is not one line
        off_binary(">", POINTS, FACES, colors=3),  # as the manual says
        off_binary("<", POINTS, FACES, colors=3),
        off_binary("<", POINTS, FACES),
    ],
    ids=["comments", "stream", "big-endian", "little-endian-colored", "little-endian"],
)
def test_off_files_of_every_kind_are_the_same_polygons(tmp_path, data):
    (shape,) = load_shapes(write(tmp_path, "a.off", data))
    assert len(shape.mesh.faces) == 3
    np.testing.assert_allclose(area_vector(shape.mesh), [0, 0, 4.0])
    assert shape.material.reflectance == DEFAULT_REFLECTANCE


def test_off_colors_may_be_numbers_from_0_to_1(tmp_path):
    text = "COFF\n3 1 0\n0 0 0 0.5 0 0\n1 0 0 0.5 0 0\n0 1 0 0.5 0 0\n3 0 1 2\n"
    colors = load_mesh(write(tmp_path, "a.off", text)).colors
    np.testing.assert_allclose(colors, [linear_from_srgb(np.array([0.5, 0.0, 0.0]))] * 3, atol=1e-6)
