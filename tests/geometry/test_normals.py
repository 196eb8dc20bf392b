"""Meshes without normals get sensible ones, and Mitsuba's `sdfgrid` becomes a closed mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from support.meshes import SQUARE, triangles, write

import wrt
from wrt.io.load_mesh import load_mesh
from wrt.io.mesh.creases import creased
from wrt.io.mitsuba.sdfgrid import isosurface
from wrt.io.mitsuba.surfaces import is_closed
from wrt.scene.normals import with_normals


def test_normals_of_a_sphere_converge_to_its_own_whatever_its_seams() -> None:
    errors = []
    for subdivisions in (2, 3, 4):
        sphere = wrt.sphere(subdivisions=subdivisions)
        soup = wrt.Mesh(triangles(sphere).reshape(-1, 3), np.arange(3 * len(sphere.faces)).reshape(-1, 3))
        welded, split = with_normals(wrt.Mesh(sphere.vertices, sphere.faces)), with_normals(soup)
        assert (len(welded.vertices), len(split.vertices)) == (len(sphere.vertices), len(soup.vertices))
        np.testing.assert_allclose(split.normals[split.faces], welded.normals[welded.faces], atol=1e-6)
        errors.append(float(np.abs(welded.normals - welded.vertices).max()))
        for scale in (1e-18, 1e15):
            mesh = with_normals(wrt.Mesh(sphere.vertices.astype(np.float64) * scale, sphere.faces))
            np.testing.assert_allclose(mesh.normals, welded.normals, atol=1e-5)
    # At least first order: half the edge length, half the error.
    assert errors[1] < 0.55 * errors[0]
    assert errors[2] < 0.55 * errors[1]


def test_normals_are_weighted_by_angle_not_by_triangles() -> None:
    # One side of the cube's corner is cut into many slivers; the corner's normal must not lean to it.
    fan = [[np.cos(t), np.sin(t), 0.0] for t in np.linspace(0, np.pi / 2, 20)]
    points = np.array([[0, 0, 0], *fan, [0, 0, 1]])
    faces = [[0, k, k + 1] for k in range(1, 20)] + [[0, 20, 21], [0, 21, 1]]
    mesh = with_normals(wrt.Mesh(points, np.array(faces)), 180.0)
    np.testing.assert_allclose(mesh.normals[0], [3**-0.5] * 3, atol=1e-6)


@pytest.mark.parametrize(("fold", "crease", "smooth"), [(30, 40, True), (50, 40, False), (1, 0, False)])
def test_creases_split_where_the_surface_folds(fold: float, crease: float, smooth: bool) -> None:
    t = np.deg2rad(fold)
    x, y = np.cos(t), np.sin(t)
    points = np.array([[0, 0, 0], [0, 0, 1], [-1, 0, 0], [-1, 0, 1], [x, y, 0], [x, y, 1]])
    mesh = with_normals(wrt.Mesh(points, np.array([[2, 3, 1], [2, 1, 0], [0, 1, 5], [0, 5, 4]])), crease)
    on_ridge = (np.abs(mesh.vertices[:, :2]) < 1e-6).all(axis=1)
    assert on_ridge.sum() == (2 if smooth else 4)
    expected = [[-np.sin(t / 2), np.cos(t / 2), 0]] if smooth else [[0, 1, 0], [-np.sin(t), np.cos(t), 0]]
    for normal in mesh.normals[on_ridge]:
        assert min(np.abs(normal - e).max() for e in expected) < 1e-6


def test_surfaces_back_to_back_keep_their_own_normals() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    mesh = with_normals(wrt.Mesh(square, np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]])), 180.0)
    flat = np.array([[0, 0, 1]] * 2 + [[0, 0, -1]] * 2)
    np.testing.assert_allclose(mesh.normals[mesh.faces], np.repeat(flat[:, None], 3, axis=1), atol=1e-6)


def test_given_normals_are_made_unit_and_mended(tmp_path: Path) -> None:
    text = SQUARE + "vn 0 0 5\nvn 0 0 0\nvn nan 0 1\nvn 0.6 0 0.8\nf 1//1 2//2 3//3 4//4\n"
    mesh = load_mesh(write(tmp_path, "mesh.obj", text))
    expected = {(0, 0): [0, 0, 1], (1, 0): [0, 0, 1], (1, 1): [0, 0, 1], (0, 1): [0.6, 0, 0.8]}
    for vertex, normal in zip(mesh.vertices, mesh.normals, strict=True):
        np.testing.assert_allclose(normal, expected[int(vertex[0]), int(vertex[1])], atol=1e-6)


# --- Grids of distances ------------------------------------------------------------------------------

SCENE = """<scene version="3.0.0"><shape type="sdfgrid"><string name="filename" value="ball.vol"/>
<string name="normals" value="{}"/></shape></scene>"""


def ball() -> np.ndarray:
    """Return the (z, y, x) distances to a ball in the unit cube, not in its middle."""
    z, y, x = np.mgrid[0:20, 0:20, 0:20] / 19.0
    return np.sqrt((x - 0.4) ** 2 + (y - 0.5) ** 2 + (z - 0.55) ** 2) - 0.3


def write_grid(path: Path, values: np.ndarray) -> None:
    header = b"VOL\x03" + np.array([1, *values.shape[::-1], 1], "<i4").tobytes() + np.zeros(6, "<f4").tobytes()
    path.write_bytes(header + values.astype("<f4").tobytes())


def test_vertices_lie_on_the_surface_and_faces_look_outwards() -> None:
    values = ball()
    mesh = isosurface(values, 3, smooth=True)
    assert is_closed(mesh)
    trilinear = RegularGridInterpolator([np.linspace(0.0, 1.0, 20)] * 3, values)
    assert np.abs(trilinear(mesh.vertices[:, ::-1])).max() < 1e-5
    radial = mesh.vertices - [0.4, 0.5, 0.55]
    assert (np.einsum("ij,ij->i", mesh.normals, radial / np.linalg.norm(radial, axis=1)[:, None]) > 0.9999).all()
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    across = np.cross(b - a, c - a)
    some = np.linalg.norm(across, axis=1) > 1e-6
    assert (np.einsum("ij,ij->i", across, radial[mesh.faces[:, 0]])[some] > 0.0).all()


@pytest.mark.parametrize("normals", ["smooth", "analytic"])
def test_a_grid_of_distances_is_read(normals: str, tmp_path: Path) -> None:
    write_grid(tmp_path / "ball.vol", ball())
    (tmp_path / "scene.xml").write_text(SCENE.format(normals), "utf-8")
    (shape,) = wrt.load(tmp_path / "scene.xml", strict=True).shapes
    assert (shape.mesh.normals is not None) == (normals == "smooth")
    np.testing.assert_allclose(shape.bounds, [[0.1, 0.2, 0.25], [0.7, 0.8, 0.85]], atol=0.003)


def test_a_grid_without_a_surface_is_refused(tmp_path: Path) -> None:
    write_grid(tmp_path / "ball.vol", np.abs(ball()) + 1.0)
    (tmp_path / "scene.xml").write_text(SCENE.format("smooth"), "utf-8")
    with pytest.raises(wrt.InputError, match=r"^[^\n]*one sign[^\n]*$"):
        wrt.load(tmp_path / "scene.xml")


def test_the_kernel_of_large_meshes_finds_the_normals_and_creases_of_numpy() -> None:
    rng = np.random.default_rng(5)
    sphere = wrt.sphere(subdivisions=4)
    rough = sphere.vertices + rng.normal(size=sphere.vertices.shape) * 0.03
    corners = np.stack([rng.permutation(250)[:3] for _ in range(3000)])  # edges of many faces, vertices at one place
    points = rng.normal(size=(200, 3))[np.r_[:200, :50]]
    corners = corners[[len(set((face % 200).tolist())) == 3 for face in corners]]
    for mesh in (sphere, wrt.Mesh(rough, sphere.faces), wrt.Mesh(points, corners)):
        bare = wrt.Mesh(mesh.vertices, mesh.faces)
        expected, found = with_normals(bare, 60.0), creased(bare, 60.0)
        assert found is not None
        for name in ("vertices", "faces"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        # NumPy's arctan2 may differ in the last bit, which shows where a component cancels to nothing.
        np.testing.assert_allclose(found.normals, expected.normals, rtol=0.0, atol=1e-15)
    degenerate, opposite = [[0, 1, 1], [0, 1, 2]], [[0, 1, 2], [0, 2, 1]]
    for faces in degenerate, opposite:
        assert creased(wrt.Mesh(np.eye(3), faces), 180.0) is None
