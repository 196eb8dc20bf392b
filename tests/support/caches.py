"""Kernel caches for tests that need one of their own, but no empty one, which 12 s of CPU would fill."""

from __future__ import annotations

import functools
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import warp as wp
from conftest import ROOT

from wrt.backend.cache_folders import user_folder, warp_folder

CORNELL_BOX = ("render", "cornell-box", "--size", "16x16", "--spp", "1", "--quiet", "-o")
"""Arguments of a small render, before the name of its picture."""


def copy_of_warm_cache(cache: Path, but_for: tuple[str, ...] = ()) -> None:
    """Fill a cache folder with the headers and the kernels of CORNELL_BOX, without a table of artefacts.

    Args:
        cache: a folder, to be named by XDG_CACHE_HOME.
        but_for: names of modules to leave out, or what they begin with.
    """
    copy_of_headers(cache)
    for folder in _kernels():
        if not folder.name.startswith(tuple(f"wp_{name}" for name in but_for)):
            shutil.copytree(folder, cache / "warp" / folder.parent.name / folder.name)


def copy_of_headers(cache: Path) -> None:
    """Fill a cache folder with Warp's headers as they are precompiled, which takes 4 s of CPU."""
    for headers in (user_folder() / "wrt").glob("headers-*"):
        shutil.copytree(headers, cache / "wrt" / headers.name)


@functools.cache
def _kernels() -> tuple[Path, ...]:
    """Return the folders of the kernels in the usual cache, after compiling missing ones."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": folder, "WARP_CACHE_PATH": str(warp_folder())}
        command = [sys.executable, "-m", "wrt", *CORNELL_BOX, "film.npy"]
        subprocess.run(command, cwd=folder, env={**os.environ, **environment}, check=True)
        (file,) = Path(folder).glob("wrt/artefacts-*.json")
        artefacts = json.loads(file.read_bytes().partition(b"\n")[2])
    return tuple(Path(each["file"]).parent for each in artefacts["files"].values())


def without_artefacts(folder: Path) -> dict[str, str]:
    """Return variables by which nothing is known to be compiled, though the usual cache has it."""
    wp.init()
    # Warp puts a folder of its version there itself.
    kernels = Path(wp.config.kernel_cache_dir).parent
    folders = {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(folder / "cache"), "WARP_CACHE_PATH": str(kernels)}
    return {**os.environ, **folders}


def python(folder: Path, environment: dict[str, str], *arguments: str) -> str:
    """Run Python in a folder, and return what it prints; it must succeed."""
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def render_small(folder: Path, environment: dict[str, str], output: str, *arguments: str) -> tuple[bool, str]:
    """Render in a process; return whether it imported Warp, and its messages."""
    command = ["-m", "wrt", "render", *arguments, "--size", "24x16", "--spp", "2", "--quiet", "-o", output]
    process = subprocess.run(
        [sys.executable, "-X", "importtime", *command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    lines = process.stderr.splitlines()
    messages = [line for line in lines if not line.startswith("import time:")]
    return any(line.endswith(" warp._src.context") for line in lines), "\n".join(messages)
