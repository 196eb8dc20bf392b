"""The style of all plots in the documentation."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

STYLE: dict[str, Any] = {"font.size": 8.5, "axes.titlesize": 9.5, "axes.grid": True, "grid.alpha": 0.3}
"""Settings for `matplotlib.rc_context`."""


def save(canvas: Any, path: Path) -> None:
    """Write a figure as a PNG with a palette, which is a third of the size."""
    from PIL import Image

    drawn = io.BytesIO()
    canvas.savefig(drawn, dpi=110, format="png")
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.open(drawn).convert("RGB").quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)
