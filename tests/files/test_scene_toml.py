"""Scene files give the scene they describe; messages about mistakes name file and key, in one line."""

import json
import re
import typing

import numpy as np
import pytest
from support.meshes import gltf_box
from support.scene_files import COMPOSITES, FULL, MISTAKES, MOVING, QUAD, scene_of, write_beside

import wrt
from wrt.io.images import save_image
from wrt.io.toml.reader import load_scene
from wrt.scene.materials import MATERIALS
from wrt.scene.srgb import linear_from_srgb


@pytest.fixture
def folder(tmp_path):
    write_beside(tmp_path)
    return tmp_path


def test_every_section_is_read(folder):
    scene = scene_of(folder, FULL)
    assert scene.settings == wrt.RenderSettings(320, 200, 12, 5, "tent", exposure=-1.5)
    assert scene.camera == wrt.PerspectiveCamera(
        (0, 1, 3), (0, 0.5, 0), (0, 0, -1), 35.0, aperture_radius=0.01, focus_distance=2.0
    )
    np.testing.assert_array_equal(scene.environment.pixels, 7.0)
    assert (scene.environment.scale, scene.environment.rotation_degrees) == (2.0, 90.0)
    point, sun = scene.lights
    assert (point.position, point.power) == ((1.0, 2.0, 3.0), (10.0, 20.0, 30.0))
    assert sun == wrt.DirectionalLight((0, -1, 0), 3.0)

    floor, box, ball, pentagon, several, smooth, flat = scene.shapes
    assert (floor.name, floor.emission, floor.two_sided_emission) == ("floor", (4.0, 4.0, 4.0), True)
    np.testing.assert_allclose(floor.material.reflectance.pixels, linear_from_srgb(100 / 255), rtol=1e-6)
    assert box.material == wrt.Conductor((0.1, 0.4, 1.4), (4, 2.4, 1.6))
    # (1, 2, 3) is scaled to (1, 4, 3), turned about y to (3, 4, -1), then about x to (3, 1, 4).
    np.testing.assert_allclose(box.mesh.bounds, [[10, 0, 0], [13, 1, 4]], atol=1e-5)
    assert ball.material == wrt.Dielectric(1.33, 1.1)
    assert ball.emission == (1.0, 2.0, 3.0)
    assert len(ball.mesh.faces) == 20 * 4**2
    assert pentagon.material == flat.material == wrt.Mirror((0.9, 0.8, 0.7))
    assert len(pentagon.mesh.faces) == len(several.mesh.faces) == 3
    assert several.material.reflectance == wrt.VertexColor()
    ridge = np.abs(smooth.mesh.vertices[:, 0]) < 1e-6
    np.testing.assert_allclose(smooth.mesh.normals[ridge], [[0, -1, 0]] * ridge.sum(), atol=1e-6)
    assert flat.mesh.normals is None


def test_composite_and_transparent_materials(folder):
    codes = np.array([[[10, 100, 200]]], np.uint8)
    save_image(folder / "data.png", linear_from_srgb(codes / 255))
    names = ("sheet", "speckled", "leaf", "paint", "even", "lamp")
    scene = scene_of(folder, COMPOSITES + "".join(f'{QUAD}material = "{name}"\n' for name in names))
    sheet, speckled, leaf, paint, even, _ = (shape.material for shape in scene.shapes)
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
        assert texture.channel == channel
        expected = codes / 255 if linear else linear_from_srgb(codes / 255)
        np.testing.assert_allclose(texture.pixels, expected, rtol=1e-6)
    assert leaf.reflectance.pixels is paint.reflectance.pixels
    assert scene.shapes[5].emission == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("kind", [kind for kind in MATERIALS if kind != "measured"])  # which needs a file
def test_every_material_has_opacity_and_textures_wherever_values_vary(folder, kind):
    cls = MATERIALS[kind]
    head = f'{QUAD}material = "m"\n[materials.m]\ntype = "{kind}"\n'
    assert scene_of(folder, f"{head}opacity = 0.5\n").shapes[0].material == cls(opacity=0.5)
    varying = [key for key, hint in typing.get_type_hints(cls).items() if wrt.ImageTexture in typing.get_args(hint)]
    assert "opacity" in varying
    for key in varying:
        scene = scene_of(folder, f'{head}{key} = {{ texture = "wood.png", linear = true }}\n')
        made = getattr(scene.shapes[0].material, key)
        assert isinstance(made, wrt.ImageTexture), key
        np.testing.assert_allclose(made.pixels, 100 / 255, rtol=1e-6)


BOX = '[[shapes]]\ntype = "box"\n'


def test_a_camera_that_moves(folder):
    """It turns about where it stands."""
    camera = scene_of(folder, MOVING + QUAD).camera
    assert isinstance(camera, wrt.FisheyeCamera)
    assert (camera.shutter_open, camera.shutter_close, camera.shutter_ramp) == (1.0, 3.0, 0.5)
    assert camera.motion.center == (1.0, 2.0, 3.0)
    point = np.array([1.0, 2.0, 4.0, 1.0])
    for time, expected in ((0.0, (1, 2, 4)), (2.0, (2, 2, 3)), (3.5, (2, 2, 7)), (9.0, (2, 2, 7))):
        np.testing.assert_allclose((camera.motion.at(time) @ point)[:3], expected, atol=1e-12)


def test_the_number_of_triangles_can_be_replaced(folder):
    text = '[[shapes]]\ntype = "many-triangles"\ntriangles = 4000\n'
    scenes = [scene_of(folder, text, n) for n in (None, 1000, 9000)]
    assert [len(scene.shapes[0].mesh.faces) for scene in scenes] == pytest.approx([4000, 1000, 9000], rel=0.1)
    assert (scenes[0].camera, scenes[0].settings) == (None, wrt.RenderSettings())  # what the file leaves out
    with pytest.raises(wrt.InputError, match=r"scene\.toml: a number of triangles was given"):
        scene_of(folder, QUAD, 1000)


PLACES = """
[[shapes]]
type = "box"
translate = [0, 1, 0]
instances = [
    { translate = [1, 0, 0], scale = 2.0 },
    { rotate = { axis = [0, 1, 0], degrees = 90 }, motion = { times = [0, 2], translate = [4, 0, 0] } },
]
[[shapes]]
type = "sphere"
subdivisions = 0
instances = "places.npy"
[[shapes]]
type = "box"
motion = { times = [1, 3], rotate = { axis = [0, 0, 1], degrees = 720 }, center = [1, 0, 0] }
[[shapes]]
type = "box"
motion = { keys = [{ time = 0.5 }, { time = 1.5, scale = 3.0, translate = [0, 2, 0] }] }
[[shapes]]
type = "mesh"
file = "low.obj"
smooth = false
scale = 2.0
deformation = { files = ["low.obj", "high.obj"], times = [0.0, 1.0] }
"""


def test_instances_motions_and_deformations(folder):
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, 0, 3] = 1.0, 2.0, 3.0
    np.save(folder / "places.npy", matrices)
    for name, height in (("low", 1.0), ("high", 3.0)):
        (folder / f"{name}.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 {height} 0\nf 1 2 3\n")
    first, second, *placed, spinning, growing, changing = scene_of(folder, PLACES).shapes
    assert first.mesh is second.mesh
    assert placed[0].mesh is placed[1].mesh is placed[2].mesh
    assert first.mesh.bounds[0, 1] == 0.5  # the shape's own transform comes first
    np.testing.assert_allclose(first.bounds, [[0.0, 1.0, -1.0], [2.0, 3.0, 1.0]])
    turned = wrt.Motion.rotation((0, 1, 0), 90.0).transforms[-1]
    expected = wrt.Motion.translation((2.0, 0.0, 0.0)).transforms[-1] @ turned
    np.testing.assert_allclose(second.transform_at(1.0), expected, atol=1e-12)
    np.testing.assert_array_equal([shape.transform for shape in placed], matrices)
    quarter = wrt.Motion.rotation((0, 0, 1), 90.0, center=(1.0, 0.0, 0.0)).transforms[-1]
    np.testing.assert_allclose(spinning.transform_at(1.25), quarter, atol=1e-12)
    half = np.diag([2.0, 2.0, 2.0, 1.0])
    half[1, 3] = 1.0
    np.testing.assert_allclose(growing.transform_at(1.0), half, atol=1e-12)
    np.testing.assert_allclose(changing.mesh_at(0.5).bounds[1], [2.0, 4.0, 0.0])
    tree = gltf_box(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float), np.array([[0, 1, 2]]))
    tree["nodes"] = [{"mesh": 0, "translation": [1, 0, 0]}, {"mesh": 0, "translation": [0, 0, 3]}]
    tree["scenes"] = [{"nodes": [0, 1]}]
    (folder / "two.gltf").write_text(json.dumps(tree))
    places = "{}, { rotate = { axis = [0, 1, 0], degrees = 90 }, translate = [0, 5, 0] }"
    text = f'[[shapes]]\ntype = "mesh"\nfile = "two.gltf"\nscale = 2.0\ninstances = [{places}]\n'
    shapes = scene_of(folder, text).shapes
    found = sorted(tuple(np.round(shape.bounds.ravel(), 6) + 0.0) for shape in shapes)
    # The triangle's corners lie at the origin, on x and on y. Twice as large, its two places are (2, 0, 0) and
    # (0, 0, 6); a quarter turn about y takes x to -z and z to x.
    expected = [
        ((2, 0, 0), (4, 2, 0)),
        ((0, 0, 6), (2, 2, 6)),
        ((0, 5, -4), (0, 7, -2)),
        ((6, 5, -2), (6, 7, 0)),
    ]
    assert found == sorted(tuple(float(x) for corner in each for x in corner) for each in expected)


@pytest.mark.parametrize("text", MISTAKES, ids=range(len(MISTAKES)))
def test_messages_name_file_and_key_in_one_line(folder, text):
    with pytest.raises(wrt.InputError) as caught:
        scene_of(folder, text)
    message = str(caught.value)
    assert message.startswith(f"{folder / 'scene.toml'}: " + MISTAKES[text].format(folder=folder))
    assert "\n" not in message
    assert message.count("scene.toml") == 1


def test_messages_about_syntax_motions_and_instances(folder):
    with pytest.raises(wrt.InputError, match=r"scene\.toml: not TOML: .*line 3, column 10"):
        scene_of(folder, "[settings]\nwidth = 5\nheight = = 5\n")
    for number in (f"0x{'f' * 5000}", "9" * 5000, str(2**63)):  # Python does not print 5,000 digits
        with pytest.raises(wrt.InputError, match=r"not TOML: .*an integer of more than 64 bits"):
            scene_of(folder, f"[settings]\nwidth = {number}\n")
    (folder / "scene.toml").write_bytes(b"a = '\xff'")
    with pytest.raises(wrt.InputError, match=r"scene\.toml: not UTF-8 text: byte 5 is 0xff"):
        load_scene(folder / "scene.toml")
    (folder / "bad.npy").write_text("no array")
    np.save(folder / "flat.npy", np.zeros(3))
    for text, message in WRONG_PLACES.items():
        with pytest.raises(wrt.InputError, match=re.escape(message)):
            scene_of(folder, text)


WRONG_PLACES = {
    f"[camera.motion]\nkeys = []\n{QUAD}": "scene.toml: camera.motion: motion times must be one or more finite numbers",
    f"[camera.motion]\nkeys = [{{ time = 1 }}, {{ time = 1 }}]\n{QUAD}": "camera.motion: motion times must ascend",
    f"[camera.motion]\nkeys = [{{ time = 1, scale = 2 }}]\n{QUAD}": "camera: camera motion must be rigid",
    f"{BOX}instances = [{{ translat = [1, 0, 0] }}]\n": "shapes[0].instances[0].translat: unknown key",
    f'{BOX}instances = "bad.npy"\n': "bad.npy: not a NumPy file",
    f'{BOX}instances = "flat.npy"\n': "must be (N, 4, 4) matrices, not an array of (3,)",
    f"{BOX}motion = {{ times = [0] }}\n": "times must be two",
    f"{BOX}motion = {{ times = [0, 1] }}\ninstances = [{{}}]\n": "both motion and instances",
    f'{BOX}deformation = {{ files = ["bad.npy"], times = [0.0, 1.0] }}\n': "two arrays of one length",
}
