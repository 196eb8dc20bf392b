"""A part of a render: the film of some of its pixels, and a header that identifies the render.

The file has the layout of a checkpoint, with another header: `part` (number and count), `wrt`, `identity` as in
checkpoints, `arithmetic` (see `wrt.backend.processor`), `developing` (how the picture becomes 8 bits), `labels`
(what numbers in layers stand for), `spp` and `seconds`. The windows of its pixels follow from its number.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt._version import __version__
from wrt.backend.processor import arithmetic_of
from wrt.errors import InputError
from wrt.io.safe_read import PathLike, first_line
from wrt.rendering.checkpoint import (
    NUMBERS,
    SETTINGS_OF_PICTURE,
    identity_of,
    kind_of_state,
    read_state,
    require_same,
    write_state,
)
from wrt.rendering.film_aovs import Labels, labels_of
from wrt.rendering.passes import LONGEST_PASS, Progress
from wrt.rendering.reading import window_of
from wrt.rendering.windows import pixels_of, windows_of_part
from wrt.scene.description import group_name
from wrt.scene.scene import MAX_SPP, RenderSettings
from wrt.upload.camera import CropWindow
from wrt.values import integer, number

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer

PART = kind_of_state("a part", "part")
"""A part replaces only parts, even with `force`."""

DEVELOPING = ("tone", "exposure", "denoise", "edge_color")
"""Settings by which a picture is developed; parts store them, since they are merged without the scene."""


@dataclass(frozen=True)
class Part:
    """A part of a render, see `wrt.Renderer.part`.

    Attributes:
        name: its file, or its number, for messages.
        header: the header of its file.
        arrays: the arrays of a film, `wrt.rendering.film.Film.state`, for the pixels of its windows in turn.
    """

    name: str
    header: dict[str, Any]
    arrays: dict[str, NDArray[Any]]

    @property
    def number(self) -> int:
        """Which part it is, from 1."""
        return int(self.header["part"][0])

    @property
    def of(self) -> int:
        """How many parts the picture has."""
        return int(self.header["part"][1])

    @property
    def spp(self) -> int:
        """Samples in each pixel."""
        return int(self.header["spp"])

    @property
    def settings(self) -> RenderSettings:
        """The settings of the picture."""
        identity = self.header["identity"]
        stored = {name: identity[name] for name in SETTINGS_OF_PICTURE}
        if NUMBERS in identity:  # merging needs no user-defined integrator
            group_name(identity["integrator"], "integrator")
            stored["integrator"] = None
        return RenderSettings(**stored, **{name: self.header["developing"][name] for name in DEVELOPING})

    @property
    def window(self) -> CropWindow:
        """The window of the film that all parts cover."""
        return window_of(self.settings)

    @property
    def labels(self) -> Labels:
        """What the numbers in its layers stand for."""
        return Labels(**self.header["labels"])

    @property
    def windows(self) -> tuple[CropWindow, ...]:
        """The windows of its pixels, in pixels of the whole picture."""
        return windows_of_part(self.window, self.number, self.of)

    def save(self, path: PathLike) -> None:
        """Write the part; an existing file is replaced only if it is a part.

        Raises:
            InputError: when it cannot be written.
        """
        write_state(path, self.header, self.arrays, PART)

    @classmethod
    def load(cls, path: PathLike) -> Part:
        """Read a part.

        Raises:
            InputError: when the file is not a part, is damaged, or is of another version of wrt.
        """
        header, arrays = read_state(path, "part")
        if "part" not in header:
            raise InputError(f"{path}: not a part, which wrt render --part writes")
        if header.get("wrt") != __version__:
            raise InputError(f"{path}: a part of wrt {header.get('wrt')}; this is wrt {__version__}")
        try:
            part = cls(str(path), header, arrays)
            part._check()
        except KeyError as error:
            raise InputError(f"{path}: damaged (it has no {error})") from None
        except (TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path}: damaged ({first_line(error)})") from None
        return part

    def _check(self) -> None:
        """Raise an error if the header lacks an entry that `render_part` writes, or has an impossible one."""
        header = self.header
        for key in ("identity", "arithmetic", "developing", "labels"):
            if not isinstance(header[key], dict):
                raise InputError(f"its {key!r} is no table")
        if not isinstance(header["part"], list) or len(header["part"]) != 2:
            raise InputError("its 'part' is not a pair of numbers")
        for value in header["part"]:
            integer(value, "the number of a part", minimum=1, maximum=2**31 - 1)
        integer(header["spp"], "its samples per pixel", minimum=1, maximum=MAX_SPP)
        number(header["seconds"], "its seconds", minimum=0.0)
        for group in header["identity"]["light_groups"]:
            group_name(group, "the name of a light group")
        integer(header["identity"]["seed"], "its seed", minimum=0, maximum=2**32 - 1)
        pixels = pixels_of(self.windows)
        for name in ("total", "count"):
            if len(self.arrays[name]) != pixels:
                raise InputError(f"its array {name!r} is not of {pixels} pixels")
        self._check_labels()
        if (self.arrays["count"] != self.spp).any():
            raise InputError(f"not all its pixels have {self.spp} samples")

    def _check_labels(self) -> None:
        labels = self.labels
        for names in (labels.objects, labels.material_names):
            if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
                raise InputError("its names are not a list of text")
        if not isinstance(labels.materials, list) or len(labels.materials) != len(labels.objects):
            raise InputError("its objects have not as many materials as names")
        for each in labels.materials:
            integer(each, "the number of a material", minimum=1, maximum=len(labels.material_names))

    def require_fit(self, header: dict[str, Any], *, what: str, pair: str) -> None:
        """Raise InputError unless its picture and the arithmetic of its digits are those of a header.

        Args:
            header: of another part.
            what: the beginning of the message, after the part's name.
            pair: see `wrt.rendering.checkpoint.require_same`.
        """
        stored, expected = ({**each["identity"], **each["arithmetic"]} for each in (self.header, header))
        require_same(self.name, stored, expected, what=what, pair=pair)


def render_part(
    renderer: Renderer,
    number: int,
    of: int,
    *,
    spp: int | None = None,
    begun: Part | None = None,
    watch: Callable[[int, Progress], object] = lambda window, progress: None,
) -> Part:
    """Render part `number` of `of` of a renderer's picture, whose own film is not touched.

    Args:
        renderer: the renderer.
        number: which part, from 1.
        of: how many parts the picture has.
        spp: samples per pixel; by default those of the settings.
        begun: the same part with fewer samples, to go on from.
        watch: called after each pass with the number of the window, from 0, and its progress.

    Raises:
        InputError: if there is no such part, or `begun` is of another picture or has more samples.
    """
    if renderer.has_updated_vertices:
        raise InputError("no part of a picture whose vertices were updated; make a new Renderer")
    if renderer._catchers is not None:
        raise InputError("no part of a picture with shadow catchers: merging would need the scene; render it whole")
    if spp is None and renderer.settings.noise is not None:
        raise InputError("the scene sets a target of noise, which is for whole pictures; give the samples of a part")
    spp = integer(renderer.settings.spp if spp is None else spp, "spp", minimum=1, maximum=MAX_SPP)
    windows = windows_of_part(renderer.window, number, of)
    header: dict[str, Any] = {
        "part": [number, of],
        "wrt": __version__,
        "identity": identity_of(renderer),
        "arithmetic": arithmetic_of(renderer.device),
        "developing": {name: getattr(renderer.settings, name) for name in DEVELOPING},
        "labels": asdict(labels_of(renderer.scene.shapes)),
        "spp": spp,
    }
    header = json.loads(json.dumps(header))  # as it will be read
    seconds = 0.0
    if begun is not None:
        if (begun.number, begun.of) != (number, of):
            raise InputError(f"{begun.name}: cannot resume, it is part {begun.number} of {begun.of}")
        begun.require_fit(header, what="cannot resume, these differ", pair="{} there, {} here")
        if begun.spp > spp:
            raise InputError(f"{begun.name}: cannot resume, it has {begun.spp} samples per pixel, more than {spp}")
        seconds = begun.header["seconds"]
    films: list[dict[str, NDArray[Any]]] = []
    first = 0
    for index, window in enumerate(windows):
        one = renderer.of_window(window)
        if begun is not None:
            one.film.restore({name: array[first : first + one.film.pixels] for name, array in begun.arrays.items()})
        first += one.film.pixels
        for progress in one.passes(spp=spp, pass_seconds=LONGEST_PASS):
            watch(index, progress)
        films.append(one.film.arrays())
        seconds += one.seconds_render
    arrays = {name: np.concatenate([film[name] for film in films]) for name in films[0]}
    return Part(f"part {number} of {of}", {**header, "seconds": seconds}, arrays)


def default_name(source: str, number: int, of: int) -> str:
    """Return the default name of a part's file, which sorts by number."""
    return f"{Path(source).stem or 'picture'}-{number:0{len(str(of))}d}-of-{of}.wrt"
