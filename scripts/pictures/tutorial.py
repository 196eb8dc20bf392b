"""The steps of docs/tutorial.md, rendered from the scene files that the page shows."""

from __future__ import annotations

import functools
import re
import shutil
import tempfile
from pathlib import Path

import wrt

from .picture import Picture, Sheet

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "tutorial.md"
MESH = ROOT / "meshes" / "teapot.ply"


def scene_files() -> list[str]:
    """Return the scene files of the page, in their order."""
    return re.findall(r"^```toml\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def make_scene(step: int) -> wrt.Scene:
    """Return the scene of one of the page's files."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(MESH, folder)
        path = Path(folder) / "pot.toml"
        path.write_text(scene_files()[step], encoding="utf-8")
        return wrt.load(path)


def noise() -> dict[str, tuple[Picture, tuple[str, ...]]]:
    """Return the last scene with few and with many samples."""
    make = functools.partial(make_scene, 2)
    label = "{} sample{} per pixel"
    return {
        f"{spp}-spp": (Picture(make, 320, 240, spp), (label.format(spp, "s" if spp > 1 else ""),))
        for spp in (1, 16, 256)
    }


PICTURES: dict[str, Picture | Sheet] = {
    "tutorial-studio": Picture(lambda: wrt.load(MESH), 480, 360, 128),
    "tutorial-camera": Picture(functools.partial(make_scene, 0), 480, 360, 128),
    "tutorial-materials": Picture(functools.partial(make_scene, 1), 480, 360, 128),
    "tutorial-light": Picture(functools.partial(make_scene, 2), 480, 360, 512),
    "tutorial-noise": Sheet(noise, 3),
}
