"""Displays and views of OpenColorIO configurations, such as ACES 2.0, through OpenImageIO.

A tone `ocio:CONFIG,DISPLAY,VIEW` names a configuration, which is a file (.ocio, .ocioz) or built into OpenColorIO, such
as ocio://default, and a display and a view of it. Display and view default to the configuration's own defaults, and the
configuration to the environment variable OCIO or else to ocio://default.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, is_utf8
from wrt.values import one_of

BUILT_IN = "ocio://default"

_SOURCES = (
    "lin_rec709_scene",
    "lin_rec709",
    "Linear Rec.709 (sRGB)",
    "Linear Rec.709",
    "Linear BT.709",
    "Linear Rec. 709",
    "Utility - Linear - sRGB",
    "Utility - Linear - Rec.709",
    "lin_srgb",
)
"""Names of linear Rec. 709 in the configurations of ACES, Blender, AgX, Khronos and others."""


@dataclass(frozen=True)
class View:
    """A view that exists: its configuration, its display, and the configuration's name for linear Rec. 709."""

    config: str
    display: str
    view: str
    source: str


def find_view(tone: str) -> View:
    """Return the view of a tone such as "ocio:CONFIG,DISPLAY,VIEW"."""
    import OpenImageIO

    parts = [part.strip() for part in tone.partition(":")[2].split(",")]
    if len(parts) > 3:
        raise InputError(f"tone {tone!r}: expected at most a configuration, a display and a view")
    config, display, view = parts + [""] * (3 - len(parts))
    config = config or os.environ.get("OCIO", "") or BUILT_IN
    if not config.startswith("ocio://") and not os.path.isfile(config):
        raise InputError(f"{config}: no such OpenColorIO configuration; name a file or {BUILT_IN}")
    if not is_utf8(config):
        raise InputError(f"{config}: OpenColorIO reads only files whose names are UTF-8; rename it")
    opened = OpenImageIO.ColorConfig(config)
    if not opened.getDisplayNames():
        raise InputError(f"{config}: cannot be read as an OpenColorIO configuration: {opened.geterror()}")
    opened.geterror()
    display = one_of(display or opened.getDefaultDisplayName(), opened.getDisplayNames(), f"{config}: display")
    views = opened.getViewNames(display)
    view = one_of(view or opened.getDefaultViewName(display), views, f"{config}: view of {display!r}")
    for name in _SOURCES:
        if opened.getColorSpaceIndex(opened.resolve(name)) >= 0:
            return View(config, display, view, name)
    raise InputError(f"{config}: has no linear Rec. 709 under a known name, such as {_SOURCES[0]}")


def encode(image: NDArray[np.float32], view: View) -> NDArray[np.float32]:
    """Return the non-linear display values, 0 to 1, of (H, W, 3) linear Rec. 709 radiance, or raise InputError."""
    import OpenImageIO

    source = OpenImageIO.ImageBuf(image)
    encoded: Any = OpenImageIO.ImageBufAlgo.ociodisplay(
        source, view.display, view.view, view.source, "", False, False, "", "", view.config
    )
    if encoded.has_error:
        raise InputError(f"{view.config}: {' '.join(encoded.geterror().split())}")
    return np.asarray(encoded.get_pixels("float"), np.float32).clip(0.0, 1.0)
