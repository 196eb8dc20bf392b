"""Which way up a mesh is meant, for files that do not say.

OBJ, PLY and STL name no axis: modelling programs mostly write y up, scanners, CAD and printing
programs z up. What tells the two apart is how the mesh would stand.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene import Shape

# Measured: what stands (scanned busts and animals, a teapot, a bottle) covers 0.26 to 0.97 of its outline
# and leans 0.19 to 0.83; on its side it covers at most 0.03. Narrow-footed vases cover 0.15, round bars
# on their side 0.2.
_BASE = 0.01  # of the height: what is so near to the lowest point touches the ground
_STANDS_COVER, _STANDS_LEAN = 0.12, 0.08
_FALLS_COVER, _FALLS_RATIO, _FALLS_LEAN = 0.25, 3.0, -0.02
_LAND_FACES = 0.5  # so much of its surface, on balance, an open one turns up that is land: of mountains 0.7
_DIRECTIONS = 24  # of the polygon that stands for a convex hull; a disc comes out 1.1 % small
_FACES = 200_000  # that the centre is taken from
_POINTS = 500_000  # that the outline is taken from

_Float = NDArray[np.floating[Any]]


def guess_up(shapes: list[Shape], default: str) -> str:
    """Return "y" or "z": the axis on which the shapes stand if only the other one is, else `default`.

    The mesh is set on the ground along each of the two. Its base is what lies within 1 % of its
    height above the lowest point. It stands if the base covers a good part of its outline from
    above, and if its centre (of the surface) is so far inside the base that it could lean by some
    degrees. It does not stand if the base covers little, or if the centre is outside. The default
    is overruled only where it does not stand and the other axis does, much better: boxes, balls
    and plates, upright or lying, stay as they are. What has a flat back and no foot, such as a
    mask, is taken to lie; then the axis must be told. Land, open and turned up all over, stays as well, which
    touches the ground at few points.

    Args:
        shapes: the parts of one mesh, in one space.
        default: the axis to return in doubt; another one than y and z is returned as it is.
    """
    if default not in ("y", "z"):
        return default
    other = "z" if default == "y" else "y"
    surface = _surface(shapes)
    if surface is None:
        return default
    center, facing = surface
    if facing["xyz".index(default)] > _LAND_FACES:
        return default
    step = 1 + sum(len(shape.mesh.vertices) for shape in shapes) // _POINTS
    points = np.concatenate([shape.mesh.vertices[::step] for shape in shapes])
    cover, lean = _standing(points, center, "xyz".index(other))
    if cover < _STANDS_COVER or lean < _STANDS_LEAN:
        return default
    default_cover, default_lean = _standing(points, center, "xyz".index(default))
    falls = default_lean < _FALLS_LEAN or (default_cover < _FALLS_COVER and _FALLS_RATIO * default_cover < cover)
    return other if falls else default


def _surface(shapes: list[Shape]) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return centre and mean normal of the surface, from every so many faces; None where those have no area.

    The mean normal of what is closed is zero.
    """
    step = 1 + sum(len(shape.mesh.faces) for shape in shapes) // _FACES
    corners = np.concatenate([shape.mesh.vertices[shape.mesh.faces[::step]] for shape in shapes]).astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    total = float(areas.sum())
    if not 0.0 < total < np.inf:
        return None
    return areas @ corners.mean(axis=1) / total, normals.sum(axis=0) / total


def _standing(points: _Float, center: NDArray[np.float64], axis: int) -> tuple[float, float]:
    """Return how well points stand along an axis.

    Returns:
        The part of the outline from above that the base covers; and the tangent of the angle by
        which the base may be tilted until the centre is no longer above it, negative where it is not.
    """
    across = [k for k in range(3) if k != axis]
    heights = points[:, axis]
    lowest, highest = float(heights.min()), float(heights.max())
    flat = np.ascontiguousarray(points[:, across].T)
    base = flat[:, heights <= lowest + _BASE * (highest - lowest)]
    directions, outline = _hull(flat)
    _, feet = _hull(base)
    whole = _area(outline)
    inside = float(((feet - center[across]) * directions).sum(axis=1).min())
    above = float(center[axis]) - lowest
    # A pane on its edge covers all of its outline, however thin it is.
    return _area(feet) / whole if whole > 0.0 else 1.0, inside / above if above > 0.0 else np.inf


def _hull(flat: _Float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return directions in order round the circle, and the point of (2, N) that is farthest in each.

    The points are corners of the convex hull, in order round it.
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
