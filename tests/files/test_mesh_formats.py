"""Every mesh format gives the same meshes: positions, faces, normals, coordinates, colours, several objects."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh
from support.mesh_files import ORDERS, Element, add, attributes, box_files, ply
from support.meshes import area, area_vector, gltf_box, repeated_edges, triangles, volume, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import from_trimesh, load_file, load_mesh, load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb


def three_mf(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """Return a mesh as a 3MF file."""
    held = io.BytesIO()
    mesh = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in vertices.tolist())
    mesh = f"<vertices>{mesh}</vertices><triangles>"
    mesh += "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist()) + "</triangles>"
    model = f'<model><resources><object id="1"><mesh>{mesh}</mesh></object></resources>'
    model += '<build><item objectid="1"/></build></model>'
    with zipfile.ZipFile(held, "w") as archive:
        archive.writestr("3D/3dmodel.model", '<?xml version="1.0"?>' + model)
    return held.getvalue()


def usd(points: np.ndarray, faces: Sequence[Sequence[int]], more: str = "") -> str:
    corners, counts = [k for face in faces for k in face], [len(face) for face in faces]
    text = f"point3f[] points = {list(map(tuple, points.tolist()))}\nint[] faceVertexIndices = {corners}\n"
    text += f"int[] faceVertexCounts = {counts}\n{more}"
    return f'#usda 1.0\n(\nmetersPerUnit = 1\nupAxis = "Y"\n)\ndef Mesh "M"\n{{\n{text}}}\n'


LIBRARIES = {"usda": "pxr", "dae": "collada"}


def written(folder: Path, files: dict[str, str | bytes]) -> list[Path]:
    """Write the files that the libraries at hand can read."""
    names = [name for name in files if find_spec(LIBRARIES.get(name.rpartition(".")[2], "numpy"))]
    return [write(folder, name, files[name]) for name in names]


def boxes_of_libraries() -> dict[str, str | bytes]:
    box, held = wrt.box((0, 0, 0), (1, 2, 3)), io.BytesIO()
    np.savez(held, vertices=box.vertices, faces=box.faces)
    found = {
        "box.usda": usd(box.vertices, box.faces.tolist()),
        "box.3mf": three_mf(box.vertices, box.faces),
        "box.npz": held.getvalue(),
    }
    if find_spec("collada"):
        from trimesh.exchange.dae import export_collada

        found["box.dae"] = export_collada(trimesh.Trimesh(box.vertices, box.faces, process=False))
    return found


def test_every_format_gives_the_same_box(tmp_path):
    for path in written(tmp_path, box_files() | boxes_of_libraries()):
        mesh, name = load_mesh(path), path.name
        assert len(mesh.faces) == 12, name
        np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [1, 2, 3]], atol=1e-6, err_msg=name)
        assert volume(mesh) == pytest.approx(6.0), name
        if name not in ("box.npz", "box.dae"):  # arrays have no normals, and trimesh writes rounded ones
            flat = np.cross(*np.moveaxis(np.diff(triangles(mesh), axis=1), 1, 0))
            flat /= np.linalg.norm(flat, axis=1, keepdims=True)
            expected = np.repeat(flat[:, None], 3, axis=1)
            assert len(mesh.vertices) == 24, name  # split at the edges, which are sharp
            np.testing.assert_allclose(mesh.normals[mesh.faces], expected, atol=1e-6, err_msg=name)


PLACES = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 3.0, 0.0)]
FACES = (0, 1, 2, 3), (3, 2, 4)
CODES = [(255, 128, 10 * k) for k in range(5)]
COLORS = linear_from_srgb(np.array(CODES) / 255.0)
UVS = [(x / 2, y / 4) for x, y, _ in PLACES]


def ply_house(order: str) -> bytes:
    """Numbers of all kinds in any order, between others that nobody asked for."""
    kinds = "double x", "uchar flag", "float y", "double z", "float nx", "float ny", "float nz", "float s", "float t"
    kinds += tuple(f"uchar {name}" for name in ("red", "green", "blue", "alpha"))
    rows = [(x, 7, y, z, 0.0, 0.6, 0.8, *uv, *c, 255) for (x, y, z), uv, c in zip(PLACES, UVS, CODES, strict=True)]
    faces: Element = ("face", ("short region", "list uchar ushort vertex_index"), [(-3, face) for face in FACES])
    edges: Element = ("edge", ("int vertex1", "int vertex2"), [(0, 1)])
    return ply(order, ("vertex", kinds, rows), faces, edges, head="comment by hand\nobj_info none\n")


def houses() -> dict[str, str | bytes]:
    """A quad and a triangle on it, with one normal, coordinates by position, and a colour for each corner."""
    together = list(zip(PLACES, UVS, CODES, strict=True))
    obj = "".join(f"v {x} {y} {z} {r / 255} {g / 255} {b / 255}\n" for (x, y, z), _, (r, g, b) in together)
    obj += "".join(f"vt {u} {v}\n" for u, v in UVS) + "vn 0 0.6 0.8\n"
    obj += "".join("f " + " ".join(f"{k + 1}/{k + 1}/1" for k in face) + "\n" for face in FACES)
    off = "".join(f"{x} {y} {z} 0 .6 .8 {r} {g} {b} 255 {u} {v}\n" for (x, y, z), (u, v), (r, g, b) in together)
    tree = gltf_box(np.array(PLACES), np.array([[0, 1, 2], [0, 2, 3], [3, 2, 4]]))
    attributes(tree).update(
        NORMAL=add(tree, [(0, 0.6, 0.8)] * 5), TEXCOORD_0=add(tree, np.array(UVS) * [1, -1] + [0, 1]),
        COLOR_0=add(tree, COLORS),
    )  # fmt: skip
    tree["materials"], tree["meshes"][0]["primitives"][0]["material"] = [{}], 0
    more = f"normal3f[] normals = {[(0, 0.6, 0.8)] * 5}\n"
    for name, array in (("texCoord2f[] primvars:st", UVS), ("color3f[] primvars:displayColor", COLORS.tolist())):
        more += f'{name} = {list(map(tuple, array))} (interpolation = "vertex")\n'
    return {
        "house.obj": obj,
        "house.off": f"STCNOFF\n5 2 0\n{off}4 0 1 2 3\n3 3 2 4\n",
        "house.gltf": json.dumps(tree),
        "house.usda": usd(np.array(PLACES), FACES, more),
        **{f"{order}.ply": ply_house(order) for order in ORDERS},
    }


def test_every_format_gives_the_same_normals_coordinates_and_colors(tmp_path):
    for path in written(tmp_path, houses()):
        shapes, name = load_shapes(path), path.name  # of OBJ two, as its faces have different sizes
        assert sum(len(shape.mesh.faces) for shape in shapes) == 3, name
        np.testing.assert_allclose(sum(area_vector(shape.mesh) for shape in shapes), [0, 0, 4], err_msg=name)
        for mesh, material in ((shape.mesh, shape.material) for shape in shapes):
            np.testing.assert_allclose(mesh.normals, [[0, 0.6, 0.8]] * len(mesh.vertices), atol=1e-6, err_msg=name)
            np.testing.assert_allclose(mesh.uvs, mesh.vertices[:, :2] * [0.5, 0.25], atol=1e-6, err_msg=name)
            nearest = np.linalg.norm(mesh.vertices[:, None] - np.array(PLACES), axis=2).argmin(axis=1)
            np.testing.assert_allclose(mesh.colors, COLORS[nearest], rtol=1e-5, atol=1e-7, err_msg=name)
            color = material.reflectance if isinstance(material, wrt.Diffuse) else material.base_color
            assert color == wrt.VertexColor(), name
            assert material.opacity == 1.0, name


@pytest.mark.parametrize(
    ("name", "count", "closed"), [("spot.obj", 5856, True), ("Duck.glb", 4212, False), ("fuze/fuze.obj", 1000, False)]
)
def test_real_files_load_whole_and_consistently_wound(name, count, closed, assets):
    mesh = load_mesh(assets / "meshes" / name)
    assert len(mesh.faces) == count
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)
    assert repeated_edges(mesh) == 0
    assert volume(mesh.translated(-mesh.bounds.mean(axis=0))) > 0.0
    if closed:
        assert np.abs(area_vector(mesh)).max() < 1e-5 * area(mesh)


@pytest.mark.slow
def test_igea_strips_keep_every_vertex_and_bridge_nothing(assets):
    mesh = load_mesh(assets / "meshes" / "igea.ply", smooth_degrees=None)
    # A closed surface of genus 0: F = 2 V - 4.
    assert (len(mesh.vertices), len(mesh.faces)) == (134345, 2 * 134345 - 4)
    longest = np.linalg.norm(np.diff(triangles(mesh)[:, [0, 1, 2, 0]], axis=1), axis=2).max()
    assert longest < 0.02 * np.linalg.norm(np.diff(mesh.bounds, axis=0))


def test_textures_of_real_files_lie_right(assets):
    """The duck is yellow: sampled where its vertices lie, red and green are far above blue."""
    duck = load_shapes(assets / "meshes" / "Duck.glb")[0]
    u, v = (duck.mesh.uvs * [1, -1] + [0, 1]).T * 512
    pixels = duck.material.base_color.pixels[v.astype(int) % 512, u.astype(int) % 512]
    red, green, blue = np.median(pixels, axis=0)
    assert min(red, green) > 0.4 > 0.1 > blue


@pytest.mark.parametrize("channels", [3, 4])
def test_a_bare_mesh_has_its_colors_and_else_the_material_of_files(channels, tmp_path):
    arrays = {"vertices": np.eye(3), "faces": [[0, 1, 2]]}
    assert wrt.load(wrt.Mesh(**arrays)).shapes[0].material.reflectance == DEFAULT_REFLECTANCE
    arrays["colors"] = np.linspace(0.0, 1.0, 3 * channels).reshape(3, channels)
    np.savez(tmp_path / "colored.npz", **arrays)
    for source in (wrt.Mesh(**arrays), tmp_path / "colored.npz"):
        material = wrt.load(source).shapes[0].material
        assert material.reflectance == wrt.VertexColor()
        assert material.opacity == (wrt.VertexColor(alpha=True) if channels == 4 else 1.0)
        assert wrt.load(source, material="gold").shapes[0].material != material


def test_colors_that_are_codes_are_refused():
    for codes in (np.full((3, 3), 200, np.uint8), np.full((3, 4), 255)):
        with pytest.raises(wrt.InputError, match=r"mesh: colors must be linear numbers, not codes up to 2"):
            wrt.Mesh(np.eye(3), [[0, 1, 2]], colors=codes)
    assert wrt.Mesh(np.eye(3), [[0, 1, 2]], colors=np.eye(3, dtype=int)).colors is not None
    bright = wrt.Mesh(np.eye(3), [[0, 1, 2]], colors=np.full((3, 3), 1.5))  # it may be meant to shine
    with pytest.raises(wrt.InputError, match=r"mesh: colors must be linear, from 0 to 1; they are from 1.5 to 1.5"):
        wrt.load(bright)


AWAY = np.array([448262.0, 5411932.0, 120.0])
CORNERS = np.random.default_rng(3).random((30, 3))
TRIANGLES = np.arange(30).reshape(-1, 3)


def test_a_mesh_with_map_coordinates_is_shown_as_exactly_as_at_the_origin():
    away = trimesh.Trimesh(CORNERS + AWAY, TRIANGLES, process=False)
    shown = triangles(wrt.load(away, up="y", strict=True).shapes[0].mesh)
    expected = CORNERS[TRIANGLES]
    np.testing.assert_allclose(shown - shown[:, :1], expected - expected[:, :1], atol=1e-6)
    with pytest.warns(InputWarning, match="move it to the origin"):  # in a scene of one's own it stays where it is
        assert load_mesh(away).bounds[0, 1] > 5e6


def test_arrays_that_single_precision_would_snap_to_a_grid_are_named():
    away = CORNERS + AWAY
    with pytest.warns(InputWarning, match=r"^map: it is 1\.\d+ across and up to 5\.4.* move it to the origin$"):
        wrt.Mesh(away, TRIANGLES, name="map")
    for harmless in (CORNERS + 1e4, away.astype(np.float32), 1e4 * CORNERS + AWAY, CORNERS * 0.0 + AWAY):
        wrt.Mesh(harmless, TRIANGLES)


def test_what_stands_in_several_places_is_there_once(tmp_path):
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    first, second = {"mesh": 0, "translation": [5, 0, 0]}, {"mesh": 0, "scale": [-1, 1, 1]}
    tree["nodes"] = [first, {"children": [0, 2], "scale": [2, 2, 2]}, second]
    tree["scenes"], tree["scene"] = [{"nodes": [1]}], 0
    path = write(tmp_path, "two.gltf", json.dumps(tree))
    matrices = [[[2, 0, 0, 10], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]], np.diag([-2.0, 2.0, 2.0, 1.0])]
    for shapes in (load_file(path).shapes, from_trimesh(trimesh.load(path))):
        shapes = sorted(shapes, key=lambda shape: -shape.transform[0, 3])
        assert shapes[0].mesh is shapes[1].mesh
        np.testing.assert_allclose([shape.transform for shape in shapes], matrices)
        np.testing.assert_allclose(shapes[0].bounds, [[10, 0, 0], [12, 2, 0]])
    # One mesh of all, and shapes without transforms, for those who want no more.
    assert load_mesh(path).bounds.tolist() == [[-2, 0, 0], [12, 2, 0]]
    assert all(shape.transform is None for shape in load_shapes(path))
