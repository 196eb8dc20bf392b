"""Points of files and objects are spheres in their colours, of a radius that follows from their spacing."""

import warnings

import numpy as np
import pytest
import trimesh
from support.mesh_files import ORDERS, XYZ, add, ply, saved
from support.meshes import write

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import from_trimesh, load_file, load_mesh, load_shapes
from wrt.scene.exact.spheres import Spheres
from wrt.scene.srgb import linear_from_srgb

DRAWN = "points are drawn as spheres of radius"
GRID = np.stack(np.meshgrid(np.arange(40.0), np.arange(30.0), [2.0]), axis=-1).reshape(-1, 3) * 0.5
CODES = np.random.default_rng(0).integers(0, 256, (len(GRID), 3))
RGB = "uchar red", "uchar green", "uchar blue"


def files() -> dict[str, str | bytes]:
    rows = [(*place, *code) for place, code in zip(GRID.tolist(), CODES.tolist(), strict=True)]
    floats = [(*row[:3], *(code / 255.0 for code in row[3:])) for row in rows]
    return {
        **{f"{order}.ply": ply(order, ("vertex", (*XYZ, *RGB), rows)) for order in ORDERS},
        "a.off": f"COFF\n{len(rows)} 0 0\n" + "".join(" ".join(map(str, (*row, 255))) + "\n" for row in rows),
        "a.obj": "".join("v {} {} {} {} {} {}\n".format(*row) for row in floats),
    }


def test_points_of_every_format_are_spheres_in_their_colors(tmp_path):
    cloud = trimesh.PointCloud(GRID, CODES.astype(np.uint8))
    sources = [cloud, *(write(tmp_path, name, data) for name, data in files().items())]
    for source in sources:
        with pytest.warns(UserWarning, match=f"its 1200 {DRAWN} 0.375;"):
            (shape,) = from_trimesh(source) if source is cloud else load_shapes(source)
        assert isinstance(shape.mesh, Spheres), source
        np.testing.assert_allclose(shape.mesh.centers, GRID, atol=1e-5)
        np.testing.assert_allclose(shape.mesh.radii, 0.375, atol=1e-5)  # three quarters of the spacing
        np.testing.assert_allclose(shape.mesh.colors[::3], linear_from_srgb(CODES / 255.0), rtol=1e-5, atol=1e-6)
        assert shape.material == wrt.Diffuse(wrt.VertexColor())
        with pytest.warns(UserWarning, match=f"{DRAWN} 0.1$"):  # nothing is lost: no error with strict
            radii = wrt.load(source, strict=True, up="y", point_radius=0.1).shapes[0].mesh.radii
        np.testing.assert_allclose(radii, 0.1, rtol=1e-4)


def test_points_of_gltf_lie_where_their_node_is(tmp_path):
    tree = {"asset": {"version": "2.0"}, "buffers": [], "bufferViews": [], "accessors": []}
    attributes = {"POSITION": add(tree, GRID), "NORMAL": add(tree, GRID), "COLOR_0": add(tree, CODES / 255.0)}
    tree |= {
        "meshes": [{"primitives": [{"attributes": attributes, "mode": 0}]}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    tree["nodes"] = [{"mesh": 0, "translation": [1, 2, 3], "scale": [2, 2, 2]}]
    with pytest.warns(UserWarning, match=DRAWN):
        scene = wrt.load(saved(tmp_path, tree), strict=True)
    cloud = scene.shapes[0]
    np.testing.assert_allclose(cloud.mesh_at(0.0).centers, 2.0 * GRID + [1.0, 2.0, 3.0], rtol=1e-5)
    np.testing.assert_allclose(cloud.mesh_at(0.0).radii, 0.75, rtol=1e-4)
    np.testing.assert_allclose(cloud.mesh.colors[::3], CODES / 255.0, rtol=1e-5)


@pytest.mark.parametrize(
    ("widths", "interpolation", "radii"),
    [("4, 6", "vertex", (2, 3)), ("4", "constant", (2, 2)), ("", "vertex", (3, 3))],
)
def test_points_of_usd_have_their_widths_and_colors(widths, interpolation, radii, tmp_path):
    pytest.importorskip("pxr")
    text = f"""#usda 1.0
(
    metersPerUnit = 0.5
)
def Points "p"
{{
    point3f[] points = [(0, 0, 0), (0, 4, 0)]
    float[] widths = [{widths}] (
        interpolation = "{interpolation}"
    )
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (
        interpolation = "vertex"
    )
    double3 xformOp:scale = (2, 2, 2)
    token[] xformOpOrder = ["xformOp:scale"]
}}
"""
    path = write(tmp_path, "a.usda", text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (shape,) = load_shapes(path)
    assert [DRAWN in str(each.message) for each in caught] == ([] if widths else [True])
    np.testing.assert_allclose(shape.mesh.centers, [(0, 0, 0), (0, 4, 0)], atol=1e-6)
    np.testing.assert_allclose(shape.mesh.radii, radii, rtol=1e-6)
    np.testing.assert_array_equal(shape.mesh.colors[::3], [(1, 0, 0), (0, 1, 0)])
    with pytest.warns(UserWarning, match=f"{DRAWN} 0.1$"):
        (shape,) = load_file(path, point_radius=0.1).shapes
    np.testing.assert_allclose(shape.mesh.radii, 0.1, rtol=1e-6)


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        (np.full((1, 3), 7.0), 1.0),
        (np.full((9, 3), 7.0), 1.0),  # all in one place
        (np.array([[0.0, 0.0, 0.0], [0.0, 4.0, 0.0]]), 3.0),
        (np.concatenate([GRID, GRID, GRID[:100] + 1e6]), 0.375),  # twice, and outliers
        (np.random.default_rng(1).random((70_000, 3)) * [300.0, 200.0, 0.0], 0.75),
    ],
    ids=["one", "one place", "two", "outliers", "many"],
)
@pytest.mark.filterwarnings("ignore:.*in single precision:wrt.errors.InputWarning")
def test_the_radius_follows_from_the_spacing(points, expected):
    with pytest.warns(UserWarning, match=DRAWN):
        (shape,) = from_trimesh(trimesh.PointCloud(points))
    assert shape.mesh.radii.mean() == pytest.approx(expected, rel=0.05)


def test_points_that_a_scanner_did_not_see_are_left_out():
    cloud = trimesh.PointCloud(np.concatenate([np.full((50, 3), np.nan), GRID]))
    lost = pytest.warns(InputWarning, match="50 of 1250 points are left out: their positions are not finite")
    with lost, pytest.warns(UserWarning, match=DRAWN):
        (shape,) = from_trimesh(cloud)
    np.testing.assert_allclose(shape.mesh.centers, GRID, atol=1e-5)


@pytest.mark.filterwarnings(f"ignore:.*{DRAWN}:UserWarning")
def test_radii_are_for_points_and_meshes_for_triangles():
    ball, cloud = trimesh.creation.icosphere(subdivisions=1), trimesh.PointCloud(GRID)
    for call, message in (
        (lambda: wrt.load(ball, point_radius=1.0), "it has no points that a radius is for"),
        (lambda: wrt.load(cloud, point_radius=-1.0), "the radius of points must be a positive number, not -1"),
        (lambda: wrt.load("cornell-box", point_radius=1.0), "a radius of points is for mesh files"),
        (lambda: load_mesh(cloud), "points and no triangles"),
        (lambda: wrt.Intersector(cloud), "an intersector has triangles only"),
    ):
        with pytest.raises(wrt.InputError, match=message):
            call()
    scene = trimesh.Scene([ball, cloud])
    assert [type(shape.mesh) for shape in wrt.load(scene).shapes[:2]] == [wrt.Mesh, Spheres]
    assert len(load_mesh(scene).faces) == 80
    cloud.colors = np.zeros((7, 4), np.uint8)
    with pytest.warns(InputWarning, match="the 7 colours of 'trimesh' are left out"):
        from_trimesh(cloud)
