"""Scene files give the scene they describe."""

from __future__ import annotations

import typing
from pathlib import Path

import numpy as np
import pytest
from support.scene_files import COMPOSITES, FULL, MOVING, QUAD, ROOF, scene_of, write_beside

import wrt
from wrt.io.images import save_image
from wrt.scene.materials import MATERIALS
from wrt.scene.materials.composite import MAX_NESTING
from wrt.scene.srgb import linear_from_srgb


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_beside(tmp_path)
    return tmp_path


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


@pytest.mark.parametrize("kind", [kind for kind in MATERIALS if kind != "measured"])  # needs a file: test_measured.py
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


def test_the_number_of_triangles_can_be_replaced(folder):
    text = '[[shapes]]\ntype = "many-triangles"\ntriangles = 4000\n'
    counts = [len(scene_of(folder, text, n).shapes[0].mesh.faces) for n in (None, 1000, 9000)]
    for count, wanted in zip(counts, (4000, 1000, 9000), strict=True):
        assert count == pytest.approx(wanted, rel=0.1)
    with pytest.raises(wrt.InputError, match=r"scene\.toml: a number of triangles was given"):
        scene_of(folder, QUAD, 1000)
