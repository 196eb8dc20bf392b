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
from wrt.io.usd.materials import UsdMaterials
from wrt.scene.mesh import Mesh
from wrt.scene.shapes import box, quad, sphere
from wrt.scene.textures import VertexColor

_ROUND_SEGMENTS = 64

SOLIDS = ("Cube", "Sphere", "Plane", "Cylinder", "Cone", "Capsule")
"""Types of prims that `solid` makes triangles of."""


def mesh_parts(path: Path, prim: Any, materials: UsdMaterials) -> list[Part]:
    """Return a part for each material of a mesh, in its own coordinates.

    Raises:
        InputError: where faces name points that are not there.
    """
    from pxr import UsdGeom

    mesh = UsdGeom.Mesh(prim)
    points = np.array(mesh.GetPointsAttr().Get() or [], np.float32).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], np.int64)
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], np.int64)
    memory_limits.take(memory_limits.MESHES, 40 * len(corners))
    if counts.sum() != len(corners) or (counts < 0).any():
        raise InputError(
            f"{path}: {prim.GetPath()}: its faces have {counts.sum()} corners, but {len(corners)} are given"
        )
    if len(corners) and (corners.min() < 0 or corners.max() >= len(points)):
        raise InputError(f"{path}: {prim.GetPath()}: a face names a point that is not there")
    scheme = mesh.GetSubdivisionSchemeAttr()
    if scheme.HasAuthoredValue() and str(scheme.Get()) != "none":
        warn(f"{path}: {prim.GetPath()}: a subdivision surface is rendered as its cage, smoothed")
    triangles, owner = triangulate(points, corners, counts)
    if str(mesh.GetOrientationAttr().Get()) == "leftHanded":
        triangles = triangles[:, ::-1]
    primvars = UsdGeom.PrimvarsAPI(prim)
    normals = _primvar(primvars.GetPrimvar("normals"), 3, corners, counts)  # comes before the attribute
    if normals is None:
        normals = _values(mesh.GetNormalsAttr().Get(), 3, str(mesh.GetNormalsInterpolation()), corners, counts)
    uvs, colors = (
        _primvar(primvars.FindPrimvarWithInheritance(name), width, corners, counts)
        for name, width in ((_coordinates(primvars), 2), ("displayColor", 3))
    )
    return [
        _part(path, prim, points, corners, triangles[np.isin(owner, faces)], normals, uvs, colors, bound, materials)
        for faces, bound in _subsets(prim, len(counts))
    ]


def solid(path: Path, prim: Any, materials: UsdMaterials) -> Part:
    """Return one of SOLIDS as triangles."""
    from pxr import UsdGeom

    kind = str(prim.GetTypeName())
    axis = np.eye(4)
    if kind == "Cube":
        half = 0.5 * float(UsdGeom.Cube(prim).GetSizeAttr().Get())
        made = box((-half,) * 3, (half,) * 3)
    elif kind == "Sphere":
        made = sphere(radius=float(UsdGeom.Sphere(prim).GetRadiusAttr().Get()))
    else:
        given = getattr(UsdGeom, kind)(prim)
        letter = str(given.GetAxisAttr().Get())
        axis[:3, :3] = {"X": np.roll(np.eye(3), 1, axis=0), "Y": np.roll(np.eye(3), 2, axis=0)}.get(letter, np.eye(3))
        if kind == "Plane":
            w, h = (float(each.Get()) for each in (given.GetWidthAttr(), given.GetLengthAttr()))
            made = quad((-0.5 * w, -0.5 * h, 0.0), (w, 0.0, 0.0), (0.0, h, 0.0))
        else:
            radius, height = (float(each.Get()) for each in (given.GetRadiusAttr(), given.GetHeightAttr()))
            made = _turned(_profile(kind, radius, 0.5 * height))
    made = made.transformed(axis)
    part = Part(str(prim.GetPath()), made.vertices, made.faces, made.normals, made.uvs)
    _dress(part, prim, materials)
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


def _subsets(prim: Any, count: int) -> list[tuple[NDArray[np.int64], Any]]:
    """Return the faces of each material, and the prim to which it is bound."""
    from pxr import UsdShade

    left = np.ones(count, bool)
    found: list[tuple[NDArray[np.int64], Any]] = []
    for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
        faces = np.array(subset.GetIndicesAttr().Get() or [], np.int64)
        faces = faces[(faces >= 0) & (faces < count)]
        left[faces] = False
        found.append((faces, subset.GetPrim()))
    return [*found, (np.flatnonzero(left), prim)] if left.any() or not found else found


def _part(
    path: Path,
    prim: Any,
    points: NDArray[np.float32],
    corners: NDArray[np.int64],
    triangles: NDArray[np.int64],
    normals: NDArray[Any] | None,
    uvs: NDArray[Any] | None,
    colors: NDArray[Any] | None,
    bound: Any,
    materials: UsdMaterials,
) -> Part:
    """Return the triangles of one material; values at corners part the vertices, unless there are none."""
    name = str(prim.GetPath())
    if normals is None and uvs is None and colors is None:
        part = Part(name, points, corners[triangles])
    else:
        used, faces = np.unique(triangles, return_inverse=True)
        part = Part(name, points[corners[used]], faces.reshape(-1, 3))
        part.normals, part.uvs, part.colors = (None if each is None else each[used] for each in (normals, uvs, colors))
    _dress(part, bound, materials)
    return part


def _dress(part: Part, bound: Any, materials: UsdMaterials) -> None:
    """Give a part its material; where there is one, the colour for display counts only if that reads it."""
    material = materials.bound_to(bound, laid=part.uvs is not None, colored=part.colors is not None)
    if material is not None:
        part.material = material
        if not any(isinstance(value, VertexColor) for value in vars(material).values()):
            part.colors = None


def _coordinates(primvars: Any) -> str:
    """Return the name of a mesh's texture coordinates: "st", or else the first of that role."""
    if primvars.FindPrimvarWithInheritance("st"):
        return "st"
    others = (each for each in primvars.FindPrimvarsWithInheritance() if each.GetTypeName().role == "TextureCoordinate")
    return next((str(each.GetPrimvarName()) for each in others), "st")


def _primvar(primvar: Any, width: int, corners: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[Any] | None:
    """Return the values of a primvar at each corner, or None."""
    if not primvar or not primvar.HasValue():
        return None
    values = primvar.ComputeFlattened()
    return _values(values, width, str(primvar.GetInterpolation()), corners, counts)


def _values(
    values: Any, width: int, interpolation: str, corners: NDArray[np.int64], counts: NDArray[np.int64]
) -> NDArray[Any] | None:
    """Return (C, width) values at each corner of the faces, or None where their number or type does not fit."""
    try:
        rows = np.array(() if values is None else values, np.float64)
    except (TypeError, ValueError):  # of a type that the schema does not have
        return None
    rows = np.atleast_2d(rows)
    if rows.ndim != 2 or rows.shape[1] != width:
        return None
    places = {
        "faceVarying": np.arange(len(corners)),
        "vertex": corners,
        "varying": corners,
        "uniform": np.repeat(np.arange(len(counts)), counts),
        "constant": np.zeros(len(corners), np.int64),
    }[interpolation]
    return rows[places] if not len(places) or places.max() < len(rows) else None
