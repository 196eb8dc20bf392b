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
from wrt.io.mitsuba.surfaces import cylinder
from wrt.io.usd.materials import UsdMaterials
from wrt.scene.shapes import box, quad, sphere

_ROUND_SEGMENTS = 64


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
    normals = _values(mesh.GetNormalsAttr().Get(), str(mesh.GetNormalsInterpolation()), corners, counts)
    primvars = UsdGeom.PrimvarsAPI(prim)
    uvs, colors = (
        _primvar(primvars.FindPrimvarWithInheritance(name), corners, counts) for name in ("st", "displayColor")
    )
    return [
        _part(path, prim, points, corners, triangles[np.isin(owner, faces)], normals, uvs, colors, bound, materials)
        for faces, bound in _subsets(prim, len(counts))
    ]


def solid(path: Path, prim: Any, materials: UsdMaterials) -> Part:
    """Return a cube, sphere, plane or cylinder as triangles."""
    from pxr import UsdGeom

    kind = str(prim.GetTypeName())
    axis = np.eye(4)
    if kind == "Cube":
        half = 0.5 * float(UsdGeom.Cube(prim).GetSizeAttr().Get())
        made = box((-half,) * 3, (half,) * 3)
    elif kind == "Sphere":
        made = sphere(radius=float(UsdGeom.Sphere(prim).GetRadiusAttr().Get()))
    else:
        given = (UsdGeom.Plane if kind == "Plane" else UsdGeom.Cylinder)(prim)
        letter = str(given.GetAxisAttr().Get())
        axis[:3, :3] = {"X": np.roll(np.eye(3), 1, axis=0), "Y": np.roll(np.eye(3), 2, axis=0)}.get(letter, np.eye(3))
        if kind == "Plane":
            w, h = (float(each.Get()) for each in (given.GetWidthAttr(), given.GetLengthAttr()))
            made = quad((-0.5 * w, -0.5 * h, 0.0), (w, 0.0, 0.0), (0.0, h, 0.0))
        else:
            radius, height = (float(each.Get()) for each in (given.GetRadiusAttr(), given.GetHeightAttr()))
            scaled = np.diag([radius, radius, height, 1.0])
            scaled[2, 3] = -0.5 * height
            made = cylinder(_ROUND_SEGMENTS).transformed(scaled)
            warn(f"{path}: {prim.GetPath()}: a cylinder is open at its ends")
    made = made.transformed(axis)
    part = Part(str(prim.GetPath()), made.vertices, made.faces, made.normals, made.uvs)
    _dress(part, prim, materials)
    return part


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
    """Give a part its material; where there is one, the colour for display does not count."""
    material = materials.bound_to(bound, laid=part.uvs is not None)
    if material is not None:
        part.material, part.colors = material, None


def _primvar(primvar: Any, corners: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[Any] | None:
    """Return the values of a primvar at each corner, or None."""
    if not primvar or not primvar.HasValue():
        return None
    values = primvar.ComputeFlattened()
    return _values(values, str(primvar.GetInterpolation()), corners, counts)


def _values(
    values: Any, interpolation: str, corners: NDArray[np.int64], counts: NDArray[np.int64]
) -> NDArray[Any] | None:
    """Return (C, width) values at each corner of the faces, or None where their number does not fit."""
    if values is None or not len(values):
        return None
    rows = np.array(values, np.float64).reshape(len(values), -1)
    places = {
        "faceVarying": np.arange(len(corners)),
        "vertex": corners,
        "varying": corners,
        "uniform": np.repeat(np.arange(len(counts)), counts),
        "constant": np.zeros(len(corners), np.int64),
    }[interpolation]
    return rows[places] if not len(places) or places.max() < len(rows) else None
