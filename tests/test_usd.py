"""USD files give the scene that their text describes."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from support.meshes import write

import wrt
from wrt.io.load_mesh import load_file

USD = """#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 0.5
    upAxis = "Z"
)
def Xform "World"
{
    double3 xformOp:translate = (2, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "Square" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        point3f[] points = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (4, 0, 0)]
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 2]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0), (0, 1)] (
            interpolation = "faceVarying"
        )
        uniform token subdivisionScheme = "none"
        rel material:binding = </World/Red>
        def GeomSubset "Part" (prepend apiSchemas = ["MaterialBindingAPI"])
        {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1]
            rel material:binding = </World/Glossy>
        }
    }
    def Material "Red"
    {
        token outputs:surface.connect = </World/Red/Shader.outputs:surface>
        def Shader "Shader"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </World/Red/Image.outputs:rgb>
            float inputs:roughness = 0.25
            float inputs:metallic = 1
            token outputs:surface
        }
        def Shader "Image"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @red.png@
            token inputs:wrapS = "mirror"
            float2 inputs:st.connect = </World/Red/Place.outputs:result>
            float3 outputs:rgb
        }
        def Shader "Place"
        {
            uniform token info:id = "UsdTransform2d"
            float2 inputs:scale = (3, 2)
            float2 outputs:result
        }
    }
    def Material "Glossy"
    {
        token outputs:surface.connect = </World/Glossy/Shader.outputs:surface>
        def Shader "Shader"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0.1, 0.2, 0.3)
            float inputs:clearcoat = 0.5
            token outputs:surface
        }
    }
    def Mesh "Hidden"
    {
        token visibility = "invisible"
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
    }
    def Camera "View"
    {
        float focalLength = 50
        float verticalAperture = 20
        double3 xformOp:translate = (0, 0, 10)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def RectLight "Panel"
    {
        float inputs:width = 4
        float inputs:height = 2
        float inputs:intensity = 3
        float inputs:exposure = 1
        double3 xformOp:translate = (0, 0, 6)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def SphereLight "Ball"
    {
        float inputs:radius = 1
        float inputs:intensity = 8
        bool inputs:normalize = 1
        color3f inputs:color = (1, 0.5, 0)
    }
    def DistantLight "Sun"
    {
        float inputs:angle = 0
        float inputs:intensity = 2
    }
    def DomeLight "Sky"
    {
        float inputs:intensity = 0.25
    }
    def PointInstancer "Many"
    {
        point3f[] positions = [(0, 0, 1), (0, 0, 2)]
        int[] protoIndices = [0, 0]
        rel prototypes = </World/Many/Ball>
        def Sphere "Ball"
        {
            double radius = 0.5
        }
    }
}
"""

pxr = pytest.importorskip("pxr")


@pytest.fixture
def scene(tmp_path):
    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), (0.5, 0.0, 0.0)))
    return load_file(write(tmp_path, "all.usda", USD))


def test_meshes_are_in_metres_with_y_up_and_parted_by_material(scene):
    other, square = sorted(scene.shapes[:2], key=lambda shape: len(shape.mesh.faces))
    # (x, y, z) becomes (x, z, −y), moved by 2 and halved.
    low, high = square.mesh.bounds
    np.testing.assert_allclose([low, high], [[1, 0, -1], [2, 0, 0]], atol=1e-6)
    assert len(square.mesh.faces) == 2
    corner = np.flatnonzero((square.mesh.vertices == (2, 0, -1)).all(axis=1))[0]
    np.testing.assert_allclose(square.mesh.uvs[corner], (1, 1))
    np.testing.assert_allclose(other.mesh.bounds, [[2, 0, -1], [3, 0, 0]], atol=1e-6)


def test_preview_surfaces(scene):
    other, square = sorted(scene.shapes[:2], key=lambda shape: len(shape.mesh.faces))
    material = square.material
    assert isinstance(material, wrt.Principled)
    assert (material.metallic, material.roughness) == (1.0, 0.25)
    image = material.base_color
    assert isinstance(image, wrt.ImageTexture)
    assert (image.scale, image.wrap) == ((3.0, 2.0), ("mirror", "repeat"))
    assert image.pixels[0, 0] == pytest.approx((0.5, 0, 0), abs=0.01)
    assert other.material.base_color == pytest.approx((0.1, 0.2, 0.3))
    assert other.material.coat == 0.5


def test_instances_share_their_mesh(scene):
    balls = scene.shapes[2:]
    assert len(balls) == 2
    assert balls[0].mesh is balls[1].mesh
    boxes = [shape.mesh_at(0.0).bounds for shape in balls]
    middles = [(low + high) / 2 for low, high in boxes]
    np.testing.assert_allclose(middles, [[1, 0.5, 0], [1, 1, 0]], atol=1e-5)
    np.testing.assert_allclose(boxes[0][1] - boxes[0][0], 0.5, atol=1e-3)


def test_lights_and_camera(scene):
    panel, ball, sun = scene.lights
    assert panel.radiance == pytest.approx((6, 6, 6))
    np.testing.assert_allclose(np.cross(panel.edge_u, panel.edge_v), (0, -2, 0), atol=1e-9)  # it shines down
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


def test_a_dome_lights_the_scene_in_place_of_the_studio(tmp_path):
    text = (
        USD[: USD.index("    def RectLight")]
        + '    def DomeLight "Sky"\n    {\n        float inputs:intensity = 2\n    }\n}\n'
    )
    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), (0.5, 0.0, 0.0)))
    loaded = wrt.load(write(tmp_path, "sky.usda", text), frame=False)
    assert loaded.environment.radiance == (2.0, 2.0, 2.0)
    assert len(loaded.shapes) == 2


def test_images_within_an_archive_are_read(tmp_path):
    from pxr import UsdUtils

    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), (0.5, 0.0, 0.0)))
    whole = load_file(write(tmp_path, "all.usda", USD))
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "all.usda"), str(tmp_path / "all.usdz"))
    (tmp_path / "red.png").unlink()
    packed = load_file(tmp_path / "all.usdz")
    for one, other in zip(whole.shapes, packed.shapes, strict=True):
        np.testing.assert_array_equal(one.mesh.vertices, other.mesh.vertices)
    images = [
        [s.material.base_color for s in each.shapes if isinstance(s.material, wrt.Principled)]
        for each in (whole, packed)
    ]
    images = [[i for i in each if isinstance(i, wrt.ImageTexture)] for each in images]
    np.testing.assert_array_equal(images[0][0].pixels, images[1][0].pixels)


def volume(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(np.float64), 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize(
    ("kind", "values", "size", "expected"),
    [
        ("Cylinder", 'double radius = 2\ndouble height = 3\ntoken axis = "X"', (3, 4, 4), 12 * math.pi),
        ("Cone", 'double radius = 1\ndouble height = 3\ntoken axis = "Y"', (2, 3, 2), math.pi),
        ("Capsule", "double radius = 1\ndouble height = 2", (2, 2, 4), (2 + 4 / 3) * math.pi),
        ("Cube", "double size = 2", (2, 2, 2), 8.0),
    ],
)
def test_solids_are_closed_and_face_outwards(tmp_path, kind, values, size, expected):
    text = f'#usda 1.0\n(\nmetersPerUnit = 1\n)\ndef {kind} "A"\n{{\n{values}\n}}\n'
    (shape,) = load_file(write(tmp_path, "solid.usda", text)).shapes
    low, high = shape.mesh.bounds
    np.testing.assert_allclose(high - low, size, rtol=3e-3)  # of 64 sides
    assert volume(shape.mesh) == pytest.approx(expected, rel=5e-3)


def test_a_material_may_read_the_colors_for_display(tmp_path):
    reader = """
        color3f inputs:diffuseColor.connect = </World/Red/Reader.outputs:result>
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
        {
    """
    text = USD.replace("color3f inputs:diffuseColor.connect = </World/Red/Image.outputs:rgb>", reader, 1)
    text = text.replace("        texCoord2f[] primvars:st", "        COLORS\n        texCoord2f[] primvars:st", 1)
    colored = text.replace("COLORS", "color3f[] primvars:displayColor = [(0, 0.5, 1)]")
    square = max(load_file(write(tmp_path, "a.usda", colored)).shapes[:2], key=lambda shape: len(shape.mesh.faces))
    assert square.material.base_color == wrt.VertexColor()
    np.testing.assert_allclose(square.mesh.colors, [(0, 0.5, 1)] * len(square.mesh.vertices))
    square = max(
        load_file(write(tmp_path, "b.usda", text.replace("COLORS", ""))).shapes[:2], key=lambda s: len(s.mesh.faces)
    )
    assert square.material.base_color == pytest.approx((0.1, 0.2, 0.3))
    assert square.mesh.colors is None


def test_coordinates_may_have_another_name_or_none(tmp_path):
    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), (0.5, 0.0, 0.0)))
    square = max(
        load_file(write(tmp_path, "a.usda", USD.replace("primvars:st ", "primvars:map1 "))).shapes[:2],
        key=lambda shape: len(shape.mesh.faces),
    )
    assert isinstance(square.material.base_color, wrt.ImageTexture)
    assert np.ptp(square.mesh.uvs) == 1.0
    without = USD.replace("texCoord2f[] primvars:st ", "float2[] unused ").replace('interpolation = "faceVarying"', "")
    square = max(load_file(write(tmp_path, "b.usda", without)).shapes[:2], key=lambda shape: len(shape.mesh.faces))
    assert square.material.base_color == pytest.approx((0.5, 0, 0), abs=0.01)  # as at (0, 0)


def test_a_layer_that_is_not_there_is_told(tmp_path):
    text = USD.replace('def Xform "World"', 'def Xform "World" (references = @look.usda@</World>)')
    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), (0.5, 0.0, 0.0)))
    with pytest.warns(wrt.errors.InputWarning, match=r"look\.usda', which it refers to, cannot be opened"):
        load_file(write(tmp_path, "all.usda", text))


def test_values_of_a_type_that_a_mesh_does_not_have_are_left_out(tmp_path):
    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), (0.5, 0.0, 0.0)))
    for wrong in (
        "int normals = 3",
        'string normals = "up"',
        "color3f primvars:displayColor = (1, 0, 0)",
        "int[] primvars:st = [1]",
    ):
        text = USD.replace("        texCoord2f[] primvars:st", f"        {wrong}\n        texCoord2f[] primvars:was")
        assert len(load_file(write(tmp_path, "wrong.usda", text)).shapes) == 4


def test_what_is_wrong_is_told_in_one_line(tmp_path, monkeypatch):
    with pytest.raises(wrt.InputError, match=r"bad\.usda: not a USD file that can be read"):
        load_file(write(tmp_path, "bad.usda", "#usda 1.0\ndef Xform {"))
    broken = USD.replace("faceVertexIndices = [0, 1, 2, 3, 1, 4, 2]", "faceVertexIndices = [0, 1, 2, 3, 1, 9, 2]")
    with pytest.raises(wrt.InputError, match="/World/Square: a face names a point that is not there"):
        load_file(write(tmp_path, "broken.usda", broken))
    (tmp_path / "inside").mkdir()
    write(tmp_path, "other.usda", USD)
    outside = '#usda 1.0\ndef "A" (references = @../other.usda@</World>)\n{\n}\n'
    path = write(tmp_path / "inside", "refers.usda", outside)
    with pytest.raises(wrt.InputError, match="outside"):
        wrt.load(path, confined=True)
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(wrt.InputError, match=r"USD files need Pixar's library: pip install 'wrt\[usd\]'"):
        load_file(write(tmp_path, "all.usda", USD))
