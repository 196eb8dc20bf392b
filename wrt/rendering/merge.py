"""Merge the parts of a render into its picture."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrt.backend.device import Device
from wrt.develop.picture import Developed
from wrt.errors import InputError
from wrt.io.images import picture_path
from wrt.io.safe_read import PathLike
from wrt.rendering.checkpoint import write_checkpoint
from wrt.rendering.film import Film
from wrt.rendering.film_aovs import Labels
from wrt.rendering.part import Part
from wrt.rendering.picture import Picture
from wrt.rendering.reading import Reading
from wrt.rendering.windows import write_windows
from wrt.scene.developing import DEVELOPED_SUFFIXES, Exposure, names_file

MOST_LISTED = 3
"""Missing parts that a message lists."""


class Merged(Picture):
    """The picture of a render whose parts were merged: that of one machine, bit for bit.

    Attributes:
        settings: the settings of the picture.
        film: its film.
        integrator: the integrator.
        seed: the seed.
        seconds_render: the sum of the seconds of all parts.
    """

    def __init__(self, first: Part, device: Device) -> None:
        """Start with an empty film for the picture of a part."""
        self.settings, self._identity = first.settings, first.header["identity"]
        self.integrator, self.seed = str(self._identity["integrator"]), int(self._identity["seed"])
        x0, y0, x1, y1 = first.window
        layers, groups = self.settings.film_layers, tuple(self._identity["light_groups"])
        self.film = Film(x1 - x0, y1 - y0, device, layers, groups, Reading.of(self.settings))
        self.seconds_render = 0.0
        self._label = first.labels

    @property
    def width(self) -> int:
        """Width of the rendered part of the picture, pixels."""
        return self.film.picture_size[0]

    @property
    def height(self) -> int:
        """Height of the rendered part of the picture, pixels."""
        return self.film.picture_size[1]

    def denoised(self) -> NDArray[np.float32]:
        """Raise InputError, since denoising needs the scene."""
        raise InputError("merged parts are not denoised, which needs the scene; resume from a checkpoint of them")

    def _labels(self) -> Labels:
        return self._label

    def save(
        self, path: PathLike, *, tone: str | None = None, exposure: Exposure = None, force: bool = False
    ) -> Developed | None:
        """Write the picture; see `wrt.Renderer.save`.

        Raises:
            InputError: also if only the parts name a configuration of OpenColorIO, see `require_own_tone`.
        """
        self.require_own_tone(picture_path(path), tone)
        return super().save(path, tone=tone, exposure=exposure, force=force)

    def require_own_tone(self, path: Path, tone: str | None) -> None:
        """Raise InputError if a picture would be developed by a file that only the parts name.

        Parts may come from strangers, and the file would be opened on this machine.
        """
        stored = self.settings.tone
        if tone is None and path.suffix.lower() in DEVELOPED_SUFFIXES and names_file(stored):
            raise InputError(
                f"the parts were rendered with tone {stored!r}, a file, which is opened only where a tone is given "
                "here; give --tone (tone=)"
            )

    def save_checkpoint(self, path: PathLike) -> None:
        """Write a checkpoint, from which `wrt.Renderer.resume` goes on with the scene.

        Raises:
            InputError: when it cannot be written.
        """
        write_checkpoint(path, self._identity, self.film.state())

    def __repr__(self) -> str:
        return f"<wrt.Merged {self.width}x{self.height} {self.integrator}, {self.spp} spp>"


def merge(parts: Iterable[PathLike | Part]) -> Merged:
    """Return the picture of all parts of a render, from `wrt.Renderer.part` or `wrt render --part`.

    Args:
        parts: the parts, or the paths of their files, in any order.

    Raises:
        InputError: naming a part that is damaged, missing or repeated, or that is of another picture, version of wrt,
            number of samples, device or kind of processor.
    """
    sources = list(parts)
    if not sources:
        raise InputError("there are no parts to merge")
    first = _loaded(sources[0])
    names: dict[int, str] = {}
    if first.of > len(sources):  # a small file may claim to be a part of a picture too large for the memory
        for source in sources:
            _add_name(_loaded(source), first, names)
        _require_all(names, first.of)
    merged, names = Merged(first, Device("cpu", threads=1)), {}
    state = merged.film.state()
    for part in itertools.chain([first], map(_loaded, sources[1:])):
        _add_name(part, first, names)
        try:
            merged.film.check(part.arrays, len(first.labels.objects), pixels=len(part.arrays["count"]))
        except InputError as error:
            raise InputError(f"{part.name}: damaged, {error}") from None
        for name, array in state.items():
            write_windows(array, first.window, part.windows, part.arrays[name])
        merged.seconds_render += float(part.header["seconds"])
    merged.film.restore(state)
    return merged


def _loaded(part: PathLike | Part) -> Part:
    return part if isinstance(part, Part) else Part.load(part)


def _add_name(part: Part, first: Part, names: dict[int, str]) -> None:
    """Add a part's name to those by number; raise InputError unless it fits the first part and is not repeated."""
    what = f"does not fit {first.name}, these differ"
    part.require_fit(first.header, what=what, pair="{}, not {}")
    for label, value, expected in (("samples per pixel", part.spp, first.spp), ("number of parts", part.of, first.of)):
        if value != expected:
            raise InputError(f"{part.name}: {what}: {label} ({value}, not {expected})")
    if part.header["labels"] != first.header["labels"]:
        raise InputError(f"{part.name}: {what}: names of objects or materials")
    if part.number in names:
        pair = f"{names[part.number]} and {part.name}"
        raise InputError(f"{pair} are the same part, {part.number} of {part.of}; leave one out")
    names[part.number] = part.name


def _require_all(names: dict[int, str], of: int) -> None:
    missing = of - len(names)
    if missing:
        listed = itertools.islice((number for number in range(1, of + 1) if number not in names), MOST_LISTED)
        further = f" and {missing - MOST_LISTED} more" if missing > MOST_LISTED else ""
        parts, are = ("part", "is") if missing == 1 else ("parts", "are")
        raise InputError(f"{parts} {', '.join(map(str, listed))}{further} of {of} {are} missing")
