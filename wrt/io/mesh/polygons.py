"""Polygons and triangle strips cut into triangles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import warn
from wrt.io import memory_limits
from wrt.io.mesh.parts import IntArray, checked_faces

_Int = NDArray[np.int64]


def triangulate(
    path: str | Path, positions: NDArray[np.floating[Any]], corners: IntArray, counts: IntArray
) -> tuple[_Int, _Int]:
    """Cut polygons into triangles; concave ones too, if they are flat and do not cross themselves.

    Args:
        path: the file, for messages.
        positions: (N, 3) vertices.
        corners: (C,) vertex indices of all polygons, one after the other.
        counts: (P,) corners of each polygon; those with fewer than three give no triangle. Concave ones of many
            thousands of corners may come out as fans, with a warning.

    Returns:
        (T, 3) indices into `corners`, and (T,) the polygon of each triangle, in order.

    Raises:
        InputError: where a corner names a missing vertex.
    """
    checked_faces(path, corners, len(positions))
    starts = np.cumsum(counts) - counts
    if len(counts) and (counts == 3).all():
        return starts[:, None] + np.arange(3), np.arange(len(counts))
    triangle_groups, owner_groups = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    # A polygon that crosses itself may take steps cubic in its corners.
    before = patience = memory_limits.remaining(memory_limits.STEPS)
    with np.errstate(all="ignore"):  # positions are checked later, by the caller
        for size in np.unique(counts[counts >= 3]):
            owner = np.flatnonzero(counts == size)
            index = starts[owner][:, None] + np.arange(size)
            middle = np.arange(1, size - 1)
            fan = np.stack([np.zeros_like(middle), middle, middle + 1], axis=1)
            triangles = np.tile(fan, (len(owner), 1, 1))
            if size > 3:
                points = positions[corners[index]].astype(np.float64)
                for polygon in np.flatnonzero(~_convex(points)):
                    triangles[polygon], patience = _clip_ears(points[polygon], patience)
            triangle_groups.append((starts[owner][:, None, None] + triangles).reshape(-1, 3))
            owner_groups.append(np.repeat(owner, size - 2))
    memory_limits.count(memory_limits.STEPS, before - patience)
    if patience <= 0:
        warn(f"{path}: its concave polygons take too long to cut into triangles; some of them come out as fans")
    owners = np.concatenate(owner_groups)
    order = np.argsort(owners, kind="stable")
    return np.concatenate(triangle_groups)[order], owners[order]


def outer_sides(triangles: _Int, owners: _Int, counts: IntArray) -> NDArray[np.uint8] | None:
    """Return `Mesh.sides` of the triangles that `triangulate` returns with these `owners`; None if all are polygons."""
    sizes = np.asarray(counts, np.int64)[owners]
    if (sizes == 3).all():
        return None
    corners = triangles - (np.cumsum(counts) - counts)[owners][:, None]
    is_edge = np.roll(corners, -1, axis=1) == (corners + 1) % sizes[:, None]
    return np.asarray(is_edge @ np.array([1, 2, 4], np.uint8), np.uint8)


def _convex(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (P,) whether each of (P, n, 3) polygons turns in one direction at every corner."""
    forward = np.roll(points, -1, axis=1) - points
    turns = np.cross(np.roll(forward, 1, axis=1), forward)
    normal = turns[:, :1] + np.cross(points[:, 1:-1] - points[:, :1], points[:, 2:] - points[:, :1]).sum(
        axis=1, keepdims=True
    )
    along = np.einsum("pij,pkj->pi", turns, normal)
    slack = 1e-9 * np.abs(along).max(axis=1, keepdims=True)
    convex: NDArray[np.bool_] = ~(along < -slack).any(axis=1)
    return convex


def _clip_ears(points: NDArray[np.float64], patience: int) -> tuple[_Int, int]:
    """Return (n - 2, 3) triangles of one (n, 3) polygon by ear clipping (Meisters 1975), and the remaining patience.

    Works in the plane of the polygon's area vector (Newell's normal). A corner is cut off where it turns outwards and
    no other corner lies in its triangle; if none qualifies, as in a polygon that crosses itself, any corner goes. Where
    patience ends, what remains becomes a fan.
    """
    normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = np.delete(points, axis, axis=1)
    # Dropping y leaves (x, z), which is left-handed seen from +y.
    turn = (1.0 if normal[axis] >= 0.0 else -1.0) * (-1.0 if axis == 1 else 1.0)
    ring = list(range(len(points)))
    x, y = (np.ascontiguousarray(flat[:, k]) * side for k, side in enumerate((turn, 1.0)))
    triangles = []
    cut = 0
    while len(ring) > 3 and patience > 0:
        first = cut % len(ring)
        for k in (*range(first, len(ring)), *range(first)):
            patience -= 400  # what trying a corner costs, in numbers compared
            corners = [(float(x[n]), float(y[n])) for n in (k - 1, k, (k + 1) % len(ring))]
            (ax, ay), (bx, by), (cx, cy) = corners
            if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) <= 0.0:
                continue
            patience -= 2000 + len(ring)
            inside = (bx - ax) * (y - ay) >= (by - ay) * (x - ax)
            inside &= (cx - bx) * (y - by) >= (cy - by) * (x - bx)
            inside &= (ax - cx) * (y - cy) >= (ay - cy) * (x - cx)
            # A corner at the same place as one of the triangle's is a keyhole, not an obstacle, if not that very one.
            if all((x[n], y[n]) in corners for n in np.flatnonzero(inside)):
                cut = k
                break
        else:
            cut = first
        triangles.append((ring[cut - 1], ring[cut], ring[(cut + 1) % len(ring)]))
        del ring[cut]
        x, y = np.delete(x, cut), np.delete(y, cut)
    triangles += zip(ring[:1] * (len(ring) - 2), ring[1:], ring[2:], strict=False)
    return np.array(triangles, np.int64), patience


def split_strips(strip: _Int) -> _Int:
    """Return (T, 3) triangles of strips that are separated by negative indices.

    Every second triangle of a strip is reversed, so that all face as the first does; triangles that name a vertex twice
    only connect parts of a strip and are left out.
    """
    strip = np.asarray(strip, np.int64)
    if len(strip) < 3:
        return np.zeros((0, 3), np.int64)
    position = np.arange(len(strip))
    begin = np.maximum.accumulate(np.where(strip < 0, position + 1, 0))
    triangles = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
    odd = (position - begin)[:-2] % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    a, b, c = triangles.T
    return np.asarray(triangles[(triangles >= 0).all(axis=1) & (a != b) & (b != c) & (c != a)])
