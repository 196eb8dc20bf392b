"""Render one picture of each material and lay them out as docs/pictures/materials.jpg.

    python scripts/gallery.py [--spp N] [--size PIXELS] [--out FOLDER] [--device NAME] [--threads N]
    python scripts/gallery.py --only NAME ...     these alone, as NAME.png

A ball stands in a checkered cove, under a soft box on the left and a strip light on the right. All tiles share one
kernel, which is compiled once.
"""

from __future__ import annotations

import argparse
import functools
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt
from wrt.formats.images import quantize

Array = NDArray[np.float64]

DOCS_PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
COLUMNS = 5
GAP = 12
LABEL_HEIGHT = 48
BACKGROUND = (30, 31, 33)
JPEG_QUALITY = 90

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


@dataclass(frozen=True)
class Tile:
    """One picture of the sheet.

    Attributes:
        name: for `--only`.
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
        Tile(
            "brushed-aluminium",
            "aluminium, alpha 0.4 0.08",
            wrt.RoughConductor((0.4, 0.08), metal="aluminium"),
        ),
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
        Tile("glass", "ior 1.5", wrt.Dielectric(), samples=3),
        Tile("rough-glass", "ior 1.5, alpha 0.1", wrt.RoughDielectric(alpha=0.1), samples=3),
        Tile("thin-glass", "ior 1.5, a bubble", wrt.ThinDielectric(), samples=3),
        Tile("diamond", "diamond", wrt.Dielectric("diamond"), cut=True),
        Tile(
            "frosted",
            "transmission 1, roughness 0.3",
            wrt.Principled(base_color=(0.45, 0.85, 0.8), transmission=1.0, roughness=0.3),
            samples=3,
        ),
        # Filled with something
        Tile(
            "coloured-glass",
            "with a medium inside",
            wrt.Dielectric(interior=wrt.Medium.from_color((0.75, 0.2, 0.05), distance=1.0)),
            samples=3,
        ),
        Tile("cloud", "with a cloud inside", wrt.Null(interior=wrt.Medium.from_albedo(0.98, 2.5, g=0.4)), samples=3),
        Tile(
            "wax",
            "with wax inside, no surface",
            wrt.Null(interior=wrt.Medium.from_subsurface((0.9, 0.75, 0.45), (0.2, 0.12, 0.05))),
            samples=3,
        ),
        Tile(
            "jade",
            "with jade inside, alpha 0.2",
            wrt.RoughDielectric(
                ior=1.6, alpha=0.2, interior=wrt.Medium.from_subsurface((0.35, 0.8, 0.5), (0.06, 0.12, 0.08))
            ),
            samples=3,
        ),
        Tile(
            "milk",
            "with milk inside",
            wrt.Dielectric(1.35, interior=wrt.Medium.from_subsurface((0.95, 0.93, 0.88), (0.08, 0.05, 0.03), g=0.7)),
            samples=3,
        ),
        # Layered and composite
        Tile(
            "car-paint",
            "metallic 0.6, coat 1",
            wrt.Principled(base_color=(0.5, 0.02, 0.02), metallic=0.6, roughness=0.5, coat=1.0),
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
            "gold and lacquer, weight an image",
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


def ball(rows: int = 80) -> wrt.Mesh:
    """Return a sphere of radius 1 on the floor, with texture coordinates: u around the y axis, v up it."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 2 * rows + 1), np.linspace(0.0, 1.0, rows + 1))
    azimuth, polar = 2.0 * np.pi * u, np.pi * (1.0 - v)
    normals = np.stack([np.sin(polar) * np.sin(azimuth), np.cos(polar), np.sin(polar) * np.cos(azimuth)], axis=2)
    faces = grid_faces(*u.shape).reshape(rows, 2 * rows, 2, 3)
    # At the poles one of each two triangles has no area.
    kept = np.concatenate([faces[0, :, 1], faces[-1, :, 0], faces[1:-1].reshape(-1, 3)])
    points = normals.reshape(-1, 3)
    return wrt.Mesh(points + [0.0, 1.0, 0.0], kept, points, np.stack([u, v], axis=2).reshape(-1, 2), name="ball")


def grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Return faces of a grid of points, two a cell; counter-clockwise where columns run right and rows up."""
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (x.ravel() for x in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    return np.stack([np.stack([a, b, d], axis=1), np.stack([b, c, d], axis=1)], axis=1).reshape(-1, 3)


def brilliant(radius: float = 1.15) -> wrt.Mesh:
    """Return a round brilliant that lies on one of the facets beneath its girdle, table towards +z.

    Crown at 34.5 degrees, culet 0.86 radii deep, table 0.53 wide; sixteen facets below instead of twenty-four.
    """
    crown = np.tan(np.radians(34.5))
    turn = 2.0 * np.pi / 16.0

    def ring(count: int, r: float, height: float, first: float) -> Array:
        angle = 2.0 * turn * (np.arange(count) * 8.0 / count + first)
        return np.stack([r * np.sin(angle), np.full(count, height), r * np.cos(angle)], axis=1)

    # The middle ring lies in the planes of the kites between table and girdle.
    middle = ring(8, 0.76, (1.0 - 0.76 * np.cos(turn)) * crown, 0.5)
    points = np.concatenate([ring(8, 0.53, 0.47 * crown, 0.0), middle, ring(16, 1.0, 0.0, 0.0), [[0.0, -0.86, 0.0]]])
    faces = [[0, i, i + 1] for i in range(1, 7)]
    for i in range(8):
        table, after, mid, before = i, (i + 1) % 8, 8 + i, 8 + (i - 1) % 8
        corner, half, far = (16 + (2 * i + k) % 16 for k in range(3))
        faces += [[table, mid, after], [table, before, corner], [table, corner, mid]]
        faces += [[mid, corner, half], [mid, half, far], [32, half, corner], [32, far, half]]
    slope = np.degrees(np.arctan2(0.86, np.cos(0.5 * turn)))
    stone = wrt.Mesh(radius * points, np.array(faces), name="brilliant")
    stone = stone.rotated((0, 1, 0), -np.degrees(0.5 * turn)).rotated((1, 0, 0), slope).rotated((0, 1, 0), -24.0)
    low, high = stone.bounds
    middle = 0.5 * (low + high)
    return stone.translated((-middle[0], -low[1], -middle[2] - 0.3))


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


def facing(center: Sequence[float], target: Sequence[float], width: float, height: float) -> wrt.Mesh:
    """Return an upright rectangle whose front faces a point."""
    toward = np.subtract(target, center)
    across = np.cross([0.0, 1.0, 0.0], toward)
    across *= width / np.linalg.norm(across)
    upward = np.cross(toward, across)
    upward *= height / np.linalg.norm(upward)
    return wrt.quad(tuple(center - 0.5 * across - 0.5 * upward), tuple(across), tuple(upward))


def make_scene(tile: Tile) -> wrt.Scene:
    """Return the set with a tile's material on what stands in it.

    The materials of the other tiles lie out of sight below the floor: so all scenes have the same features, and with
    them the same kernel.
    """
    camera = wrt.PerspectiveCamera(origin=(0.0, 2.5, 8.0), target=(0.0, 0.96, 0.0), fov_degrees=17.5)
    scene = wrt.Scene(camera=camera, environment=sky())
    scene.settings.max_depth = 32
    light, dark = cove()
    scene.add(light, material=wrt.Diffuse((0.64, 0.61, 0.57)))
    scene.add(dark, material=wrt.Diffuse((0.13, 0.14, 0.16)))
    aim = (0.0, 1.0, 0.0)
    scene.add(facing((-4.0, 5.0, 4.0), aim, 3.2, 3.2), material=wrt.Diffuse(0.0), emission=(7.3, 7.1, 6.7))
    scene.add(facing((4.6, 2.6, 1.6), aim, 0.8, 4.6), material=wrt.Diffuse(0.0), emission=(5.2, 5.4, 5.8))
    scene.add(brilliant() if tile.cut else ball(), material=tile.material, name=tile.name)
    speck = ball(4).scaled(1e-3).translated((0.0, -5.0, 0.0))
    for other in tiles():
        if not any(other.material.emission):
            scene.add(speck, material=other.material, name=other.name)
    return scene


# --- The sheet -------------------------------------------------------------------------------------


def contact_sheet(pictures: dict[str, NDArray[np.uint8]]) -> Any:
    """Return a Pillow image of all tiles in rows of COLUMNS, each above its type and its caption."""
    from PIL import Image, ImageDraw, ImageFont

    size = len(next(iter(pictures.values())))
    shown = tiles()
    rows = -(-len(shown) // COLUMNS)
    sheet = Image.new("RGB", (GAP + COLUMNS * (size + GAP), GAP + rows * (size + LABEL_HEIGHT + GAP)), BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    large, small = ImageFont.load_default(size=18), ImageFont.load_default(size=15)
    for place, tile in enumerate(shown):
        x = GAP + place % COLUMNS * (size + GAP)
        y = GAP + place // COLUMNS * (size + LABEL_HEIGHT + GAP)
        sheet.paste(Image.fromarray(pictures[tile.name]), (x, y))
        draw.text((x + 2, y + size + 4), tile.material.type_name, font=large, fill=(240, 240, 240))
        draw.text((x + 2, y + size + 26), tile.caption, font=small, fill=(165, 168, 172))
    return sheet


def render(tile: Tile, options: argparse.Namespace) -> NDArray[np.float32]:
    """Return a tile's picture, linear."""
    started = time.perf_counter()
    scene = make_scene(tile)
    image = wrt.render(
        scene,
        width=options.size,
        height=options.size,
        spp=options.spp * tile.samples,
        device=options.device,
        threads=options.threads,
    )
    print(f"{tile.name}: {time.perf_counter() - started:.1f} s", flush=True)
    return image


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Render the gallery of materials.")
    parser.add_argument("--spp", type=int, default=128, help="samples per pixel (default %(default)s)")
    parser.add_argument("--size", type=int, default=304, help="width and height of a tile (default %(default)s)")
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", choices=[tile.name for tile in tiles()], help="these tiles"
    )
    parser.add_argument("--out", type=Path, default=DOCS_PICTURES, metavar="FOLDER", help="where the pictures go")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N")
    parser.add_argument("--threads", type=int, help="CPU threads; by default all cores")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    try:
        if options.only:
            for tile in tiles():
                if tile.name in options.only:
                    wrt.save_image(options.out / f"{tile.name}.png", render(tile, options))
            return 0
        sheet = contact_sheet({tile.name: quantize(render(tile, options)) for tile in tiles()})
    except wrt.InputError as error:
        print(f"gallery: error: {error}", file=sys.stderr)
        return 2
    path = options.out / "materials.jpg"
    sheet.save(path, quality=JPEG_QUALITY, subsampling=0, optimize=True)
    print(f"{path}: {path.stat().st_size / 1e3:,.0f} kB, {time.perf_counter() - started:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
