"""Each mesh format is read to its letter: indices, strips, polygons, colours, materials, transforms."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from PIL import Image
from support.meshes import SQUARE, area, area_vector, gltf_box, write

import wrt
from wrt.errors import InputWarning
from wrt.io.images import save_image
from wrt.io.load_mesh import from_trimesh, load_file, load_mesh, load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.io.mesh.polygons import split_strips, triangulate
from wrt.scene.srgb import linear_from_srgb

# OBJ ----------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:.*it names no file .mtllib. that describes its materials")
def test_obj_reads_what_is_found_in_the_wild(tmp_path):
    cases = {
        "comments": SQUARE + "f 1 2 3 # here\n# f 1 2 4\nf 1 3 4\n",
        "relative": SQUARE + "f -4 -3 -2\nf -4 -2 -1\nv 9 9 9\n",
        "relative between": "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 1 0\nf -4 -2 -1\n",
        "quad": SQUARE + "f 1 2 3 4\n",
        "mixed corners": SQUARE + "vn 0 0 1\nvt 0 0\nf 1/1/1 2//1 3\nf 1/1 3 4\n",
        "indented": "".join(f"\t {line}\n" for line in (SQUARE + "f 1 2 3 4").splitlines()),
        "continued": SQUARE + "f 1 2 \\\n 3 4\n",
        "windows": (SQUARE + "f 1 2 3 4\n").replace("\n", "\r\n"),
        "old mac": (SQUARE + "f 1 2 3 4\n").replace("\n", "\r"),
        "weights": SQUARE.replace(" 0\n", " 0 1\n") + "f 1 2 3 4\n",
        "groups": SQUARE + "o one\ng a\ns 1\nf 1 2 3\ng b\nusemtl x\nf 1 3 4\nl 1 2\np 1\n",
    }
    for name, text in cases.items():
        mesh = load_mesh(write(tmp_path, "mesh.obj", text))
        assert len(mesh.faces) == 2, name
        np.testing.assert_allclose(area_vector(mesh), [0, 0, 1], err_msg=name)
        np.testing.assert_allclose(mesh.normals, np.tile([0, 0, 1], (len(mesh.vertices), 1)), atol=1e-6, err_msg=name)


def test_obj_errors_name_what_is_wrong(tmp_path):
    for face, message in {
        "f 1 2 9": r"a face names something that is not there \(index 8 is out of bounds .* size 4\)",
        "f 0 1 2": r"line 6: face corner '0' names a 'v' that is not there \(4 are\)",
        "f 1/1 2/0 3/1": r"line 6: face corner '2/0' names a 'vt' that is not there \(1 are\)",
        "f -1 -2 -9": r"line 6: face corner '-9' names a 'v'",
        "f 1 2 three": r"something else where a number should be",
    }.items():
        with pytest.raises(wrt.InputError, match=message):
            load_mesh(write(tmp_path, "mesh.obj", SQUARE + "vt 0 0\n" + face + "\n"))
    with pytest.raises(wrt.InputError, match="something else where a number should be"):
        load_mesh(write(tmp_path, "mesh.obj", "v 0 0 0\nv 1 a 0\nv 1 1 0\nf 1 2 3\n"))


def test_obj_materials_split_the_mesh_without_a_seam_in_the_shading(tmp_path):
    save_image(tmp_path / "a picture.png", np.full((2, 2, 3), linear_from_srgb(128 / 255)))
    write(
        tmp_path,
        "two words.mtl",
        "newmtl red\nKd 0.8 0.1 0.05\nnewmtl laid\nKd 0.5 0.5 0.5\nmap_Kd -s 1 1 1 -clamp on a picture.png\n",
    )
    # A roof folded by 20 degrees, one side of each material.
    y = np.tan(np.deg2rad(10))
    text = f"mtllib two words.mtl\nv -1 0 0\nv 0 {y} 0\nv 0 {y} 1\nv -1 0 1\nv 1 0 0\nv 1 0 1\nvt 0 0\nvt 1 0\nvt 1 1\n"
    text += "usemtl red\nf 1 4 3 2\nusemtl laid\nf 2/1 3/1 6/2 5/3\n"
    red, laid = load_shapes(write(tmp_path, "roof.obj", text))
    assert red.material.reflectance == pytest.approx((0.8, 0.1, 0.05))
    assert isinstance(laid.material.reflectance, wrt.ImageTexture)
    np.testing.assert_allclose(laid.material.reflectance.pixels, linear_from_srgb(128 / 255), rtol=1e-6)
    assert laid.material.reflectance.factor == (0.5, 0.5, 0.5)
    assert laid.material.reflectance.wrap == ("clamp", "clamp")
    for shape in (red, laid):
        ridge = shape.mesh.vertices[:, 1] > 0.1
        assert ridge.sum() == 2
        np.testing.assert_allclose(shape.mesh.normals[ridge], [[0, 1, 0]] * 2, atol=1e-6)


def test_obj_with_missing_material_or_image_still_loads_with_a_warning(tmp_path):
    path = write(tmp_path, "mesh.obj", "mtllib none.mtl\n" + SQUARE + "usemtl x\nf 1 2 3 4\n")
    with pytest.warns(InputWarning, match=r"none\.mtl', which it refers to: no such file"):
        assert load_shapes(path)[0].material.reflectance == DEFAULT_REFLECTANCE
    write(tmp_path, "none.mtl", "newmtl x\nKd 0.1 0.2 0.3\nmap_Kd none.png\n")
    with pytest.warns(InputWarning, match=r"none\.png', which it refers to: no such file"):
        assert load_shapes(path)[0].material.reflectance == pytest.approx((0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("named", "told"),
    [
        ("mtllib old name.mtl\n", r"'old name\.mtl', which it refers to, is not there; '.*renamed\.MTL' is taken"),
        ("", r"it names no file \(mtllib\) that describes its materials, 'x'; '.*renamed\.MTL' is taken"),
    ],
)
def test_obj_takes_the_material_file_of_its_own_name_where_there_is_no_other(tmp_path, named, told):
    write(tmp_path, "renamed.MTL", "newmtl x\nKd 0.1 0.2 0.3\n")
    path = write(tmp_path, "renamed.obj", named + SQUARE + "usemtl x\nf 1 2 3 4\n")
    with pytest.warns(InputWarning, match=told):
        assert load_shapes(path)[0].material.reflectance == pytest.approx((0.1, 0.2, 0.3))


def test_obj_vertex_colors_are_decoded(tmp_path):
    path = write(tmp_path, "mesh.obj", "v 0 0 0 1 0 0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0 0 0 1\nf 1 2 3\n")
    shape = load_shapes(path)[0]
    assert shape.material.reflectance == wrt.VertexColor()
    grey = float(linear_from_srgb(0.5))
    np.testing.assert_allclose(shape.mesh.colors, [[1, 0, 0], [grey] * 3, [0, 0, 1]], rtol=1e-6)


def test_obj_faces_of_different_kinds_keep_what_each_gives_and_concave_ones_their_shape(tmp_path):
    # A triangle with normals, another with coordinates, and an arrowhead, each of which trimesh mistakes in company.
    text = "v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nvt 0.25 0.5\nvn 0 0.6 0.8\n"
    text += "f 1//1 2//1 3//1\nf 1/1 3/1 4/1\nf 4 1 2 3\n"
    by_size = load_shapes(write(tmp_path, "mesh.obj", text))
    first, second, arrow = (shape.mesh for shape in by_size)
    np.testing.assert_allclose(first.normals, [[0, 0.6, 0.8]] * 3, atol=1e-6)
    assert first.uvs is None
    np.testing.assert_allclose(second.uvs, [[0.25, 0.5]] * 3)
    assert len(arrow.faces) == 2
    assert area_vector(arrow) == pytest.approx([0, 0, 4.0])
    assert area(arrow) == pytest.approx(4.0)  # a fan from the first corner would cover more


def test_obj_texture_that_no_coordinates_lay_is_told(tmp_path):
    save_image(tmp_path / "grey.png", np.full((2, 2, 3), 0.25))
    write(tmp_path, "mesh.mtl", "newmtl x\nmap_Kd grey.png\n")
    text = "mtllib mesh.mtl\n" + SQUARE + "vt 0 0\nusemtl x\nf 1/1 2/1 3/2\n"
    with pytest.warns(InputWarning, match=r"texture grey\.png cannot be laid"):
        shape = load_shapes(write(tmp_path, "mesh.obj", text))[0]
    assert shape.material.reflectance == pytest.approx((0.25, 0.25, 0.25), abs=0.003)


# PLY ----------------------------------------------------------------------------------------------

STRIP = [0, 1, 2, 3, 4, 5, -1, 6, 7, 8, 8, 8, 9, 9, 10, 11]


def strip_points() -> np.ndarray:
    """A band of four triangles, then a triangle, and further along one more, joined by none of its area."""
    band = [[x, y, 0] for x in range(3) for y in (1, 0)]
    return np.array([*band, [4, 0, 0], [5, 0, 0], [4, 1, 0], [7, 0, 0], [8, 0, 0], [7, 1, 0]], np.float32)


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_strips_keep_their_winding_and_restarts(tmp_path, order):
    points = strip_points()
    head = f"ply\nformat {order} 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
    head += "property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    if order == "ascii":
        body = ("\n".join(" ".join(map(str, p)) for p in points.tolist()) + "\n").encode()
        body += " ".join(map(str, [len(STRIP), *STRIP])).encode()
    else:
        end = "<" if "little" in order else ">"
        body = points.astype(f"{end}f4").tobytes() + np.array([len(STRIP), *STRIP], f"{end}i4").tobytes()
    mesh = load_mesh(write(tmp_path, "strip.ply", head.encode() + body), smooth_degrees=None)
    assert area_vector(mesh) == pytest.approx([0, 0, 3.0])
    assert area(mesh) == pytest.approx(3.0)  # so no triangle faces down, and none bridges the gaps


def test_strips_alternate_and_restart():
    assert split_strips(np.array([0, 1, 2, 3, -1, 4, 5, 6, 7])).tolist() == [[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 5, 7]]
    assert split_strips(np.array([0, 1, -1, -1, 2])).tolist() == []


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_polygons_of_different_sizes_with_colors_and_coordinates(tmp_path, order):
    head = f"ply\nformat {order} 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    head += "property float s\nproperty float t\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    head += "element face 2\nproperty list uchar uint vertex_index\nproperty short flags\nend_header\n"
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 2, 0)]
    rows = [(*p, p[0], p[1] / 2, 255, 128, k) for k, p in enumerate(points)]
    polygons = [(4, 0, 1, 2, 3, 7), (3, 3, 2, 4, 8)]
    if order == "ascii":
        body = "\n".join(" ".join(map(str, row)) for row in [*rows, *polygons]).encode()
    else:
        sign = ">" if "big" in order else "<"
        body = b"".join(struct.pack(f"{sign}5f3B", *row) for row in rows)
        body += b"".join(struct.pack(f"{sign}B{p[0]}Ih", *p) for p in polygons)
        with pytest.raises(wrt.InputError, match=r"not as long as the PLY header says: it is truncated"):
            load_shapes(write(tmp_path, "mixed.ply", head.encode() + body[:-1]))
    shape = load_shapes(write(tmp_path, "mixed.ply", head.encode() + body))[0]
    assert len(shape.mesh.faces) == 3
    assert area_vector(shape.mesh) == pytest.approx([0, 0, 1.5])
    np.testing.assert_allclose(shape.mesh.uvs, shape.mesh.vertices[:, :2] * (1.0, 0.5))
    assert shape.material.reflectance == wrt.VertexColor()
    np.testing.assert_allclose(shape.mesh.colors[:, 1], linear_from_srgb(128 / 255), rtol=1e-6)


def test_ply_polygons_of_different_sizes_keep_colors_and_coordinates_of_faces(tmp_path):
    head = "ply\nformat binary_little_endian 1.0\nelement edge 1\nproperty int vertex1\nelement vertex 5\n"
    head += "property float x\nproperty float y\nproperty float z\nelement face 2\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    head += "property list uchar int vertex_indices\nproperty list ushort float texcoord\nend_header\n"
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 2, 0)], "<f4")
    body = struct.pack("<i", 3) + points.tobytes()
    for polygon, color in (((0, 1, 2, 3), (255, 0, 0)), ((3, 2, 4), (0, 0, 255))):
        count, laid = len(polygon), points[list(polygon), :2] / 2.0
        body += struct.pack(f"<3BB{count}iH", *color, count, *polygon, 2 * count) + laid.astype("<f4").tobytes()
    mesh = load_shapes(write(tmp_path, "mixed.ply", head.encode() + body))[0].mesh
    assert area_vector(mesh) == pytest.approx([0, 0, 1.5])
    np.testing.assert_allclose(mesh.uvs, mesh.vertices[:, :2] / 2.0)
    red = mesh.vertices[mesh.faces].max(axis=1)[:, 1] < 1.5
    np.testing.assert_array_equal(mesh.colors[mesh.faces][red], [[[1, 0, 0]] * 3] * 2)
    np.testing.assert_array_equal(mesh.colors[mesh.faces][~red], [[[0, 0, 1]] * 3])


def test_a_header_that_stops_trimesh_is_told_in_words(tmp_path):
    path = write(tmp_path, "blank.ply", "ply\nformat ascii 1.0\n\nend_header\n")
    message = r"not a whole PLY file that can be read: something in it is missing or not as specified \(list index"
    with pytest.raises(wrt.InputError, match=message):
        load_shapes(path)


def test_ply_face_colors_become_flat_patches(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 2\nproperty list uchar int vertex_indices\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    body = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 255 0 0\n3 0 2 3 0 0 255\n"
    shape = load_shapes(write(tmp_path, "patches.ply", head + body))[0]
    np.testing.assert_array_equal(shape.mesh.colors[shape.mesh.faces][0], [[1, 0, 0]] * 3)
    np.testing.assert_array_equal(shape.mesh.colors[shape.mesh.faces][1], [[0, 0, 1]] * 3)


def test_ply_quads_keep_their_shape_and_colors(tmp_path):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 2\nproperty list uchar int vertex_indices\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    points = np.array([[0, 0, 0], [4, 0, 0], [1, 1, 0], [0, 4, 0], [4, 4, 0]], "<f4")
    body = points.tobytes() + struct.pack("<B4i3B", 4, 3, 0, 1, 2, 255, 0, 0)
    body += struct.pack("<B4i3B", 4, 2, 1, 4, 3, 0, 0, 255)
    shape = load_shapes(write(tmp_path, "quads.ply", head.encode() + body))[0]
    assert area_vector(shape.mesh) == pytest.approx([0, 0, 16.0])
    assert area(shape.mesh) == pytest.approx(16.0)  # the first is concave
    colors = shape.mesh.colors[shape.mesh.faces][:, 0]
    np.testing.assert_array_equal(colors, [[1, 0, 0]] * 2 + [[0, 0, 1]] * 2)


def test_ply_names_its_image_by_the_word_of_meshlab(tmp_path):
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "red_A.png")
    head = "ply\nformat ascii 1.0\ncomment TextureFile <this>_A.png\n"
    head += "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
    head += "property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    body = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 1 0 0 1\n3 2 1 0 6 0 1 1 0 0 0\n"
    (shape,) = load_shapes(write(tmp_path, "red.ply", head + body))
    assert isinstance(shape.material.reflectance, wrt.ImageTexture)
    np.testing.assert_array_equal(shape.material.reflectance.pixels[0, 0], (1, 0, 0))


# glTF ---------------------------------------------------------------------------------------------


def test_gltf_nodes_factors_strips_and_normalized_integers(tmp_path):
    points = np.array([[0, 1, 0], [0, 0, 0], [1, 1, 0], [1, 0, 0]], "<f4")
    colors = np.array([[255, 0, 0, 255], [128, 128, 128, 255], [0, 0, 255, 255], [255] * 4], "<u1")
    data = points.tobytes() + colors.tobytes()
    half = 0.5**0.5
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"children": [1, 2], "translation": [10, 0, 0]},
            {"mesh": 0, "rotation": [half, 0, 0, half], "scale": [2, 2, 2]},  # +90 degrees about x
            {"mesh": 0, "scale": [-1, 1, 1]},
        ],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.001, 0.5, 1.0, 1.0]}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "mode": 5, "material": 0}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4},
            {"bufferView": 1, "componentType": 5121, "type": "VEC4", "count": 4, "normalized": True},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 16},
        ],
        "buffers": [{"byteLength": len(data), "uri": "the%20data.bin"}],
    }
    write(tmp_path, "the data.bin", data)
    path = write(tmp_path, "scene.gltf", json.dumps(tree))
    turned, mirrored = load_shapes(path)
    # The square faces +z; a quarter turn about x takes that to -y.
    assert area_vector(turned.mesh) == pytest.approx([0, -4, 0], abs=1e-6)
    np.testing.assert_allclose(turned.mesh.bounds, [[10, 0, 0], [12, 0, 2]], atol=1e-6)
    assert area_vector(mirrored.mesh) == pytest.approx([0, 0, 1])  # a mirror keeps fronts in front
    np.testing.assert_allclose(mirrored.mesh.bounds, [[9, 0, 0], [10, 1, 0]], atol=1e-6)
    grey = 128 / 255  # linear in this format
    expected = np.array([[1, 0, 0], [grey] * 3, [0, 0, 1], [1, 1, 1]]) * [0.001, 0.5, 1.0]
    np.testing.assert_allclose(turned.mesh.colors, expected, rtol=1e-6)

    del tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]
    write(tmp_path, "scene.gltf", json.dumps(tree))
    assert load_shapes(path)[0].material.base_color == pytest.approx((0.001, 0.5, 1.0))

    (tmp_path / "the data.bin").unlink()
    with pytest.raises(wrt.InputError, match=r"the data\.bin', which it refers to: no such file"):
        load_shapes(path)
    tree["extensionsRequired"] = ["KHR_techniques_webgl"]
    write(tmp_path, "scene.gltf", json.dumps(tree))
    with pytest.raises(wrt.InputError, match="KHR_techniques_webgl, which is not supported"):
        load_shapes(path)
    del tree["extensionsRequired"]
    tree["nodes"][1]["children"] = [0]
    write(tmp_path, "scene.gltf", json.dumps(tree))
    write(tmp_path, "the data.bin", data)
    with pytest.raises(wrt.InputError, match="circle"):
        load_shapes(path)


def test_points_without_faces_are_told(tmp_path):
    ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    for name, text in (("cloud.ply", f"{ply}0 0 0\n1 1 1\n"), ("cloud.obj", "v 0 0 0\nv 1 1 1\nl 1 2\n")):
        with pytest.raises(wrt.InputError, match="it has 2 points and no faces; only triangles are rendered"):
            load_mesh(write(tmp_path, name, text))


def test_gltf_lays_the_texture_by_the_coordinates_and_transform_it_names(tmp_path):
    save_image(tmp_path / "grey.png", np.full((2, 2, 3), 0.25))
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    uvs = np.array([[0, 0], [1, 0], [0, 0.5]], "<f4")
    write(tmp_path, "uvs.bin", uvs.tobytes())
    tree = gltf_box(points, np.array([[0, 1, 2]]))
    tree["buffers"].append({"uri": "uvs.bin", "byteLength": uvs.nbytes})
    tree["bufferViews"].append({"buffer": 1, "byteLength": uvs.nbytes})
    tree["accessors"].append({"bufferView": 2, "componentType": 5126, "type": "VEC2", "count": 3})
    tree["images"], tree["textures"] = [{"uri": "grey.png"}], [{"source": 0}]
    texture = {
        "index": 0,
        "texCoord": 1,
        "extensions": {"KHR_texture_transform": {"offset": [0.25, 0], "scale": [2, 1]}},
    }
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": texture}}]
    tree["meshes"][0]["primitives"][0] |= {"attributes": {"POSITION": 0, "TEXCOORD_1": 2}, "material": 0}
    # A node with a camera may carry others.
    tree["nodes"] = [{"camera": 0, "children": [1], "translation": [0, 0, 7]}, {"mesh": 0}]
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]
    shape = load_shapes(write(tmp_path, "laid.gltf", json.dumps(tree)))[0]
    assert isinstance(shape.material.base_color, wrt.ImageTexture)
    np.testing.assert_allclose(shape.mesh.vertices, points + [0, 0, 7])
    np.testing.assert_allclose(shape.mesh.uvs, uvs * [2, -1] + [0.25, 1], atol=1e-6)


def test_what_stands_in_several_places_is_there_once(tmp_path):
    import trimesh

    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    tree = gltf_box(points, np.array([[0, 1, 2]]))
    tree["nodes"] = [
        {"mesh": 0, "translation": [5, 0, 0]},
        {"children": [0, 2], "scale": [2, 2, 2]},
        {"mesh": 0, "scale": [-1, 1, 1]},
    ]
    file = load_file(write(tmp_path, "two.gltf", json.dumps(tree)))
    scene = trimesh.Scene()
    mesh = trimesh.Trimesh(points, [[0, 1, 2]], process=False)
    matrices = [np.diag([2.0, 2.0, 2.0, 1.0]) for _ in range(2)]
    matrices[0][0, 3], matrices[1][0, 0] = 10.0, -2.0
    scene.add_geometry(mesh, geom_name="m", transform=matrices[0])
    scene.graph.update(frame_to="another", matrix=matrices[1], geometry="m")
    for first, second in (file.shapes, from_trimesh(scene)):
        assert first.mesh is second.mesh
        np.testing.assert_allclose(first.transform, matrices[0])
        np.testing.assert_allclose(second.transform, matrices[1])
        np.testing.assert_allclose(first.bounds, [[10, 0, 0], [12, 2, 0]])
    presented = wrt.load(tmp_path / "two.gltf", up="z")
    assert presented.shapes[0].mesh is presented.shapes[1].mesh
    np.testing.assert_allclose(presented.shapes[0].bounds, [[10, 0, -2], [12, 0, 0]], atol=1e-6)
    # One mesh of all, and shapes without transforms, for those who want no more.
    assert load_mesh(tmp_path / "two.gltf").bounds.tolist() == [[-2, 0, 0], [12, 2, 0]]
    assert all(shape.transform is None for shape in load_shapes(tmp_path / "two.gltf"))


# Polygons -----------------------------------------------------------------------------------------


def test_concave_polygons_are_filled_exactly():
    rng = np.random.default_rng(3)
    for size in (4, 5, 7, 12, 31):
        for axis in range(3):
            angle = np.sort(rng.uniform(0, 2 * np.pi, size))
            angle = np.linspace(0, 2 * np.pi, size, endpoint=False) + 0.5 * (angle - angle.mean()) / size
            radius = rng.uniform(0.2, 1.0, size)
            flat = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
            points = np.insert(flat, axis, 0.5, axis=1)
            corners = np.arange(size)
            cut, owner = triangulate(points, corners, np.array([size]))
            assert len(cut) == size - 2
            assert not owner.any()
            mesh = wrt.Mesh(points, cut)
            newell = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)[axis] / 2.0
            # Positive parts that add up to the polygon's own area can neither overlap nor spill.
            assert area_vector(mesh)[axis] == pytest.approx(newell, rel=1e-5)
            assert area(mesh) == pytest.approx(abs(newell), rel=1e-5)


def test_polygons_that_cross_themselves_end():
    star = np.array([[np.cos(4 * np.pi * k / 5), np.sin(4 * np.pi * k / 5), 0.0] for k in range(5)])
    assert len(triangulate(star, np.arange(5), np.array([5]))[0]) == 3
    assert len(triangulate(np.zeros((6, 3)), np.arange(6), np.array([6]))[0]) == 4
