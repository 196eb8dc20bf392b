"""Pictures of docs/inverse-rendering.md, which its programs write."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .picture import Drawing, How, contact_sheet

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "inverse-rendering.md"


def program(name: str) -> str:
    """Return the program of the page that writes pictures `name`-STEP.png."""
    found = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return next(code for code in found if f'"{name}-' in code)


@dataclass(frozen=True)
class Search:
    """What a program of the page writes, side by side; options of the command line do not change it.

    Attributes:
        written: first part of the names of its files.
        steps: numbers in these names.
    """

    written: str
    steps: Sequence[int]

    def draw(self, name: str, how: How) -> Any:
        """Run the program and return a Pillow image."""
        from PIL import Image

        tiles = []
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "PYTHONPATH": str(ROOT)}
            subprocess.run([sys.executable, "-c", program(self.written)], cwd=folder, env=environment, check=True)
            for step in self.steps:
                with Image.open(Path(folder) / f"{self.written}-{step}.png") as picture:
                    tiles.append((np.asarray(picture.convert("RGB")), (f"{step} steps",)))
        return contact_sheet(tiles, len(tiles))


PICTURES: dict[str, Drawing] = {
    "inverse-texture": Search("texture", (0, 10, 150)),
    "inverse-lamps": Search("lamps", (0, 10, 100)),
    "inverse-metal": Search("metal", (0, 10, 100)),
    "inverse-balls": Search("balls", (0, 20, 150)),
}
