"""What mesh readers return: parts of one material each, unchecked. `repair.py` makes shapes of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.safe_read import first_line
from wrt.linalg import determinant, norm, product
from wrt.scene.camera import Camera
from wrt.scene.lights import Light
from wrt.scene.materials import Material
from wrt.scene.mesh import turned_sides
from wrt.scene.srgb import linear_from_srgb
from wrt.scene.tangents import moved_tangents
from wrt.scene.textures import ImageTexture
from wrt.values import array, vec3

DEFAULT_REFLECTANCE = (0.62, 0.60, 0.57)
"""Reflectance of a mesh that brings no colour: unglazed clay, light enough to show its shading."""

NO_ANIMATION = "it has no animation, so there is no time to choose"
"""Reason to refuse a file without animations if a time is given."""

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]


@dataclass
class Part:
    """Triangles of one material as a reader found them: unchecked.

    Attributes:
        name: for messages.
        vertices: (N, 3) positions.
        faces: (M, 3) vertex indices, or (M, 1) of points, which are drawn as spheres.
        normals: (N, 3) or None; need not be unit or finite.
        uvs: (N, 2), (N, 4) for two sets, or None; v up.
        colors: (N, 3), (N, 4) with alpha, or None; linear Rec. 709; need not be finite.
        face_colors: (M, 3), (M, 4) or None, like `colors`.
        tangents: (N, 4) or None, as in `wrt.Mesh`; need not be unit.
        reflectance: an image mapped by `uvs`, if the file names one.
        material: the material, if the file describes more than a reflectance; it fits `uvs` and `colors`.
        radius: of points: (N,), one for all, or 0 if the file does not say.
        two_sided: whether emission is two-sided.
        double_sided: whether it is seen from behind.
        smoothing: what the file says of a surface without normals (docs/foreign-files.md): 0 for flat triangles, or
            (M,) smoothing groups of faces as in OBJ, 0 for none; None if it does not say.
        vertex_format: names a vertex by its number in messages; loaders of some formats renumber vertices.
        sides: (M,) or None, as in `wrt.Mesh`.
        places: (4, 4) transforms of its instances, if there are several; otherwise it is in world space.
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    normals: FloatArray | None = None
    uvs: FloatArray | None = None
    colors: FloatArray | None = None
    face_colors: FloatArray | None = None
    tangents: FloatArray | None = None
    reflectance: ImageTexture | None = None
    material: Material | None = None
    places: list[NDArray[np.float64]] = field(default_factory=list)
    two_sided: bool = False
    double_sided: bool = True
    radius: FloatArray | float = 0.0
    smoothing: IntArray | int | None = None
    sides: NDArray[np.uint8] | None = None
    vertex_format: str = "vertex {} (counted from 0)"


@dataclass
class Contents:
    """The content of a file.

    Attributes:
        parts: the triangles.
        lights: lights without a mesh.
        cameras: names and cameras in file order; names may be empty or occur twice.
    """

    parts: list[Part]
    lights: list[Light] = field(default_factory=list)
    cameras: list[tuple[str, Camera]] = field(default_factory=list)


@contextmanager
def as_specified(path: str | Path, kind: str, *errors: type[Exception]) -> Iterator[None]:
    """Report as InputError what code raises that follows the unchecked content of a damaged file of a kind.

    `errors` are raised by the libraries that it calls.
    """
    python = LookupError, TypeError, ValueError, AttributeError, OverflowError, RuntimeError, EOFError
    unchecked: tuple[type[Exception], ...] = (*python, *errors)
    try:
        yield
    except InputError:
        raise
    except unchecked as error:
        reason = f"{type(error).__name__}: {first_line(error)}"
        raise InputError(f"{path}: the {kind} file is damaged or not as specified ({reason})") from None


def points_of(name: str, vertices: FloatArray, colors: FloatArray | None = None) -> Part:
    """Return a part of (N, 3) points, with (N, 3) or (N, 4) linear colours or None."""
    return Part(name, vertices, np.arange(len(vertices))[:, None], colors=colors)


def placed(part: Part, places: list[NDArray[np.float64]]) -> Part:
    """Return a part moved to its one place, or with the transforms of its several instances, which share its memory."""
    return moved(part, places[0]) if len(places) == 1 else replace(part, places=places)


def moved(part: Part, matrix: NDArray[np.float64]) -> Part:
    """Return a part transformed by a (4, 4) matrix; a reflection also flips the winding, so that fronts stay fronts."""
    linear = matrix[:3, :3]
    mirrored = (volume := determinant(linear)) < 0.0
    radius = part.radius * np.cbrt(abs(volume))
    normals, tangents = part.normals, part.tangents
    # Places that overflow are refused with all other vertices that are not finite.
    with np.errstate(over="ignore", invalid="ignore"):  # signalling NaN, too
        if normals is not None:
            # The cofactor matrix: the inverse transpose up to scale, which exists for singular transforms too.
            a, b, c = linear
            cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
            normals = product(np.asarray(normals, np.float64), cofactors.T) * (-1.0 if mirrored else 1.0)
        if tangents is not None:
            tangents = moved_tangents(tangents, linear)
        vertices = product(np.asarray(part.vertices, np.float64), linear.T) + matrix[:3, 3]
    faces, sides = part.faces, part.sides
    if mirrored:
        faces, sides = faces[:, ::-1], turned_sides(sides)
    return replace(part, vertices=vertices, faces=faces, normals=normals, tangents=tangents, sides=sides, radius=radius)


def viewpoint(matrix: NDArray[np.float64]) -> dict[str, Any]:
    """Return `origin`, `target` and `up` of a camera that looks along the −z axis of a (4, 4) transform."""
    origin, up, back = matrix[:3, 3], matrix[:3, 1], matrix[:3, 2]
    length = norm(back)
    if length == 0.0:
        raise InputError("a camera hangs on a node that is scaled to nothing")
    return {"origin": vec3(origin), "target": vec3(origin - back / length), "up": vec3(up)}


def split_vertices(
    vertices: FloatArray, faces: IntArray, values: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return vertices, faces and values per vertex, given (3M, K) values at the corners of (M, 3) faces.

    Vertices with several values become several.
    """
    corners = faces.reshape(-1)
    rows = np.column_stack([corners, values])
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return vertices[corners[first]], inverse.reshape(-1, 3), values[first]


def rows_of(path: str | Path, value: Any, what: str, width: int) -> NDArray[Any]:
    """Return `value` as (N, width) numbers, or raise InputError; loaders may return ragged lists."""
    rows = array(value, f"{path}: {what}")
    if rows.ndim != 2 or rows.shape[1] != width or rows.dtype.kind not in "fiu":
        raise InputError(f"{path}: its {what} are not {width} numbers each")
    return rows


def matching(array: Any, count: int) -> NDArray[Any] | None:
    """Return an array if it has a row for each vertex or face, which not all files ensure; otherwise None."""
    try:
        rows = np.asarray(array)
    except ValueError:  # rows of different lengths
        return None
    return rows if rows.ndim == 2 and len(rows) == count and rows.dtype.kind in "fiu" else None


def decoded(colors: NDArray[Any], *, linear: bool = False) -> FloatArray:
    """Return (N, 3) linear colours, or (N, 4) if any is not opaque. Integers span the range of their type.

    Args:
        colors: (N, 3) or (N, 4).
        linear: whether they are linear, as in glTF. Otherwise they are sRGB, except for alpha, and an alpha of 0
            everywhere counts as none, since some programs leave it unset.
    """
    values = colors[:, :4].astype(np.float64)
    if colors.dtype.kind in "iu":
        values /= np.iinfo(colors.dtype).max
    elif (values[np.isfinite(values)] > 1.0).any():
        values /= 255.0
    with np.errstate(all="ignore"):  # invalid colours are left out later, with a warning
        rgb, alpha = values[:, :3], np.clip(values[:, 3:], 0.0, 1.0)
        rgb = rgb if linear else linear_from_srgb(rgb)
        return np.column_stack([rgb, alpha]) if (alpha < 1.0).any() and (linear or alpha.any()) else rgb


def checked_faces(path: str | Path, faces: IntArray, count: int) -> None:
    """Raise an InputError where a face names a vertex beyond the `count` vertices of the mesh."""
    if len(faces) and (faces.min() < 0 or faces.max() >= count):
        bad = faces.min() if faces.min() < 0 else faces.max()
        raise InputError(f"{path}: a face names vertex {bad}, but there are {count} (counted from 0)")
