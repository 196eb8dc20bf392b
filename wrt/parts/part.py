"""A part of a render: the film of some of its pixels, and a header that identifies the render.

The file has the layout of a checkpoint, with another header: `part` (number and count), `wrt`, `identity` as in
checkpoints, `arithmetic` (see `wrt.backend.processor`), `developing` (how the picture becomes 8 bits), `spp` and
`seconds`. The windows of its pixels follow from its number.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt._version import __version__
from wrt.backend.processor import arithmetic_of
from wrt.errors import InputError
from wrt.io.safe_read import PathLike, first_line
from wrt.parts.cut import pixels_of, windows_of_part
from wrt.rendering.checkpoint import (
    SETTINGS_OF_PICTURE,
    identity_of,
    kind_of_state,
    read_state,
    require_same,
    write_state,
)
from wrt.rendering.renderer import Renderer
from wrt.scene.scene import MAX_SPP, RenderSettings
from wrt.upload.camera import CropWindow
from wrt.values import integer, number

PART = kind_of_state("a part", "part")
"""A part replaces only parts, even with `force`."""

DEVELOPING = ("tone", "exposure", "denoise")
"""Settings by which a picture is developed; parts store them, since they are merged without the scene."""

MATERIALS = "materials"
"""The name in files of the array with the material numbers of the scene's shapes."""


@dataclass(frozen=True)
class Part:
    """A part of a render, see `wrt.Renderer.part`.

    Attributes:
        name: its file, or its number, for messages.
        header: the header of its file.
        arrays: the arrays of a film, `wrt.rendering.film.Film.state`, for the pixels of its windows in turn.
        materials: the material numbers of the scene's shapes.
    """

    name: str
    header: dict[str, Any]
    arrays: dict[str, NDArray[Any]]
    materials: NDArray[np.int32]

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
        return RenderSettings(**stored, **{name: self.header["developing"][name] for name in DEVELOPING})

    @property
    def crop(self) -> CropWindow:
        """The window that all parts cover."""
        settings = self.settings
        return settings.crop or (0, 0, settings.width, settings.height)

    @property
    def windows(self) -> tuple[CropWindow, ...]:
        """The windows of its pixels, in pixels of the whole picture."""
        return windows_of_part(self.crop, self.number, self.of)

    def save(self, path: PathLike) -> None:
        """Write the part; an existing file is replaced only if it is a part.

        Raises:
            InputError: when it cannot be written.
        """
        write_state(path, self.header, {**self.arrays, MATERIALS: self.materials}, PART)

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
            part = cls(str(path), header, arrays, arrays.pop(MATERIALS))
            part._check()
        except KeyError as error:
            raise InputError(f"{path}: damaged (it has no {error})") from None
        except (TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path}: damaged ({first_line(error)})") from None
        return part

    def _check(self) -> None:
        """Raise an error if the header or the number of pixels is impossible."""
        _check_header(self.header)
        pixels = pixels_of(self.windows)
        for name in ("total", "count"):
            if len(self.arrays[name]) != pixels:
                raise InputError(f"its array {name!r} is not of {pixels} pixels")
        if self.materials.ndim != 1 or self.materials.dtype != np.int32:
            raise InputError("its numbers of materials are of another shape")
        if (self.arrays["count"] != self.spp).any():
            raise InputError(f"not all its pixels have {self.spp} samples")

    def require_fit(self, header: dict[str, Any], *, what: str, pair: str) -> None:
        """Raise InputError unless its picture and the arithmetic of its digits are those of a header.

        Args:
            header: of another part, or as `header_of` makes it.
            what: the beginning of the message, after the part's name.
            pair: see `wrt.rendering.checkpoint.require_same`.
        """
        stored, expected = ({**each["identity"], **each["arithmetic"]} for each in (self.header, header))
        require_same(self.name, stored, expected, what=what, pair=pair)


def _check_header(header: dict[str, Any]) -> None:
    """Raise KeyError or InputError unless a header has the entries that `render_part` writes."""
    for key in ("identity", "arithmetic", "developing"):
        if not isinstance(header[key], dict):
            raise InputError(f"its {key!r} is no table")
    if not isinstance(header["part"], list) or len(header["part"]) != 2:
        raise InputError("its 'part' is not a pair of numbers")
    for value in header["part"]:
        integer(value, "the number of a part", minimum=1, maximum=2**31 - 1)
    integer(header["spp"], "its samples per pixel", minimum=1, maximum=MAX_SPP)
    number(header["seconds"], "its seconds", minimum=0.0)
    integer(header["identity"]["seed"], "its seed", minimum=0, maximum=2**32 - 1)


def header_of(renderer: Renderer) -> dict[str, Any]:
    """Return the entries that are the same in the headers of all parts of a renderer's picture."""
    header = {
        "wrt": __version__,
        "identity": identity_of(renderer),
        "arithmetic": arithmetic_of(renderer.device),
        "developing": {name: getattr(renderer.settings, name) for name in DEVELOPING},
    }
    return dict(json.loads(json.dumps(header)))  # as it will be read


def default_name(source: str, number: int, of: int) -> str:
    """Return the default name of a part's file, which sorts by number."""
    return f"{Path(source).stem or 'picture'}-{number:0{len(str(of))}d}-of-{of}.wrt"
