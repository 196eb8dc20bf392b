"""Every mesh format gives the same meshes; OBJ, PLY, STL and OFF files are read to their letter."""

import io
import json
import zipfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from support.mesh_files import INDICES, ORDERS, XYZ, Element, add, attributes, box_files, facets, off_binary, ply
from support.meshes import SQUARE, area, area_vector, gltf_box, triangles, volume, write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_mesh, load_shapes
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb


def three_mf(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """Return a mesh as a 3MF file."""
    buffer = io.BytesIO()
    mesh = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in vertices.tolist())
    mesh = f"<vertices>{mesh}</vertices><triangles>"
    mesh += "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist()) + "</triangles>"
    model = f'<model unit="meter"><resources><object id="1"><mesh>{mesh}</mesh></object></resources>'
    model += '<build><item objectid="1"/></build></model>'
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("3D/3dmodel.model", '<?xml version="1.0"?>' + model)
    return buffer.getvalue()


def usd(points: np.ndarray, faces: Sequence[Sequence[int]], attributes: str = "") -> str:
    corners, counts = [k for face in faces for k in face], [len(face) for face in faces]
    text = f"point3f[] points = {list(map(tuple, points.tolist()))}\nint[] faceVertexIndices = {corners}\n"
    text += f"int[] faceVertexCounts = {counts}\n{attributes}"
    return f'#usda 1.0\n(\nmetersPerUnit = 1\nupAxis = "Y"\n)\ndef Mesh "M"\n{{\n{text}}}\n'


LIBRARIES = {"usda": "pxr", "dae": "collada"}


def written(folder: Path, files: dict[str, str | bytes]) -> list[Path]:
    """Write the files that the libraries at hand can read."""
    names = [name for name in files if find_spec(LIBRARIES.get(name.rpartition(".")[2], "numpy"))]
    return [write(folder, name, files[name]) for name in names]


def boxes_of_libraries() -> dict[str, str | bytes]:
    box, buffer = wrt.box((0, 0, 0), (1, 2, 3)), io.BytesIO()
    np.savez(buffer, vertices=box.vertices, faces=box.faces)
    found = {
        "box.usda": usd(box.vertices, box.faces.tolist()),
        "box.3mf": three_mf(box.vertices, box.faces),
        "box.npz": buffer.getvalue(),
    }
    if find_spec("collada"):
        from trimesh.exchange.dae import export_collada

        found["box.dae"] = export_collada(trimesh.Trimesh(box.vertices, box.faces, process=False))
    return found


def test_every_format_gives_the_same_box(tmp_path):
    for path in written(tmp_path, box_files() | boxes_of_libraries()):
        mesh, name = load_mesh(path, smooth_degrees=60.0), path.name
        assert len(mesh.faces) == 12, name
        np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [1, 2, 3]], atol=1e-6, err_msg=name)
        assert volume(mesh) == pytest.approx(6.0), name
        if name not in ("box.npz", "box.dae"):  # arrays have no normals, and trimesh writes rounded ones
            flat = np.cross(*np.moveaxis(np.diff(triangles(mesh), axis=1), 1, 0))
            flat /= np.linalg.norm(flat, axis=1, keepdims=True)
            expected = np.repeat(flat[:, None], 3, axis=1)
            assert len(mesh.vertices) == 24, name  # split at the edges, which are sharp
            np.testing.assert_allclose(mesh.normals[mesh.faces], expected, atol=1e-6, err_msg=name)


ROOF = np.array([[0.0, 0, 1], [0, 1, 0], [0, -1, 0.2], [1, 0, 1], [1, 1, 0], [1, -1, 0.2]]) * [1.0, 1.0, 0.5]
SLOPES = np.array([[0, 3, 4], [0, 4, 1], [0, 2, 5], [0, 5, 3]])
"""Two slopes of two triangles each, folded by 48 degrees at the edge from vertex 0 to vertex 3."""


def obj_roof(*groups: str) -> str:
    """Return the roof with a statement before either slope."""
    slopes = ["".join("f {} {} {}\n".format(*face) for face in faces) for faces in np.split(SLOPES + 1, 2)]
    statements = (f"{group}\n{slope}" for group, slope in zip(groups, slopes, strict=True))
    return "".join("v {} {} {}\n".format(*point) for point in ROOF) + "".join(statements)


SMOOTH = {
    **dict.fromkeys(["a.ply", "a.stl", "a.off", "a.3mf", "a.usda"], True),
    **dict.fromkeys(["a.glb", "a.gltf", "none.usda"], False),
}
OBJ_ROOFS = {("", ""): True, ("s 1", ""): True, ("s off", ""): False, ("s 1", "s 2"): False, ("", "s 3"): False}
"""Whether the edge is smooth by smoothing groups."""


def test_what_formats_say_of_meshes_without_normals(tmp_path):
    """glTF 2.0 3.7.2.1; smoothing groups of OBJ. An angle overrides all of it."""
    roof = trimesh.Trimesh(ROOF, SLOPES, process=False)
    files = {name: roof.export(file_type=name[2:]) for name in ("a.ply", "a.stl", "a.off", "a.glb")}
    files |= {"a.3mf": three_mf(ROOF, SLOPES), "a.gltf": json.dumps(gltf_box(ROOF, SLOPES))}
    schemes = {"a.usda": "", "none.usda": 'uniform token subdivisionScheme = "none"\n'}
    files |= {name: usd(ROOF, SLOPES.tolist(), scheme) for name, scheme in schemes.items()}
    expected = SMOOTH | {f"{number}.obj": smooth for number, smooth in enumerate(OBJ_ROOFS.values())}
    files |= {f"{number}.obj": obj_roof(*groups) for number, groups in enumerate(OBJ_ROOFS)}
    for path in written(tmp_path, files):
        for degrees, smooth in ((None, expected[path.name]), (0.0, False), (60.0, True), (30.0, False)):
            mesh = load_mesh(path, smooth_degrees=degrees)
            flat = np.cross(*np.moveaxis(np.diff(triangles(mesh), axis=1), 1, 0))
            flat /= np.linalg.norm(flat, axis=1, keepdims=True)
            bent = 0.0 if mesh.normals is None else np.abs(mesh.normals[mesh.faces] - flat[:, None]).max()
            assert (bent > 0.2) == smooth, (path.name, degrees)
            assert smooth or bent < 1e-6, (path.name, degrees)


PLACES = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 3.0, 0.0)]
FACES = (0, 1, 2, 3), (3, 2, 4)
CODES = [(255, 128, 10 * k) for k in range(5)]
COLORS = linear_from_srgb(np.array(CODES) / 255.0)
UVS = [(x / 2, y / 4) for x, y, _ in PLACES]


def ply_house(order: str) -> bytes:
    """Numbers of all kinds in any order, between unknown ones."""
    kinds = "double x", "uchar flags", "float y", "double z", "float nx", "float ny", "float nz", "float s", "float t"
    kinds += tuple(f"uchar {name}" for name in ("red", "green", "blue", "alpha"))
    rows = [(x, 7, y, z, 0.0, 0.6, 0.8, *uv, *c, 255) for (x, y, z), uv, c in zip(PLACES, UVS, CODES, strict=True)]
    faces: Element = ("face", ("short quality", "list uchar ushort vertex_index"), [(-3, face) for face in FACES])
    camera: Element = ("camera", ("int view", "int scale"), [(0, 1)])
    return ply(order, ("vertex", kinds, rows), faces, camera, head="comment by hand\nobj_info none\n")


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
    primvars = f"normal3f[] normals = {[(0, 0.6, 0.8)] * 5}\n"
    for name, array in (("texCoord2f[] primvars:st", UVS), ("color3f[] primvars:displayColor", COLORS.tolist())):
        primvars += f'{name} = {list(map(tuple, array))} (interpolation = "vertex")\n'
    return {
        "house.obj": obj,
        "house.off": f"STCNOFF\n5 2 0\n{off}4 0 1 2 3\n3 3 2 4\n",
        "house.gltf": json.dumps(tree),
        "house.usda": usd(np.array(PLACES), FACES, primvars),
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
    bright = wrt.Mesh(np.eye(3), [[0, 1, 2]], colors=np.full((3, 3), 1.5))  # it may be an emission
    with pytest.raises(wrt.InputError, match=r"mesh: colors must be linear, from 0 to 1; they are from 1.5 to 1.5"):
        wrt.load(bright)


AWAY = np.array([448262.0, 5411932.0, 120.0])
CORNERS = np.random.default_rng(3).random((30, 3))
TRIANGLES = np.arange(30).reshape(-1, 3)


def test_map_coordinates_are_shown_exactly_or_named():
    away = trimesh.Trimesh(CORNERS + AWAY, TRIANGLES, process=False)
    shown = triangles(wrt.load(away, up="y", strict=True).shapes[0].mesh)
    expected = CORNERS[TRIANGLES]
    np.testing.assert_allclose(shown - shown[:, :1], expected - expected[:, :1], atol=1e-6)
    with pytest.warns(InputWarning, match="move it to the origin"):  # as part of a scene it stays where it is
        assert load_mesh(away).bounds[0, 1] > 5e6
    away = CORNERS + AWAY
    with pytest.warns(InputWarning, match=r"^map: it is 1\.\d+ across and up to 5\.4.* move it to the origin$"):
        wrt.Mesh(away, TRIANGLES, name="map")
    for harmless in (CORNERS + 1e4, away.astype(np.float32), 1e4 * CORNERS + AWAY, CORNERS * 0.0 + AWAY):
        wrt.Mesh(harmless, TRIANGLES)


@pytest.mark.filterwarnings("ignore:.*it names no file .mtllib. that describes its materials")
def test_obj_reads_what_is_found_in_the_wild(tmp_path):
    quad = SQUARE + "f 1 2 3 4\n"
    cases = {
        "comments": SQUARE + "f 1 2 3 # here\n# f 1 2 4\nf 1 3 4\n",
        "relative": "vn 1 0 0\n" + SQUARE + "vn 0 0 1\nf -4//-1 -3//-1 -2//-1\nf -4//2 -2//2 -1//2\nv 9 9 9\n",
        "relative between": "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 1 0\nf -4 -2 -1\n",
        "mixed corners": SQUARE + "vn 0 0 1\nvt 0 0\nf 1/1/1 2//1 3\nf 1/1 3 4\n",
        "indented": "".join(f"\t {line}\n" for line in quad.splitlines()),
        "continued": SQUARE + "f 1 2 \\\n 3 4\n",
        "windows": quad.replace("\n", "\r\n"),
        "old mac": quad.replace("\n", "\r"),
        "weights": quad.replace(" 0\n", " 0 1\n"),
        "groups": SQUARE + "o one\ng a\ns 1\nf 1 2 3\ng b\nusemtl x\nf 1 3 4\n",
    }
    for name, text in cases.items():
        mesh = load_mesh(write(tmp_path, "mesh.obj", text))
        assert len(mesh.faces) == 2, name
        np.testing.assert_allclose(area_vector(mesh), [0, 0, 1], err_msg=name)
        np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * len(mesh.vertices), atol=1e-6, err_msg=name)


@pytest.mark.parametrize("axis", range(3))
def test_concave_polygons_are_filled_exactly(axis, tmp_path):
    rng = np.random.default_rng(axis)
    for size in (4, 7, 31):
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


@pytest.mark.parametrize("order", ORDERS)
def test_ply_strips_keep_their_winding_and_restarts(tmp_path, order):
    """A band of four triangles, then a triangle, and further along one more, joined by none of its area."""
    band = [(x, y, 0) for x in range(3) for y in (1, 0)]
    points = [*band, (4, 0, 0), (5, 0, 0), (4, 1, 0), (7, 0, 0), (8, 0, 0), (7, 1, 0)]
    strip = [0, 1, 2, 3, 4, 5, -1, -1, 6, 7, 8, 8, 8, 9, 9, 10, 11, -1, 3]
    data = ply(order, ("vertex", XYZ, points), ("tristrips", ["list int int vertex_indices"], [[strip]]))
    mesh = load_mesh(write(tmp_path, "strip.ply", data), smooth_degrees=0.0)
    assert area_vector(mesh) == pytest.approx([0, 0, 3.0])
    assert area(mesh) == pytest.approx(3.0)  # so no triangle faces down, and none bridges the gaps


RGB = "uchar red", "uchar green", "uchar blue"
RED, BLUE = (255, 0, 0), (0, 0, 255)


def test_ply_faces_keep_their_shape_and_color(tmp_path):
    for points, faces in (
        ([(0, 0, 0), (4, 0, 0), (1, 1, 0), (0, 4, 0), (4, 4, 0)], [(3, 0, 1, 2), (2, 1, 4, 3)]),  # one is concave
        ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 2, 0)], [(0, 1, 2, 3), (3, 2, 4)]),
    ):
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
        rows = [(face, [x / 2 for k in face for x in points[k][:2]], 0) for face in faces]
        kinds = "list uchar int vertex_indices", "list ushort float texcoord", "int texnumber"
        elements = ("camera", ["int view"], [[3]]), ("vertex", XYZ, points), ("face", kinds, rows)
        path = write(tmp_path, "red.ply", ply(order, *elements, head="comment TextureFile <this>_A.png\n"))
        shapes = load_shapes(path)
        assert sum(area(shape.mesh) for shape in shapes) == pytest.approx(1.5)
        for shape in shapes:
            np.testing.assert_allclose(shape.mesh.uvs, shape.mesh.vertices[:, :2] / 2.0)
            np.testing.assert_array_equal(shape.material.reflectance.pixels[0, 0], (1, 0, 0))


@pytest.mark.parametrize("end", ["\n", "\r"])
def test_solids_of_a_stl_file_are_shapes_and_its_wrong_normals_do_not_count(end, tmp_path):
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    text = "".join(f"solid {k}\n{facets(corners + k, '1 0 0')}endsolid {k}\n" for k in range(2))
    shapes = load_shapes(write(tmp_path, "two.stl", text.replace("\n", end)))
    for k, shape in enumerate(shapes):
        np.testing.assert_allclose(shape.bounds, [[k, k, k], [k + 1, k + 1, k]])
        np.testing.assert_allclose(shape.mesh.normals, [[0, 0, 1]] * 3)
    assert len(shapes) == 2


LINES = "\n".join(f"{x} {y} {z}" for x, y, z in PLACES)


@pytest.mark.parametrize(
    "data",
    [
        f"# a comment\nOFF 5 2 0\n\n{LINES}  # its last point\r\n\n4 0 1 2 3 255 0 0\n3 3 2 4\n",
        f"OFF\n5 2 0\n{LINES}\n4 0 1\n2 3 3\n3 2 4\n",  # one face is not one line
        off_binary(">", PLACES, FACES, colors=3),  # as the manual says
        off_binary("<", PLACES, FACES),
    ],
    ids=["comments", "stream", "big-endian-colored", "little-endian"],
)
def test_off_files_of_every_kind_are_the_same_polygons(tmp_path, data):
    (shape,) = load_shapes(write(tmp_path, "a.off", data))
    assert len(shape.mesh.faces) == 3
    np.testing.assert_allclose(area_vector(shape.mesh), [0, 0, 4.0])
