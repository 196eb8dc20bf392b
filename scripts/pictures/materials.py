"""One picture of each material, for docs/shading.md.

A ball stands in a checkered cove, under a soft box on the left and a strip light on the right. All tiles share one
kernel, which is compiled once.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import wrt

from .bodies import ball, brilliant, facing, grid_faces
from .picture import Picture, Sheet, Tiles

Array = NDArray[np.float64]

SIZE = 200
"""Pixels of a tile, either way."""

SPP = 256

SQUARE = 0.5
"""Side of the cove's squares, metres; the ball has radius 1."""


# --- Images that the materials read ----------------------------------------------------------------


def longitude_latitude(width: int = 1024) -> tuple[Array, Array]:
    """Return u to the right and v upwards at the pixels of an image twice as wide as high."""
    return np.meshgrid((np.arange(width) + 0.5) / width, 1.0 - (np.arange(width // 2) + 0.5) / (width // 2))


def grey(values: Array) -> wrt.ImageTexture:
    """Return an image of numbers."""
    return wrt.ImageTexture(np.repeat(values[..., None], 3, axis=2).astype(np.float32))


def swirl() -> wrt.ImageTexture:
    """Return bands that wind from pole to pole, 0 or 1."""
    u, v = longitude_latitude()
    return grey((np.sin(2.0 * np.pi * (5.0 * u + 1.2 * v)) > 0.0).astype(np.float64))


def holes() -> wrt.ImageTexture:
    """Return 1 with round holes of 0, in rows around the axis that have fewer towards the poles."""
    u, v = longitude_latitude()
    rows = 8
    row = np.floor(v * rows)
    latitude = np.pi * ((row + 0.5) / rows - 0.5)
    count = np.maximum(np.round(2.0 * rows * np.cos(latitude)), 1.0)
    across = (u * count + 0.5 * (row % 2)) % 1.0 - 0.5
    along = v * rows - row - 0.5
    return grey((np.hypot(across, along) > 0.32).astype(np.float64))


def dimples() -> wrt.NormalMap:
    """Return the normals of hammered sheet: dimples on a hexagonal lattice."""
    u, v = longitude_latitude()
    x, y = 2.0 * np.pi * 14.0 * u, 2.0 * np.pi * 7.0 * v
    # Whole numbers of waves around the ball. Slopes are per texel of u and of v, which are equally long at the equator.
    waves = ((x, 1.0, 0.0), (0.5 * x + y, 0.5, 1.0), (0.5 * x - y, 0.5, -1.0))
    slope = 0.35 * np.sum([np.sin(phase) * np.array([a, b])[:, None, None] for phase, a, b in waves], axis=0)
    slope *= np.sin(np.pi * v)  # not at the poles, where u runs in circles
    normals = np.stack([slope[0], slope[1], np.ones_like(u)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return wrt.NormalMap((0.5 * normals + 0.5).astype(np.float32))


# --- Tiles -----------------------------------------------------------------------------------------


class Tile(NamedTuple):
    """One picture of the sheet.

    Attributes:
        name: for the command line.
        caption: what is set, beneath the material's type; ASCII, as Pillow's own font has little more.
        material: of the ball.
        cut: whether it is a cut stone instead of a ball.
        samples: multiplies the samples per pixel, where reflections are rare and bright.
    """

    name: str
    caption: str
    material: wrt.Material
    cut: bool = False
    samples: int = 1


@functools.cache
def tiles() -> tuple[Tile, ...]:
    """Return all tiles, row by row."""
    clay, red = (0.55, 0.26, 0.15), (0.55, 0.03, 0.02)
    return (
        # Matt, and matt under a coat
        Tile("diffuse", "reflectance 0.55 0.26 0.15", wrt.Diffuse(clay)),
        Tile("oren-nayar", "the same, sigma 0.6", wrt.OrenNayar(clay, sigma=0.6)),
        Tile("plastic", "red", wrt.Plastic(red)),
        Tile("rough-plastic", "red, alpha 0.3", wrt.RoughPlastic(red, alpha=0.3)),
        Tile("normal-map", "alpha 0.1, a normal map", wrt.RoughPlastic((0.02, 0.22, 0.25), normal_map=dimples())),
        # Mirrors and smooth metals
        Tile("mirror", "reflectance 0.9", wrt.Mirror(0.9)),
        Tile("glossy", "side 0.4", wrt.Glossy(0.9, side=0.4)),
        Tile("gold", "gold", wrt.Conductor(metal="gold")),
        Tile("titanium", "titanium", wrt.Conductor(metal="titanium")),
        Tile("brushed-aluminium", "aluminium, alpha 0.4 0.08", wrt.RoughConductor((0.4, 0.08), metal="aluminium")),
        # Rough metals
        Tile("copper-ggx", "copper, ggx, alpha 0.25", wrt.RoughConductor(0.25, metal="copper")),
        Tile(
            "copper-beckmann",
            "copper, beckmann, alpha 0.25",
            wrt.RoughConductor(0.25, metal="copper", distribution="beckmann"),
        ),
        Tile("one-bounce", "gold, alpha 1", wrt.RoughConductor(1.0, metal="gold")),
        Tile(
            "multiple-bounces",
            "the same, multiple_bounces",
            wrt.RoughConductor(1.0, metal="gold", multiple_bounces=True),
        ),
        Tile(
            "metallic",
            "metallic 1, roughness 0.3",
            wrt.Principled(base_color=(0.25, 0.42, 0.75), metallic=1.0, roughness=0.3),
        ),
        # Clear
        Tile("glass", "ior 1.5", wrt.Dielectric(), samples=2),
        Tile("rough-glass", "ior 1.5, alpha 0.1", wrt.RoughDielectric(alpha=0.1), samples=2),
        Tile("thin-glass", "ior 1.5, a bubble", wrt.ThinDielectric(), samples=2),
        Tile("diamond", "diamond", wrt.Dielectric("diamond"), cut=True),
        Tile(
            "frosted",
            "transmission 1, roughness 0.3",
            wrt.Principled(base_color=(0.45, 0.85, 0.8), transmission=1.0, roughness=0.3),
            samples=2,
        ),
        # Filled with something
        Tile(
            "coloured-glass",
            "with a medium inside",
            wrt.Dielectric(interior=wrt.Medium.from_color((0.75, 0.2, 0.05), distance=1.0)),
            samples=2,
        ),
        Tile("cloud", "with a cloud inside", wrt.Null(interior=wrt.Medium.from_albedo(0.98, 2.5, g=0.4)), samples=2),
        Tile(
            "wax",
            "with wax inside, no surface",
            wrt.Null(interior=wrt.Medium.from_subsurface((0.9, 0.75, 0.45), (0.2, 0.12, 0.05))),
            samples=2,
        ),
        Tile(
            "jade",
            "with jade inside, alpha 0.2",
            wrt.RoughDielectric(
                ior=1.6, alpha=0.2, interior=wrt.Medium.from_subsurface((0.35, 0.8, 0.5), (0.06, 0.12, 0.08))
            ),
            samples=2,
        ),
        Tile(
            "milk",
            "with milk inside",
            wrt.Dielectric(1.35, interior=wrt.Medium.from_subsurface((0.95, 0.93, 0.88), (0.08, 0.05, 0.03), g=0.7)),
            samples=2,
        ),
        # Layered and composite
        Tile(
            "burley",
            "metallic 0.6, coat 1",
            wrt.Burley((0.5, 0.02, 0.02), metallic=0.6, roughness=0.5, coat=1.0, coat_gloss=0.9),
        ),
        Tile(
            "velvet",
            "sheen_roughness 0.3",
            wrt.Principled(
                base_color=(0.06, 0.004, 0.015), roughness=1.0, sheen_color=(0.8, 0.25, 0.4), sheen_roughness=0.3
            ),
        ),
        Tile(
            "mix",
            "gold on lacquer, by an image",
            wrt.Mix(wrt.Plastic(0.015), wrt.RoughConductor(0.1, metal="gold"), weight=swirl()),
        ),
        Tile(
            "two-sided",
            "opacity an image",
            wrt.TwoSided(wrt.Diffuse((0.6, 0.32, 0.05)), wrt.Diffuse((0.04, 0.2, 0.5)), opacity=holes()),
        ),
        Tile("emissive", "radiance 1.8 0.8 0.25", wrt.Emissive((1.8, 0.8, 0.25))),
    )


# --- The set ---------------------------------------------------------------------------------------


def cove() -> tuple[wrt.Mesh, wrt.Mesh]:
    """Return the light and the dark squares of a floor that rises into a wall behind the ball."""
    half, front, back, radius, top = 6.0, 8.0, 2.5, 1.5, 6.0
    fine = 8
    step = SQUARE / fine
    bend = 0.5 * np.pi * radius
    s = np.arange(0.0, front + back + bend + top, step)
    x = np.arange(-half, half + SQUARE, SQUARE) - 0.5 * SQUARE  # a square in the middle, not an edge
    angle = np.clip((s - front - back) / radius, 0.0, 0.5 * np.pi)
    z = front - np.minimum(s, front + back) - radius * np.sin(angle)
    y = radius * (1.0 - np.cos(angle)) + np.maximum(s - front - back - bend, 0.0)
    points = np.stack([np.tile(x, len(s)), np.repeat(y, len(x)), np.repeat(z, len(x))], axis=1)
    normals = np.stack([np.zeros_like(s), np.cos(angle), np.sin(angle)], axis=1).repeat(len(x), axis=0)
    row, column = np.meshgrid(np.arange(len(s) - 1) // fine, np.arange(len(x) - 1), indexing="ij")
    dark = ((row + column) % 2 == 1).ravel().repeat(2)
    faces = grid_faces(len(s), len(x))
    return tuple(wrt.Mesh(points, faces[dark == d], normals, name="cove") for d in (False, True))  # type: ignore


def sky() -> wrt.ImageEnvironment:
    """Return a gradient: dark below, dim at the horizon, bright and bluish above."""
    height = np.cos(np.pi * (np.arange(32) + 0.5) / 32.0)[:, None]
    up = np.clip(height, 0.0, 1.0)
    below = np.array([0.06, 0.055, 0.05])
    row = np.where(height < 0.0, below, [0.32, 0.32, 0.33] + up * np.array([0.53, 0.60, 0.70]))
    return wrt.ImageEnvironment(np.repeat(row[:, None], 64, axis=1).astype(np.float32), name="sky")


def stage() -> wrt.Scene:
    """Return the set with its lights and nothing standing in it."""
    camera = wrt.PerspectiveCamera(origin=(0.0, 2.5, 8.0), target=(0.0, 0.96, 0.0), fov_degrees=17.5)
    scene = wrt.Scene(camera=camera, environment=sky())
    scene.settings.max_depth = 32
    light, dark = cove()
    scene.add(light, material=wrt.Diffuse((0.64, 0.61, 0.57)))
    scene.add(dark, material=wrt.Diffuse((0.13, 0.14, 0.16)))
    aim = (0.0, 1.0, 0.0)
    scene.add(facing((-4.0, 5.0, 4.0), aim, 3.2, 3.2), material=wrt.Diffuse(0.0), emission=(7.3, 7.1, 6.7))
    scene.add(facing((4.6, 2.6, 1.6), aim, 0.8, 4.6), material=wrt.Diffuse(0.0), emission=(5.2, 5.4, 5.8))
    return scene


def speck() -> wrt.Mesh:
    """Return a ball out of sight below the floor, for materials that a scene has for the sake of a shared kernel."""
    return ball(4).scaled(1e-3).translated((0.0, -5.0, 0.0))


def make_scene(tile: Tile) -> wrt.Scene:
    """Return the set with a tile's material on what stands in it.

    The materials of the other tiles lie out of sight below the floor: so all scenes have the same features, and with
    them the same kernel.
    """
    scene = stage()
    scene.add(brilliant() if tile.cut else ball(), material=tile.material, name=tile.name)
    for each in tiles():
        if not any(each.material.emission):
            scene.add(speck(), material=each.material, name=each.name)
    return scene


def pictures() -> Tiles:
    """Return each tile's picture, and its material's type and caption."""
    return {
        tile.name: (
            Picture(functools.partial(make_scene, tile), SIZE, SIZE, SPP * tile.samples),
            (tile.material.type_name, tile.caption),
        )
        for tile in tiles()
    }


PICTURES = {"materials": Sheet(pictures, columns=5)}
