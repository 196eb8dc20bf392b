"""Every mistake in a scene file is told by file and key, in one line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.scene_files import QUAD, scene_of, write_beside

import wrt
from wrt.io.toml.reader import load_scene


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_beside(tmp_path)
    return tmp_path


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
    "[settings]\ncrop = [4, 0, 4, 4]": "settings: crop must not be empty: there are no pixels from (4, 0) up to (4, 4)",
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
    "[[lights]]\ntype = 'pont'": "lights[0]: type must be one of 'point', 'spot', 'projector', 'directional', "
    "'rectangle', 'disk', 'sphere', not 'pont' (did you mean",
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
    "[[shapes]]\ntype = 'polygon'\ncorners = [[0, 0, 0], [1, 0, 0]]": "shapes[0]: a polygon needs at least three",
    "[[shapes]]\ntype = 'polygons'\npolygons = []": "shapes[0]: polygons must be an array of arrays of corners",
    "[[shapes]]\ntype = 'mesh'\nfile = 'none.ply'": "shapes[0].file: {folder}/none.ply: no such file",
    "[[shapes]]\ntype = 'mesh'\nfile = 'sky.exr'": "shapes[0].file: {folder}/sky.exr: not a known mesh format",
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


MOTIONS = {
    "keys = []": "camera.motion: motion times must be one or more finite numbers",
    "keys = [{ translate = [0, 0, 1] }]": "camera.motion.keys[0]: the key 'time' is missing",
    "keys = [{ time = 1 }, { time = 1 }]": "camera.motion: motion times must ascend",
    "keys = [{ time = 0 }, { time = 1e308 }]": "camera.motion: motion times must be one or more finite numbers",
    "keys = [{ time = 1, turn = 3 }]": "camera.motion.keys[0].turn: unknown key",
    "keys = [{ time = 1, scale = 2 }]": "camera: camera motion must be rigid",
    "keys = 3": "camera.motion.keys: must be an array of tables",
    "center = [0, 0, 0]": "camera.motion: the key 'keys' is missing",
}


@pytest.mark.parametrize("text", MOTIONS)
def test_motions_that_cannot_be(folder, text):
    with pytest.raises(wrt.InputError, match=re.escape(f"scene.toml: {MOTIONS[text]}")):
        scene_of(folder, f"[camera.motion]\n{text}\n{QUAD}")
