"""The options of docs/first-pictures.md, on the teapot."""

from __future__ import annotations

import functools
from typing import Any

import wrt

from .picture import Picture, Sheet
from .tutorial import MESH

VIEWS = ("three-quarter", "front", "right", "back", "top", "-60,35")
LOOKS: dict[str, dict[str, Any]] = {
    "gold": {"material": "gold"},
    "glass": {"material": "glass"},
    "sky": {"environment": "sky", "view": "20,4"},
}
WORDS = {"gold": "--material gold", "glass": "--material glass", "sky": "--environment sky --view 20,4"}


def views() -> dict[str, tuple[Picture, tuple[str, ...]]]:
    """Return the teapot from every side."""
    return {
        view: (Picture(functools.partial(wrt.load, MESH, view=view), 300, 225, 128), (f"--view {view}",))
        for view in VIEWS
    }


def looks() -> dict[str, tuple[Picture, tuple[str, ...]]]:
    """Return the teapot of other materials and under a sky."""
    return {
        name: (Picture(functools.partial(wrt.load, MESH, **given), 300, 225, 512), (WORDS[name],))
        for name, given in LOOKS.items()
    }


PICTURES: dict[str, Picture | Sheet] = {"studio-views": Sheet(views, 3), "studio-looks": Sheet(looks, 3)}
