"""Commands of wrt as programs of their own, and a scene whose kernels are those of cornell-box."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from conftest import ROOT

SMALL = ("--size", "8x8", "--spp", "1")
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}

CAMERA = "[camera]\norigin = [0.5, 0.5, 3]\ntarget = [0.5, 0.5, 0]\n"
QUAD = '[[shapes]]\ntype = "quad"\norigin = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\n'
LAMP = '[[shapes]]\ntype = "quad"\norigin = [0, 0, 2]\nedge_u = [0, 1, 0]\nedge_v = [0.5, 0, 0]\nemission = 4\n'
ROOM = CAMERA + QUAD + LAMP
"""A scene file with the features of cornell-box: diffuse quads and an emitting one."""


def _default_interrupt() -> None:
    # A test run started in the background hands down SIGINT ignored, and wrt would rightly go on ignoring it.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def start(folder: Path, *arguments: str, **options: Any) -> subprocess.Popen[str]:
    pipe, before = subprocess.PIPE, options.pop("before", lambda: None)

    def prepare() -> None:
        _default_interrupt()
        before()

    streams = {"stdin": subprocess.DEVNULL, "stdout": pipe, "stderr": pipe, "text": True}
    command = [sys.executable, "-m", "wrt", *arguments]
    return subprocess.Popen(command, cwd=folder, preexec_fn=prepare, **{**streams, "env": ENVIRONMENT, **options})


def run(folder: Path, *arguments: str, **options: Any) -> subprocess.CompletedProcess[Any]:
    """Run a command to its end; `before` is called in its process first. Its error output comes without progress."""
    process = start(folder, *arguments, **options)
    out, err = process.communicate(timeout=300)
    err = without_progress(err) if isinstance(err, str) else err
    return subprocess.CompletedProcess(arguments, process.returncode, out, err)


def without_progress(output: str) -> str:
    """Remove progress lines, which appear when a render is slow, as on a busy machine or while kernels are compiled."""
    lines = output.splitlines(keepends=True)
    return "".join(line for line in lines if not re.match(r"wrt: .*: (getting ready;|\d+ %  \d)", line))


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 240.0
    while not path.exists():
        assert process.poll() is None, f"ended too early: {process.communicate()}"
        assert time.monotonic() < deadline, f"{path.name} never came"
        time.sleep(0.01)


def modules_imported(*arguments: str) -> set[str]:
    """Return the names of the modules that a command of wrt imports."""
    command = [sys.executable, "-X", "importtime", "-m", "wrt", *arguments]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    return {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
