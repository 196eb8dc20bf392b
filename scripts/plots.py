"""Plot the reflection models of docs/shading.md, from their own device functions (plot_figures.py).

    python scripts/plots.py [--only NAME ...] [--out FOLDER]

Needs matplotlib (pip install '.[plots]').
"""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from plot_figures import FIGURES, Figure, Panel

STYLE: dict[str, Any] = {"font.size": 8.5, "axes.titlesize": 9.5, "axes.grid": True, "grid.alpha": 0.3}
"""Settings for `matplotlib.rc_context`."""

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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Plot the reflection models.")
    names = list(FIGURES)
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", choices=names, default=names, help=f"of {', '.join(names)}"
    )
    parser.add_argument("--out", type=Path, default=DOCS_PLOTS, metavar="FOLDER", help="folder to write to")
    options = parser.parse_args(arguments)
    for name in options.only:
        draw(FIGURES[name](), options.out / f"{name}.png")
        print(options.out / f"{name}.png", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
