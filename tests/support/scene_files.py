"""Scene files that use many features, and the files that they name."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import wrt
from wrt.io.images import save_image
from wrt.io.toml.reader import load_scene
from wrt.scene.srgb import linear_from_srgb

FULL = """
settings = { width = 320, height = 200, spp = 12, max_depth = 5, filter = "tent", exposure = -1.5 }
environment = { type = "image", file = "sky.exr", scale = 2, rotation_degrees = 90 }
lights = [
    { type = "point", position = [1, 2, 3], power = [10, 20, 30] },
    { type = "directional", direction = [0, -2, 0], irradiance = 3 },
]

[camera]
type = "perspective"
origin = [0, 1, 3]
target = [0, 0.5, 0]
up = [0, 0, -1]
fov_degrees = 35
aperture_radius = 0.01
focus_distance = 2

[materials]
wood = { type = "diffuse", reflectance = { texture = "wood.png" } }
painted = { type = "diffuse", reflectance = "vertex-colors" }
silver = { type = "mirror", reflectance = [0.9, 0.8, 0.7] }
gold = { type = "conductor", eta = [0.1, 0.4, 1.4], k = [4, 2.4, 1.6] }
water = { type = "dielectric", ior = 1.33, exterior_ior = 1.1 }

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
"""Every section, kind of shape and transform."""

COMPOSITES = """
[materials]  # the first names materials that come later
sheet = { type = "two-sided", front = "leaf", back = "speckled", opacity = DATA_B }
speckled = { type = "mix", first = "leaf", second = "paint", weight = DATA_G }
leaf = { type = "diffuse", reflectance = { texture = "data.png" }, opacity = 0.75 }
paint = { type = "mirror", reflectance = { texture = "data.png", channel = "r" }, opacity = "vertex-colors" }
even = { type = "mix", first = "paint", second = "paint" }
lamp = { type = "emissive", radiance = [1, 2, 3], opacity = DATA_B }
"""
for _channel in "bg":
    _texture = f'{{ texture = "data.png", channel = "{_channel}", linear = true }}'
    COMPOSITES = COMPOSITES.replace(f"DATA_{_channel.upper()}", _texture)
"""Materials made of others and partly there."""

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
"""A camera that moves."""

QUAD = '[[shapes]]\ntype = "quad"\norigin = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\n'

ROOF = "v -1 0 0\nv 0 0.1 0\nv 0 0.1 1\nv -1 0 1\nv 1 0 0\nv 1 0 1\nf 1 4 3 2\nf 2 3 6 5\n"

RED = "[materials.red]\ntype = 'diffuse'\n"

MISTAKES = {
    QUAD * 3 + 'materal = "x"': "shapes[2].materal: unknown key (did you mean 'material'?)",
    "[cammera]": "cammera: unknown key (did you mean 'camera'?)",
    "[camera]\nfov_degrees = 200": "camera: camera fov_degrees must be at most 179, not 200",
    '[camera]\ntype = "fish"': "camera: type must be one of 'perspective', 'orthographic', 'panorama', 'fisheye', not",
    "[settings]\ncrop = [0, 0, 4]": "settings: crop must be four whole numbers (x0, y0, x1, y1), not [0, 0, 4]",
    '[environment]\ntype = "constant"\nradiance = -1': "environment: radiance must be at least 0, not -1",
    '[environment]\ntype = "image"\nfile = "none.hdr"': "environment.file: {folder}/none.hdr: no such file",
    "[[lights]]\ntype = 'pont'": "lights[0]: type must be one of 'point', 'spot', 'projector', 'directional', "
    "'rectangle', 'disk', 'sphere', not 'pont' (did you mean",
    "[[lights]]\ntype = 'point'\nposition = [0, 0, 0]": "lights[0]: a point light takes one of intensity, power and",
    f"{RED}reflectance = 1.5": "materials.red: reflectance must be at most 1, not 1.5",
    f"{RED}reflectance = {{ texture = 'no.png' }}": "materials.red.reflectance.texture: {folder}/no.png: no such file",
    f"{RED}opacity = {{ texture = 'wood.png', channel = ['r'] }}": (
        "materials.red.opacity.texture: texture wood.png: channel must be one of r, g, b, not ['r']"
    ),
    "[materials.both]\ntype = 'mix'\nfirst = 'gold'\n[materials.old]\ntype = 'mirror'": (
        "materials.both.first: there is no [materials.gold] (did you mean 'old'?)"
    ),
    "[materials.a]\ntype = 'mix'\nsecond = 'b'\n[materials.b]\ntype = 'two-sided'\nfront = 'a'": (
        "materials.b.front: 'a' is made of itself"
    ),
    "[materials.a]\ntype = 'mix'\nsecond = 'b'\n[materials.b]\ntype = 'emissive'": (
        "materials.a: second must not emit light; give the shape an emission instead"
    ),
    "".join(
        f"[materials.m{i}]\ntype = 'mix'\nfirst = 'm{i + 1}'\n" for i in range(300)
    ): "materials.m7.first: materials are nested more than 7 deep",
    "[[shapes]]\norigin = [0, 0, 0]": "shapes[0]: the key 'type' is missing",
    "[[shapes]]\ntype = 'polygon'\ncorners = [[0, 0, 0], [1, 0]]": "shapes[0]: corners[1] must be three numbers",
    "[[shapes]]\ntype = 'mesh'\nfile = 'sky.exr'": "shapes[0].file: {folder}/sky.exr: it is an image",
    QUAD + "rotate = [{ axis = [0, 1, 0] }]": "shapes[0].rotate[0]: the key 'degrees' is missing",
    QUAD + f"scale = 1{'0' * 400}": "not TOML: scale is an integer of more than 64 bits",
    "[camera\nx = 1": "not TOML: ",
    "x = " + "[" * 5000: "not TOML: ",
}
"""Texts with a mistake, and how the message begins after the name of the file."""


def write_beside(folder: Path) -> None:
    """Write the files that the scenes here name."""
    save_image(folder / "sky.exr", np.full((2, 4, 3), 7.0))
    save_image(folder / "wood.png", np.full((2, 2, 3), linear_from_srgb(100 / 255)))
    (folder / "meshes").mkdir()
    (folder / "meshes" / "roof.obj").write_text(ROOF)


def scene_of(folder: Path, text: str, triangles: int | None = None) -> wrt.Scene:
    """Return the scene of a text, written to scene.toml in a folder."""
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return load_scene(path, triangles)
