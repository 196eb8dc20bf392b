"""What benchmarks share: programs run in turn, means, tables, and the pages of the documentation that hold them."""

from __future__ import annotations

import json
import math
import os
import platform
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import wrt

ROOT = Path(__file__).resolve().parents[2]
MEASURED_FOLDER = ROOT / "docs" / "measured"
"""Results that the documentation shows."""

Row = dict[str, Any]


def machine() -> Row:
    """Return what a result depends on beside the code."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists() and (found := re.search(r"^model name\s*: (.+)$", cpuinfo.read_text(), re.MULTILINE)):
        model = found[1]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {"machine": model, "cores": cores, "wrt": wrt.__version__, "python": sys.version.split()[0]}


def gpu() -> str:
    """Return the name of the first GPU and the version of its driver, as NVIDIA's tool reports them."""
    query = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
    name, driver = subprocess.run(query, capture_output=True, text=True, check=True).stdout.splitlines()[0].split(", ")
    return f"{name}, driver {driver}"


def run(command: Sequence[str], folder: Path, variables: Mapping[str, str]) -> dict[str, float]:
    """Run a program to its end in a folder; return seconds on the clock and of CPU, and its peak bytes of memory.

    Raises:
        RuntimeError: with the end of its output, where it fails.
    """
    with (folder / "log").open("w+", encoding="utf-8", errors="replace") as log:
        start = time.perf_counter()
        process = subprocess.Popen(command, cwd=folder, env=variables, stdout=log, stderr=log)
        _, status, used = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            log.seek(0)
            raise RuntimeError(f"{command[0]} ended with {process.returncode}: {log.read()[-500:]}")
    return {"seconds": seconds, "cpu_seconds": used.ru_utime + used.ru_stime, "peak_bytes": 1024.0 * used.ru_maxrss}


def run_in_turn(
    commands: Mapping[str, Sequence[str]],
    repeats: int,
    folder: Path,
    variables: Mapping[str, str],
    between: Callable[[], None] = lambda: None,
) -> dict[str, dict[str, float]]:
    """Run programs once to fill their caches and then `repeats` times in turn; return the medians of `run`.

    Args:
        commands: by the program's name.
        repeats: runs that are measured.
        folder: where they run.
        variables: their environment.
        between: called after each run.

    Returns:
        By program; `first_seconds` and `first_cpu_seconds` are those of the run that fills the caches.
    """
    runs: dict[str, list[dict[str, float]]] = {program: [] for program in commands}
    for _ in range(1 + repeats):
        for program, command in commands.items():
            runs[program].append(run(command, folder, variables))
            between()
    medians = {}
    for program, (first, *repeated) in runs.items():
        medians[program] = {key: statistics.median(each[key] for each in repeated) for key in first}
        medians[program] |= {f"first_{key}": first[key] for key in ("seconds", "cpu_seconds")}
    return medians


def result_of(name: str) -> Row:
    """Return what `benchmark.py NAME --docs` wrote last."""
    result: Row = json.loads((MEASURED_FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return result


def geometric_mean(values: Iterable[float]) -> float:
    """Return the geometric mean of positive numbers."""
    return math.exp(statistics.fmean(math.log(value) for value in values))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def write_section(page: Path, name: str, text: str) -> None:
    """Replace the text of a page between `<!-- NAME -->` and `<!-- end of NAME -->`, which stay.

    Raises:
        ValueError: where the page does not have these marks once.
    """
    old = page.read_text(encoding="utf-8")
    section = re.compile(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end of {re.escape(name)} -->)", re.DOTALL)
    new, count = section.subn(lambda found: f"{found[1]}{text.strip()}\n{found[2]}", old)
    if count != 1:
        raise ValueError(f"{page}: has {count} sections called {name}, not one")
    page.write_text(new, encoding="utf-8")
