"""Plots of what was measured last, from the results in docs/measured."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from canvas import STYLE, save
from peers.peer import OWN, PEERS

from benchmarks.measure import MEASURED_FOLDER

COLORS = {
    "mitsuba-llvm": "#1f6fb4",
    "mitsuba-scalar": "#9ec9e2",
    "mitsuba-cuda": "#1f6fb4",
    "cycles": "#d1495b",
    "luxcore": "#b8860b",
}


def result_of(name: str) -> dict[str, Any]:
    """Return what `benchmark.py NAME --docs` wrote last."""
    result: dict[str, Any] = json.loads((MEASURED_FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return result


def draw_render(path: Path) -> None:
    """Draw how many times as fast as others wrt is, and how many times as large their errors are, scene by scene."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    rows = result_of("render")["rows"]
    peers = [name for name in PEERS if any("ratio" in row["renderers"].get(name, {}) for row in rows)]
    panels: dict[str, dict[str, list[float]]] = {"paths a second: wrt over the other": {}}
    for peer in peers:
        panels["paths a second: wrt over the other"][peer] = [
            row["renderers"].get(peer, {}).get("ratio", np.nan) for row in rows
        ]
    times = sorted({e["seconds"] for row in rows for e in row["renderers"][OWN.name].get("errors", [])})
    for seconds in times:
        panels[f"error after {seconds:g} s: the other's over wrt's"] = {
            peer: [error_ratio(row, peer, seconds) for row in rows] for peer in peers
        }
    with mpl.rc_context(STYLE):
        canvas = Figure(figsize=(3.6 * len(panels) + 1.0, 0.42 * len(rows) + 1.2), layout="constrained")
        axes = canvas.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        places = np.arange(len(rows), dtype=np.float64)
        for ax, (title, values) in zip(axes, panels.items(), strict=True):
            for k, peer in enumerate(peers):
                height = 0.8 / len(peers)
                y = places + (k - 0.5 * (len(peers) - 1)) * height
                ax.barh(y, values[peer], height, label=PEERS[peer].title.replace("`", ""), color=COLORS.get(peer))
            ax.set_xscale("log", base=2)
            ax.axvline(1.0, color="black", linewidth=1.0)
            ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
            ax.set_title(title)
            ax.grid(visible=False, axis="y")
        axes[0].set_yticks(places, [row["scene"] for row in rows])
        axes[0].invert_yaxis()
        canvas.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(peers), fontsize=7.5)
        save(canvas, path)


def error_ratio(row: dict[str, Any], peer: str, seconds: float, key: str = "rmse") -> float:
    """Return how many times as large a renderer's error is as that of wrt, NaN where it was not measured."""
    found = [row["renderers"].get(name, {}).get("errors", []) for name in (peer, OWN.name)]
    theirs, ours = ([error[key] for error in errors if error["seconds"] == seconds] for errors in found)
    return theirs[0] / ours[0] if theirs and ours and ours[0] > 0.0 else float("nan")


def draw_scaling(path: Path) -> None:
    """Draw rates, and below them memory where it was measured, with the laws that they follow."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    series = result_of("scaling")["series"]
    with mpl.rc_context(STYLE):
        canvas = Figure(figsize=(3.1 * len(series), 5.2), layout="constrained")
        axes = canvas.subplots(2, len(series), squeeze=False)
        for (top, below), (name, found) in zip(axes.T, series.items(), strict=True):
            points = found["points"]
            x = [point[name] for point in points]
            label = {"samples": "samples in a pass", "pixels": "pixels of the picture"}.get(name, name)
            top.plot(x, [point["paths_per_second"] / 1e6 for point in points], "o-", color="#1f6fb4", markersize=3.5)
            top.set_ylim(bottom=0.0)
            top.set_title(law_in_lines(found["laws"].get("rate", "")), fontsize=7.5)
            key, scale = ("seconds", 1e3) if name == "samples" else ("peak_bytes", 1e-6)
            below.plot(x, [scale * point[key] for point in points], "o-", color="#d1495b", markersize=3.5)
            below.set_ylim(bottom=0.0)
            below.set_title(law_in_lines(found["laws"].get("memory", "")), fontsize=7.5)
            below.set_ylabel("ms a pass" if name == "samples" else "MB at most")
            below.set_xlabel(label)
            for ax in (top, below):
                ax.set_xscale("log")
                if name == "threads":
                    ax.set_xscale("linear")
                    ax.set_xticks(x)
        axes[0, 0].set_ylabel("M paths/s")
        save(canvas, path)


def law_in_lines(law: str) -> str:
    """Return a law in short lines, and without what is a table's."""
    return law.replace(", ", "\n")


MEASURED: dict[str, Callable[[Path], None]] = {"benchmark-render": draw_render, "benchmark-scaling": draw_scaling}
"""What draws a plot, by the name of its file."""
