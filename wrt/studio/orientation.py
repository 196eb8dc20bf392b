"""The up axis of a mesh, for files that do not name it.

OBJ, PLY and STL name no axis. Modelling programs mostly write y up; scanners, CAD and printing programs write z up. The
axis on which the mesh would stand tells them apart.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import product
from wrt.scene.exact.spheres import Spheres
from wrt.scene.scene import Shape

# Measured: standing objects (scanned busts and animals, a teapot, a bottle) cover 0.26 to 0.97 of their outline and
# lean 0.19 to 0.83; on their side they cover at most 0.03. Vases with narrow feet cover 0.15, round bars on their side
# 0.2.
_BASE = 0.01  # fraction of the height, from the lowest point, that counts as touching the ground
_STANDS_COVER, _STANDS_LEAN = 0.12, 0.08
_FALLS_COVER, _FALLS_RATIO, _FALLS_LEAN = 0.25, 3.0, -0.02
_LAND_FACES = 0.5  # mean upward normal above which an open surface is terrain; mountains have 0.7
_DIRECTIONS = 24  # corners of the polygon that approximates a convex hull; a disc comes out 1.1 % too small
_FACES = 200_000  # sampled for the centre
_POINTS = 500_000  # sampled for the outline
_SHEET = 1e-6  # largest thickness of a sheet, relative to its width: some rounding errors of float32

_Float = NDArray[np.floating[Any]]


def guess_up(shapes: list[Shape], default: str) -> str:
    """Return the axis, "y" or "z", on which the shapes stand; in doubt `default`.

    The mesh is set on the ground along both axes. Its base is the part within 1 % of its height above the lowest
    point. It stands if the base covers much of its outline from above, and its surface's centre is so far inside the
    base that the mesh could lean by some degrees. It falls if the base covers little or the centre is outside. The
    default is overruled only if the mesh falls along it and stands much better along the other axis: boxes, balls and
    plates, upright or lying, stay as they are. So does terrain, an open surface that faces upwards and touches the
    ground at few points. An object with a flat back and no foot, such as a mask, is taken to lie; give its axis.
    A flat sheet without thickness, which could not be told from the floor that it lies on, is stood up.

    Args:
        shapes: the parts of one mesh, in one space.
        default: the axis to return in doubt; an axis other than y and z is returned unchanged.
    """
    if default not in ("y", "z"):
        return default
    alternative = "z" if default == "y" else "y"
    surface = _surface(shapes)
    if surface is None:
        return default
    center, facing = surface
    step = 1 + sum(len(shape.mesh.vertices) for shape in shapes) // _POINTS
    points = np.concatenate([shape.mesh.vertices[::step] for shape in shapes])
    extent = np.ptp(points, axis=0)
    if extent["xyz".index(default)] <= _SHEET * extent.max():
        return alternative
    if facing["xyz".index(default)] > _LAND_FACES:
        return default
    cover, lean = _standing(points, center, "xyz".index(alternative))
    if cover < _STANDS_COVER or lean < _STANDS_LEAN:
        return default
    default_cover, default_lean = _standing(points, center, "xyz".index(default))
    falls = default_lean < _FALLS_LEAN or (default_cover < _FALLS_COVER and _FALLS_RATIO * default_cover < cover)
    return alternative if falls else default


def _surface(shapes: list[Shape]) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the centre and mean normal of the surface, from a subset of its faces; None if they have no area.

    The mean normal of a closed surface is zero.
    """
    step = 1 + sum(len(shape.mesh.faces) for shape in shapes) // _FACES
    corners = np.concatenate([shape.mesh.vertices[shape.mesh.faces[::step]] for shape in shapes]).astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    total = float(areas.sum())
    if total == 0.0 and all(isinstance(shape.mesh, Spheres) for shape in shapes):
        return corners.mean(axis=(0, 1)), np.zeros(3)
    if not 0.0 < total < np.inf:
        return None
    return product(areas, corners.mean(axis=1)) / total, normals.sum(axis=0) / total


def _standing(points: _Float, center: NDArray[np.float64], axis: int) -> tuple[float, float]:
    """Return how well points stand along an axis.

    Returns:
        The fraction of the outline from above that the base covers; and the tangent of the angle by which the base may
        tilt until the centre is no longer above it, negative if it is not above it to begin with.
    """
    across = [k for k in range(3) if k != axis]
    heights = points[:, axis]
    lowest, highest = float(heights.min()), float(heights.max())
    flat = np.ascontiguousarray(points[:, across].T)
    base = flat[:, heights <= lowest + _BASE * (highest - lowest)]
    directions, outline = _hull(flat)
    _, feet = _hull(base)
    covered = _area(outline)
    inside = float(((feet - center[across]) * directions).sum(axis=1).min())
    above = float(center[axis]) - lowest
    # A pane on its edge has no outline area, and covers all of it.
    return _area(feet) / covered if covered > 0.0 else 1.0, inside / above if above > 0.0 else np.inf


def _hull(flat: _Float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return directions in order around the circle, and the farthest of (2, N) points in each.

    These points are corners of the convex hull, in order.
    """
    angles = np.arange(_DIRECTIONS // 2) * (2.0 * np.pi / _DIRECTIONS)
    half = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    far, near = [], []
    for x, y in half.astype(flat.dtype):
        along = x * flat[0] + y * flat[1]
        far.append(int(along.argmax()))
        near.append(int(along.argmin()))
    return np.concatenate([half, -half]), flat[:, far + near].T.astype(np.float64)


def _area(corners: NDArray[np.float64]) -> float:
    """Return the area of a polygon (the shoelace formula)."""
    x, y = (corners - corners[0]).T
    return 0.5 * abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()))
