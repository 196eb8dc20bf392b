"""Meshes of USD files as parts of one material each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.mesh.parts import Part
from wrt.io.mesh.polygons import triangulate
from wrt.io.usd.lights import Values
from wrt.io.usd.materials import UsdMaterials
from wrt.scene.mesh import Mesh
from wrt.scene.shapes import box, quad, sphere
from wrt.scene.textures import VertexColor

_ROUND_SEGMENTS = 64


def mesh_parts(path: Path, shape: dict[str, Any], materials: UsdMaterials) -> list[Part]:
    """Return a part for each material of a mesh, in its own coordinates.

    Raises:
        InputError: where faces name points that are not there.
    """
    name, values = shape["path"], shape["values"]
    points = _rows(values["points"], 3)
    points = np.zeros((0, 3), np.float32) if points is None else points.astype(np.float32)
    counts, corners = (indices(values[key]) for key in ("faceVertexCounts", "faceVertexIndices"))
    memory_limits.take(memory_limits.MESHES, 40 * len(corners))
    if (counts < 0).any() or (counts > len(corners)).any() or counts.sum() != len(corners):
        raise InputError(f"{path}: {name}: its faces have {counts.sum()} corners, but {len(corners)} are given")
    if shape["subdivided"]:
        warn(f"{path}: {name}: a subdivision surface is rendered as its cage, smoothed")
    triangles, owner = triangulate(f"{path}: {name}", points, corners, counts)
    if values["orientation"] == "leftHanded":
        triangles = triangles[:, ::-1]
    normals = None
    for given in shape["normals"]:
        normals = _values(given, 3, corners, counts) if normals is None else normals
    uvs, colors = _values(shape["uvs"], 2, corners, counts), _values(shape["colors"], 3, corners, counts)
    return [
        _part(name, points, corners, triangles[np.isin(owner, faces)], (normals, uvs, colors), bound, materials)
        for faces, bound in _subsets(shape, len(counts))
    ]


def solid(path: Path, shape: dict[str, Any], materials: UsdMaterials) -> Part:
    """Return a solid as triangles."""
    kind, name = shape["kind"], shape["path"]
    values = Values(shape["values"], f"{path}: {name}")
    axis = np.eye(4)
    if kind == "Cube":
        half = 0.5 * values.number("size")
        made = box((-half,) * 3, (half,) * 3)
    elif kind == "Sphere":
        made = sphere(radius=values.number("radius"))
    else:
        turns = {"X": np.roll(np.eye(3), 1, axis=0), "Y": np.roll(np.eye(3), 2, axis=0)}
        axis[:3, :3] = turns.get(values.word("axis"), np.eye(3))
        if kind == "Plane":
            w, h = values.number("width"), values.number("length")
            made = quad((-0.5 * w, -0.5 * h, 0.0), (w, 0.0, 0.0), (0.0, h, 0.0))
        else:
            made = _turned(_profile(kind, values.number("radius"), 0.5 * values.number("height")))
    made = made.transformed(axis)
    part = Part(name, made.vertices, made.faces, made.normals, made.uvs)
    _dress(part, shape["material"], materials)
    return part


def _profile(kind: str, radius: float, half: float) -> NDArray[np.float64]:
    """Return (P, 2) distances from the axis and heights of a round solid, from its lower end to its upper one."""
    if kind == "Capsule":
        angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _ROUND_SEGMENTS // 2)  # of an even number, so that none is 0
        return np.stack([radius * np.cos(angle), radius * np.sin(angle) + np.copysign(half, angle)], axis=1)
    top = radius if kind == "Cylinder" else 0.0
    return np.array([(0.0, -half), (radius, -half), (top, half), (0.0, half)])[: 4 if top else 3]


def _turned(profile: NDArray[np.float64]) -> Mesh:
    """Return the closed surface of a profile that is turned about z; its first and last point lie on the axis."""
    angle = np.arange(_ROUND_SEGMENTS) * (2.0 * np.pi / _ROUND_SEGMENTS)
    middle = profile[1:-1, None]
    rings = np.stack(
        np.broadcast_arrays(middle[..., 0] * np.cos(angle), middle[..., 0] * np.sin(angle), middle[..., 1]), 2
    )
    ends = np.zeros((2, 3))
    ends[:, 2] = profile[[0, -1], 1]
    last = len(rings) * _ROUND_SEGMENTS
    here = np.arange(_ROUND_SEGMENTS)
    following = np.roll(here, -1)
    faces = [np.stack([following, here, np.full_like(here, last)], axis=1)]
    for start in range(0, last - _ROUND_SEGMENTS, _ROUND_SEGMENTS):
        a, b, c, d = (
            start + here,
            start + following,
            start + _ROUND_SEGMENTS + following,
            start + _ROUND_SEGMENTS + here,
        )
        faces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    top = last - _ROUND_SEGMENTS
    faces.append(np.stack([top + here, top + following, np.full_like(here, last + 1)], axis=1))
    return Mesh(np.concatenate([rings.reshape(-1, 3), ends]), np.concatenate(faces))


def _subsets(shape: dict[str, Any], count: int) -> list[tuple[NDArray[np.int64], str | None]]:
    """Return the faces of each material, and the material."""
    left = np.ones(count, bool)
    found: list[tuple[NDArray[np.int64], str | None]] = []
    for given, bound in shape["subsets"]:
        faces = indices(given)
        faces = faces[(faces >= 0) & (faces < count)]
        left[faces] = False
        found.append((faces, bound))
    return [*found, (np.flatnonzero(left), shape["material"])] if left.any() or not found else found


def _part(
    name: str,
    points: NDArray[np.float32],
    corners: NDArray[np.int64],
    triangles: NDArray[np.int64],
    at_corners: tuple[NDArray[Any] | None, ...],
    bound: str | None,
    materials: UsdMaterials,
) -> Part:
    """Return the triangles of one material; normals, coordinates and colours at corners part the vertices."""
    if all(each is None for each in at_corners):
        part = Part(name, points, corners[triangles])
    else:
        used, faces = np.unique(triangles, return_inverse=True)
        part = Part(name, points[corners[used]], faces.reshape(-1, 3))
        part.normals, part.uvs, part.colors = (None if each is None else each[used] for each in at_corners)
    _dress(part, bound, materials)
    return part


def _dress(part: Part, bound: str | None, materials: UsdMaterials) -> None:
    """Give a part its material; where there is one, the colour for display counts only if that reads it."""
    material = materials.bound_to(bound, laid=part.uvs is not None, colored=part.colors is not None)
    if material is not None:
        part.material = material
        if not any(isinstance(value, VertexColor) for value in vars(material).values()):
            part.colors = None


def indices(value: Any) -> NDArray[np.int64]:
    """Return whole numbers; none where the value is of a type that the schema does not have."""
    fits = isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "iu"
    return value.astype(np.int64) if fits else np.zeros(0, np.int64)


def _rows(value: Any, width: int) -> NDArray[Any] | None:
    """Return (N, width) numbers, or None where the value is of a type that the schema does not have."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        return None
    rows: NDArray[Any] = np.atleast_2d(value)
    return rows if rows.ndim == 2 and rows.shape[1] == width else None


def _values(
    given: list[Any] | None, width: int, corners: NDArray[np.int64], counts: NDArray[np.int64]
) -> NDArray[Any] | None:
    """Return (C, width) values at each corner of the faces, or None where their number or type does not fit.

    Args:
        given: the values and their interpolation, or None.
        width: numbers in each.
        corners: (C,) point of each corner.
        counts: corners of each face.
    """
    rows = _rows(given[0], width) if given else None
    if given is None or rows is None:
        return None
    places = {
        "faceVarying": np.arange(len(corners)),
        "vertex": corners,
        "varying": corners,
        "uniform": np.repeat(np.arange(len(counts)), counts),
        "constant": np.zeros(len(corners), np.int64),
    }.get(given[1])
    if places is None or (len(places) and places.max() >= len(rows)):
        return None
    return np.asarray(rows[places], np.float64)
