"""Scene files give the scene they describe, and every mistake in one is told by file and key."""

from __future__ import annotations

import re
import typing
from pathlib import Path

import numpy as np
import pytest

import wrt
from wrt.formats.images import save_image
from wrt.formats.scene_toml import load_scene
from wrt.materials import MATERIALS
from wrt.materials.composite import MAX_NESTING
from wrt.srgb import linear_from_srgb

FULL = """
[settings]
width = 320
height = 200
spp = 12
max_depth = 5
filter = "tent"
exposure = -1.5

[camera]
type = "perspective"
origin = [0, 1, 3]
target = [0, 0.5, 0]
up = [0, 0, -1]
fov_degrees = 35
aperture_radius = 0.01
focus_distance = 2

[environment]
type = "image"
file = "sky.exr"
scale = 2
rotation_degrees = 90

[[lights]]
type = "point"
position = [1, 2, 3]
power = [10, 20, 30]

[[lights]]
type = "directional"
direction = [0, -2, 0]
irradiance = 3

[materials.wood]
type = "diffuse"
reflectance = { texture = "wood.png" }

[materials.painted]
type = "diffuse"
reflectance = "vertex-colors"

[materials.silver]
type = "mirror"
reflectance = [0.9, 0.8, 0.7]

[materials.gold]
type = "conductor"
eta = [0.1, 0.4, 1.4]
k = [4, 2.4, 1.6]

[materials.water]
type = "dielectric"
ior = 1.33
exterior_ior = 1.1

[[shapes]]
name = "floor"
type = "quad"
origin = [0, 0, 0]
edge_u = [0, 0, 2]
edge_v = [2, 0, 0]
material = "wood"
emission = 4
two_sided_emission = true

[[shapes]]
type = "box"
low = [0, 0, 0]
high = [1, 2, 3]
material = "gold"
scale = [1, 2, 1]
rotate = [{ axis = [0, 1, 0], degrees = 90 }, { axis = [2, 0, 0], degrees = 90 }]
translate = [10, 0, 0]

[[shapes]]
type = "sphere"
center = [1, 1, 1]
radius = 0.5
subdivisions = 2
material = "water"
emission = [1, 2, 3]

[[shapes]]
type = "polygon"
corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-0.5, 0.5, 0]]
material = "silver"

[[shapes]]
type = "polygons"
polygons = [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]]
material = "painted"

[[shapes]]
type = "mesh"
file = "meshes/roof.obj"
rotate = { axis = [0, 0, 1], degrees = 180 }

[[shapes]]
type = "mesh"
file = "meshes/roof.obj"
smooth = false
material = "silver"
"""

ROOF = "v -1 0 0\nv 0 0.1 0\nv 0 0.1 1\nv -1 0 1\nv 1 0 0\nv 1 0 1\nf 1 4 3 2\nf 2 3 6 5\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_image(tmp_path / "sky.exr", np.full((2, 4, 3), 7.0))
    save_image(tmp_path / "wood.png", np.full((2, 2, 3), linear_from_srgb(100 / 255)))
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "roof.obj").write_text(ROOF)
    return tmp_path


def scene_of(folder: Path, text: str, triangles: int | None = None) -> wrt.Scene:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return load_scene(path, triangles)


def test_a_file_that_uses_everything_gives_the_scene_it_describes(folder):
    scene = scene_of(folder, FULL)
    assert scene.settings == wrt.RenderSettings(320, 200, 12, 5, "tent", exposure=-1.5)
    assert scene.camera == wrt.PerspectiveCamera(
        (0, 1, 3), (0, 0.5, 0), (0, 0, -1), 35.0, aperture_radius=0.01, focus_distance=2.0
    )
    assert isinstance(scene.environment, wrt.ImageEnvironment)
    np.testing.assert_array_equal(scene.environment.pixels, 7.0)
    assert (scene.environment.scale, scene.environment.rotation_degrees) == (2.0, 90.0)
    point, sun = scene.lights
    assert (point.position, point.power) == ((1.0, 2.0, 3.0), (10.0, 20.0, 30.0))
    assert sun == wrt.DirectionalLight((0, -1, 0), 3.0)

    floor, box, ball, pentagon, several, own, flat = scene.shapes
    assert (floor.name, floor.emission, floor.two_sided_emission) == ("floor", (4.0, 4.0, 4.0), True)
    np.testing.assert_allclose(floor.material.reflectance.pixels, linear_from_srgb(100 / 255), rtol=1e-6)
    assert box.material == wrt.Conductor((0.1, 0.4, 1.4), (4, 2.4, 1.6))
    # (1, 2, 3) is scaled to (1, 4, 3), turned about y to (3, 4, -1), then about x to (3, 1, 4).
    np.testing.assert_allclose(box.mesh.bounds, [[10, 0, 0], [13, 1, 4]], atol=1e-5)
    assert ball.material == wrt.Dielectric(1.33, 1.1)
    assert ball.emission == (1.0, 2.0, 3.0)
    assert len(ball.mesh.faces) == 20 * 4**2
    assert pentagon.material == wrt.Mirror((0.9, 0.8, 0.7))
    assert len(pentagon.mesh.faces) == 3
    assert several.material.reflectance == wrt.VertexColor()
    assert len(several.mesh.faces) == 3
    ridge = np.abs(own.mesh.vertices[:, 0]) < 1e-6
    np.testing.assert_allclose(own.mesh.normals[ridge], [[0, -1, 0]] * ridge.sum(), atol=1e-6)
    assert flat.mesh.normals is None
    assert flat.material == wrt.Mirror((0.9, 0.8, 0.7))


COMPOSITES = """
[materials.sheet]                  # names materials that come later
type = "two-sided"
front = "leaf"
back = "speckled"
opacity = { texture = "data.png", channel = "b", linear = true }

[materials.speckled]
type = "mix"
first = "leaf"
second = "paint"
weight = { texture = "data.png", channel = "g", linear = true }

[materials.leaf]
type = "diffuse"
reflectance = { texture = "data.png" }
opacity = 0.75

[materials.paint]
type = "mirror"
reflectance = { texture = "data.png", channel = "r" }
opacity = "vertex-colors"

[materials.even]
type = "mix"
first = "paint"
second = "paint"

[materials.lamp]
type = "emissive"
radiance = [1, 2, 3]
opacity = { texture = "data.png", channel = "b", linear = true }
"""


def test_materials_made_of_others_and_partly_there(folder):
    codes = np.array([[[10, 100, 200]]], np.uint8)
    save_image(folder / "data.png", linear_from_srgb(codes / 255))
    names = ("sheet", "speckled", "leaf", "paint", "even", "lamp")
    scene = scene_of(folder, COMPOSITES + "".join(f'{QUAD}material = "{name}"\n' for name in names))
    sheet, speckled, leaf, paint, even, lamp = (shape.material for shape in scene.shapes)
    assert isinstance(sheet, wrt.TwoSided)
    assert isinstance(speckled, wrt.Mix)
    # One object a name, wherever it is used: it is uploaded once.
    assert (sheet.front, sheet.back, speckled.first, speckled.second) == (leaf, speckled, leaf, paint)
    assert sheet.back.first is leaf
    assert even.first is even.second is paint
    assert (even.weight, leaf.opacity, paint.opacity) == (0.5, 0.75, wrt.VertexColor())
    # Numbers as they are in the file, where it says so; else decoded like colours. Pixels of a file are read once.
    for texture, channel, linear in (
        (sheet.opacity, "b", True),
        (speckled.weight, "g", True),
        (leaf.reflectance, None, False),
        (paint.reflectance, "r", False),
    ):
        assert (texture.channel, texture.name) == (channel, "data.png")
        expected = codes / 255 if linear else linear_from_srgb(codes / 255)
        np.testing.assert_allclose(texture.pixels, expected, rtol=1e-6)
    assert sheet.opacity.pixels is speckled.weight.pixels
    assert leaf.reflectance.pixels is paint.reflectance.pixels
    assert lamp.opacity is sheet.opacity
    assert scene.shapes[5].emission == (1.0, 2.0, 3.0)
    assert [shape.emits for shape in scene.shapes] == [False] * 5 + [True]


@pytest.mark.parametrize("kind", MATERIALS)
def test_every_material_is_there_with_opacity_and_textures_wherever_values_vary(folder, kind):
    cls = MATERIALS[kind]
    scene = scene_of(folder, f'[materials.m]\ntype = "{kind}"\nopacity = 0.5\n{QUAD}material = "m"\n')
    assert scene.shapes[0].material == cls(opacity=0.5)
    varying = [key for key, hint in typing.get_type_hints(cls).items() if wrt.ImageTexture in typing.get_args(hint)]
    assert "opacity" in varying
    for key in varying:
        value = f'{key} = {{ texture = "wood.png", linear = true }}'
        scene = scene_of(folder, f'[materials.m]\ntype = "{kind}"\n{value}\n{QUAD}material = "m"\n')
        made = getattr(scene.shapes[0].material, key)
        assert isinstance(made, wrt.ImageTexture), key
        np.testing.assert_allclose(made.pixels, 100 / 255, rtol=1e-6)


def test_materials_may_be_nested_as_deep_as_kernels_go(folder):
    links = "".join(f"[materials.m{i}]\ntype = 'mix'\nfirst = 'm{i + 1}'\n" for i in range(MAX_NESTING))
    scene = scene_of(folder, f"{links}[materials.m{MAX_NESTING}]\ntype = 'mirror'\n{QUAD}material = 'm0'\n")
    material = scene.shapes[0].material
    for _ in range(MAX_NESTING):
        material = material.first
    assert material == wrt.Mirror()


def test_an_empty_file_is_an_empty_scene(folder):
    scene = scene_of(folder, "# nothing yet\n")
    assert scene.shapes == []
    assert scene.camera is None
    assert scene.settings == wrt.RenderSettings()
    box = scene_of(folder, '[environment]\ntype = "constant"\n[[shapes]]\ntype = "box"\n')
    assert box.environment == wrt.ConstantEnvironment(1.0)
    assert box.shapes[0].material == wrt.Diffuse()


def test_a_mesh_keeps_its_own_materials_unless_given_one(folder):
    (folder / "two.mtl").write_text("newmtl a\nKd 0.1 0.2 0.3\nnewmtl b\nKd 0.4 0.5 0.6\n")
    *points, left, right = ROOF.splitlines()
    (folder / "two.obj").write_text("\n".join(["mtllib two.mtl", *points, "usemtl a", left, "usemtl b", right]))
    shape = '[[shapes]]\ntype = "mesh"\nfile = "two.obj"\n'
    own = scene_of(folder, shape)
    assert [s.material.reflectance for s in own.shapes] == [(0.1, 0.2, 0.3), (0.4, 0.5, 0.6)]
    given = scene_of(folder, shape + 'material = "m"\n[materials.m]\ntype = "mirror"\n')
    assert len(given.shapes) == 1
    assert len(given.shapes[0].mesh.faces) == 4
    assert given.shapes[0].material == wrt.Mirror()


MOVING = """
[camera]
type = "fisheye"
origin = [1, 2, 3]
shutter_open = 1.0
shutter_close = 3
shutter_ramp = 0.5
[camera.motion]
keys = [
    { time = 1 },
    { time = 2, rotate = { axis = [0, 1, 0], degrees = 90 } },
    { time = 3.5, rotate = { axis = [0, 1, 0], degrees = 90 }, translate = [0, 0, 4] },
]
"""


def test_a_camera_that_moves(folder):
    """It turns about where it stands, unless told about what."""
    camera = scene_of(folder, MOVING + QUAD).camera
    assert isinstance(camera, wrt.FisheyeCamera)
    assert (camera.shutter_open, camera.shutter_close, camera.shutter_ramp) == (1.0, 3.0, 0.5)
    assert camera.motion.center == (1.0, 2.0, 3.0)
    point = np.array([1.0, 2.0, 4.0, 1.0])
    for time, expected in ((0.0, (1, 2, 4)), (2.0, (2, 2, 3)), (3.5, (2, 2, 7)), (9.0, (2, 2, 7))):
        np.testing.assert_allclose((camera.motion.at(time) @ point)[:3], expected, atol=1e-12)
    own = scene_of(folder, MOVING.replace("[camera.motion]", "[camera.motion]\ncenter = [0, 0, 0]") + QUAD).camera
    np.testing.assert_allclose((own.motion.at(2.0) @ point)[:3], (4, 2, -1), atol=1e-12)


MOTIONS = {
    "keys = []": "camera.motion: motion times must be finite numbers, at least one",
    "keys = [{ translate = [0, 0, 1] }]": "camera.motion.keys[0]: the key 'time' is missing",
    "keys = [{ time = 1 }, { time = 1 }]": "camera.motion: motion times must ascend",
    "keys = [{ time = 1, turn = 3 }]": "camera.motion.keys[0].turn: unknown key",
    "keys = [{ time = 1, scale = 2 }]": "camera: camera motion must only move and turn",
    "keys = 3": "camera.motion.keys: must be an array of tables",
    "center = [0, 0, 0]": "camera.motion: the key 'keys' is missing",
}


@pytest.mark.parametrize("text", MOTIONS)
def test_motions_that_cannot_be(folder, text):
    with pytest.raises(wrt.InputError, match=re.escape(f"scene.toml: {MOTIONS[text]}")):
        scene_of(folder, f"[camera.motion]\n{text}\n{QUAD}")


def test_the_number_of_triangles_can_be_replaced(folder):
    text = '[[shapes]]\ntype = "many-triangles"\ntriangles = 4000\n'
    counts = [len(scene_of(folder, text, n).shapes[0].mesh.faces) for n in (None, 1000, 9000)]
    for count, wanted in zip(counts, (4000, 1000, 9000), strict=True):
        assert count == pytest.approx(wanted, rel=0.1)
    with pytest.raises(wrt.InputError, match=r"scene\.toml: a number of triangles was given"):
        scene_of(folder, QUAD, 1000)


QUAD = '[[shapes]]\ntype = "quad"\norigin = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\n'

MISTAKES = {
    QUAD * 2 + QUAD + 'materal = "x"': "shapes[2].materal: unknown key (did you mean 'material'?)",
    "[cammera]": "cammera: unknown key (did you mean 'camera'?)",
    "[camera]\nfov = 40": "camera.fov: unknown key",
    "[camera]\nfov_degrees = 200": "camera: camera fov_degrees must be less than 180, not 200",
    '[camera]\nfov_degrees = "wide"': "camera: camera fov_degrees must be a number, not 'wide'",
    '[camera]\ntype = "fish"': (
        "camera: type must be one of 'perspective', 'orthographic', 'panorama', 'fisheye', not 'fish'"
    ),
    '[camera]\ntype = "fisheye"\naperture_radius = 1': "camera.aperture_radius: unknown key",
    '[camera]\ntype = "fisheye"\nfov_degrees = 361': "camera: camera fov_degrees must be at most 360, not 361",
    "[camera]\nshutter_close = -1": "camera: camera shutter_close must not be before shutter_open: -1 is before 0",
    '[camera]\naperture = "star"': "camera: camera aperture must be one of disk, square, polygon, not 'star'",
    "[camera]\naperture_blades = 2": "camera: camera aperture_blades must be between 3 and 1000, not 2",
    "[settings]\ncrop = [0, 0, 4]": "settings: crop must be four whole numbers (x0, y0, x1, y1), not [0, 0, 4]",
    "[settings]\nwidth = 8\ncrop = [0, 0, 9, 4]": "settings: crop must lie inside the picture: (9, 4) is beyond",
    "[settings]\ncrop = [4, 0, 4, 4]": "settings: crop must not be empty: from (4, 0) up to (4, 4) there are no pixels",
    "[camera]\norigin = [0, 0]": "camera: camera origin must be three numbers, not [0, 0]",
    "[camera]\norigin = [0, 0, 0]": "camera: camera origin and target must differ",
    "camera = 3": "camera: must be a table, not 3",
    "[settings]\nwidth = 0": "settings: width must be between 1 and 65536, not 0",
    "[settings]\nspp = 1.5": "settings: spp must be a whole number, not 1.5",
    '[settings]\nfilter = "bell"': "settings: filter must be one of",
    "[environment]\nradiance = 1": "environment: the key 'type' is missing",
    '[environment]\ntype = "constant"\nradiance = -1': "environment: radiance must be at least 0, not -1",
    '[environment]\ntype = "image"': "environment: the key 'file' is missing",
    '[environment]\ntype = "image"\nfile = "none.hdr"': "environment.file: {folder}/none.hdr: no such file",
    '[environment]\ntype = "image"\nfile = 5': "environment.file: must be a text, not 5",
    "[lights]\ntype = 'point'": "lights: must be an array of tables; write [[lights]]",
    "[[lights]]\ntype = 'pont'": "lights[0]: type must be one of 'point', 'spot', 'directional', 'rectangle', 'disk', "
    "'sphere', not 'pont' (did you mean",
    "[[lights]]\ntype = 'point'\nintensity = 1": "lights[0]: the key 'position' is missing",
    "[[lights]]\ntype = 'point'\nposition = [0, 0, 0]": "lights[0]: a point light takes one of intensity, power and "
    "color",
    "[materials]\nred = 5": "materials.red: must be a table, not 5",
    "[materials.red]\nreflectance = 1": "materials.red: the key 'type' is missing",
    "[materials.red]\ntype = 'diffuse'\nreflectance = 1.5": "materials.red: reflectance must be at most 1, not 1.5",
    "[materials.red]\ntype = 'diffuse'\nreflectance = 'red'": "materials.red.reflectance: must be a number",
    "[materials.red]\ntype = 'diffuse'\nreflectance = { texture = 'no.png' }": (
        "materials.red.reflectance.texture: {folder}/no.png: no such file"
    ),
    "[materials.red]\ntype = 'diffuse'\nroughness = 1": "materials.red.roughness: unknown key",
    "[materials.red]\ntype = 'diffuse'\nopacity = 2": "materials.red: opacity must be at most 1, not 2",
    "[materials.red]\ntype = 'diffuse'\nopacity = { texture = 'wood.png', chanel = 'g' }": (
        "materials.red.opacity.chanel: unknown key (did you mean 'channel'?)"
    ),
    "[materials.red]\ntype = 'diffuse'\nopacity = { texture = 'wood.png', channel = 'a' }": (
        "materials.red.opacity.texture: texture wood.png: channel must be one of r, g, b, not 'a'"
    ),
    "[materials.red]\ntype = 'diffuse'\nopacity = { texture = 'wood.png', channel = ['r'] }": (
        "materials.red.opacity.texture: texture wood.png: channel must be one of r, g, b, not ['r']"
    ),
    "[materials.red]\ntype = 'diffuse'\nopacity = { texture = 'wood.png', linear = 1 }": (
        "materials.red.opacity: linear must be true or false, not 1"
    ),
    "[materials.red]\ntype = 'diffuse'\nopacity = { channel = 'r' }": (
        "materials.red.opacity: the key 'texture' is missing"
    ),
    "[materials.both]\ntype = 'mix'\nweight = 1.5": "materials.both: weight must be at most 1, not 1.5",
    "[materials.both]\ntype = 'mix'\nfirst = 'gold'\n[materials.old]\ntype = 'mirror'": (
        "materials.both.first: there is no [materials.gold] (did you mean 'old'?)"
    ),
    "[materials.both]\ntype = 'mix'\nfirst = 0.5": "materials.both.first: must be a text, not 0.5",
    "[materials.both]\ntype = 'two-sided'\nback = { type = 'mirror' }": "materials.both.back: must be a text, not {{",
    "[materials.both]\ntype = 'mix'\nfirst = 'both'": "materials.both.first: 'both' is made of itself",
    "[materials.a]\ntype = 'mix'\nsecond = 'b'\n[materials.b]\ntype = 'two-sided'\nfront = 'a'": (
        "materials.b.front: 'a' is made of itself"
    ),
    "[materials.a]\ntype = 'mix'\nsecond = 'b'\n[materials.b]\ntype = 'mirror'\nreflectance = 2": (
        "materials.b: reflectance must be at most 1, not 2"
    ),
    "[materials.a]\ntype = 'mix'\nsecond = 'b'\n[materials.b]\ntype = 'emissive'": (
        "materials.a: second must not emit light; give the shape an emission instead"
    ),
    "".join(f"[materials.m{i}]\ntype = 'mix'\nfirst = 'm{i + 1}'\n" for i in range(300)): (
        "materials.m7.first: materials are nested more than 7 deep"
    ),
    "".join(f"[materials.m{i}]\ntype = 'mix'\nfirst = 'm{i + 1}'\n" for i in range(8))
    + "[materials.m8]\ntype = 'mirror'": ("materials.m7.first: materials are nested more than 7 deep"),
    "[[shapes]]\norigin = [0, 0, 0]": "shapes[0]: the key 'type' is missing",
    "[[shapes]]\ntype = 'quad'\norigin = [0, 0, 0]": "shapes[0]: the key 'edge_u' is missing",
    "[[shapes]]\ntype = 'cube'": "shapes[0]: type must be one of",
    "[[shapes]]\ntype = ['box']": "shapes[0]: type must be one of",
    "[[shapes]]\ntype = 'polygon'\ncorners = [[0, 0, 0], [1, 0]]": "shapes[0]: corners[1] must be three numbers",
    "[[shapes]]\ntype = 'polygon'\ncorners = [[0, 0, 0], [1, 0, 0]]": "shapes[0]: a polygon takes at least three",
    "[[shapes]]\ntype = 'polygons'\npolygons = []": "shapes[0]: polygons must be an array of arrays of corners",
    "[[shapes]]\ntype = 'mesh'\nfile = 'none.ply'": "shapes[0].file: {folder}/none.ply: no such file",
    "[[shapes]]\ntype = 'mesh'\nfile = 'sky.exr'": "shapes[0].file: {folder}/sky.exr: not a mesh format",
    "[[shapes]]\ntype = 'mesh'\nfile = 'meshes/roof.obj'\nsmooth = 1": "shapes[0]: smooth must be true or false, not 1",
    "[[shapes]]\ntype = 'many-triangles'\ntriangles = 1.5": "shapes[0]: triangles must be a whole number",
    QUAD + "material = 'gold'\n[materials.old]\ntype = 'mirror'": (
        "shapes[0].material: there is no [materials.gold] (did you mean 'old'?)"
    ),
    QUAD + "emission = -1": "shapes[0]: ",
    QUAD + "two_sided_emission = 1": "shapes[0]: two_sided_emission must be true or false, not 1",
    QUAD + "name = 5": "shapes[0].name: must be a text, not 5",
    QUAD + "scale = 0": "shapes[0]: scale must not be 0",
    QUAD + "scale = true": "shapes[0]: scale must be a number, not True",
    QUAD + "rotate = { axis = [0, 0, 0], degrees = 1 }": "shapes[0].rotate: axis must not be zero",
    QUAD + "rotate = [{ axis = [0, 1, 0] }]": "shapes[0].rotate[0]: the key 'degrees' is missing",
    QUAD + "rotate = 90": "shapes[0].rotate: must be a table, not 90",
    QUAD + "translate = [0, inf, 0]": "shapes[0]: translate[1] must be finite, not inf",
    QUAD + f"scale = 1{'0' * 400}": "shapes[0]: ",
    "[camera\nx = 1": "not TOML: ",
    "a = 1\na = 2": "not TOML: ",
    "x = " + "[" * 5000: "not TOML: ",
}


@pytest.mark.parametrize("text", MISTAKES, ids=range(len(MISTAKES)))
def test_mistakes_are_told_by_file_and_key_in_one_line(folder, text):
    with pytest.raises(wrt.InputError) as caught:
        scene_of(folder, text)
    message = str(caught.value)
    assert message.startswith(f"{folder / 'scene.toml'}: " + MISTAKES[text].format(folder=folder))
    assert "\n" not in message
    assert message.count("scene.toml") == 1


def test_syntax_errors_give_line_and_column(folder):
    with pytest.raises(wrt.InputError, match=r"scene\.toml: not TOML: .*line 3, column 10"):
        scene_of(folder, "[settings]\nwidth = 5\nheight = = 5\n")


def test_files_that_are_not_text_or_not_there_are_refused(folder):
    (folder / "scene.toml").write_bytes(b"a = '\xff'")
    with pytest.raises(wrt.InputError, match=r"scene\.toml: not UTF-8 text: byte 5 is 0xff"):
        load_scene(folder / "scene.toml")
    with pytest.raises(wrt.InputError, match=r"none\.toml: no such file"):
        load_scene(folder / "none.toml")
    with pytest.raises(wrt.InputError, match="is a directory"):
        load_scene(folder)
