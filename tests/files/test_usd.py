"""USD files give the scene that their text describes."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from support.mesh_files import check_refused
from support.meshes import volume, write
from support.same_scenes import differences

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import load_file

USD = (ROOT / "tests/scenes/meshes/world.usda").read_text("utf-8")
"""A square of two materials, one with an image, two balls by instances, a camera, and four lights."""

ST = "        texCoord2f[] primvars:st"
"""Where the attributes of the square go on."""

pxr = pytest.importorskip("pxr")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the image that the scene names."""
    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), (0.5, 0.0, 0.0)))
    return tmp_path


@pytest.fixture
def scene(folder: Path) -> wrt.Scene:
    return load_file(write(folder, "all.usda", USD))


def square_of(scene: wrt.Scene) -> wrt.Shape:
    return max(scene.shapes[:2], key=lambda shape: len(shape.mesh.faces))


def test_meshes_are_in_metres_with_y_up_and_parted_by_material(scene):
    square, triangle = square_of(scene), min(scene.shapes[:2], key=lambda shape: len(shape.mesh.faces))
    # (x, y, z) becomes (x, z, -y), moved by 2 and halved.
    np.testing.assert_allclose(square.mesh.bounds, [[1, 0, -1], [2, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(triangle.mesh.bounds, [[2, 0, -1], [3, 0, 0]], atol=1e-6)
    assert len(square.mesh.faces) == 2
    corner = np.flatnonzero((square.mesh.vertices == (2, 0, -1)).all(axis=1))[0]
    np.testing.assert_allclose(square.mesh.uvs[corner], (1, 1))
    material = square.material
    assert isinstance(material, wrt.Principled)
    assert (material.metallic, material.roughness) == (1.0, 0.25)
    assert (material.base_color.scale, material.base_color.wrap) == ((3.0, 2.0), ("mirror", "repeat"))
    assert material.base_color.pixels[0, 0] == pytest.approx((0.5, 0, 0), abs=0.01)
    assert triangle.material.base_color == pytest.approx((0.1, 0.2, 0.3))
    assert triangle.material.coat == 0.5
    balls = scene.shapes[2:]
    assert len({id(ball.mesh) for ball in balls}) == 1
    boxes = np.array([ball.mesh_at(0.0).bounds for ball in balls])
    np.testing.assert_allclose(boxes.mean(axis=1), [[1, 0.5, 0], [1, 1, 0]], atol=1e-5)
    np.testing.assert_allclose(np.ptp(boxes, axis=1), 0.5, atol=1e-3)


def test_lights_and_camera(scene):
    panel, ball, sun = scene.lights
    assert panel.radiance == pytest.approx((6, 6, 6))
    np.testing.assert_allclose(np.cross(panel.edge_u, panel.edge_v), (0, -2, 0), atol=1e-9)  # it emits downwards
    np.testing.assert_allclose(np.add(panel.origin, np.add(panel.edge_u, panel.edge_v) / 2), (1, 3, 0), atol=1e-9)
    area = 4 * math.pi * 0.25
    assert ball.radius == pytest.approx(0.5)
    assert ball.radiance == pytest.approx((8 / area, 4 / area, 0))
    assert sun.irradiance == pytest.approx((2, 2, 2))
    np.testing.assert_allclose(sun.direction, (0, -1, 0), atol=1e-9)
    assert scene.environment.radiance == pytest.approx((0.25,) * 3)
    assert scene.camera.origin == pytest.approx((1, 5, 0))
    np.testing.assert_allclose(np.subtract(scene.camera.target, scene.camera.origin), (0, -1, 0), atol=1e-9)
    assert scene.camera.fov_degrees == pytest.approx(math.degrees(2 * math.atan(0.2)))


def test_images_within_an_archive_are_read(scene, folder):
    from pxr import UsdUtils

    assert UsdUtils.CreateNewUsdzPackage(str(folder / "all.usda"), str(folder / "all.usdz"))
    (folder / "red.png").unlink()
    assert differences(scene, load_file(folder / "all.usdz")) == {}


@pytest.mark.parametrize(
    ("kind", "values", "size", "expected"),
    [
        ("Cylinder", 'double radius = 2\ndouble height = 3\ntoken axis = "X"', (3, 4, 4), 12 * math.pi),
        ("Capsule", "double radius = 1\ndouble height = 2", (2, 2, 4), (2 + 4 / 3) * math.pi),
        ("Cube", "double size = 2", (2, 2, 2), 8.0),
    ],
)
def test_solids_are_closed_and_face_outwards(tmp_path, kind, values, size, expected):
    text = f'#usda 1.0\n(\nmetersPerUnit = 1\n)\ndef {kind} "A"\n{{\n{values}\n}}\n'
    (shape,) = load_file(write(tmp_path, "solid.usda", text)).shapes
    np.testing.assert_allclose(np.ptp(shape.mesh.bounds, axis=0), size, rtol=3e-3)  # of 64 sides
    assert volume(shape.mesh) == pytest.approx(expected, rel=5e-3)


def test_materials_may_read_attributes_by_their_names(folder):
    """The colours for display, or what stands for them where there are none; coordinates that are not called st."""
    reader = """color3f inputs:diffuseColor.connect = </World/Red/Reader.outputs:result>
            token outputs:surface
        }
        def Shader "Reader"
        {
            uniform token info:id = "UsdPrimvarReader_float3"
            string inputs:varname = "displayColor"
            color3f inputs:fallback = (0.1, 0.2, 0.3)
            float3 outputs:result
        }
        def Shader "Unused"
        {"""
    text = USD.replace("color3f inputs:diffuseColor.connect = </World/Red/Image.outputs:rgb>", reader)
    assert square_of(load_file(write(folder, "a.usda", text))).material.base_color == pytest.approx((0.1, 0.2, 0.3))
    text = text.replace(ST, f"        color3f[] primvars:displayColor = [(0, 0.5, 1)]\n{ST}")
    colored = square_of(load_file(write(folder, "b.usda", text)))
    assert colored.material.base_color == wrt.VertexColor()
    np.testing.assert_allclose(colored.mesh.colors, [(0, 0.5, 1)] * len(colored.mesh.vertices))
    laid = square_of(load_file(write(folder, "c.usda", USD.replace("primvars:st ", "primvars:map1 "))))
    assert isinstance(laid.material.base_color, wrt.ImageTexture)
    assert np.ptp(laid.mesh.uvs) == 1.0


def test_missing_references_wrong_types_faces_and_a_missing_library_are_told(folder, monkeypatch):
    text = USD.replace('def Xform "World"', 'def Xform "World" (references = @look.usda@</World>)')
    with pytest.warns(InputWarning, match=r"look\.usda', which it refers to, cannot be opened"):
        load_file(write(folder, "all.usda", text))
    text = USD.replace(ST, "        int normals = 3\n        texCoord2f[] primvars:was")
    assert len(load_file(write(folder, "wrong.usda", text)).shapes) == 4
    path = write(folder, "broken.usda", USD.replace("[0, 1, 2, 3, 1, 4, 2]", "[0, 1, 2, 3, 1, 9, 2]"))
    check_refused("/World/Square: a face names vertex 9, but there are 5", load_file, path)
    monkeypatch.setitem(sys.modules, "pxr", None)
    check_refused(r"USD files need Pixar's library: pip install 'wrt\[usd\]'", load_file, path)
