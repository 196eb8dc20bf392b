"""COLLADA files, which trimesh reads with a library of an extra."""

from __future__ import annotations

import io
from pathlib import Path

from wrt.errors import InputError
from wrt.io.mesh.parts import Contents
from wrt.io.mesh.trimesh_loaders import Beside, quiet
from wrt.io.safe_read import first_line


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
    beside = Beside(path, images=False)
    with quiet():
        try:
            scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=beside)
        except ImportError as error:
            reason = f"{path}: .{kind} files need further libraries: pip install 'wrt[formats]' ({first_line(error)})"
            raise InputError(reason) from None
        except Exception as error:  # noqa: BLE001 - loaders raise undocumented exceptions on damaged files
            reason = first_line(error)
            raise InputError(f"{path}: not a whole {kind.upper()} file that can be read: {reason}") from None
    return read_object(scene)
