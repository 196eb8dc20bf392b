"""What a picture of the documentation is: a scene, how it is rendered, and sheets of several of them."""

from __future__ import annotations

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
    """Options of the command line.

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
        options: further options of `wrt.Renderer`.
    """

    make: Callable[[], wrt.Scene]
    width: int = 480
    height: int = 270
    spp: int = 128
    options: Mapping[str, Any] = field(default_factory=dict)

    def rendered(self, name: str, how: How) -> wrt.Renderer:
        """Return a renderer that has all samples, and print its noise."""
        width = how.size or self.width
        size = {"width": width, "height": max(1, round(width * self.height / self.width))}
        renderer = wrt.Renderer(self.make(), **size, device=how.device, threads=how.threads, **self.options)
        noise = None
        for progress in renderer.passes(spp=how.spp or self.spp):
            noise = progress.noise
        print(f"{name}: noise {'unknown' if noise is None else format(noise, '.1%')}", flush=True)
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


Tiles = Mapping[str, tuple[Picture, Sequence[str]]]
"""By name, a picture and its one or two labels; ASCII, as Pillow's own font has little more."""


@dataclass(frozen=True)
class Sheet:
    """Pictures in rows of `columns`, each above its labels; `tiles` returns them."""

    tiles: Callable[[], Tiles]
    columns: int = 5

    def draw(self, name: str, how: How) -> Any:
        """Return a Pillow image; `name` is what progress is reported by."""
        tiles = self.tiles()
        drawn = [(picture.pixels(f"{name}/{tile}", how), labels) for tile, (picture, labels) in tiles.items()]
        return contact_sheet(drawn, self.columns)


@dataclass(frozen=True)
class DevelopedSheet:
    """Several tiles of each rendered picture, in rows of `columns`.

    Attributes:
        pictures: by name.
        tiles_of: returns pixels and labels of a picture's tiles, for its name and the renderer that has its samples.
        columns: tiles in a row.
    """

    pictures: Mapping[str, Picture]
    tiles_of: Callable[[str, wrt.Renderer], Sequence[tuple[Pixels, Sequence[str]]]]
    columns: int

    @property
    def picture(self) -> Picture:
        """The first picture."""
        return next(iter(self.pictures.values()))

    def draw(self, name: str, how: How) -> Any:
        """Return a Pillow image; `name` is what progress is reported by."""
        drawn = []
        for label, picture in self.pictures.items():
            drawn += self.tiles_of(label, picture.rendered(f"{name}/{label}", how))
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
