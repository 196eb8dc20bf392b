"""USD files give the scene that their text describes."""

import math
import sys
from functools import partial

import numpy as np
import pytest
from conftest import ROOT
from support.mesh_files import check_refused
from support.meshes import volume, write
from support.same_scenes import differences

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import animation_of, load_file

USD = (ROOT / "tests/scenes/meshes/world.usda").read_text("utf-8")
"""A square of two materials, one with an image, two balls by instances, a camera, and four lights."""

ST = "        texCoord2f[] primvars:st"
"""Where the attributes of the square go on."""

pxr = pytest.importorskip("pxr")


@pytest.fixture
def folder(tmp_path):
    """Return a folder with the image that the scene names."""
    wrt.save_image(tmp_path / "red.png", np.full((2, 2, 3), (0.5, 0.0, 0.0)))
    return tmp_path


@pytest.fixture
def scene(folder):
    return load_file(write(folder, "all.usda", USD))


def square_of(scene: wrt.Scene) -> wrt.Shape:
    return max(scene.shapes[:2], key=lambda shape: len(shape.mesh.faces))


def test_the_scene_is_in_metres_with_y_up_and_also_in_an_archive(scene, folder):
    square, triangle = square_of(scene), min(scene.shapes[:2], key=lambda shape: len(shape.mesh.faces))
    # (x, y, z) becomes (x, z, -y), moved by 2 and halved.
    np.testing.assert_allclose(square.mesh.bounds, [[1, 0, -1], [2, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(triangle.mesh.bounds, [[2, 0, -1], [3, 0, 0]], atol=1e-6)
    assert len(square.mesh.faces) == 2
    corner = np.flatnonzero((square.mesh.vertices == (2, 0, -1)).all(axis=1))[0]
    np.testing.assert_allclose(square.mesh.uvs[corner], (1, 1))
    material = square.material
    assert isinstance(material, wrt.Principled)
    assert (material.name, triangle.material.name) == ("/World/Red", "/World/Glossy")
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
    from pxr import UsdUtils

    assert UsdUtils.CreateNewUsdzPackage(str(folder / "all.usda"), str(folder / "all.usdz"))
    (folder / "red.png").unlink()
    assert differences(scene, load_file(folder / "all.usdz")) == {}


@pytest.mark.parametrize(
    ("up", "signed_axes"),  # axes of the file, from 1, that become x, y and z
    [
        (None, (1, 3, -2)),
        ("z", (1, 3, -2)),
        ("-z", (1, -3, 2)),
        ("y", (1, 2, 3)),
        ("-y", (1, -2, -3)),
        ("x", (-2, 1, 3)),
    ],
)
def test_an_axis_that_is_given_points_up_whatever_the_file_declares(up, signed_axes, folder):
    """Also in a file with lights, which of other formats cannot be turned."""
    scene = wrt.load(write(folder, "all.usda", USD), up=up)
    rows = np.sign(signed_axes)[:, None] * np.eye(3)[np.abs(signed_axes) - 1]
    square = np.array([[1, 0, 0], [2, 1, 0]]) @ rows.T
    np.testing.assert_allclose(square_of(scene).bounds, np.sort(square, axis=0), atol=1e-6)
    upright = wrt.load(folder / "all.usda")
    turn = rows @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # from a world whose y is the file's z
    for name in ("origin", "target", "up"):
        np.testing.assert_allclose(getattr(scene.camera, name), turn @ getattr(upright.camera, name), atol=1e-6)
    for light, other in zip(scene.lights, upright.lights, strict=True):
        if hasattr(light, "position"):
            np.testing.assert_allclose(light.position, turn @ other.position, atol=1e-6)


def test_solids_are_closed_and_face_outwards(tmp_path):
    for kind, values, size, expected in (
        ("Cylinder", 'double radius = 2\ndouble height = 3\ntoken axis = "X"', (3, 4, 4), 12 * math.pi),
        ("Capsule", "double radius = 1\ndouble height = 2", (2, 2, 4), (2 + 4 / 3) * math.pi),
        ("Cube", "double size = 2", (2, 2, 2), 8.0),
    ):
        text = f'#usda 1.0\n(\nmetersPerUnit = 1\n)\ndef {kind} "A"\n{{\n{values}\n}}\n'
        (shape,) = load_file(write(tmp_path, "solid.usda", text)).shapes
        np.testing.assert_allclose(np.ptp(shape.mesh.bounds, axis=0), size, rtol=3e-3)  # of 64 sides
        assert volume(shape.mesh) == pytest.approx(expected, rel=5e-3)


def test_colors_and_coordinates_are_those_that_a_material_reads(folder):
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
    reader = """def Shader "Reader"
        {
            uniform token info:id = "UsdPrimvarReader_float3"
            string inputs:varname = "paint"
            float3 outputs:result
        }
        def Shader "Image"
        {"""
    text = USD.replace("</World/Red/Image.outputs:rgb>", "</World/Red/Reader.outputs:result>")
    text = text.replace('def Shader "Image"\n        {', reader)
    text = text.replace(ST, f"        color3f[] primvars:paint = [(0, 0.5, 1)]\n{ST}")
    square = square_of(load_file(write(folder, "paint.usda", text)))
    np.testing.assert_allclose(square.mesh.colors, [(0, 0.5, 1)] * len(square.mesh.vertices))
    missing = USD.replace("asset inputs:file = @red.png@", "float3 inputs:fallback = (0, 0, 1)")
    assert square_of(load_file(write(folder, "b.usda", missing))).material.base_color == (0, 0, 1)
    opaque = USD.replace("float inputs:metallic = 1", "float inputs:opacity.connect = </World/Red/Image.outputs:a>")
    assert square_of(load_file(write(folder, "d.usda", opaque))).material.opacity == 1.0  # of an image without alpha
    shown = USD.replace(ST, f"        float[] primvars:displayOpacity = [0.25]\n{ST}")
    shown = shown.replace("rel material:binding = </World/Red>", "")
    assert square_of(load_file(write(folder, "c.usda", shown))).mesh.colors[0, 3] == 0.25


def test_missing_references_wrong_types_faces_and_a_missing_library_are_told(folder, monkeypatch):
    text = USD.replace('def Xform "World"', 'def Xform "World" (references = @look.usda@</World>)')
    with pytest.warns(InputWarning, match=r"look\.usda', which it refers to, cannot be opened"):
        load_file(write(folder, "all.usda", text))
    text = USD.replace(ST, "        int normals = 3\n        texCoord2f[] primvars:was")
    with pytest.warns(InputWarning, match="a primvar normals that does not fit"):
        assert len(load_file(write(folder, "wrong.usda", text)).shapes) == 4
    path = write(folder, "broken.usda", USD.replace("[0, 1, 2, 3, 1, 4, 2]", "[0, 1, 2, 3, 1, 9, 2]"))
    check_refused("/World/Square: a face names vertex 9, but there are 5", load_file, path)
    monkeypatch.setitem(sys.modules, "pxr", None)
    check_refused(r"USD files need Pixar's library: pip install 'wrt\[usd\]'", load_file, path)


BALL = '#usda 1.0\n(\nmetersPerUnit = 1\n)\ndef Sphere "s" {}\n'

MOVING = ROOT / "tests/scenes/meshes/moving.usda"
"""Points, instances, visibility, a light and a camera that change from the first time code to the thirteenth."""


def test_time_samples_are_those_of_a_time_and_by_default_of_the_first(tmp_path):
    assert animation_of(MOVING) == (0.0, 0.5)
    for time, top, y, count, intensity, z in ((None, 1, 0, 2, 1, 30), (0.25, 2, 4, 2, 1.5, 33), (0.5, 3, 8, 3, 2, 36)):
        scene = load_file(MOVING, time=time)
        assert len(scene.shapes) == count
        assert scene.shapes[0].mesh.bounds[1].tolist() == [1, top, 0]
        np.testing.assert_allclose(scene.shapes[1].mesh_at(0.0).bounds, [[4, y - 1, 1], [6, y + 1, 3]])
        assert scene.lights[0].radiance == pytest.approx((intensity,) * 3)
        assert scene.camera.origin == pytest.approx((0, 0, z))
    check_refused("it has no animation", partial(load_file, time=0.0), write(tmp_path, "a.usda", BALL))


def test_instances_have_colors_of_their_own(tmp_path):
    instancer = """def PointInstancer "p"
    {
        int[] protoIndices = [0, 0, 0]
        point3f[] positions = [(0, 0, 0), (5, 0, 0), (9, 0, 0)]
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (1, 0, 0)] (
            interpolation = "vertex"
        )
        rel prototypes = </p/s>
        def Cube "s" {}
    }
    """
    shapes = load_file(write(tmp_path, "p.usda", BALL.replace('def Sphere "s" {}', instancer))).shapes
    found = {tuple(shape.mesh.colors[0]): 0 for shape in shapes}
    for shape in shapes:
        found[tuple(shape.mesh.colors[0])] += 1
    assert found == {(1, 0, 0): 2, (0, 1, 0): 1}
    assert len({id(shape.mesh) for shape in shapes}) == 2


def test_images_are_black_beyond_their_edges_unless_they_continue(folder):
    wrt.save_image(folder / "red.png", np.full((32, 32, 3), 1.0))
    for wrap, expected in (("black", 0.0), ("useMetadata", 0.0), ("clamp", 1.0), ("repeat", 1.0)):
        text = USD.replace("@red.png@", f'@red.png@\ntoken inputs:wrapS = "{wrap}"\ntoken inputs:wrapT = "{wrap}"')
        text = text.replace(
            '            token inputs:wrapS = "mirror"\n            token inputs:wrapT = "repeat"\n', ""
        )
        texture = square_of(load_file(write(folder, f"{wrap}.usda", text))).material.base_color
        for uv, value in (((0.001, 0.3), 1.0), ((0.4, 0.1), expected), ((0.1, -0.3), expected)):  # of scale 3 and 2
            np.testing.assert_allclose(texel(texture, uv), value, err_msg=f"{wrap} at {uv}")


def test_an_image_without_coordinates_has_the_colour_of_its_origin(folder):
    pixels = np.full((2, 2, 3), 1.0)
    pixels[1, 0] = 0.25, 0.5, 0.0
    wrt.save_image(folder / "red.exr", pixels)
    text = USD.replace("red.png", "red.exr").replace("float2 inputs:st.connect = </World/Red/Place.outputs:result>", "")
    assert square_of(load_file(write(folder, "a.usda", text))).material.base_color == pytest.approx((0.25, 0.5, 0.0))


@pytest.mark.filterwarnings("error::wrt.errors.InputWarning")
def test_the_pole_of_a_dome_may_be_that_of_the_stage_and_what_no_schema_has_is_not_named(folder):
    image = "asset inputs:texture:file = @red.png@"
    stage = BALL.replace("metersPerUnit = 1", 'metersPerUnit = 1\nupAxis = "Z"')
    turned = "matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1))"
    turned += '\nuniform token[] xformOpOrder = ["xformOp:transform"]'
    scenes = [
        load_file(write(folder, f"{number}.usda", stage + dome))
        for number, dome in enumerate(
            (
                f'def DomeLight "d" {{\n{image}\n{turned}\n}}\n',
                f'def DomeLight_1 "d" {{\n{image}\n}}\n',
                f'def DomeLight_1 "d" {{\n{image}\nuniform token poleAxis = "Z"\n}}\ndef "b" {{\nint extra = 1\n}}\n',
                f'def DomeLight_1 "d" {{\n{image}\nuniform token poleAxis = "Y"\n}}\n',
            )
        )
    ]
    assert [bool(differences(scenes[0], scene)) for scene in scenes] == [False, False, False, True]


def texel(texture: wrt.ImageTexture, uv: tuple[float, float]) -> np.ndarray:
    """Return the nearest texel of a texture that clamps or repeats."""
    u, v = texture.placement @ (*uv, 1.0)
    height, width = texture.pixels.shape[:2]
    column, row = math.floor(u * width), math.floor((1.0 - v) * height)
    clamps = [wrap == "clamp" for wrap in texture.wrap]
    column = min(max(column, 0), width - 1) if clamps[0] else column % width
    return texture.pixels[min(max(row, 0), height - 1) if clamps[1] else row % height, column]


def test_native_instances_inherit_materials_and_colors_of_their_own(folder):
    asset = """
class Xform "Asset"
{
    def Cube "cube" {}
}
"""
    inherited = (
        "color3f[] primvars:displayColor = [(1, 0, 0)]",
        "color3f[] primvars:displayColor = [(0, 1, 0)]",
        "color3f[] primvars:displayColor = [(0, 1, 0)]",
        "rel material:binding = </World/Glossy>",
    )
    head = "(\n    instanceable = true\n    inherits = </Asset>\n)"
    roots = "".join(f'def Xform "i{k}" {head}\n{{\n{text}\n}}\n' for k, text in enumerate(inherited))
    shapes = load_file(write(folder, "n.usda", USD + asset + roots)).shapes
    cubes = [shape for shape in shapes if shape.name.endswith("/cube")]
    found = [
        shape.material.coat if shape.mesh.colors is None else tuple(shape.mesh.colors[0].tolist()) for shape in cubes
    ]
    assert sorted(map(str, found)) == sorted(map(str, [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), 0.5]))
    assert len({id(shape.mesh) for shape in cubes}) == 3
