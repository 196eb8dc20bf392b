"""What a picture of the documentation is: a scene, how it is rendered, and sheets of several of them."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import wrt
from wrt.develop.exposure import stops
from wrt.develop.picture import develop_image

Pixels = NDArray[np.uint8]

GAP = 10
"""Pixels between the pictures of a sheet, which are those of its rim too."""

BACKGROUND = (30, 31, 33)
LARGE, SMALL = (16, (240, 240, 240)), (13, (165, 168, 172))
"""Height and colour of the first line below a picture, and of the second."""


@dataclass(frozen=True)
class How:
    """What the command line asks for.

    Attributes:
        spp: samples per pixel, in place of each picture's own.
        size: width in pixels (of a tile, in a sheet), in place of each picture's own; heights follow.
        device: cpu, cuda or cuda:N.
        threads: of the CPU; by default all cores.
    """

    spp: int | None = None
    size: int | None = None
    device: str = "cpu"
    threads: int | None = None


class Drawing(Protocol):
    """What makes one file: a `Picture`, or a sheet of several."""

    @property
    def about(self) -> str:
        """Size and samples, in words."""

    def draw(self, name: str, how: How) -> Any:
        """Return a Pillow image; `name` is what progress is reported by."""


@dataclass(frozen=True)
class Picture:
    """One rendered picture.

    Attributes:
        make: returns the scene; its `settings.exposure` counts.
        width: pixels.
        height: pixels.
        spp: samples per pixel, as many as its noise wants.
        given: what else `wrt.Renderer` is told.
    """

    make: Callable[[], wrt.Scene]
    width: int = 480
    height: int = 270
    spp: int = 128
    given: Mapping[str, Any] = field(default_factory=dict)

    @property
    def about(self) -> str:
        """Size and samples, in words."""
        return f"{self.width} x {self.height}, {self.spp} spp"

    def rendered(self, name: str, how: How) -> wrt.Renderer:
        """Return a renderer that has all samples, and print what they cost."""
        started = time.perf_counter()
        width = how.size or self.width
        size = {"width": width, "height": max(1, round(width * self.height / self.width))}
        renderer = wrt.Renderer(self.make(), **size, device=how.device, threads=how.threads, **self.given)
        compiled = time.perf_counter()
        noise = None
        for progress in renderer.passes(spp=how.spp or self.spp):
            noise = progress.noise
        print(
            f"{name}: {renderer.width} x {renderer.height}, {renderer.spp} spp, "
            f"noise {'unknown' if noise is None else format(noise, '.1%')}, "
            f"{compiled - started:.1f} s to set up, {time.perf_counter() - compiled:.1f} s to render",
            flush=True,
        )
        return renderer

    def pixels(self, name: str, how: How) -> Pixels:
        """Return (H, W, 3) sRGB codes."""
        renderer = self.rendered(name, how)
        settings = renderer.settings
        return develop_image(renderer.image(), tone=settings.tone, exposure=stops(renderer.image(), settings.exposure))

    def draw(self, name: str, how: How) -> Any:
        """Return a Pillow image; `name` is what progress is reported by."""
        from PIL import Image

        return Image.fromarray(self.pixels(name, how))


@dataclass(frozen=True)
class Sheet:
    """Pictures in rows, each above its labels.

    Attributes:
        tiles: returns, by name, a picture and its one or two labels; ASCII, as Pillow's own font has little more.
        columns: tiles in a row.
    """

    tiles: Callable[[], Mapping[str, tuple[Picture, Sequence[str]]]]
    columns: int = 5

    @functools.cached_property
    def about(self) -> str:
        """Size and samples, in words."""
        pictures = [picture for picture, _ in self.tiles().values()]
        least, most = (f(picture.spp for picture in pictures) for f in (min, max))
        return f"{len(pictures)} tiles of {pictures[0].width} x {pictures[0].height}, {least} to {most} spp"

    def draw(self, name: str, how: How) -> Any:
        """Return a Pillow image; `name` is what progress is reported by."""
        tiles = self.tiles()
        drawn = [(picture.pixels(f"{name}/{tile}", how), labels) for tile, (picture, labels) in tiles.items()]
        return contact_sheet(drawn, self.columns)


def contact_sheet(tiles: Sequence[tuple[Pixels, Sequence[str]]], columns: int) -> Any:
    """Return a Pillow image of pictures of the same size in rows of `columns`, each above its one or two labels."""
    from PIL import Image, ImageDraw, ImageFont

    height, width = tiles[0][0].shape[:2]
    styles = (LARGE, SMALL)[: max(len(labels) for _, labels in tiles)]
    below = sum(size + 5 for size, _ in styles)
    rows = -(-len(tiles) // columns)
    size = (GAP + columns * (width + GAP), GAP + rows * (height + below + GAP))
    sheet = Image.new("RGB", size, BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    for place, (pixels, labels) in enumerate(tiles):
        x = GAP + place % columns * (width + GAP)
        y = GAP + place // columns * (height + below + GAP)
        sheet.paste(Image.fromarray(pixels), (x, y))
        y += height + 3
        for label, (points, color) in zip(labels, styles, strict=False):
            draw.text((x + 2, y), label, font=ImageFont.load_default(size=points), fill=color)
            y += points + 4
    return sheet
