"""Results as tables of docs/performance.md and docs/notes, and everything else that --docs writes."""

from __future__ import annotations

import itertools
import json
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from peers.peer import OWN, PEERS

from benchmarks import caustics, checkouts, found, gradients, own, rays
from benchmarks.measure import MEASURED_FOLDER, ROOT, Row, geometric_mean, table, write_section

PAGE = ROOT / "docs" / "performance.md"
NOTES = ROOT / "docs" / "notes"
PICTURES = ROOT / "docs" / "pictures"
TILE = 220
"""Pixels a side of a picture on the sheet."""

TITLES = {name: peer.title for name, peer in {OWN.name: OWN, **PEERS}.items()}


def texts(result: Row) -> list[str]:
    """Return the tables of a result."""
    return [section.text(result) for section in SECTIONS[result["benchmark"]]]


def write_documents(result: Row, pictures: Mapping[str, NDArray[np.float64]]) -> None:
    """Write a result to docs/measured, its tables into the pages that show them, and its pictures."""
    name = result["benchmark"]
    MEASURED_FOLDER.mkdir(parents=True, exist_ok=True)
    (MEASURED_FOLDER / f"{name}.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    for section in SECTIONS[name]:
        write_section(section.page, section.name, section.text(result))
    if name == "render" and pictures and all(row["scene"] in pictures for row in result["rows"]):
        write_sheet(result["rows"], pictures)


def write_sheet(rows: list[Row], pictures: Mapping[str, NDArray[np.float64]]) -> None:
    """Write a sheet of the pictures that were timed, each at an exposure of its own."""
    from pictures.picture import contact_sheet
    from PIL import Image

    from wrt.develop.picture import develop_image

    tiles = []
    for row in rows:
        picture = pictures[row["scene"]]
        codes = develop_image(picture * (0.3 / np.quantile(picture, 0.6)), tone="none", exposure=0.0)
        small = Image.fromarray(codes).resize((TILE, TILE), Image.Resampling.LANCZOS)
        tiles.append((np.asarray(small), (row["scene"], row["about"])))
    contact_sheet(tiles, 4).save(PICTURES / "benchmark.jpg", quality=88, optimize=True)


def peers_of(rows: list[Row]) -> list[str]:
    """Return the renderers that wrt was compared with."""
    return [name for name in PEERS if any("ratio" in row["renderers"].get(name, {}) for row in rows)]


def paragraph(text: str) -> str:
    """Return a text in lines, and an empty one."""
    return textwrap.fill(text, 120, break_on_hyphens=False) + "\n\n"


def versions_and_size(result: Row) -> str:
    """Return the versions of the other renderers, and the size of the pictures."""
    versions = []
    for name in peers_of(result["rows"]):
        found = next(row["renderers"][name] for row in result["rows"] if "about" in row["renderers"].get(name, {}))
        versions.append(f"{TITLES[name]} {found['about']['version']}")
    return f"{', '.join(versions)}. Pictures of {result['size']} x {result['size']} pixels."


def speed_table(rows: list[Row]) -> str:
    """Return millions of paths a second at equal samples, and how many times as fast wrt is."""
    head, last = ["scene", "triangles", "depth", "spp", "wrt"], ["geometric mean", "", "", "", ""]
    lines = [[f"`{row['scene']}`", f"{row['triangles']:,}", str(row["depth"]), str(row["spp"])] for row in rows]
    for name in (OWN.name, *peers_of(rows)):
        ratios = []
        for row, line in zip(rows, lines, strict=True):
            found = row["renderers"].get(name, {})
            line.append(f"{found['paths_per_second'] / 1e6:.2f}" if "ratio" in found else "")
            if name != OWN.name:
                line.append(f"{found['ratio']:.2f}" if "ratio" in found else "")
                ratios += [found["ratio"]] if "ratio" in found else []
        if ratios:
            head += [TITLES[name], "ratio"]
            last += ["", f"**{geometric_mean(ratios):.2f}**"]
    return paragraph("Millions of camera paths a second, and wrt's over the other's:") + table(head, [*lines, last])


def error_table(rows: list[Row]) -> str:
    """Return wrt's errors at equal time, and how many times as large those of others are."""
    times = sorted({e["seconds"] for row in rows for e in row["renderers"][OWN.name].get("errors", [])})
    if not times:
        return ""
    columns = list(itertools.product((OWN.name, *peers_of(rows)), times))
    lines = []
    for row in rows:
        found = {(name, e["seconds"]): e["rmse"] for name, r in row["renderers"].items() for e in r.get("errors", [])}
        line = [f"`{row['scene']}`"]
        for name, seconds in columns:
            error, ours = found.get((name, seconds)), found.get((OWN.name, seconds))
            if error is None or not ours:
                line.append("")
            else:
                line.append(f"{100.0 * error:.2f} %" if name == OWN.name else f"{error / ours:.2f}")
        lines.append(line)
    intro = "Root mean square error after equal seconds, of wrt over the picture's mean, of others over that of wrt:"
    return paragraph(intro) + table(["scene", *(f"{TITLES[name]}, {t:g} s" for name, t in columns)], lines)


def table_by_renderer(intro: str, rows: list[Row], names: Sequence[str], cell: Callable[[Row], str]) -> str:
    """Return an introduction and a table of scenes and renderers; `cell` is given what was measured of both."""
    lines = [[f"`{row['scene']}`", *(cell(row["renderers"].get(name, {})) for name in names)] for row in rows]
    return paragraph(intro) + table(["scene", *(TITLES[name] for name in names)], lines)


def start_table(rows: list[Row]) -> str:
    """Return seconds from the shell to a first picture, empty where none were measured."""

    def cell(found: Row) -> str:
        seconds = found.get("first_picture_seconds")
        return f"{seconds['cold']:.1f} / {seconds['warm']:.2f}" if seconds else ""

    timed = [row for row in rows if cell(row["renderers"][OWN.name])]
    intro = "Seconds from the shell to a picture of one sample, with nothing compiled / with kernels in the cache:"
    return table_by_renderer(intro, timed, [OWN.name, *peers_of(rows)], cell) if timed else ""


def agreement_table(rows: list[Row]) -> str:
    """Return how far pictures are the same."""

    def cell(found: Row) -> str:
        if (result := found.get("agreement")) is None:
            return ""
        text = (
            f"{100.0 * result['pass_fraction']:.2f} %, {100.0 * result['mean_difference']:+.2f} %, "
            f"{100.0 * result['block_difference']:.2f} % ({100.0 * result['block_noise']:.2f} %)"
        )
        return text if result["agrees"] else f"**differ:** {text}"

    intro = (
        "Are they pictures of the same thing? Pixels within noise (z-test), difference of the mean, of blocks of "
        "16 x 16 pixels (in brackets what noise alone makes), wrt against:"
    )
    return table_by_renderer(intro, rows, peers_of(rows), cell)


def render_text(result: Row) -> str:
    """Return the tables of `render`."""
    rows = result["rows"]
    about = f"On {result['machine']}, {result['cores']} cores, {result['device']}; {versions_and_size(result)}"
    tables = [speed_table(rows), error_table(rows), start_table(rows)]
    return paragraph(about) + "\n".join(tables)


def gpu_text(result: Row) -> str:
    """Return the tables of `render --device cuda`."""
    tables = [speed_table(result["rows"]), start_table(result["rows"])]
    return paragraph(f"On an {result['gpu']}; {versions_and_size(result)}") + "\n".join(tables)


def files_text(result: Row) -> str:
    """Return the tables of `render --files`."""
    rows = result["rows"]
    size = rows[0]["size"]
    about = f"On {result['machine']}, {result['cores']} cores; pictures of {size} x {size} pixels.\n"
    return "\n".join([about, speed_table(rows), error_table(rows), agreement_table(rows)])


class Section(NamedTuple):
    """A part of a page that is written by a benchmark.

    Attributes:
        page: the file; None where no page shows the results.
        name: the name between the marks where the part begins and ends.
        text: returns the part as Markdown.
    """

    page: Path | None
    name: str
    text: Callable[[Row], str]


SECTIONS = {
    "render": (
        Section(NOTES / "comparison.md", "render", render_text),
        Section(NOTES / "comparison.md", "agreement", lambda result: agreement_table(result["rows"])),
    ),
    "gpu": (Section(ROOT / "docs" / "notes" / "gpu.md", "speed", gpu_text),),
    "files": (Section(NOTES / "comparison.md", "files", files_text),),
    "found": (Section(PAGE, "found", found.text),),
    "rays": (Section(None, "rays", rays.text),),
    "gradients": (Section(None, "gradients", gradients.text),),
    "caustics": (Section(None, "caustics", caustics.text),),
    "checkouts": (Section(None, "checkouts", checkouts.text),),
    "own": (Section(None, "own", own.text),),
}
"""The tables of each benchmark."""
