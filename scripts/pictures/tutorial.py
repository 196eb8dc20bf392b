"""The steps of docs/tutorial.md, from the scene files that it shows, and the options of docs/first-pictures.md."""

from __future__ import annotations

import functools
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

import wrt

from .picture import Drawing, Picture, Sheet, Tiles

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "tutorial.md"
MESH = ROOT / "meshes" / "teapot.ply"


def scene_file(step: int) -> str:
    """Return the scene file after a step of the page; a step replaces or adds tables."""
    steps = re.findall(r"^```toml\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    tables: dict[str, str] = {}
    for text in steps[: step + 1]:
        own: dict[str, str] = {}
        for table, name in re.findall(r"^(\[+(\w+).*\n(?:[^\[\n].*\n|\n)*)", text, re.MULTILINE):
            own[name] = own.get(name, "") + table
        tables |= own
    return "\n".join(tables.values())


def make_scene(step: int) -> wrt.Scene:
    """Return the scene after one of the page's steps."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(MESH, folder)
        path = Path(folder) / "pot.toml"
        path.write_text(scene_file(step), encoding="utf-8")
        return wrt.load(path)


def noise() -> Tiles:
    """Return the last scene with few and with many samples."""
    make = functools.partial(make_scene, 2)
    label = "{} sample{} per pixel"
    return {
        f"{spp}-spp": (Picture(make, 320, 240, spp), (label.format(spp, "s" if spp > 1 else ""),))
        for spp in (1, 16, 256)
    }


def studio(spp: int, options: dict[str, dict[str, Any]]) -> Tiles:
    """Return the teapot of docs/first-pictures.md, by name, each loaded with its options, which labels show."""
    return {
        name: (
            Picture(functools.partial(wrt.load, MESH, **keywords), 300, 225, spp),
            (" ".join(f"--{key} {value}" for key, value in keywords.items()),),
        )
        for name, keywords in options.items()
    }


VIEWS = {view: {"view": view} for view in ("three-quarter", "front", "right", "back", "top", "-60,35")}
LOOKS = {"gold": {"material": "gold"}, "glass": {"material": "glass"}, "sky": {"environment": "sky", "view": "20,4"}}
PICTURES: dict[str, Drawing] = {
    "tutorial-studio": Picture(lambda: wrt.load(MESH), 480, 360, 128),
    "tutorial-camera": Picture(functools.partial(make_scene, 0), 480, 360, 128),
    "tutorial-materials": Picture(functools.partial(make_scene, 1), 480, 360, 128),
    "tutorial-light": Picture(functools.partial(make_scene, 2), 480, 360, 512),
    "tutorial-noise": Sheet(noise, 3),
    "studio-views": Sheet(functools.partial(studio, 128, VIEWS), 3),
    "studio-looks": Sheet(functools.partial(studio, 512, LOOKS), 3),
}
