#!/usr/bin/env python3
"""Load all Mitsuba scenes of a folder, and compare their pictures with Mitsuba's.

For each scene it tells whether wrt reads it as it is, with warnings, or not. With --compare both programs render it
at small size: blocks of pixels are compared by Welch's t-test with Sidak's correction, and the mean by its standard
error. It fetches nothing. Mitsuba's own scenes are the folder `docs/scenes` of the repository mitsuba-data.

    scripts/foreign_scenes.py mitsuba-data/docs/scenes --compare --table docs/measured/mitsuba-scenes.md

Files that others include, or that lack what an including file defines, are no scenes and are left out. The exit status
is 1 if anything other than an InputError came out of a file, or if a picture read without a warning disagrees.
"""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt

BLOCK = 8
"""Side of the blocks that are compared, in pixels: wide enough that few samples are shared through filters."""

BORDER = 2
"""Pixels at the edges that are not compared. Mitsuba takes no samples beyond the film, wrt does where the filter
reaches there; both programs' widest default filter, Gaussian, has a radius of 2."""

RUNS = 16
"""Independent renderings by Mitsuba, whose spread is its error."""

SIGNIFICANCE = 0.01
"""Of one scene, over all its blocks."""

LEAST_SHARE, MOST_ERRORS, MOST_DIFFERENCE = 0.995, 3.0, 0.002
"""Share of blocks that must pass, and how far the mean may differ: in standard errors, or relatively."""


@dataclasses.dataclass
class Verdict:
    """What became of a scene.

    Attributes:
        name: its path in the folder.
        state: "as it is", "with warnings", "refused" or "broken".
        messages: warnings, or the reason.
        agreement: of the pictures, in words; empty where they were not compared.
        differs: whether the pictures disagree.
    """

    name: str
    state: str
    messages: list[str] = dataclasses.field(default_factory=list)
    agreement: str = ""
    differs: bool = False


def scenes(folder: Path) -> list[Path]:
    """Return the scene files under a folder that no other file includes."""
    files = sorted(folder.rglob("*.xml"))
    included = set()
    for file in files:
        for name in re.findall(r'<include\s+filename\s*=\s*"([^"]+)"', file.read_text("utf-8", "replace")):
            included.add((file.parent / name).resolve())
    # Parts of scenes may be included by a name made of parameters; such folders say what they are.
    return [file for file in files if file.resolve() not in included and file.parent.name != "include"]


def parameters_of(path: Path) -> dict[str, str]:
    """Return values for the parameters that a scene needs and does not define."""
    text = path.read_text("utf-8", "replace")
    needed = {"spp": "16", "resx": "256", "resy": "256", "width": "256", "height": "256", "max_depth": "6"}
    used = {a or b for a, b in re.findall(r"\$(?:\{(\w+)\}|(\w+))", text)}
    return {name: value for name, value in needed.items() if name in used and f'<default name="{name}"' not in text}


def examined(path: Path, folder: Path) -> tuple[Verdict, wrt.Scene | None]:
    """Load one scene."""
    name = str(path.relative_to(folder))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            scene = wrt.load(path, parameters=parameters_of(path))
        except wrt.InputError as error:
            return Verdict(name, "refused", [_short(str(error), path)]), None
        except Exception as error:  # noqa: BLE001 - anything else is a mistake of wrt, to be reported with the rest
            return Verdict(name, "broken", [repr(error)]), None
    messages = list(dict.fromkeys(_short(str(each.message), path) for each in caught))
    return Verdict(name, "with warnings" if messages else "as it is", messages), scene


def _short(message: str, path: Path) -> str:
    message = message.replace(f"{path.parent}/", "")
    return re.sub(r"^\S+: line \d+: ", "", message)


def compare(verdict: Verdict, scene: wrt.Scene, path: Path, *, height: int, spp: int, variant: str) -> None:
    """Render a scene by wrt and by Mitsuba, and note how they compare."""
    if scene.settings.integrator not in (None, "path", "direct"):
        return
    settings = scene.settings
    width = max(BLOCK, round(height * settings.width / settings.height / BLOCK) * BLOCK)
    # Another shape of the picture would show more or less of the scene, in either program.
    height = max(1, round(width * settings.height / settings.width))
    if settings.crop is not None:
        return
    try:
        theirs = _by_mitsuba(path, width, height, spp, variant)
    except Exception as error:  # noqa: BLE001 - Mitsuba raises RuntimeError and others on what a variant lacks
        verdict.agreement = f"Mitsuba cannot render it: {str(error).strip().splitlines()[-1][:80]}"
        return
    scene.settings = dataclasses.replace(settings, width=width, height=height, sampler="independent")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        renderer = wrt.Renderer(scene, seed=1)
        for _ in renderer.passes(spp=spp):
            pass
    judge(verdict, renderer.image(), renderer.variance(), theirs)


def _by_mitsuba(path: Path, width: int, height: int, spp: int, variant: str) -> NDArray[np.float64]:
    """Return (RUNS, height, width, 3) independent renderings."""
    import mitsuba as mi

    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Error)
    scene = mi.load_file(str(path), **parameters_of(path))
    sensor = scene.sensors()[0]
    parameters = mi.traverse(sensor)
    parameters["film.size"] = [width, height]
    parameters["film.crop_size"] = [width, height]
    parameters.update()
    images = [
        np.array(mi.render(scene, sensor=sensor, spp=max(1, spp // RUNS), seed=1_000_003 * (run + 1)), np.float64)
        for run in range(RUNS)
    ]
    return np.stack(images)[..., :3]


def judge(verdict: Verdict, ours: NDArray[Any], variance: NDArray[Any], theirs: NDArray[np.float64]) -> None:
    """Compare a picture and the variance of its pixels with several independent ones."""
    from scipy.stats import t

    inner = slice(BORDER, -BORDER)
    ours, variance, theirs = ours[inner, inner], variance[inner, inner], theirs[:, inner, inner]
    mean, error = float(ours.mean()), float(np.sqrt(variance.sum()) / ours.size)
    means = theirs.mean(axis=(1, 2, 3))
    their_mean, their_error = float(means.mean()), float(means.std(ddof=1) / np.sqrt(RUNS))
    relative = mean / their_mean - 1.0
    errors = abs(mean - their_mean) / max(np.hypot(error, their_error), 1e-12)

    blocks = np.stack([_blocks(run) for run in theirs])
    spread = blocks.var(axis=0, ddof=1) / RUNS
    own = _blocks(variance) / BLOCK**2
    total = spread + own
    sure = total > 0.0
    difference = np.abs(_blocks(ours) - blocks.mean(axis=0))
    freedom = total[sure] ** 2 / np.maximum(spread[sure] ** 2 / (RUNS - 1), 1e-300)
    p = 2.0 * t.sf(difference[sure] / np.sqrt(total[sure]), np.minimum(freedom, 1e9))
    passed = np.zeros(difference.shape, bool)
    passed[sure] = p > 1.0 - (1.0 - SIGNIFICANCE) ** (1.0 / max(1, p.size))
    # Where nothing is random, filters and rounding are all that differs.
    share = float((passed | (difference <= MOST_DIFFERENCE * np.maximum(blocks.mean(axis=0), 1e-3))).mean())
    verdict.differs = share < LEAST_SHARE or (errors > MOST_ERRORS and abs(relative) > MOST_DIFFERENCE)
    word = "differs" if verdict.differs else "agrees"
    verdict.agreement = f"{word}: mean {100.0 * relative:+.2f} % ({errors:.1f} σ), {100.0 * share:.1f} % of blocks"


def _blocks(image: NDArray[Any]) -> NDArray[np.float64]:
    """Return the means of whole blocks."""
    rows, columns = image.shape[0] // BLOCK, image.shape[1] // BLOCK
    whole = np.asarray(image, np.float64)[: rows * BLOCK, : columns * BLOCK]
    return np.asarray(whole.reshape(rows, BLOCK, columns, BLOCK, 3).mean(axis=(1, 3)))


def table(verdicts: Sequence[Verdict]) -> str:
    """Return the verdicts as a table in Markdown."""
    lines = ["| scene | read | picture | remarks |", "| --- | --- | --- | --- |"]
    for each in verdicts:
        remarks = "; ".join(each.messages).replace("|", "\\|")
        lines.append(f"| `{each.name.removesuffix('.xml')}` | {each.state} | {each.agreement or '-'} | {remarks} |")
    return "\n".join(lines) + "\n"


def parse_arguments(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of Mitsuba scenes")
    parser.add_argument("--only", metavar="REGEX", default="", help="scenes whose path matches")
    parser.add_argument("--compare", action="store_true", help="render them by wrt and Mitsuba")
    parser.add_argument("--height", type=int, default=48, help="rows of the pictures; default: 48")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel; default: 256")
    parser.add_argument("--variant", default="scalar_rgb", help="variant of Mitsuba; default: scalar_rgb")
    parser.add_argument("--table", type=Path, metavar="FILE", help="write the verdicts as Markdown")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine the scenes, print a line for each, and return the exit status."""
    options = parse_arguments(arguments)
    if not options.folder.is_dir():
        sys.exit(f"{options.folder}: not a folder")
    verdicts = []
    for path in scenes(options.folder):
        if not re.search(options.only, str(path.relative_to(options.folder))):
            continue
        verdict, scene = examined(path, options.folder)
        if scene is not None and options.compare:
            compare(verdict, scene, path, height=options.height, spp=options.spp, variant=options.variant)
        verdicts.append(verdict)
        print(f"{verdict.name}: {verdict.state}; {verdict.agreement} {'; '.join(verdict.messages)}", flush=True)
    counts = {state: sum(each.state == state for each in verdicts) for state in sorted({v.state for v in verdicts})}
    print(f"{len(verdicts)} scenes: {', '.join(f'{count} {state}' for state, count in counts.items())}")
    if options.table is not None:
        options.table.write_text(table(verdicts), "utf-8")
    return int(any(v.state == "broken" or (v.differs and v.state == "as it is") for v in verdicts))


if __name__ == "__main__":
    sys.exit(main())
