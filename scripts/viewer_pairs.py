#!/usr/bin/env python3
"""Lay pictures that wrt makes of files beside those that another program made, for looking at.

Each pair is a file, a picture of it, and the view from which that was taken: AZIMUTH,ELEVATION in degrees. Samples of
glTF have such pictures of a browser's viewer beside them. Nothing but the view is set, and nothing is fetched.

    scripts/viewer_pairs.py pairs.png Mixer.glb:rr-Mixer-0.png:35,15 BoomBox.glb:screenshot.jpg:150,20

Under each pair stand the means of both pictures over what wrt says the object covers: lightness of CIELAB and chroma.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

import wrt
from wrt.develop.picture import develop_image
from wrt.scene.srgb import linear_from_srgb

LINE = 14
"""Height of the text under a pair, in pixels."""


def rendered(scene: wrt.Scene, size: int, spp: int) -> tuple[NDArray[np.uint8], wrt.Renderer]:
    """Return a square picture as `wrt render` develops it, and its Renderer."""
    renderer = wrt.Renderer(scene, width=size, height=size)
    for _ in renderer.passes(spp=spp):
        pass
    return develop_image(renderer.image(), exposure="auto"), renderer


def lightness_and_chroma(picture: NDArray[np.uint8], where: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the means over some pixels in CIELAB (CIE 15:2004), of the white of sRGB."""
    xyz = linear_from_srgb(picture[where] / 255.0) @ np.array(
        [[0.4124, 0.2126, 0.0193], [0.3576, 0.7152, 0.1192], [0.1805, 0.0722, 0.9505]]
    )
    ratio = xyz / (0.9505, 1.0, 1.089)
    f = np.where(ratio > 216 / 24389, np.cbrt(ratio), (24389 / 27 * ratio + 16) / 116)
    a, b = 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])
    return float((116 * f[:, 1] - 16).mean()), float(np.hypot(a, b).mean())


def squared(path: Path, size: int) -> NDArray[np.uint8]:
    """Return the middle square of a picture at a size; what is transparent becomes white."""
    with Image.open(path) as opened:
        picture = opened.convert("RGBA")
    side = min(picture.size)
    left, top = (picture.width - side) // 2, (picture.height - side) // 2
    picture = picture.crop((left, top, left + side, top + side)).resize((size, size), Image.Resampling.LANCZOS)
    white = Image.new("RGBA", picture.size, (255, 255, 255, 255))
    return np.asarray(Image.alpha_composite(white, picture).convert("RGB"))


def pair(text: str, size: int, spp: int) -> tuple[Any, str]:
    """Return the two pictures as one, and what is written under them."""
    file, reference, *view = text.split(":")
    options: dict[str, Any] = {"view": view[0]} if view else {}
    ours, _ = rendered(wrt.load(file, aspect=1.0, **options), size, spp)
    _, alone = rendered(wrt.load(file, aspect=1.0, transparent=True, **options), size, 4)
    theirs = squared(Path(reference), size)
    # Both show the object in the middle; where framing differs a little, the means of its middle do not.
    alpha = alone.alpha()
    covered = np.zeros((size, size), bool) if alpha is None else alpha > 0.99
    notes = [
        f"L {light:.0f} C {chroma:.0f}" for light, chroma in (lightness_and_chroma(p, covered) for p in (ours, theirs))
    ]
    both = Image.new("RGB", (2 * size, size + LINE), (255, 255, 255))
    both.paste(Image.fromarray(ours), (0, 0))
    both.paste(Image.fromarray(theirs), (size, 0))
    caption = f"{Path(file).stem}: {notes[0]}; the other: {notes[1]}"
    ImageDraw.Draw(both).text((2, size), caption, fill=(0, 0, 0))
    return both, caption


def laid_out(pairs: Sequence[Any]) -> Any:
    """Return pictures of one size as one picture, two in a row."""
    width, height = pairs[0].size
    columns = min(2, len(pairs))
    whole = Image.new("RGB", (columns * width, -(-len(pairs) // columns) * height), (255, 255, 255))
    for k, each in enumerate(pairs):
        whole.paste(each, (k % columns * width, k // columns * height))
    return whole


def parse_arguments(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path, help="the picture of all pairs")
    parser.add_argument("pairs", nargs="+", metavar="FILE:PICTURE[:AZIMUTH,ELEVATION]")
    parser.add_argument("--size", type=int, default=256, help="pixels of a side; default: 256")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel; default: 64")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Render, write the picture of all pairs, and print what is written under each."""
    options = parse_arguments(arguments)
    made = []
    for text in options.pairs:
        both, caption = pair(text, options.size, options.spp)
        print(caption, flush=True)
        made.append(both)
        laid_out(made).save(options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
