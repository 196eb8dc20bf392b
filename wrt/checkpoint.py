"""Checkpoints: a film's state and what it belongs to, in one file.

The file is an uncompressed NumPy archive (.npz layout) of the film's arrays and a JSON header.
"""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError

FORMAT = 1
_HEADER = "header"


def write_checkpoint(path: str | os.PathLike[str], header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
    """Write a checkpoint atomically: the old file stays whole until the new one is.

    Raises:
        InputError: where the folder does not exist or the path is a folder.
        OSError: where writing fails, such as on a full disk.
    """
    path = Path(path)
    check_checkpoint_path(path)
    text = np.array(json.dumps({"format": FORMAT, **header}))
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **{_HEADER: text}, **arrays)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def check_checkpoint_path(path: str | os.PathLike[str]) -> None:
    """Raise InputError unless a checkpoint could be written there."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, not a checkpoint file")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist")


def read_checkpoint(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return a checkpoint's header and arrays.

    Raises:
        InputError: where there is no such file, or it is not a whole checkpoint of this format.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such checkpoint file")
    try:
        with np.load(path, allow_pickle=False) as archive:
            header = json.loads(str(archive[_HEADER]))
            arrays = {name: archive[name] for name in archive.files if name != _HEADER}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, TypeError) as error:
        raise InputError(f"{path}: not a wrt checkpoint, or damaged ({error})".splitlines()[0]) from None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise InputError(f"{path}: written in another checkpoint format than this version of wrt reads")
    return header, arrays


def require_same(path: str | os.PathLike[str], stored: dict[str, Any], wanted: dict[str, Any]) -> None:
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
