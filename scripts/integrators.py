"""Render the pictures of docs/integrators.md: one scene as each integrator shows it, and its layers.

    python scripts/integrators.py [--spp N] [--width N] [--only NAME ...] [--out FOLDER] [--device NAME] [--threads N]

Balls of glass and mirror float over a checkered floor, as in the picture by which ray trees became known.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt
from wrt.formats.images import quantize
from wrt.formats.parts import merge
from wrt.layer_pictures import picture_of
from wrt.layers import LAYERS

DOCS_PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
JPEG_QUALITY = 88

PICTURES: dict[str, dict[str, Any]] = {
    "integrator-whitted": {"integrator": "whitted", "max_depth": 12, "spp": 0.5},
    "integrator-path": {"integrator": "path", "max_depth": 32},
    "integrator-direct": {"integrator": "direct"},
    "integrator-ao": {"integrator": "ao", "ao_distance": 2.0, "spp": 2.0},
}
"""By name what the renderer is told; `spp` multiplies the samples."""

LAYER_SHEET = "layers"
COLUMNS = 5
GAP = 8
LABEL = 24


def sky() -> wrt.ImageEnvironment:
    """Return a blue that is paler towards the horizon, and a dim ground."""
    height = np.cos(np.pi * (np.arange(64) + 0.5) / 64.0)[:, None]
    up = np.clip(height, 0.0, 1.0) ** 0.6
    row = np.where(height < 0.0, [0.12, 0.1, 0.08], [0.62, 0.72, 0.85] - up * np.array([0.5, 0.45, 0.25]))
    return wrt.ImageEnvironment(np.repeat(row[:, None], 128, axis=1).astype(np.float32), name="sky")


def floor() -> tuple[wrt.Mesh, wrt.Mesh]:
    """Return the squares of the one and of the other colour, half a metre wide."""
    parts: tuple[list[wrt.Mesh], list[wrt.Mesh]] = ([], [])
    for i in range(-9, 8):
        for j in range(-14, 6):
            parts[(i + j) % 2].append(wrt.quad((0.5 * i, 0.0, 0.5 * j + 0.5), (0.5, 0.0, 0.0), (0.0, 0.0, -0.5)))
    return merge(parts[0], "light squares"), merge(parts[1], "dark squares")


def make_scene(*, moving: bool = False) -> wrt.Scene:
    """Return the scene, in which one ball may roll to the right while the shutter is open."""
    camera = wrt.PerspectiveCamera(
        (0.3, 1.25, 4.4), (0.0, 0.78, 0.0), fov_degrees=38.0, shutter_close=1.0 if moving else 0.0
    )
    scene = wrt.Scene(camera=camera, environment=sky())
    light, dark = floor()
    scene.add(light, material=wrt.Diffuse((0.75, 0.62, 0.12)), name="light squares")
    scene.add(dark, material=wrt.Diffuse((0.5, 0.06, 0.05)), name="dark squares")
    scene.add(wrt.sphere((-0.35, 1.05, 0.9), 0.55, subdivisions=5), material=wrt.Dielectric(ior=1.45), name="glass")
    scene.add(wrt.sphere((0.7, 0.72, -0.3), 0.6, subdivisions=5), material=wrt.Mirror(0.85), name="mirror")
    blue = wrt.Diffuse((0.2, 0.35, 0.5))
    scene.add(wrt.box((-1.75, 0.0, -1.6), (-1.0, 1.5, -0.85)), material=blue, name="block")
    scene.add(wrt.sphere((-1.25, 0.22, 1.1), 0.22, subdivisions=5), material=blue, name="blue ball")
    ball = wrt.sphere((1.35, 0.28, 1.0), 0.28, subdivisions=5)
    rolls = wrt.Motion.translation((0.1, 0.0, 0.0)) if moving else None
    scene.shapes.append(wrt.Shape(ball, wrt.Plastic((0.05, 0.3, 0.08)), name="ball", transform=rolls))
    scene.add_light(wrt.PointLight((-2.5, 5.0, 3.5), intensity=62.0))
    return scene


def render(name: str, options: argparse.Namespace) -> NDArray[np.float32]:
    """Return one picture, linear."""
    given = dict(PICTURES[name])
    spp = max(1, round(options.spp * given.pop("spp", 1.0)))
    renderer = make_renderer(make_scene(), options, **given)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer.image()


def make_renderer(scene: wrt.Scene, options: argparse.Namespace, **given: Any) -> wrt.Renderer:
    """Return a renderer of the size asked for."""
    size = {"width": options.width, "height": round(options.width * 0.6)}
    return wrt.Renderer(scene, **size, device=options.device, threads=options.threads, **given)


def layer_sheet(options: argparse.Namespace) -> Any:
    """Return a Pillow image of all layers in rows, each under its name."""
    from PIL import Image, ImageDraw, ImageFont

    tile = argparse.Namespace(**{**vars(options), "width": options.width * 2 // 3})
    renderer = make_renderer(make_scene(moving=True), tile, integrator="aov", layers=tuple(LAYERS))
    for _ in renderer.passes(spp=max(1, options.spp // 4)):
        pass
    layers = renderer.layers()
    height, width = renderer.height, renderer.width
    rows = -(-len(layers) // COLUMNS)
    sheet = Image.new("RGB", (GAP + COLUMNS * (width + GAP), GAP + rows * (height + LABEL + GAP)), (30, 31, 33))
    draw = ImageDraw.Draw(sheet)
    for place, (name, values) in enumerate(layers.items()):
        x = GAP + place % COLUMNS * (width + GAP)
        y = GAP + place // COLUMNS * (height + LABEL + GAP)
        draw.text((x + 2, y + 2), name, font=ImageFont.load_default(size=16), fill=(240, 240, 240))
        sheet.paste(Image.fromarray(quantize(picture_of(name, values))), (x, y + LABEL))
    return sheet


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    from PIL import Image

    names = [*PICTURES, LAYER_SHEET]
    parser = argparse.ArgumentParser(description="Render the pictures of docs/integrators.md.")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel (default %(default)s)")
    parser.add_argument("--width", type=int, default=480, help="pixels (default %(default)s)")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=names, help="these pictures")
    parser.add_argument("--out", type=Path, default=DOCS_PICTURES, metavar="FOLDER", help="where the pictures go")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N")
    parser.add_argument("--threads", type=int, help="CPU threads; by default all cores")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.only or names:
        started = time.perf_counter()
        try:
            picture = layer_sheet(options) if name == LAYER_SHEET else Image.fromarray(quantize(render(name, options)))
        except wrt.InputError as error:
            print(f"integrators: error: {error}", file=sys.stderr)
            return 2
        path = options.out / f"{name}.jpg"
        picture.save(path, quality=JPEG_QUALITY, optimize=True)
        print(f"{path}: {path.stat().st_size / 1e3:,.0f} kB, {time.perf_counter() - started:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
