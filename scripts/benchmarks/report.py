"""Results as tables of docs/performance.md and docs/notes, and everything else that --docs writes."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from peers.peer import OWN, PEERS

from benchmarks.figures import MEASURED, error_ratio
from benchmarks.measure import MEASURED_FOLDER, ROOT, geometric_mean, table, write_section

PAGE = ROOT / "docs" / "performance.md"
NOTES = ROOT / "docs" / "notes"
PICTURES = ROOT / "docs" / "pictures"
TILE = 220
"""Pixels a side of a picture on the sheet."""

Row = dict[str, Any]


def write_documents(result: Row, pictures: Mapping[str, NDArray[np.float64]]) -> None:
    """Write a result to docs/measured, its tables into the pages that show them, and its plot and pictures."""
    name = result["benchmark"]
    MEASURED_FOLDER.mkdir(parents=True, exist_ok=True)
    (MEASURED_FOLDER / f"{name}.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    for section in SECTIONS[name]:
        write_section(section.page, section.name, section.text(result))
    if f"benchmark-{name}" in MEASURED:
        MEASURED[f"benchmark-{name}"](PICTURES / "plots" / f"benchmark-{name}.png")
    if name == "render" and pictures and all(row["scene"] in pictures for row in result["rows"]):
        write_sheet(result["rows"], pictures)


def write_sheet(rows: list[Row], pictures: Mapping[str, NDArray[np.float64]]) -> None:
    """Write the pictures of what was timed, each as bright as suits it."""
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


def render_text(result: Row) -> str:
    """Return the tables of `render`."""
    rows = result["rows"]
    peers = peers_of(rows)
    return "\n".join(
        [
            paragraph(
                f"On {result['machine']}, {result['cores']} cores, {result['device']}; {versions(rows, peers)}. "
                f"Pictures of {result['size']} x {result['size']} pixels."
            ).rstrip("\n"),
            "",
            speed_table(rows, peers),
            error_table(rows, peers),
            cost_table(rows, peers),
        ]
    )


def gpu_text(result: Row) -> str:
    """Return the tables of `render --device cuda`."""
    rows = result["rows"]
    peers = peers_of(rows)
    about = f"On an {result['gpu']}; {versions(rows, peers)}. Pictures of {result['size']} x {result['size']} pixels."
    parts = [paragraph(about).rstrip("\n"), "", speed_table(rows, peers), start_table(rows, peers)]
    return "\n".join(parts)


def agreement_text(result: Row) -> str:
    """Return the table of `render` that tells whether all renderers made the same picture."""
    return agreement_table(result["rows"], peers_of(result["rows"]))


def peers_of(rows: list[Row]) -> list[str]:
    """Return the renderers that wrt was compared with."""
    return [name for name in PEERS if any("ratio" in row["renderers"].get(name, {}) for row in rows)]


def paragraph(text: str) -> str:
    """Return a text in lines, and an empty one."""
    return textwrap.fill(text, 120, break_on_hyphens=False) + "\n\n"


def versions(rows: list[Row], peers: list[str]) -> str:
    """Return the versions of all that took part."""
    found = []
    for name in peers:
        about = next(row["renderers"][name]["about"] for row in rows if "about" in row["renderers"].get(name, {}))
        found.append(f"{title(name)} {about['version']}")
    return ", ".join(found)


def title(name: str) -> str:
    """Return a renderer's name in tables."""
    return OWN.title if name == OWN.name else PEERS[name].title


def speed_table(rows: list[Row], peers: list[str]) -> str:
    """Return millions of paths a second at equal samples, and how many times as fast wrt is."""
    head = ["scene", "triangles", "depth", "spp", "wrt"]
    head += [text for name in peers for text in (title(name), "ratio")]
    lines = []
    for row in rows:
        line = [f"`{row['scene']}`", f"{row['triangles']:,}", str(row["depth"]), str(row["spp"])]
        line.append(f"{row['renderers'][OWN.name]['paths_per_second'] / 1e6:.2f}")
        for name in peers:
            own = row["renderers"].get(name, {})
            line += [f"{own['paths_per_second'] / 1e6:.2f}", f"{own['ratio']:.2f}"] if "ratio" in own else ["", ""]
        lines.append(line)
    means = [
        [row["renderers"][name]["ratio"] for row in rows if "ratio" in row["renderers"].get(name, {})] for name in peers
    ]
    lines.append(
        ["geometric mean", "", "", "", "", *(text for m in means for text in ("", f"**{geometric_mean(m):.2f}**"))]
    )
    return paragraph("Millions of camera paths a second, and wrt's over the other's:") + table(head, lines)


def error_table(rows: list[Row], peers: list[str]) -> str:
    """Return errors at equal time, and how many times as large those of others are."""
    times = sorted({e["seconds"] for row in rows for e in row["renderers"][OWN.name].get("errors", [])})
    if not times:
        return ""
    names = ["wrt", *(title(name) for name in peers)]
    head = ["scene", *(f"{name}, {seconds:g} s" for name in names for seconds in times)]
    lines = []
    for row in rows:
        ours = {e["seconds"]: e for e in row["renderers"][OWN.name]["errors"]}  # fewer times may have been asked for
        line = [f"`{row['scene']}`"]
        line += [
            f"{100.0 * ours[t]['rmse']:.2f} % ({100.0 * ours[t]['relative']:.2f} %)" if t in ours else "" for t in times
        ]
        for name in peers:
            for seconds in times:
                ratios = [error_ratio(row, name, seconds, key) for key in ("rmse", "relative")]
                line.append("" if math.isnan(ratios[0]) else f"{ratios[0]:.2f} ({ratios[1]:.2f})")
        lines.append(line)
    intro = (
        "Root mean square error of wrt after equal seconds, over the picture's mean, and how many times as large "
        "that of others is; in brackets with every pixel over its own radiance:"
    )
    return paragraph(intro) + table(head, lines)


def cost_table(rows: list[Row], peers: list[str]) -> str:
    """Return memory, and seconds from the shell to a first picture where they were measured."""
    names = [OWN.name, *peers]
    memory = [
        [f"`{row['scene']}`", *(cell(row, name, "peak_bytes", memory_in_words) for name in names)] for row in rows
    ]
    text = paragraph("Most memory at equal samples, MB:") + table(["scene", *map(title, names)], memory)
    starts = start_table(rows, peers)
    return f"{text}\n{starts}" if starts else text


def start_table(rows: list[Row], peers: list[str]) -> str:
    """Return seconds from the shell to a first picture; nothing where none were measured."""
    key = "first_picture_seconds"
    timed = [row for row in rows if key in row["renderers"][OWN.name]]
    if not timed:
        return ""
    names = [OWN.name, *peers]
    first = [[f"`{row['scene']}`", *(cell(row, n, key, start_in_words) for n in names)] for row in timed]
    intro = "Seconds from the shell to a picture of one sample, with nothing compiled / with kernels in the cache:"
    return paragraph(intro) + table(["scene", *map(title, names)], first)


def cell(row: Row, name: str, key: str, in_words: Callable[[Any], str]) -> str:
    """Return a renderer's figure, or nothing where there is none."""
    found = row["renderers"].get(name, {})
    return in_words(found[key]) if key in found else ""


def memory_in_words(count: int) -> str:
    """Return bytes as megabytes."""
    return f"{count / 1e6:.0f}"


def start_in_words(seconds: Row) -> str:
    """Return the seconds to a first picture, cold and warm."""
    return f"{seconds['cold']:.1f} / {seconds['warm']:.2f}"


def agreement_table(rows: list[Row], peers: list[str]) -> str:
    """Return in how far pictures are the same."""
    lines = []
    for row in rows:
        line = [f"`{row['scene']}`"]
        for name in peers:
            found = row["renderers"].get(name, {}).get("agreement")
            line.append("" if found is None else agreement_in_words(found))
        lines.append(line)
    intro = (
        "Are they pictures of the same thing? Pixels within noise (z-test), difference of the mean, of blocks of "
        "16 x 16 pixels (in brackets what noise alone makes), wrt against:"
    )
    return paragraph(intro) + table(["scene", *(title(name) for name in peers)], lines)


def agreement_in_words(found: Row) -> str:
    """Return an agreement as a cell of a table."""
    text = (
        f"{100.0 * found['pass_fraction']:.2f} %, {100.0 * found['mean_difference']:+.2f} %, "
        f"{100.0 * found['block_difference']:.2f} % ({100.0 * found['block_noise']:.2f} %)"
    )
    return text if found["agrees"] else f"**differ:** {text}"


def scaling_text(result: Row) -> str:
    """Return the tables of `scaling`."""
    texts = [f"On {result['machine']}, {result['cores']} cores.\n"]
    for name, found in result["series"].items():
        if name == "samples":
            continue
        head = [name, "M paths/s", "MB at most", "s to build"]
        lines = [
            [
                f"{point[name]:,.0f}",
                f"{point['paths_per_second'] / 1e6:.2f}",
                f"{point['peak_bytes'] / 1e6:.0f}",
                f"{point['build_seconds']:.2f}",
            ]
            for point in found["points"]
        ]
        texts.append(table(head, lines) + "\n" + "; ".join(found["laws"].values()) + ".\n")
    if "samples" in result["series"]:
        found = result["series"]["samples"]
        lines = [
            [f"{p['samples']}", f"{1e3 * p['seconds']:.2f}", f"{p['paths_per_second'] / 1e6:.2f}"]
            for p in found["points"]
        ]
        texts.append(table(["samples in a pass", "ms", "M paths/s"], lines) + f"\n{found['laws']['rate']}.\n")
    return "\n".join(texts)


def compile_text(result: Row) -> str:
    """Return the table of `compile`."""
    lines = [[f"`{row['kernel']}`", f"{row['seconds']:.1f}", f"{row['bytes'] / 1e3:.0f}"] for row in result["rows"]]
    return f"On {result['machine']}.\n\n" + table(["kernel", "seconds", "kB of code"], lines)


def widths_text(result: Row) -> str:
    """Return the table of `widths`: a line for each number of lanes."""
    ratios = {(row["lanes"], row["scene"]): row["ratio"] for row in result["rows"]}
    scenes = list(dict.fromkeys(scene for _, scene in ratios))
    lines = []
    for lanes, target in dict.fromkeys((row["lanes"], row["target"]) for row in result["rows"]):
        own = [ratios[lanes, scene] for scene in scenes]
        lines.append([str(lanes), f"`{target}`", *(f"{ratio:.2f}" for ratio in own), f"**{geometric_mean(own):.2f}**"])
    head = ["lanes", "processor", *(f"`{scene}`" for scene in scenes), "mean"]
    return f"On {result['machine']}; {result['size']} x {result['size']} pixels.\n\n" + table(head, lines)


def profile_text(result: Row) -> str:
    """Return the table of `scripts/profile_cpu.py`: per cent of each phase, the largest first."""
    rows = result["rows"]
    names = {name for row in rows for name in row["phases"]}
    most = {name: max(row["phases"].get(name, 0.0) for row in rows) for name in names}
    shown = sorted((name for name in names if most[name] >= 5e-4), key=lambda name: -most[name])
    lines = [[name, *(f"{100.0 * row['phases'].get(name, 0.0):.1f}" for row in rows)] for name in shown]
    head = ["per cent of the time", *(f"`{row['scene']}`" for row in rows)]
    return f"On {result['machine']}.\n\n" + table(head, lines)


@dataclass(frozen=True)
class Section:
    """A part of a page that is written by a benchmark.

    Attributes:
        page: the file.
        name: the name between the marks where it begins and ends.
        text: returns the part as Markdown.
    """

    page: Path
    name: str
    text: Callable[[Row], str]


def found_text(result: Row) -> str:
    """Return the table of `found`."""
    head = ("scene", "spp", "second render: seconds of CPU, wrt", "Mitsuba", "Mitsuba / wrt", "first render: wrt")
    head += ("Mitsuba / wrt",)
    rows = []
    for row in result["rows"]:
        own, other = row["programs"]["wrt"], row["programs"]["mitsuba"]
        cpu = (f"{own['cpu_seconds']:.2f}", f"{other['cpu_seconds']:.2f}", f"{row['ratio']:.2f}")
        is_first = "first_cpu_seconds" in own  # not where the cache had the scene's kernel already
        first = (f"{own['first_cpu_seconds']:.2f}", f"{_first_ratio(row):.2f}") if is_first else ("", "")
        rows.append((f"`{row['scene']}`", str(row["spp"]), *cpu, *first))
    for spp in dict.fromkeys(row["spp"] for row in result["rows"]):
        chosen = [row for row in result["rows"] if row["spp"] == spp]
        of_second = geometric_mean(row["ratio"] for row in chosen)
        firsts = [_first_ratio(row) for row in chosen if "first_cpu_seconds" in row["programs"]["wrt"]]
        of_first = f"**{geometric_mean(firsts):.2f}**" if firsts else ""
        rows.append(("geometric mean", str(spp), "", "", f"**{of_second:.2f}**", "", of_first))
    said = f"On {result['machine']}, {result['cores']} cores; pictures of {result['size']} x {result['size']} pixels."
    return f"{said}\n\n{table(head, rows)}"


def files_text(result: Row) -> str:
    """Return the tables of `render --files`."""
    rows = result["rows"]
    peers = peers_of(rows)
    size = rows[0]["size"]
    said = f"On {result['machine']}, {result['cores']} cores; pictures of {size} x {size} pixels."
    texts = [speed_table(rows, peers), error_table(rows, peers), agreement_table(rows, peers)]
    return "\n".join([f"{said}\n", *texts])


def _first_ratio(row: Row) -> float:
    """Return Mitsuba's seconds of CPU over those of wrt's first render."""
    ratio: float = row["programs"]["mitsuba"]["cpu_seconds"] / row["programs"]["wrt"]["first_cpu_seconds"]
    return ratio


SECTIONS = {
    "render": (
        Section(PAGE, "render", render_text),
        Section(NOTES / "comparison.md", "agreement", agreement_text),
    ),
    "gpu": (Section(ROOT / "docs" / "gpu.md", "speed", gpu_text),),
    "scaling": (Section(NOTES / "scaling.md", "scaling", scaling_text),),
    "profile": (Section(NOTES / "profile.md", "profile", profile_text),),
    "found": (Section(PAGE, "found", found_text),),
    "files": (Section(NOTES / "comparison.md", "files", files_text),),
    "widths": (Section(PAGE, "widths", widths_text),),
    "compile": (Section(NOTES / "compiling.md", "compile", compile_text),),
}
"""What writes the tables of the documentation, by the benchmark."""
