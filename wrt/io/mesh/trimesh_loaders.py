"""trimesh's loaders of mesh files, and their output as parts.

The loaders are called directly, which return the arguments of Trimesh's constructor. Trimesh objects would round
colours to 8 bits, and do not distinguish normals of the file from normals that trimesh computes.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from wrt.errors import InputError
from wrt.io.mesh.parts import Part, decoded, matching, rows_of
from wrt.io.mesh.polygons import outer_sides, triangulate
from wrt.io.safe_read import first_line
from wrt.values import array

Fields = dict[str, Any]
"""Output of a trimesh loader for one mesh: arguments of trimesh.Trimesh."""

_PYTHON_NOTICED = (IndexError, KeyError, AttributeError, TypeError, AssertionError, UnboundLocalError)
"""Errors of loaders that did not check their input."""


@contextlib.contextmanager
def reading_with_trimesh(path: Path, kind: str) -> Iterator[None]:
    """Silence trimesh's log and NumPy's warnings, and raise InputError when reading a file fails for any reason."""
    from trimesh.constants import log

    disabled, log.disabled = log.disabled, True
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            # np.fromstring only warns when it stops at text that is not a number.
            warnings.filterwarnings("error", message="string or file could not be read")
            yield
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - loaders raise undocumented exceptions on damaged files
        reason = first_line(error)
        if "could not be read" in reason:
            reason = "there is something else where a number should be"
        elif isinstance(error, IndexError) and "out of bounds" in reason:
            reason = f"a face names something that is not there ({reason})"
        elif isinstance(error, _PYTHON_NOTICED):
            reason = f"something in it is missing or not as specified ({reason})"
        raise InputError(f"{path}: not a whole {kind.upper()} file that can be read: {reason}") from None
    finally:
        log.disabled = disabled


def load(path: Path, data: bytes | str, kind: str, **options: Any) -> Fields:
    """Return the output of trimesh's loader of a kind of file, such as "obj", with further arguments of that loader.

    Raises:
        InputError: where the loader fails for any reason.
    """
    from trimesh.exchange.load import mesh_loaders

    file = io.StringIO(data) if isinstance(data, str) else io.BytesIO(data)
    with reading_with_trimesh(path, kind):
        loaded: Fields = mesh_loaders[kind](file_obj=file, **options)
    return loaded


def part_of(path: Path, name: str, fields: Fields) -> Part | None:
    """Return a loader's mesh, its polygons triangulated, as a part without a material; None if it has no triangles.

    Raises:
        InputError: where faces name missing vertices.
    """
    faces = array(() if fields.get("faces") is None else fields["faces"], f"{path}: faces")
    if faces.dtype.kind not in "iu":
        faces = array(faces, f"{path}: faces", np.int64)
    if faces.ndim != 2 or faces.shape[1] < 3 or not len(faces):
        return None
    vertices = rows_of(path, fields.get("vertices", ()), "vertices", 3)
    count, size = faces.shape
    owner: Any = slice(None)
    sides = fields.get("sides")
    if size > 3:
        corners = faces.reshape(-1)
        counts = np.full(count, size)
        triangles, owner = triangulate(path, vertices, corners, counts)
        faces, sides = corners[triangles], outer_sides(triangles, owner, counts)
    part = Part(name, vertices, faces, sides=sides)
    part.normals = matching(fields.get("vertex_normals"), len(vertices))
    part.uvs = matching(getattr(fields.get("visual"), "uv", None), len(vertices))
    colors = matching(fields.get("vertex_colors"), len(vertices))
    face_colors = matching(fields.get("face_colors"), count)
    if colors is not None:
        part.colors = decoded(colors)
    elif face_colors is not None:
        part.face_colors = decoded(face_colors)[owner]
    return part


def is_stand_in(image: Any) -> bool:
    """Whether an image is the grey patch that trimesh creates for coordinates without an image."""
    from trimesh.visual.material import color_image

    return image is not None and image.format is None and np.array_equal(np.asarray(image), np.asarray(color_image()))
