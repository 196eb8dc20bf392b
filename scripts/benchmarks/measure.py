"""Seconds, medians, tables, and pages of the documentation that hold them."""

from __future__ import annotations

import math
import os
import platform
import re
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt

ROOT = Path(__file__).resolve().parents[2]
MEASURED_FOLDER = ROOT / "docs" / "measured"
"""Results that the documentation shows."""


def timed(action: Callable[[], Any]) -> tuple[float, Any]:
    """Return the seconds an action takes, and what it returns."""
    start = time.perf_counter()
    result = action()
    return time.perf_counter() - start, result


def in_turn(actions: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Return the median seconds of each action, run once to warm up and then in turn."""
    for action in actions.values():
        action()
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(repeats):
        for name, action in actions.items():
            seconds[name].append(timed(action)[0])
    return {name: statistics.median(values) for name, values in seconds.items()}


def machine() -> dict[str, Any]:
    """Return what a result depends on beside the code."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists() and (found := re.search(r"^model name\s*: (.+)$", cpuinfo.read_text(), re.MULTILINE)):
        model = found[1]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {"machine": model, "cores": cores, "wrt": wrt.__version__, "python": sys.version.split()[0]}


def geometric_mean(values: Iterable[float]) -> float:
    """Return the geometric mean of positive numbers."""
    logs = [math.log(value) for value in values]
    return math.exp(sum(logs) / len(logs))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def write_section(page: Path, name: str, text: str) -> None:
    """Replace what a page has between `<!-- NAME -->` and `<!-- end of NAME -->`, which stay.

    Raises:
        ValueError: where the page has no such place.
    """
    old = page.read_text(encoding="utf-8")
    place = re.compile(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end of {re.escape(name)} -->)", re.DOTALL)
    new, count = place.subn(lambda found: f"{found[1]}{text.strip()}\n{found[2]}", old)
    if count != 1:
        raise ValueError(f"{page}: {count} places are called {name}, not one")
    page.write_text(new, encoding="utf-8")


def law_of_power(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return factor, exponent and R² of y = factor · x^exponent, least squares of the logarithms."""
    log_x, log_y = np.log(x), np.log(y)
    exponent, shift = np.polyfit(log_x, log_y, 1)
    return float(np.exp(shift)), float(exponent), determination(log_y, exponent * log_x + shift)


def line_through(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return offset, slope and R² of y = offset + slope · x, least squares of relative differences."""
    slope, offset = np.polyfit(x, y, 1, w=1.0 / y)
    return float(offset), float(slope), determination(y, offset + slope * x)


def determination(y: NDArray[np.float64], fitted: NDArray[np.float64]) -> float:
    """Return R²: the share of the variance that a fit explains."""
    spread = float(np.sum((y - y.mean()) ** 2))
    return 1.0 - float(np.sum((y - fitted) ** 2)) / spread if spread > 0.0 else 1.0
