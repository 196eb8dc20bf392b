"""Checkpoints: a film's state and what it belongs to, in one file.

The file is an uncompressed NumPy archive (.npz layout) of the film's arrays and a JSON header.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.files import PathLike, first_line, forget_input, read_file
from wrt.formats.npy import read_archive
from wrt.safe_write import Kind, write_whole

SETTINGS_OF_PICTURE = (
    "width",
    "height",
    "max_depth",
    "max_scatterings",
    "filter",
    "sampler",
    "crop",
    "integrator",
    "min_attenuation",
    "ao_distance",
    "layers",
    "clamp_indirect",
    "regularization",
)
"""What of `RenderSettings` changes a picture: checkpoints tell it."""

FORMAT = 1
_HEADER = "header"

_BEGINNING = 512
"""Leading bytes of a checkpoint that contain the start of its header, which NumPy stores as UTF-32."""


def _is_checkpoint(path: Path) -> bool:
    with path.open("rb") as file:
        beginning = file.read(_BEGINNING)
    name = f"{_HEADER}.npy".encode()
    return beginning.startswith(b"PK\3\4") and name in beginning and '{"format": '.encode("utf-32-le") in beginning


CHECKPOINT = Kind("a checkpoint", _is_checkpoint, may_force=False)
"""A checkpoint replaces only checkpoints, even with `force`."""


def write_checkpoint(path: PathLike, header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
    """Write a checkpoint atomically: the old file stays whole until the new one is.

    Raises:
        InputError: where it cannot be written, be it for the path or for a full disk.
    """
    text = np.array(json.dumps({"format": FORMAT, **header}))

    def write(temporary: Path) -> None:
        with temporary.open("wb") as handle:
            np.savez(handle, **{_HEADER: text}, **arrays)  # type: ignore[arg-type]

    write_whole(Path(path), write, CHECKPOINT)


def read_checkpoint(path: PathLike) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return a checkpoint's header and arrays.

    Raises:
        InputError: where there is no such file, or it is not a whole checkpoint of this format.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such checkpoint file")
    try:
        arrays = read_archive(read_file(path))
        forget_input(path)  # a resumed render may replace its checkpoint
        header = json.loads(str(arrays.pop(_HEADER)))
    except (KeyError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a wrt checkpoint, or damaged ({first_line(error)})") from None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise InputError(f"{path}: written in another checkpoint format than this version of wrt reads")
    return header, arrays


def require_same(path: PathLike, stored: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Raise InputError naming everything in which a stored header differs from the wanted one."""
    differences = []
    for key, value in wanted.items():
        found = stored.get(key)
        if found == value:
            continue
        if isinstance(value, dict) and isinstance(found, dict):
            differences += [f"the scene's {part}" for part in value if found.get(part) != value[part]]
        else:
            differences.append(f"{key} ({found} there, {value} here)")
    if differences:
        raise InputError(f"{path}: cannot resume, these differ: {', '.join(differences)}")


def refuse_to_be_copied(_: object, __: Any) -> Any:
    """Raise TypeError; used as a renderer's `__reduce_ex__`, since its arrays and threads belong to a device."""
    raise TypeError(
        "a Renderer cannot be copied or pickled; copy its Scene and a file from save_checkpoint instead, and continue "
        "with Renderer.resume"
    )
