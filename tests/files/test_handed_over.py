"""What people hand over instead of meshes, materials and colours: objects of other libraries, words, files."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

import wrt
from wrt.scene.srgb import linear_from_srgb

BOX = trimesh.creation.box()
CODES = np.arange(24, dtype=np.uint8).reshape(8, 3) * 10


class Open3DMesh:
    """The part of open3d.geometry.TriangleMesh that is read."""

    vertices, triangles, vertex_normals = BOX.vertices, BOX.faces.astype(np.int32), np.zeros((0, 3))
    vertex_colors = CODES / 255.0
    textures = ()

    def has_triangle_uvs(self) -> bool:
        return False


class PyVistaMesh:
    """The part of pyvista.PolyData that is read."""

    points = BOX.vertices
    faces = np.insert(BOX.faces, 0, 3, axis=1).reshape(-1)
    is_all_triangles = True
    n_cells, n_lines, n_verts = len(BOX.faces), 0, 0
    active_texture_coordinates = None

    def __init__(self, active: str | None = None, **data: Any) -> None:
        self.point_data, self.cell_data, self.active_scalars_name = data or {"RGB": CODES}, {}, active

    def extract_surface(self) -> PyVistaMesh:
        return self


class Tensors:
    """The part of open3d.t.geometry.TriangleMesh that is read."""

    def to_legacy(self) -> Open3DMesh:
        return Open3DMesh()


@pytest.mark.parametrize("source", [Open3DMesh(), PyVistaMesh(), Tensors()], ids=lambda each: type(each).__name__)
def test_objects_of_other_libraries_keep_triangles_and_colors(source: object) -> None:
    shape = wrt.Scene().add(source)
    corners = shape.mesh.vertices[shape.mesh.faces]
    assert np.allclose(np.sort(corners.reshape(-1, 3), axis=0), np.sort(BOX.triangles.reshape(-1, 3), axis=0))
    nearest = np.abs(shape.mesh.vertices[:, None] - BOX.vertices).sum(axis=2).argmin(axis=1)
    assert np.allclose(shape.mesh.colors[:, :3], linear_from_srgb(CODES / 255.0)[nearest], atol=1e-6)
    assert len(wrt.load_mesh(source).faces) == 12


def test_anything_with_vertices_and_faces_is_a_mesh() -> None:
    scene = wrt.load(SimpleNamespace(vertices=BOX.vertices.tolist(), faces=BOX.faces.tolist()))
    assert len(scene.shapes[0].mesh.faces) == 12


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (SimpleNamespace(vertices=np.zeros((3, 2)), faces=[[0, 1, 2]]), "vertices must be"),
        (SimpleNamespace(vertices=np.zeros((3, 3)), faces=[[0, 1, 3]]), "beyond the 3"),
        (SimpleNamespace(vertices=np.zeros((3, 3)), faces=[[0.0, 1.0, 2.0]]), "whole numbers"),
        (SimpleNamespace(GetPolys=None), "pip install pyvista"),
        (SimpleNamespace(points=np.zeros((2, 3)), colors=np.zeros((2, 3)), lines=[[0, 1]]), "expected a path"),
    ],
)
def test_unusable_objects_are_refused(source: object, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.load(source)


def test_values_that_are_no_colors_are_named() -> None:
    with pytest.warns(wrt.InputWarning, match="'temperature' are not drawn"):
        wrt.load(PyVistaMesh("temperature", temperature=np.zeros(8)))


def test_materials_by_name_color_and_image(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "red.png")
    scene, orange = wrt.Scene(), tuple(linear_from_srgb(np.array([255, 136, 0]) / 255.0))
    for material in ("#f80", "#ff8800", orange):
        assert scene.add(BOX, material=material).material.reflectance == pytest.approx(orange)
    assert scene.add(wrt.box((0, 0, 0), (1, 1, 1)), material="red").material == wrt.Diffuse((1.0, 0.0, 0.0))
    texture = scene.add(BOX, material=tmp_path / "red.png").material.reflectance
    assert np.array_equal(texture.pixels[0, 0], [1.0, 0.0, 0.0])
    assert isinstance(scene.add(BOX, material="gold").material, wrt.RoughConductor)
    for wrong, message in (("rad", "did you mean"), (3.0, "not float"), ((0.5, 2.0, 0.5), "at most 1")):
        with pytest.raises(wrt.InputError, match=message):
            scene.add(BOX, material=wrong)


def test_files_and_scenes_of_several_parts_are_added_where_the_transform_says() -> None:
    several = trimesh.Scene([BOX, trimesh.creation.icosphere(subdivisions=1).apply_translation((5, 0, 0))])
    matrix = trimesh.transformations.translation_matrix((0, 7, 0))
    scene = wrt.Scene()
    assert len(scene.add(several, transform=matrix)) == 2
    assert scene.bounds == pytest.approx(np.array([[-0.5, 6.0, -1.0], [6.0, 8.0, 1.0]]), abs=0.2)
    assert scene.add("meshes/teapot.ply", name="pot").name == "pot"
    lamp = wrt.PointLight((0.0, 9.0, 0.0), power=9.0)
    assert scene.add(lamp) is lamp is scene.lights[0]
    with pytest.raises(wrt.InputError, match="no material"):
        scene.add(lamp, material="gold")
