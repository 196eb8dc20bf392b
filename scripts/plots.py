"""Plot the reflection models, from their own device functions (plot_figures.py), and the measurements.

    python scripts/plots.py [--only NAME ...] [--out FOLDER]

Needs matplotlib (pip install '.[plots]'). docs/shading.md shows the plots of models, docs/performance.md those of
the latest results of scripts/benchmark.py, which are in docs/measured.
"""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks import report
from benchmarks.measure import result_of
from plot_figures import FIGURES, Figure, Panel

STYLE: dict[str, Any] = {"font.size": 8.5, "axes.titlesize": 9.5, "axes.grid": True, "grid.alpha": 0.3}
"""Settings for `matplotlib.rc_context`."""

PEER_COLORS = {"mitsuba-llvm": "#1f6fb4", "mitsuba-scalar": "#9ec9e2", "cycles": "#d1495b", "luxcore": "#b8860b"}

DOCS_PLOTS = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "plots"


def draw(figure: Figure, path: Path) -> None:
    """Write a figure as PNG."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    columns = min(figure.columns, len(figure.panels))
    rows = -(-len(figure.panels) // columns)
    polar = figure.kind in ("half", "round")
    width, height = {"half": (4.2, 2.4), "round": (3.3, 3.6)}.get(figure.kind, (3.2, 2.7))
    legends = {tuple(curve.label for curve in panel.curves) for panel in figure.panels}
    with mpl.rc_context(STYLE):
        canvas = Canvas(figsize=(width * columns, height * rows), layout="constrained")
        axes = canvas.subplots(rows, columns, squeeze=False, subplot_kw={"projection": "polar"} if polar else {})
        for place, (ax, panel) in enumerate(zip(axes.flat, figure.panels, strict=False)):
            for curve in panel.curves:
                options = {"label": curve.label} if curve.label else {}
                x = np.radians(curve.x) if polar else curve.x
                ax.plot(x, curve.y, curve.style, color=curve.color, linewidth=1.3, **options)
            ax.set_title(panel.title)
            if polar:
                _arrange_polar(ax, panel, half=figure.kind == "half")
            else:
                _arrange(ax, figure, first=place % columns == 0, last=place // columns == rows - 1)
            if figure.kind == "half":
                ax.legend(fontsize=7.5, loc="upper left", bbox_to_anchor=(0.98, 1.0))
            elif len(legends) > 1:
                ax.legend(fontsize=7.5, framealpha=0.8)
        if figure.kind != "half" and len(legends) == 1:
            canvas.legend(*axes[0, 0].get_legend_handles_labels(), fontsize=7.5, loc="outside right upper")
        save(canvas, path)


def _arrange(ax: Any, figure: Figure, *, first: bool, last: bool) -> None:
    """Set up Cartesian axes, with labels only at the left and below."""
    from matplotlib.ticker import MultipleLocator

    if figure.kind == "log":
        ax.set_yscale("log")
    if figure.limits:
        ax.set_ylim(*figure.limits)
    ax.margins(x=0.0)
    ax.xaxis.set_major_locator(MultipleLocator(30.0))
    if first:
        ax.set_ylabel(figure.y_label)
    if last:
        ax.set_xlabel(figure.x_label)


def _arrange_polar(ax: Any, panel: Panel, *, half: bool) -> None:
    """Set up polar axes: the normal upwards, the viewer marked."""
    from matplotlib.ticker import MaxNLocator

    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    top = 1.05 * max(float(curve.y.max()) for curve in panel.curves)
    if panel.viewer is not None:
        ax.plot([np.radians(panel.viewer)] * 2, [0.0, top], ":", color="black", linewidth=1.2, label="viewer")
    ax.set_ylim(0.0, top)
    if half:
        ax.set_thetamin(-90)
        ax.set_thetamax(90)
        ax.set_xticks(np.radians(np.arange(-90, 91, 30)))
    else:
        ax.set_xticks(np.radians(np.arange(0, 360, 30)), [f"{a if a <= 180 else a - 360}°" for a in range(0, 360, 30)])
        ax.plot(np.radians([-90.0, 90.0]), [top, top], "-", color="#888888", linewidth=1.0)  # the surface
    ax.yaxis.set_major_locator(MaxNLocator(3))
    ax.tick_params(labelsize=7)


def save(canvas: Any, path: Path) -> None:
    """Write a figure as a PNG with a palette, which is a third of the size."""
    from PIL import Image

    drawn = io.BytesIO()
    canvas.savefig(drawn, dpi=110, format="png")
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.open(drawn).convert("RGB").quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)


# --- Measurements ----------------------------------------------------------------------------------


def draw_render(path: Path) -> None:
    """Draw how many times as fast as others wrt is, and how many times as large their errors are, scene by scene."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    rows = result_of("render")["rows"]
    peers = report.peers_of(rows)
    speed = {peer: [row["renderers"].get(peer, {}).get("ratio", np.nan) for row in rows] for peer in peers}
    panels = {"paths a second: wrt over the other": speed}
    for seconds in sorted({error["seconds"] for row in rows for error in row["renderers"]["wrt"].get("errors", [])}):
        ratios = {peer: [report.error_ratio(row, peer, seconds) for row in rows] for peer in peers}
        panels[f"error after {seconds:g} s: the other's over wrt's"] = ratios
    height = 0.8 / len(peers)
    with mpl.rc_context(STYLE):
        canvas = Canvas(figsize=(3.6 * len(panels) + 1.0, 0.42 * len(rows) + 1.2), layout="constrained")
        axes = canvas.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for ax, (title, values) in zip(axes, panels.items(), strict=True):
            for k, peer in enumerate(peers):
                y = np.arange(len(rows)) + (k - 0.5 * (len(peers) - 1)) * height
                label = report.TITLES[peer].replace("`", "")
                ax.barh(y, values[peer], height, label=label, color=PEER_COLORS.get(peer))
            ax.set_xscale("log", base=2)
            ax.axvline(1.0, color="black", linewidth=1.0)
            ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
            ax.set_title(title)
            ax.grid(visible=False, axis="y")
        axes[0].set_yticks(np.arange(len(rows)), [row["scene"] for row in rows])
        axes[0].invert_yaxis()
        canvas.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(peers), fontsize=7.5)
        save(canvas, path)


def draw_scaling(path: Path) -> None:
    """Draw rates, and below them memory where it was measured, with the laws that they follow."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    series = result_of("scaling")["series"]
    with mpl.rc_context(STYLE):
        canvas = Canvas(figsize=(3.1 * len(series), 5.2), layout="constrained")
        axes = canvas.subplots(2, len(series), squeeze=False)
        for (top, below), (name, found) in zip(axes.T, series.items(), strict=True):
            x = [point[name] for point in found["points"]]
            key, scale, unit = "peak_bytes", 1e-6, "MB at most"
            if name == "samples":
                key, scale, unit = "seconds", 1e3, "ms a pass"
            for ax, color, law, y in (
                (top, "#1f6fb4", "rate", [point["paths_per_second"] / 1e6 for point in found["points"]]),
                (below, "#d1495b", "memory", [scale * point[key] for point in found["points"]]),
            ):
                ax.plot(x, y, "o-", color=color, markersize=3.5)
                ax.set_ylim(bottom=0.0)
                ax.set_title(found["laws"].get(law, "").replace(", ", "\n"), fontsize=7.5)
                ax.set_xscale("linear" if name == "threads" else "log")
                if name == "threads":
                    ax.set_xticks(x)
            below.set_ylabel(unit)
            below.set_xlabel({"samples": "samples in a pass", "pixels": "pixels of the picture"}.get(name, name))
        axes[0, 0].set_ylabel("M paths/s")
        save(canvas, path)


MEASURED: dict[str, Callable[[Path], None]] = {"benchmark-render": draw_render, "benchmark-scaling": draw_scaling}
"""What draws a plot, by the name of its file."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Plot the reflection models and the measurements.")
    every = [*FIGURES, *MEASURED]
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", choices=every, help=f"plots to draw, of {', '.join(every)}"
    )
    parser.add_argument("--out", type=Path, default=DOCS_PLOTS, metavar="FOLDER", help="folder to write to")
    options = parser.parse_args(arguments)
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        print("plots: error: matplotlib is not installed; run: pip install '.[plots]'", file=sys.stderr)
        return 2
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.only or every:
        path = options.out / f"{name}.png"
        if name in MEASURED:
            MEASURED[name](path)
        else:
            draw(FIGURES[name](), path)
        print(f"{path}: {path.stat().st_size / 1e3:,.0f} kB", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
