"""Render the pictures of the documentation, defined in `pictures/`, to docs/pictures.

    python scripts/gallery.py                       list them
    python scripts/gallery.py NAME ... [--spp N] [--size PIXELS] [--out FOLDER] [--device NAME] [--threads N]

A name is a group (`media`), a picture (`media-fog`), a tile (`materials/gold`, which becomes materials-gold.jpg) or
`all`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from pictures import GROUPS
from pictures.picture import Drawing, How, Sheet

import wrt

DOCS_PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
JPEG_QUALITY = 88


def drawings(name: str) -> dict[str, Drawing]:
    """Return the pictures of a name, by the names of their files.

    Raises:
        InputError: where there is no such group, picture or tile.
    """
    drawn = {key: drawing for group in GROUPS.values() for key, drawing in group.items()}
    if name == "all":
        return drawn
    if name in GROUPS:
        return dict(GROUPS[name])
    if name in drawn:
        return {name: drawn[name]}
    sheet, _, tile = name.partition("/")
    if isinstance(drawing := drawn.get(sheet), Sheet) and tile in (tiles := drawing.tiles()):
        return {f"{sheet}-{tile}": tiles[tile][0]}
    raise wrt.InputError(f"{name}: no such group or picture; without a name, gallery.py lists them")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Render the pictures of the documentation.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="group, picture or tile, or all; none: list them")
    parser.add_argument("--spp", type=int, help="samples per pixel; by default each picture's own")
    parser.add_argument(
        "--size", type=int, help="width of pictures, or of the tiles of a sheet; by default each picture's own"
    )
    parser.add_argument("--out", type=Path, default=DOCS_PICTURES, metavar="FOLDER", help="folder to write to")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N")
    parser.add_argument("--threads", type=int, help="CPU threads; by default all cores")
    options = parser.parse_args(arguments)
    if not options.names:
        for group, members in GROUPS.items():
            print(f"{group}: {', '.join(members)}")
        return 0
    how = How(options.spp, options.size, options.device, options.threads)
    try:
        chosen = {key: drawing for name in options.names for key, drawing in drawings(name).items()}
        options.out.mkdir(parents=True, exist_ok=True)
        for name, drawing in chosen.items():
            path = options.out / f"{name}.jpg"
            drawing.draw(name, how).save(path, quality=JPEG_QUALITY, optimize=True)
            print(f"{path}: {path.stat().st_size / 1e3:,.0f} kB", flush=True)
    except wrt.InputError as error:
        print(f"gallery: error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
