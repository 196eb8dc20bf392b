"""The sample meshes and scenes are what they claim to be, and scripts/ makes them again."""

import cornell_box
import make_meshes
import numpy as np
import pytest
import trimesh
from conftest import ROOT
from support.meshes import volume

import wrt
import wrt.meshes
from wrt.meshes import many_triangles


def face_normals(mesh: wrt.Mesh) -> np.ndarray:
    """Return (M, 3) float64 face normals, twice the area long."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(np.float64), 1, 0)
    return np.cross(b - a, c - a)


def holes(mesh: wrt.Mesh) -> list[np.ndarray]:
    """Return the vertices of each hole of a mesh whose faces all run the same way round."""
    made = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert made.is_winding_consistent
    open_edges = made.edges[trimesh.grouping.group_rows(made.edges_sorted, require_count=1)]
    return trimesh.graph.connected_components(open_edges)


def test_meshes_are_what_the_script_makes(tmp_path):
    make_meshes.main(tmp_path)
    for name in ("teapot.ply", "sweep.ply"):
        ours, made = wrt.load_mesh(ROOT / "meshes" / name), wrt.load_mesh(tmp_path / name)
        assert np.array_equal(ours.faces, made.faces)
        # Sums may be rounded in another order on another machine: one step of float32 at the largest coordinate.
        np.testing.assert_allclose(ours.vertices, made.vertices, rtol=0.0, atol=2.0**-22)
        np.testing.assert_allclose(ours.normals, made.normals, rtol=0.0, atol=2.0**-22)


def test_teapot_is_one_pot_with_six_published_openings():
    mesh = wrt.load_mesh(ROOT / "meshes" / "teapot.ply")
    assert len(mesh.faces) == 32 * 20 * 20 * 2 - 8 * 20  # a patch with a pole has 20 faces fewer
    low, high = mesh.bounds
    assert (low[1], high[1], low[2]) == (0.0, pytest.approx(0.15, abs=1e-7), -high[2])
    assert np.linalg.norm(face_normals(mesh), axis=1).min() > 1e-9
    found = holes(mesh)
    height = 0.15 / 3.15  # metres in one of Newell's units
    # Both ends of the handle and of the spout; then the lid's edge and the rim, a tenth of a unit apart.
    assert sorted(len(hole) for hole in found) == [40, 40, 40, 40, 80, 80]
    radii = [np.hypot(*mesh.vertices[hole][:, [0, 2]].T).min() / height for hole in found if len(hole) == 80]
    np.testing.assert_allclose(sorted(radii), [1.3, 1.4], atol=1e-5)
    # Fronts are outside: a part turned inside out would have a negative volume.
    parts = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).split(only_watertight=False)
    assert len(parts) == 4
    assert all(volume(wrt.Mesh(part.vertices - part.vertices.mean(axis=0), part.faces)) > 0.0 for part in parts)


def test_cornell_box_has_the_published_walls_and_the_measured_colors():
    """Two triangles make each published quadrilateral: how far is its fourth corner off the plane of the others?"""
    cornell = wrt.load("cornell-box")
    for shape in cornell.shapes:
        normals, corners = face_normals(shape.mesh)[::2], shape.mesh.vertices[shape.mesh.faces].astype(np.float64)
        unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        off = np.einsum("mk,mk->m", corners[1::2, 2] - corners[::2, 0], unit)
        expected = 3.1997e-3 if shape.name == "left wall" else 0.0  # by hand from the published numbers
        np.testing.assert_allclose(np.abs(off), expected, atol=1e-6, err_msg=shape.name)
    by_name = {shape.name: shape for shape in cornell.shapes}
    names = ("left wall", "tall block", "short block", "right wall")
    middles = np.array([by_name[name].mesh.vertices.mean(axis=0) for name in names])
    assert (np.diff(middles @ cornell.camera.frame()[0]) > 0.0).all()
    assert np.tan(np.radians(cornell.camera.fov_degrees) / 2) == pytest.approx(0.0125 / 0.035, rel=1e-12)
    colors = cornell_box.colors()
    for shape, color in (("floor", "white"), ("right wall", "green"), ("left wall", "red")):
        np.testing.assert_allclose(by_name[shape].material.reflectance, colors[color], rtol=0.0, atol=0.5e-4)
    np.testing.assert_allclose(by_name["light"].emission, colors["light"], rtol=5e-4)


def test_terrain_is_an_upward_sheet_of_the_number_of_triangles_asked_for():
    mesh, second = many_triangles.terrain(54_321), many_triangles.terrain(54_321)
    for name in ("vertices", "faces", "normals", "colors"):
        assert np.array_equal(getattr(mesh, name), getattr(second, name)), name
    assert (face_normals(mesh)[:, 1] > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)
    assert 0.0 <= mesh.colors.min() <= mesh.colors.max() <= 1.0
    assert len(holes(mesh)) == 1  # its rim
    low, high = mesh.bounds
    np.testing.assert_allclose([low[[0, 2]], high[[0, 2]]], [[-2000.0, -2000.0], [2000.0, 2000.0]])
    assert 0.0 <= low[1] < 0.1 * many_triangles.RELIEF < high[1] <= many_triangles.RELIEF  # hills
    for count in (1_000, 100_000, 1_000_000, 10_000_000, *range(1_000, 20_000, 97)):
        rows, columns = many_triangles.grid_size(count)
        assert (1.0 if count % 1000 == 0 else 0.98) * count <= 2 * rows * columns <= count
    for wrong in (999, 10_000_001, 1e6, "many"):
        with pytest.raises(wrt.InputError, match="triangles"):
            many_triangles.terrain(wrong)
