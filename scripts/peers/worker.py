"""The side of a renderer that is measured: a process of its own, which renders what it is asked for.

Imports nothing but the standard library and NumPy, as it runs in the environment of the renderer that is asked.

A worker is started with the folder of a scene. It loads the scene, says so in a line of JSON on its standard output,
and then answers one line of JSON by another. Everything that libraries print goes to the standard error.
With --picture it writes the first picture instead, of one sample per pixel, and ends.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TextIO

STARTED = time.perf_counter()


class Worker(Protocol):
    """A renderer with its scene loaded.

    One that does more in `render` than it times may keep the seconds of CPU of what it times as `cpu_seconds`.
    """

    def about(self) -> dict[str, Any]:
        """Return versions, and what it needed to get here: seconds by name."""

    def render(self, spp: int, seed: int) -> float:
        """Render a new picture and return the seconds."""

    def picture(self) -> Any:
        """Return the last picture: (H, W, 3) float32, linear Rec. 709, row 0 the top."""

    def save(self, path: str) -> None:
        """Write the last picture as PNG."""


@dataclass(frozen=True)
class NamedFile:
    """A scene file that all renderers are to read.

    Attributes:
        file: Mitsuba's XML.
        size: pixels a side of the picture.
        box: whether the filter is a box, whatever the file says.
    """

    file: Path
    size: int
    box: bool


def named_file(folder: Path) -> NamedFile | None:
    """Return the scene file that all renderers are to read; None where each has its own."""
    note = folder / "file.json"
    if not note.exists():
        return None
    found = json.loads(note.read_text(encoding="utf-8"))
    return NamedFile(Path(found["file"]), found["size"], found["box"])


def peak_memory() -> int:
    """Return the most bytes of memory that this process has had.

    Of Linux's own account: `getrusage` would count the process that started this one too.
    """
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmHWM:"):
            return 1024 * int(line.split()[1])
    raise RuntimeError("no VmHWM in /proc/self/status")


def serve(make: Callable[[Path, str], Worker]) -> None:
    """Load the scene of the command line, and answer what is asked until there is nothing more."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--picture")
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    if options.threads:
        # Before anything counts the cores; every library then finds so many.
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.threads])
    answers = _own_output()
    worker = make(options.folder, options.device)
    if options.picture:
        worker.render(1, 0)
        worker.save(options.picture)
        return
    _answer(answers, {**worker.about(), "start_seconds": time.perf_counter() - STARTED})
    for line in sys.stdin:
        question = json.loads(line)
        result: dict[str, Any] = {}
        if question["do"] == "render":
            started = time.process_time()
            result["seconds"] = worker.render(question["spp"], question["seed"])
            result["cpu_seconds"] = getattr(worker, "cpu_seconds", time.process_time() - started)
            if question.get("save"):
                import numpy as np

                np.save(question["save"], worker.picture())
        elif question["do"] == "memory":
            result["bytes"] = peak_memory()
        else:
            raise ValueError(f"unknown question: {question}")
        _answer(answers, result)


def _own_output() -> TextIO:
    """Return the standard output, and have all that writes to it write to the standard error from now on."""
    sys.stdout.flush()
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return answers


def _answer(answers: TextIO, result: dict[str, Any]) -> None:
    answers.write(json.dumps(result) + "\n")
    answers.flush()
