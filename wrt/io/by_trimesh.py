"""COLLADA files, which trimesh reads with a library of an extra.

Format: Khronos Group 2008, "COLLADA: Digital Asset Schema Release 1.4.1".
"""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

from wrt.errors import InputError, warn
from wrt.io.encodings import as_text
from wrt.io.mesh.collada import in_plain_words
from wrt.io.mesh.parts import Contents
from wrt.io.mesh.trimesh_loaders import Beside, in_words, quiet
from wrt.io.safe_read import first_line, read_file

_BEGINNING = 1 << 16
"""Bytes at the start of a file that hold its description."""

_UP = re.compile(r"<(?:\w+:)?up_axis>\s*([XYZ])_UP\s*<")


def read_by_trimesh(path: Path, data: bytes) -> Contents:
    """Return the content of a file as trimesh's objects hold it: meshes with materials, where they are.

    Raises:
        InputError: where the extra is not installed, or the file cannot be read.
    """
    import trimesh
    from trimesh.exchange.load import mesh_loaders

    from wrt.io.trimesh_objects import read_object

    kind = path.suffix.lower().removeprefix(".")
    if kind not in mesh_loaders:
        raise InputError(f"{path}: .{kind} files need further libraries: pip install 'wrt[formats]'")
    resolver = Beside(path, images=False)
    with quiet():
        try:
            plain, notes = in_plain_words(data)
            scene = trimesh.load_scene(io.BytesIO(plain), file_type=kind, resolver=resolver)
        except ImportError as error:
            reason = f"{path}: .{kind} files need further libraries: pip install 'wrt[formats]' ({first_line(error)})"
            raise InputError(reason) from None
        except Exception as error:  # noqa: BLE001 - loaders raise undocumented exceptions on damaged files
            raise InputError(f"{path}: not a whole {kind.upper()} file that can be read: {in_words(error)}") from None
    resolver.tell()
    for note in notes:
        warn(f"{path}: {note}")
    if unread := [kind for kind in ("camera", "light") if f"instance_{kind}".encode() in data]:
        warn(f"{path}: {' and '.join(f'{kind}s' for kind in unread)} of COLLADA files are left out")
    return read_object(scene, str(path))


def declared_up(path: Path) -> str | None:
    """Return the up axis that a file declares: x, y or z; None if it declares none."""
    with contextlib.suppress(InputError):
        found = _UP.search(as_text(read_file(path, _BEGINNING)))
        return found[1].lower() if found else None
    return None
