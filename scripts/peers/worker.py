"""The process of a renderer that is measured, which renders on request.

It imports nothing but the standard library and NumPy, as it runs in the environment of the renderer.

A worker is started with the folder of a scene. It loads the scene, reports that in a line of JSON on its standard
output, and then answers each line of JSON with another. Everything that libraries print goes to the standard error.
With --picture it writes a picture of one sample per pixel instead, and ends.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TextIO

STARTED = time.perf_counter()


class Worker(Protocol):
    """A renderer with its scene loaded.

    If `render` does more than it times, `cpu_seconds` has the seconds of CPU of the timed part.
    """

    def about(self) -> dict[str, Any]:
        """Return versions, and the seconds of each step of its preparation."""

    def render(self, spp: int, seed: int) -> float:
        """Render a new picture and return the seconds."""

    def gradients(self, d_image: Any, names: list[str], spp: int, seed: int) -> dict[str, Any]:
        """Return the derivatives of a loss by parameters; `render` need not be called before."""

    def picture(self) -> Any:
        """Return the last picture: (H, W, 3) float32, linear Rec. 709, row 0 the top."""

    def save(self, path: str) -> None:
        """Write the last picture as PNG."""


class SharedFile(NamedTuple):
    """A Mitsuba scene file that all renderers read, with `size` pixels a side, and perhaps a box as its filter.

    `values` are those of parameters of the file in Mitsuba alone.
    """

    file: Path
    size: int
    box: bool
    values: dict[str, str]


def shared_file(folder: Path) -> SharedFile | None:
    """Return the scene file that all renderers read; None where each has its own."""
    note = folder / "file.json"
    if not note.exists():
        return None
    found = json.loads(note.read_text(encoding="utf-8"))
    return SharedFile(Path(found["file"]), found["size"], found["box"], found["values"])


def peak_memory() -> int:
    """Return the peak memory of this process, bytes; `getrusage` would count the process that started it too."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmHWM:"):
            return 1024 * int(line.split()[1])
    raise RuntimeError("no VmHWM in /proc/self/status")


def serve(make: Callable[[Path, str], Worker]) -> None:
    """Load the scene of the command line, and answer requests until the standard input ends."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--picture")
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    if options.threads:
        # Before any library counts the cores.
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.threads])
    answers = _private_output()
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
        elif question["do"] == "gradients":
            import numpy as np

            arguments = np.load(question["d_image"]), question["names"], question["spp"], question["seed"]
            started = time.process_time()
            found = worker.gradients(*arguments)
            result["cpu_seconds"] = time.process_time() - started
            np.savez(question["save"], **found)
        elif question["do"] == "memory":
            result["bytes"] = peak_memory()
        else:
            raise ValueError(f"unknown question: {question}")
        _answer(answers, result)


def _private_output() -> TextIO:
    """Return the standard output, and redirect all other writes to it to the standard error."""
    sys.stdout.flush()
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return answers


def _answer(answers: TextIO, result: dict[str, Any]) -> None:
    answers.write(json.dumps(result) + "\n")
    answers.flush()
