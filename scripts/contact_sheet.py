#!/usr/bin/env python3
"""Load the meshes and scenes of folders, render each as a small picture, and lay the pictures out on sheets.

For each file it tells whether wrt reads it as it is, with warnings, or not. The sheets are for looking at: a picture
that is wrong is found sooner than described. It fetches nothing.

    scripts/contact_sheet.py glTF-Sample-Assets/Models --sheet sheet --table files.md

The exit status is 1 if anything other than an InputError came out of a file.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import re
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt
from wrt.develop.picture import develop_image
from wrt.io.load_mesh import MESH_SUFFIXES

SUFFIXES = (*MESH_SUFFIXES, ".xml", ".toml")

PER_SHEET = 60
"""Pictures of a sheet."""

LABEL = 14
"""Height of the line under a picture, in pixels."""


@dataclasses.dataclass
class Verdict:
    """What became of a file.

    Attributes:
        name: its path, from the folder's name on.
        state: "as it is", "with warnings", "refused" or "broken".
        messages: warnings, or the reason.
        seconds: that loading took.
        picture: (H, W, 3) 8-bit sRGB, or None.
    """

    name: str
    state: str
    messages: list[str] = dataclasses.field(default_factory=list)
    seconds: float = 0.0
    picture: NDArray[np.uint8] | None = None


def files(folders: Sequence[Path], suffixes: Sequence[str]) -> Iterator[tuple[Path, str]]:
    """Yield the files with one of the suffixes, each with a name that begins with that of its folder."""
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() in suffixes and path.is_file():
                yield path, f"{folder.name}/{path.relative_to(folder)}"


def examined(path: Path, name: str, *, size: int, spp: int) -> Verdict:
    """Load a file, and render it unless `spp` is 0."""
    verdict = Verdict(name, "as it is")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            start = time.perf_counter()
            scene = wrt.load(path, aspect=1.0)
            verdict.seconds = time.perf_counter() - start
            if spp:
                verdict.picture = picture(scene, size=size, spp=spp)
        except wrt.InputError as error:
            verdict.state, verdict.messages = "refused", [short(str(error), path)]
            return verdict
        except Exception as error:  # noqa: BLE001 - anything else is a mistake of wrt, to be reported with the rest
            verdict.state, verdict.messages = "broken", [repr(error)]
            return verdict
    verdict.messages = list(dict.fromkeys(short(str(each.message), path) for each in caught))
    if verdict.messages:
        verdict.state = "with warnings"
    return verdict


def short(message: str, path: Path) -> str:
    """Return a message without the path of its file."""
    return message.replace(f"{path}: ", "").replace(f"{path.parent}/", "").partition("\n")[0]


def picture(scene: wrt.Scene, *, size: int, spp: int) -> NDArray[np.uint8]:
    """Return (H, W, 3) the picture of a scene, no larger than `size` either way."""
    scene.settings = dataclasses.replace(scene.settings, integrator="path", crop=None)
    wide = scene.settings.width / scene.settings.height
    width, height = (size, max(1, round(size / wide))) if wide >= 1.0 else (max(1, round(size * wide)), size)
    renderer = wrt.Renderer(scene, width=width, height=height)
    for _ in renderer.passes(spp=spp):
        pass
    return develop_image(renderer.image(), exposure="auto")


def sheet(verdicts: Sequence[Verdict], size: int) -> Any:
    """Return the pictures of files, with their numbers and names, as one image."""
    from PIL import Image, ImageDraw

    columns = min(10, len(verdicts))
    rows = math.ceil(len(verdicts) / columns)
    drawn = Image.new("RGB", (columns * size, rows * (size + LABEL)), (255, 255, 255))
    pen = ImageDraw.Draw(drawn)
    for k, verdict in enumerate(verdicts):
        x, y = k % columns * size, k // columns * (size + LABEL)
        if verdict.picture is not None:
            drawn.paste(Image.fromarray(verdict.picture), (x, y))
        else:
            pen.text((x + 4, y + size // 2), verdict.state, fill=(160, 0, 0))
        color = {"as it is": (0, 0, 0), "with warnings": (160, 100, 0)}.get(verdict.state, (160, 0, 0))
        pen.text((x + 2, y + size), Path(verdict.name).stem[-size // 6 :], fill=color)
    return drawn


def save_sheet(verdicts: Sequence[Verdict], options: argparse.Namespace) -> None:
    """Write the sheet of the last of the files."""
    number = (len(verdicts) - 1) // PER_SHEET
    sheet(verdicts[number * PER_SHEET :], options.size).save(f"{options.sheet}-{number + 1}.png")


def table(verdicts: Sequence[Verdict]) -> str:
    """Return the verdicts in Markdown: the names of files read as they are, and a table of the others."""
    plain = ", ".join(f"`{each.name}`" for each in verdicts if each.state == "as it is")
    lines = [f"As they are: {plain}.", "", "| file | read | remarks |", "| --- | --- | --- |"]
    for each in verdicts:
        if each.state != "as it is":
            remarks = "; ".join(each.messages).replace("|", "\\|")
            lines.append(f"| `{each.name}` | {each.state} | {remarks} |")
    return "\n".join(lines) + "\n"


def parse_arguments(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", type=Path, nargs="+", help="folders of files")
    parser.add_argument("--only", metavar="REGEX", default="", help="files whose name matches")
    parser.add_argument("--size", type=int, default=128, help="pixels along the longer side; default: 128")
    parser.add_argument("--spp", type=int, default=16, help="samples per pixel; 0 loads only; default: 16")
    parser.add_argument("--suffixes", nargs="+", default=SUFFIXES, help="of the files; default: all that wrt reads")
    parser.add_argument("--sheet", type=Path, metavar="NAME", help="write sheets NAME-1.png, NAME-2.png, ...")
    parser.add_argument("--table", type=Path, metavar="FILE", help="write the verdicts as Markdown")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine the files, print a line for each, and return the exit status."""
    options = parse_arguments(arguments)
    for folder in options.folders:
        if not folder.is_dir():
            sys.exit(f"{folder}: not a folder")
    verdicts = []
    for path, name in files(options.folders, options.suffixes):
        if re.search(options.only, name):
            verdicts.append(examined(path, name, size=options.size, spp=options.spp))
            print(f"{name}: {verdicts[-1].state}; {'; '.join(verdicts[-1].messages)}", flush=True)
            if options.sheet is not None and len(verdicts) % PER_SHEET == 0:
                save_sheet(verdicts, options)
    counts = {state: sum(each.state == state for each in verdicts) for state in sorted({v.state for v in verdicts})}
    print(f"{len(verdicts)} files: {', '.join(f'{count} {state}' for state, count in counts.items())}")
    if options.sheet is not None and len(verdicts) % PER_SHEET:
        save_sheet(verdicts, options)
    if options.table is not None:
        options.table.write_text(table(verdicts), "utf-8")
    return int(any(verdict.state == "broken" for verdict in verdicts))


if __name__ == "__main__":
    sys.exit(main())
