"""Render the pictures of docs/cameras.md: one place, seen by every camera.

    python scripts/cameras.py [--spp N] [--scale X] [--only NAME ...] [--out FOLDER] [--device NAME] [--threads N]

Pillars stand around three balls, and strings of lights hang between them, at dusk. All pictures share one kernel.
"""

from __future__ import annotations

import argparse
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
from wrt.formats.parts import merge

DOCS_PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
JPEG_QUALITY = 88

PILLARS = 12
RING = 4.0
"""Radius of the circle of pillars, metres."""
TOP = 3.6
"""Height of the pillars."""


@dataclass(frozen=True)
class Picture:
    """One picture.

    Attributes:
        camera: what sees the place.
        width: pixels.
        height: pixels.
        samples: multiplies the samples per pixel.
    """

    camera: wrt.Camera
    width: int
    height: int
    samples: float = 1.0


EYE = (-1.1, 1.55, 2.6)
LENS: dict[str, Any] = {"aperture_radius": 0.07, "aperture": "polygon", "aperture_blades": 5, "focus_distance": 1.85}
CLOSE: dict[str, Any] = {"origin": (-0.35, 0.62, 2.3), "target": (0.12, 0.95, 0.35), "fov_degrees": 34.0}
LEVEL: dict[str, Any] = {"origin": (0.0, 1.0, 8.2), "fov_degrees": 46.0}

PICTURES: dict[str, Picture] = {
    "camera-bokeh": Picture(wrt.PerspectiveCamera(**CLOSE, **LENS), 720, 405, 2.0),
    "camera-panorama": Picture(wrt.PanoramaCamera(EYE, (EYE[0] + 0.35, EYE[1], EYE[2] - 1.0)), 720, 360),
    "camera-fisheye": Picture(wrt.FisheyeCamera((0.0, 0.25, 1.3), (0.0, 1.1, 0.9), fov_degrees=180.0), 400, 400),
    "camera-orthographic": Picture(wrt.OrthographicCamera((4.6, 6.4, 8.0), (0, 0.9, 0), view_height=10.5), 400, 400),
    "camera-tilted": Picture(wrt.PerspectiveCamera(target=(0.0, 2.95, 0.0), **LEVEL), 320, 400),
    "camera-shifted": Picture(wrt.PerspectiveCamera(target=(0.0, 1.0, 0.0), **LEVEL, shift_y=0.28), 320, 400),
    "camera-moving": Picture(
        wrt.PerspectiveCamera(
            EYE,
            (0.0, 0.9, 0.0),
            fov_degrees=48.0,
            shutter_close=0.125,
            shutter_ramp=0.2,
            motion=wrt.Motion.rotation((0, 1, 0), 24.0, center=(0.0, 0.0, 0.35), times=(0.0, 0.125)),
        ),
        400,
        400,
        1.5,
    ),
}


def sky() -> wrt.ImageEnvironment:
    """Return a dusk: orange at the horizon of -z, deep blue above, dark below."""
    rows, columns = 64, 128
    up = np.cos(np.pi * (np.arange(rows) + 0.5) / rows)[:, None, None]
    ahead = np.cos(2.0 * np.pi * (np.arange(columns) + 0.5) / columns - np.pi)[None, :, None]
    band = np.exp(-(np.clip(up, 0.0, 1.0) / 0.22)) * (0.35 + 0.65 * (0.5 + 0.5 * ahead) ** 2)
    above = np.array([0.035, 0.06, 0.15]) + band * np.array([0.62, 0.30, 0.14])
    return wrt.ImageEnvironment(np.where(up < 0.0, [0.03, 0.03, 0.035], above).astype(np.float32), name="sky")


def pillar_places() -> NDArray[np.float64]:
    """Return (PILLARS, 2) where pillars stand, x and z, none of them straight before or behind the balls."""
    angle = 2.0 * np.pi * (np.arange(PILLARS) + 0.5) / PILLARS
    return RING * np.stack([np.sin(angle), np.cos(angle)], axis=1)


def pillars() -> wrt.Mesh:
    """Return pillars with a base and a capital, turned to the middle."""
    parts = []
    for x, z in pillar_places():
        for half, low, high in ((0.24, 0.0, 0.22), (0.16, 0.22, TOP - 0.18), (0.24, TOP - 0.18, TOP)):
            body = wrt.box((-half, low, -half), (half, high, half))
            parts.append(body.rotated((0, 1, 0), float(np.degrees(np.arctan2(x, z)))).translated((x, 0.0, z)))
    return merge(parts, "pillars")


def lamps(first: int) -> wrt.Mesh:
    """Return every third of the little lights that hang in bows from pillar to pillar, and in one across."""
    bead = wrt.sphere((0, 0, 0), 0.028, subdivisions=1)
    places = pillar_places()
    strings = [(places[k], places[(k + 1) % PILLARS], 1.0) for k in range(PILLARS)]
    strings += [(places[k], places[k + PILLARS // 2], 1.2) for k in (1, 4)]
    points = []
    for start, end, sag in strings:
        count = max(6, int(np.linalg.norm(end - start) / 0.33))
        for share in (np.arange(count) + 0.5) / count:
            x, z = start + share * (end - start)
            points.append((x, TOP - 0.3 - 4.0 * sag * share * (1.0 - share), z))
    return merge([bead.translated(point) for point in points[first::3]], "lamps")


def floor() -> tuple[wrt.Mesh, wrt.Mesh]:
    """Return the light and the dark flags of the floor, half a metre wide."""
    side, half = 0.5, 12
    parts: tuple[list[wrt.Mesh], list[wrt.Mesh]] = ([], [])
    for i in range(-half, half):
        for j in range(-half, half):
            parts[(i + j) % 2].append(wrt.quad((i * side, 0, (j + 1) * side), (side, 0, 0), (0, 0, -side)))
    return merge(parts[0], "light flags"), merge(parts[1], "dark flags")


def make_scene(camera: wrt.Camera) -> wrt.Scene:
    """Return the place as a camera sees it."""
    scene = wrt.Scene(camera=camera, environment=sky())
    scene.settings.max_depth = 12
    light, dark = floor()
    scene.add(light, material=wrt.Diffuse((0.5, 0.46, 0.42)))
    scene.add(dark, material=wrt.RoughPlastic((0.05, 0.055, 0.06), alpha=0.15))
    ground = wrt.quad((-40, -0.01, 40), (80, 0, 0), (0, 0, -80))
    scene.add(ground, material=wrt.Diffuse((0.09, 0.1, 0.07)), name="ground")
    scene.add(pillars(), material=wrt.Diffuse((0.62, 0.56, 0.48)))
    for first, color in enumerate(((24.0, 13.0, 5.0), (24.0, 17.0, 10.0), (20.0, 8.0, 3.0))):
        scene.add(lamps(first), material=wrt.Diffuse(0.0), emission=color)
    plinth = wrt.box((-0.9, 0.0, -0.1), (0.9, 0.35, 0.8))
    scene.add(plinth, material=wrt.Diffuse((0.4, 0.38, 0.36)), name="plinth")
    for x, z, material in (
        (-0.55, 0.25, wrt.RoughConductor(0.12, metal="gold")),
        (0.05, 0.45, wrt.Dielectric()),
        (0.6, 0.15, wrt.RoughPlastic((0.45, 0.03, 0.02), alpha=0.05)),
    ):
        scene.add(wrt.sphere((x, 0.6, z), 0.25), material=material, name="ball")
    return scene


def render(picture: Picture, options: argparse.Namespace) -> NDArray[np.float32]:
    """Return a picture, linear."""
    return wrt.render(
        make_scene(picture.camera),
        width=round(picture.width * options.scale),
        height=round(picture.height * options.scale),
        spp=max(1, round(options.spp * picture.samples)),
        device=options.device,
        threads=options.threads,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    from PIL import Image

    parser = argparse.ArgumentParser(description="Render the pictures of docs/cameras.md.")
    parser.add_argument("--spp", type=int, default=128, help="samples per pixel (default %(default)s)")
    parser.add_argument("--scale", type=float, default=1.0, help="multiplies width and height (default %(default)s)")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=list(PICTURES), help="these pictures")
    parser.add_argument("--out", type=Path, default=DOCS_PICTURES, metavar="FOLDER", help="where the pictures go")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N")
    parser.add_argument("--threads", type=int, help="CPU threads; by default all cores")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.only or PICTURES:
        started = time.perf_counter()
        path = options.out / f"{name}.jpg"
        try:
            image = quantize(1.6 * render(PICTURES[name], options))
        except wrt.InputError as error:
            print(f"cameras: error: {error}", file=sys.stderr)
            return 2
        Image.fromarray(image).save(path, quality=JPEG_QUALITY, optimize=True)
        print(f"{path}: {path.stat().st_size / 1e3:,.0f} kB, {time.perf_counter() - started:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
