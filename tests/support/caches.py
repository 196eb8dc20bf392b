"""Copies of the kernel cache, for tests that must not begin with an empty one, which takes 12 s of CPU to fill."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from conftest import ROOT

CORNELL_BOX = ("render", "cornell-box", "--size", "16x16", "--spp", "1", "--quiet", "-o")
"""Arguments of a small render, before the name of its picture."""


def copy_of_warm_cache(folder: Path, but_for: Callable[[str], bool] = lambda _: False) -> None:
    """Fill a cache folder with the headers and the kernels of CORNELL_BOX, without notes.

    Args:
        folder: a new folder.
        but_for: tells for the folder of each kernel whether to leave it out.
    """
    shutil.copytree(
        _filled_cache(), folder, ignore=lambda _, names: [n for n in names if n.startswith("builds-") or but_for(n)]
    )


@functools.cache
def _filled_cache() -> Path:
    """Render once into a cache that lives as long as this process, and return it."""
    _folders.append(made := tempfile.TemporaryDirectory(prefix="wrt-test-cache-"))
    cache = Path(made.name, "cache")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("WARP_")}
    environment |= {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(cache)}
    command = [sys.executable, "-m", "wrt", *CORNELL_BOX, "film.npy"]
    subprocess.run(command, cwd=made.name, env=environment, check=True)
    return cache


_folders: list[tempfile.TemporaryDirectory[str]] = []
