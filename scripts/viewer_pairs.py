#!/usr/bin/env python3
"""Lay pictures that wrt makes of files beside those that other programs made, for looking at and in numbers.

Each pair is a file, a picture of it, and the view from which that was taken: AZIMUTH,ELEVATION in degrees. Samples of
glTF have such pictures of a browser's viewer beside them. Nothing but the view is set, and nothing is fetched.

    scripts/viewer_pairs.py pairs.png Mixer.glb:rr-Mixer-0.png:35,15 BoomBox.glb:screenshot.jpg:150,20

With --scenarios there are several pictures of each file, by the cameras that Khronos' glTF-Render-Fidelity lists in its
config.json. The pictures are in GOLDENS/NAME/VIEWER-golden.*, and the files anywhere below MODELS.

    scripts/viewer_pairs.py all.png --scenarios config.json --goldens GOLDENS --models MODELS --only 'Duck|Helmet'

Under each picture stand its means over what wrt says the object covers: lightness of CIELAB and chroma. --environment,
--tone and --exposure render as a viewer does instead of as by default, which tests materials.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

import wrt
from wrt.develop.exposure import stops
from wrt.develop.picture import develop_image
from wrt.io.load_mesh import load_file
from wrt.scene.srgb import linear_from_srgb

LINE = 14
"""Height of the text under a picture, in pixels."""

COVERED = 0.99
"""Least alpha of pixels that count, in wrt's picture and in the other."""


@dataclasses.dataclass(frozen=True)
class Orbit:
    """A camera around a point, as viewers of glTF name it.

    Attributes:
        theta, phi: azimuth from +z towards +x, and angle from +y; degrees.
        radius: distance from the target, in the file's unit.
        target: the point in the middle of the picture, (3,).
        fov: full vertical field of view, degrees.
    """

    theta: float
    phi: float
    radius: float
    target: tuple[float, float, float]
    fov: float

    def camera(self, factor: float) -> wrt.PerspectiveCamera:
        """Return the camera for a scene that is `factor` times as large as the file."""
        theta, phi = math.radians(self.theta), math.radians(self.phi)
        toward = np.array([math.sin(phi) * math.sin(theta), math.cos(phi), math.sin(phi) * math.cos(theta)])
        target = factor * np.array(self.target)
        origin = target + factor * self.radius * toward
        return wrt.PerspectiveCamera(origin=tuple(origin), target=tuple(target), fov_degrees=self.fov)


@dataclasses.dataclass(frozen=True)
class Subject:
    """A file, how it is looked at, and pictures of it.

    Attributes:
        name: for captions.
        file: path of the file.
        pictures: those of other programs, by the program's name.
        view: azimuth and elevation, if they are known.
        orbit: the camera itself, if it is known.
        aspect: width of the pictures over their height.
    """

    name: str
    file: Path
    pictures: dict[str, Path]
    view: tuple[float, float] | None = None
    orbit: Orbit | None = None
    aspect: float = 1.0


def subject_of_pair(text: str) -> Subject:
    """Return the subject of FILE:PICTURE[:AZIMUTH,ELEVATION]."""
    file, reference, *view = text.split(":")
    angles = tuple(float(each) for each in view[0].split(",")) if view else None
    return Subject(Path(file).stem, Path(file), {"the other": Path(reference)}, angles)  # type: ignore[arg-type]


def subjects_of_scenarios(config: Path, goldens: Path, models: Path, only: str) -> Iterator[Subject]:
    """Yield the scenarios of a configuration of glTF-Render-Fidelity whose file and pictures are there."""
    for each in json.loads(config.read_text("utf-8"))["scenarios"]:
        if not re.search(only, each["name"]):
            continue
        name = Path(each["model"]).stem
        files = sorted(path for path in models.rglob(f"{name}.gl*") if path.suffix in (".glb", ".gltf"))
        pictures = {path.name.partition("-golden")[0]: path for path in sorted((goldens / each["name"]).glob("*"))}
        if not files or not pictures:
            continue
        orbit, target, size = each["orbit"], each["target"], each["dimensions"]
        place = (target["x"], target["y"], target["z"])
        yield Subject(
            each["name"].removeprefix("khronos-"),
            files[0],
            pictures,
            (orbit["theta"], 90.0 - orbit["phi"]),
            Orbit(orbit["theta"], orbit["phi"], orbit["radius"], place, each["verticalFoV"]),
            size["width"] / size["height"],
        )


def loaded(subject: Subject, **options: Any) -> wrt.Scene:
    """Return the scene of a subject, with its own camera where that is known."""
    if subject.view is not None:
        options["view"] = subject.view
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = wrt.load(subject.file, aspect=subject.aspect, **options)
        if subject.orbit is None:
            return scene
        raw = load_file(subject.file)
    shown = wrt.Scene(shapes=scene.shapes[: len(raw.shapes)])
    factor = float(np.ptp(shown.bounds, axis=0).max() / np.ptp(raw.bounds, axis=0).max())
    return dataclasses.replace(scene, camera=subject.orbit.camera(factor))


def rendered(scene: wrt.Scene, width: int, height: int, spp: int) -> wrt.Renderer:
    """Return the Renderer of a finished picture."""
    renderer = wrt.Renderer(scene, width=width, height=height)
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


def lightness_and_chroma(picture: NDArray[np.uint8], where: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the means over some pixels in CIELAB (CIE 15:2004), of the white of sRGB."""
    lab = cielab(picture[where])
    return float(lab[:, 0].mean()), float(np.hypot(lab[:, 1], lab[:, 2]).mean())


def cielab(codes: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return (..., 3) lightness, a and b of sRGB codes (CIE 15:2004), of the white of sRGB."""
    xyz = linear_from_srgb(codes / 255.0) @ np.array(
        [[0.4124, 0.2126, 0.0193], [0.3576, 0.7152, 0.1192], [0.1805, 0.0722, 0.9505]]
    )
    ratio = xyz / (0.9505, 1.0, 1.089)
    f = np.where(ratio > 216 / 24389, np.cbrt(ratio), (24389 / 27 * ratio + 16) / 116)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def fitted(path: Path, subject: Subject, width: int, height: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return a picture at a size, on white, and where it is opaque; of unknown cameras the middle square."""
    with Image.open(path) as opened:
        picture = opened.convert("RGBA")
    if subject.orbit is None:
        side = min(picture.size)
        left, top = (picture.width - side) // 2, (picture.height - side) // 2
        picture = picture.crop((left, top, left + side, top + side))
    picture = picture.resize((width, height), Image.Resampling.LANCZOS)
    white = Image.new("RGBA", picture.size, (255, 255, 255, 255))
    codes = np.asarray(Image.alpha_composite(white, picture).convert("RGB"))
    return codes, np.asarray(picture)[..., 3] >= COVERED * 255.0


def compared(subject: Subject, options: argparse.Namespace) -> tuple[Any, dict[str, tuple[float, float]]]:
    """Return all pictures of a subject in a row, and lightness and chroma by the program's name."""
    height = options.size
    width = round(height * subject.aspect)
    given = {} if options.environment is None else {"environment": options.environment, "transparent": True}
    ours = rendered(loaded(subject, **given), width, height, options.spp)
    alone = ours if given else rendered(loaded(subject, transparent=True), width, height, 4)
    alpha = alone.alpha()
    covered = np.zeros((height, width), bool) if alpha is None else alpha > COVERED
    image = ours.image()
    exposure = stops(image, None) if options.exposure is None else options.exposure
    codes = develop_image(image, tone=options.tone, exposure=exposure)
    if given and alpha is not None:
        codes = np.where(covered[..., None], codes, 255).astype(np.uint8)
    rows = {"wrt": codes}
    for name, path in subject.pictures.items():
        if re.fullmatch(options.viewers, name):
            rows[name], opaque = fitted(path, subject, width, height)
            if subject.orbit is not None:  # what an animation or an older file has elsewhere does not count
                covered = covered & opaque
    means = {name: lightness_and_chroma(row, covered) for name, row in rows.items()}
    sheet = Image.new("RGB", (len(rows) * width, height + LINE), (255, 255, 255))
    for k, (name, row) in enumerate(rows.items()):
        sheet.paste(Image.fromarray(row), (k * width, 0))
        caption = f"{subject.name}, {name}: L {means[name][0]:.0f} C {means[name][1]:.0f}"
        ImageDraw.Draw(sheet).text((k * width + 2, height), caption, fill=(0, 0, 0))
    return sheet, means


def laid_out(sheets: Sequence[Any]) -> Any:
    """Return rows of pictures as one picture; pairs stand two in a row."""
    columns = 2 if len({sheet.size for sheet in sheets}) == 1 and sheets[0].width < 3 * sheets[0].height else 1
    width, height = max(sheet.width for sheet in sheets), max(sheet.height for sheet in sheets)
    whole = Image.new("RGB", (min(columns, len(sheets)) * width, -(-len(sheets) // columns) * height), (255, 255, 255))
    for k, each in enumerate(sheets):
        whole.paste(each, (k % columns * width, k // columns * height))
    return whole


def table(found: dict[str, dict[str, tuple[float, float]]]) -> str:
    """Return lightness and chroma of wrt, and the least, median and greatest of the others, in Markdown."""
    lines = ["| file | viewers | L: wrt | L: others | C: wrt | C: others |", "| --- | --- | --- | --- | --- | --- |"]
    for name, means in found.items():
        others = np.array([value for key, value in means.items() if key != "wrt"])
        spans = [f"{each.min():.0f} to {each.max():.0f}, median {np.median(each):.0f}" for each in others.T]
        light, chroma = means["wrt"]
        lines.append(f"| `{name}` | {len(others)} | {light:.0f} | {spans[0]} | {chroma:.0f} | {spans[1]} |")
    return "\n".join(lines) + "\n"


def parse_arguments(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path, help="the picture of all pairs")
    parser.add_argument("pairs", nargs="*", metavar="FILE:PICTURE[:AZIMUTH,ELEVATION]")
    parser.add_argument("--scenarios", type=Path, metavar="CONFIG", help="cameras, as glTF-Render-Fidelity lists them")
    parser.add_argument("--goldens", type=Path, metavar="FOLDER", help="with --scenarios: the pictures")
    parser.add_argument("--models", type=Path, metavar="FOLDER", help="with --scenarios: the files")
    parser.add_argument("--only", metavar="REGEX", default="", help="with --scenarios: those whose name matches")
    parser.add_argument("--viewers", metavar="REGEX", default=".*", help="other programs whose name matches")
    parser.add_argument("--environment", metavar="FILE", help="light by an image alone, without floor and lamp")
    parser.add_argument("--tone", default="soft", help="tone curve of wrt's pictures; default: soft")
    parser.add_argument("--exposure", type=float, help="stops of wrt's pictures; default: as wrt render chooses")
    parser.add_argument("--size", type=int, default=256, help="rows of a picture; default: 256")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel; default: 64")
    options = parser.parse_args(arguments)
    if options.scenarios is None and not options.pairs:
        parser.error("name pairs, or --scenarios")
    if options.scenarios is not None and (options.goldens is None or options.models is None):
        parser.error("--scenarios needs --goldens and --models")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Render, write the picture of all pairs, and print what is written under each, and the table."""
    options = parse_arguments(arguments)
    subjects = [subject_of_pair(text) for text in options.pairs]
    if options.scenarios is not None:
        subjects += subjects_of_scenarios(options.scenarios, options.goldens, options.models, options.only)
    sheets, found = [], {}
    for subject in subjects:
        sheet, found[subject.name] = compared(subject, options)
        print(f"{subject.name}: " + "; ".join(f"{k} L {v[0]:.1f} C {v[1]:.1f}" for k, v in found[subject.name].items()))
        sys.stdout.flush()
        sheets.append(sheet)
        laid_out(sheets).save(options.out)
    print(table(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
