"""Render the pictures of docs/media.md: what is inside of things, and around them.

python scripts/media_pictures.py [--spp N] [--width PIXELS] [--only NAME ...] [--out FOLDER] [--device NAME]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import wrt
from wrt.formats.images import quantize
from wrt.normals import with_normals

DOCS_PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
SEGMENTS = 128
"""Facets around what is turned on a lathe."""

JPEG_QUALITY = 90


def turned(profile: Sequence[tuple[float, float]], crease_degrees: float = 40.0) -> wrt.Mesh:
    """Return the body of revolution about the y axis of a closed profile (radius, height), counter-clockwise.

    Going along the profile, what is inside lies on the left.
    """
    points = np.asarray(profile, np.float64)
    angle = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    r, y = points[:, 0][:, None], np.repeat(points[:, 1][:, None], SEGMENTS, axis=1)
    vertices = np.stack([r * np.sin(angle), y, r * np.cos(angle)], axis=2).reshape(-1, 3)
    i, k = np.meshgrid(np.arange(len(points)), np.arange(SEGMENTS), indexing="ij")
    a, b = i * SEGMENTS + k, i * SEGMENTS + (k + 1) % SEGMENTS
    c, d = (x + SEGMENTS for x in (a, b))
    rows = slice(0, len(points) - 1)
    faces = np.concatenate([np.stack(t, axis=2)[rows].reshape(-1, 3) for t in ((a, b, d), (a, d, c))])
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return with_normals(wrt.Mesh(vertices, faces[areas > 1e-12]), crease_degrees)


def room(camera: wrt.PerspectiveCamera, table: tuple[float, float, float] = (0.5, 0.42, 0.34)) -> wrt.Scene:
    """Return a table before a wall of light grey, a soft lamp on the left and a dim sky."""
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment((0.25, 0.28, 0.32)))
    scene.add(wrt.quad((-2, 0, 1.5), (4, 0, 0), (0, 0, -2.5)), material=wrt.Diffuse(table), name="table")
    scene.add(wrt.quad((-2, 0, -1.0), (4, 0, 0), (0, 2.5, 0)), material=wrt.Diffuse(0.6), name="wall")
    lamp = wrt.quad((-0.9, 0.5, 0.8), (0.0, 0.9, 0.0), (-0.45, 0.0, -0.9))
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=(9.0, 8.6, 8.0), two_sided_emission=True, name="lamp")
    return scene


def water_and_ice() -> wrt.Scene:
    """A glass of water with ice, the water reaching half a millimetre into the glass."""
    scene = room(wrt.PerspectiveCamera((0.0, 0.22, 0.62), (0.0, 0.062, 0.0), fov_degrees=18.0))
    glass = wrt.Dielectric("glass", interior=wrt.Medium.from_color((0.8, 0.95, 0.9), 0.05), priority=3)
    inner, outer, bottom, top = 0.034, 0.037, 0.012, 0.13
    wall = [(0.0, 0.0005), (outer - 0.002, 0.0005), (outer, 0.0025), (outer, top - 0.001), (outer - 0.001, top)]
    hollow = [
        (inner + 0.001, top),
        (inner, top - 0.001),
        (inner, bottom + 0.004),
        (inner - 0.004, bottom),
        (0.0, bottom),
    ]
    scene.add(turned([*wall, *hollow]), material=glass, name="glass")
    water = wrt.Dielectric("water", interior=wrt.Medium.from_color((0.55, 0.85, 0.95), 0.2), priority=1)
    level, over = 0.1, 0.0005
    body = [
        (0.0, bottom - over),
        (inner - 0.004, bottom - over),
        (inner + over, bottom + 0.004),
        (inner + over, level),
        (0.0, level),
    ]
    scene.add(turned(body), material=water, name="water")
    ice = wrt.Dielectric(1.31, priority=2)
    for center, turn, degrees in (
        ((-0.011, 0.096, 0.006), (0.3, 1.0, 0.2), 35.0),
        ((0.013, 0.092, -0.007), (1.0, 0.6, 0.4), 50.0),
        ((0.004, 0.07, 0.012), (0.2, 0.5, 1.0), 20.0),
    ):
        cube = wrt.box((-0.0095,) * 3, (0.0095,) * 3).rotated(turn, degrees).translated(center)
        scene.add(cube, material=ice, name="ice")
    return scene


def coloured_glass() -> wrt.Scene:
    """Blocks of one glass, two, four and eight centimetres thick."""
    scene = room(wrt.PerspectiveCamera((0.1, 0.35, 0.75), (0.0, 0.045, 0.0), fov_degrees=24.0), (0.75, 0.74, 0.72))
    amber = wrt.Dielectric("glass", interior=wrt.Medium.from_color((0.85, 0.45, 0.08), 0.05))
    x = -0.155
    for thickness in (0.02, 0.04, 0.08):
        block = wrt.box((x, 0.0005, -0.5 * thickness), (x + 0.08, 0.1, 0.5 * thickness))
        scene.add(block, material=amber)
        x += 0.11
    return scene


def fog() -> wrt.Scene:
    """A spot in a foggy room, and three pillars that throw their shadows through the air."""
    camera = wrt.PerspectiveCamera((0.0, 1.1, 4.2), (0.0, 0.9, 0.0), fov_degrees=36.0)
    scene = wrt.Scene(camera=camera, medium=wrt.Medium.from_albedo((0.92, 0.94, 0.96), 0.22, g=0.4))
    scene.add(wrt.quad((-4, 0, 4.5), (8, 0, 0), (0, 0, -7)), material=wrt.Diffuse(0.35))
    scene.add(wrt.quad((-4, 0, -2.5), (8, 0, 0), (0, 5, 0)), material=wrt.Diffuse((0.3, 0.33, 0.4)))
    way = (2.8, -2.6, 2.2)
    spot = wrt.SpotLight(
        (-2.2, 2.9, -1.6), way, intensity=(190.0, 170.0, 140.0), inner_degrees=19.0, outer_degrees=24.0
    )
    scene.add_light(spot)
    for x in (-0.7, 0.0, 0.7):
        scene.add(wrt.box((x - 0.09, 0.0, -0.3), (x + 0.09, 1.5, -0.12)), material=wrt.Diffuse(0.6))
    scene.environment = None
    return scene


def wax() -> wrt.Scene:
    """A candle of wax and a chessman of marble, lit from behind, each of a medium below a rough surface or none."""
    scene = room(wrt.PerspectiveCamera((0.0, 0.16, 0.55), (0.0, 0.055, 0.0), fov_degrees=20.0))
    candle = wrt.Null(interior=wrt.Medium.from_subsurface((0.93, 0.72, 0.42), (0.012, 0.006, 0.003)))
    body = [(0.0, 0.0005), (0.028, 0.0005), (0.03, 0.003), (0.03, 0.1), (0.027, 0.106), (0.012, 0.1), (0.0, 0.098)]
    scene.add(turned(body, 60.0).translated((-0.05, 0, 0)), material=candle, name="candle")
    scene.add_light(wrt.SphereLight((-0.05, 0.118, 0.0), 0.006, radiance=(260.0, 150.0, 60.0)))
    marble = wrt.RoughDielectric(
        1.45, alpha=0.15, interior=wrt.Medium.from_subsurface((0.9, 0.88, 0.84), (0.004, 0.0035, 0.003))
    )
    pawn = [(0.0, 0.0005), (0.026, 0.0005), (0.027, 0.006), (0.02, 0.014), (0.012, 0.022), (0.009, 0.045)]
    pawn += [(0.015, 0.05), (0.009, 0.054)]
    angle = np.radians(np.linspace(-50.0, 90.0, 15))
    pawn += [(0.016 * np.cos(a) * (a < 1.57), 0.067 + 0.016 * np.sin(a)) for a in angle]
    scene.add(turned(pawn, 60.0).translated((0.045, 0, 0.01)), material=marble, name="pawn")
    return scene


SCENES: dict[str, tuple[Callable[[], wrt.Scene], float]] = {
    "water-and-ice": (water_and_ice, 4.0),
    "coloured-glass": (coloured_glass, 2.0),
    "fog": (fog, 1.0),
    "wax": (wax, 1.0),
}
"""What is rendered, and how many times the samples."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Render the pictures of media.")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel (default %(default)s)")
    parser.add_argument("--width", type=int, default=480, help="pixels (default %(default)s)")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=list(SCENES), help="these alone")
    parser.add_argument("--out", type=Path, default=DOCS_PICTURES, metavar="FOLDER", help="where the pictures go")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N")
    options = parser.parse_args(arguments)
    from PIL import Image

    for name in options.only or SCENES:
        build, samples = SCENES[name]
        started = time.perf_counter()
        image = wrt.render(
            build(),
            width=options.width,
            height=options.width * 3 // 4,
            spp=int(options.spp * samples),
            device=options.device,
        )
        Image.fromarray(quantize(image)).save(options.out / f"media-{name}.jpg", quality=JPEG_QUALITY)
        print(f"{name}: {time.perf_counter() - started:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
