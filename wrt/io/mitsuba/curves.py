"""Tessellate Mitsuba's curves, `bsplinecurve` and `linearcurve`, as tubes.

Texture coordinates are Mitsuba's: u is the fraction of a turn about the curve, v the fraction of all segments of the
file.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.surfaces import Detail
from wrt.io.safe_read import read_file
from wrt.linalg import norm, product
from wrt.scene.exact.spheres import ball
from wrt.scene.mesh import Mesh, merge

Array = NDArray[np.float64]

CURVES = ("bsplinecurve", "linearcurve")

LEAST_AROUND, MOST_AROUND = 8, 96  # sides of a tube
MOST_ALONG = 64  # rings of one segment of a spline
_BYTES_PER_VERTEX = 80  # of a tube: a position, a normal, texture coordinates, and two triangles


def read_curves(plugin: Plugin, detail: Detail) -> tuple[Mesh, bool]:
    """Return the tubes of a plugin in world space, and whether the inside of any is seen through an open end."""
    path = plugin.file()
    matrix = plugin.transform()
    is_spline = plugin.type == "bsplinecurve"
    step = 3 if is_spline else 1
    pieces: list[Mesh] = []
    first = 0
    with plugin.locating():
        curves = _control_points(path, step + 1)
        total = sum(len(each) - step for each in curves)
        for each in curves:  # radii stay as they are
            each[:, :3] = product(each[:, :3], matrix[:3, :3].T) + matrix[:3, 3]
            pieces += [_spline(each, first, total, detail)] if is_spline else _chain(each, first, total, detail)
            first += len(each) - step
    weights = np.array([1.0, 4.0, 1.0]) / 6.0
    is_open = is_spline and any(product(weights, end) > 0.0 for each in curves for end in (each[:3, 3], each[-3:, 3]))
    return merge(pieces, path.name), is_open


def _control_points(path: Path, least: int) -> list[Array]:
    """Return the (N, 4) positions and radii of each curve; empty lines separate curves."""
    curves: list[list[list[float]]] = [[]]
    for number, line in enumerate(read_file(path).decode("utf-8", "replace").splitlines(), 1):
        words = line.split()
        if not words:
            curves.append([])
            continue
        try:
            values = [float(word) for word in words[:4]]
        except ValueError:
            values = []
        if len(values) != 4 or not all(map(math.isfinite, values)) or values[3] < 0.0:
            raise InputError(f"{path}: line {number}: a point of a curve is three coordinates and a radius from 0")
        curves[-1].append(values)
    curves = [curve for curve in curves if curve]
    fewest = min(map(len, curves), default=0)
    if fewest < least:
        raise InputError(f"{path}: a curve has {fewest} points; it needs {least} at least")
    return [np.array(curve) for curve in curves]


def _around(points: Array, detail: Detail) -> tuple[int, float]:
    """Return the number of sides of a tube, and its tolerance in metres."""
    radius = max(float(points[:, 3].max()), 1e-12)
    tolerance = min(detail.tolerance(point, radius) for point in points[:: max(1, len(points) // 8), :3])
    share = min(max(0.5 * tolerance / radius, 1e-9), 1.0)
    sides = math.ceil(math.pi / math.acos(1.0 - share)) if share < 1.0 else LEAST_AROUND
    return min(max(sides, LEAST_AROUND), MOST_AROUND), tolerance


def _spline(points: Array, first: int, total: int, detail: Detail) -> Mesh:
    """Return a uniform cubic B-spline as an open tube (de Boor 1978)."""
    sides, tolerance = _around(points, detail)
    segments = len(points) - 3
    bend = np.linalg.norm(points[2:, :3] - 2.0 * points[1:-1, :3] + points[:-2, :3], axis=1).max()
    size = max(float(points[:, 3].max()), 1e-12)
    # A chord of a parabola with second derivative b is off by b h² / 8; the outside of a bend by more.
    along = math.ceil(math.sqrt(bend / (4.0 * tolerance) * (1.0 + size / max(tolerance * sides, 1e-12) * 0.1)))
    along = min(max(along, 4), MOST_ALONG)
    memory_limits.require(memory_limits.MADE, segments * along * sides * _BYTES_PER_VERTEX)
    place = np.arange(segments * along + 1) / along
    index = np.minimum(place.astype(np.int64), segments - 1)
    t = (place - index)[:, None]
    a, b, c, d = (points[index + k] for k in range(4))
    value = ((1 - t) ** 3 * a + (3 * t**3 - 6 * t**2 + 4) * b + (-3 * t**3 + 3 * t**2 + 3 * t + 1) * c + t**3 * d) / 6.0
    slope = (-((1 - t) ** 2) * a + (3 * t**2 - 4 * t) * b + (-3 * t**2 + 2 * t + 1) * c + t**2 * d) / 2.0
    second = (1 - t) * a + (3 * t - 2) * b + (1 - 3 * t) * c + t * d
    return _tube(value, slope, second, (first + place) / total, sides)


def _tube(value: Array, slope: Array, second: Array, v: Array, sides: int) -> Mesh:
    """Return a tube around points with radii, given their first and second derivatives."""
    length = np.linalg.norm(slope[:, :3], axis=1)
    tangent = slope[:, :3] / np.maximum(length, 1e-30)[:, None]
    good = np.flatnonzero(length >= 1e-20)
    if not len(good):
        tangent[:] = 0.0, 0.0, 1.0
    elif len(good) < len(v):  # where control points are repeated
        tangent = tangent[good[np.abs(np.arange(len(v))[:, None] - good).argmin(1)]]
    x, y = _frames(tangent)
    theirs_x, theirs_y = _mitsuba_frames(tangent)
    # The geometry follows frames that do not twist; u is measured in Mitsuba's, which can.
    shift = np.unwrap(np.arctan2((x * theirs_y).sum(1), (x * theirs_x).sum(1)))
    turn = np.arange(sides + 1) / sides
    angle = 2.0 * math.pi * (np.arange(sides + 1) % sides) / sides
    out = np.cos(angle)[None, :, None] * x[:, None] + np.sin(angle)[None, :, None] * y[:, None]
    radius = value[:, None, 3:]
    points = value[:, None, :3] + radius * out
    stretch = (length**2)[:, None, None] - radius * (out * second[:, None, :3]).sum(2, keepdims=True)
    normals = np.maximum(stretch, 1e-30) * out - slope[:, None, 3:] * slope[:, None, :3]
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300)
    u = turn[None, :] + (shift / (2.0 * math.pi))[:, None]
    uvs = np.stack([u, np.broadcast_to(v[:, None], u.shape)], axis=-1)
    return Mesh(points.reshape(-1, 3), _faces(len(v), sides), normals.reshape(-1, 3), uvs.reshape(-1, 2), name="curve")


def _faces(rings: int, sides: int) -> NDArray[np.int64]:
    """Return the triangles of a tube, outwards where the rings turn counter-clockwise about the direction they go."""
    row, column = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a = (row * (sides + 1) + column).reshape(-1)
    b, c, d = a + 1, a + sides + 1, a + sides + 2
    return np.concatenate([np.stack([a, b, d], -1), np.stack([a, d, c], -1)])


def _mitsuba_frames(tangent: Array) -> tuple[Array, Array]:
    """Return Mitsuba's directions of u = 0 and u = 1/4: perpendicular to the curve and nearest to z."""
    up = np.array([0.0, 0.0, 1.0]) - tangent * tangent[:, 2:]
    size = np.linalg.norm(up, axis=1, keepdims=True)
    up = np.where(size < 1e-9, np.array([0.0, 1.0, 0.0]), up / np.maximum(size, 1e-30))
    return np.cross(up, tangent), up


def _frames(tangent: Array) -> tuple[Array, Array]:
    """Return directions perpendicular to the curve that do not twist about it (Wang et al. 2008, double reflection)."""
    x = np.empty_like(tangent)
    start, up = _mitsuba_frames(tangent[:1])
    x[0] = start[0]
    # Right-handed about the tangent, in the sense of _faces.
    side = 1.0 if product(np.cross(start[0], up[0]), tangent[0]) > 0.0 else -1.0
    for i in range(len(tangent) - 1):
        between = tangent[i + 1] - tangent[i]
        weight = product(between, between)
        moved = x[i]
        if weight > 1e-24:
            # A rotation from one tangent to the next about their common normal.
            cosine = float(np.clip(product(tangent[i], tangent[i + 1]), -1.0, 1.0))
            axis = np.cross(tangent[i], tangent[i + 1])
            if 1.0 + cosine > 1e-9:
                moved = x[i] * cosine + np.cross(axis, x[i]) + axis * product(axis, x[i]) / (1.0 + cosine)
        moved = moved - tangent[i + 1] * product(tangent[i + 1], moved)
        x[i + 1] = moved / max(norm(moved), 1e-30)
    return x, side * np.cross(tangent, x)


def _chain(points: Array, first: int, total: int, detail: Detail) -> list[Mesh]:
    """Return straight segments: cones that touch a ball at each of their points, and those balls."""
    sides, _ = _around(points, detail)
    memory_limits.require(memory_limits.MADE, len(points) * sides * (sides // 2 + 3) * _BYTES_PER_VERTEX)
    balls = 4 * math.ceil(sides / 4)
    pieces = []
    for i, (x, y, z, radius) in enumerate(points):
        if radius > 0.0:
            matrix = np.diag([radius, radius, radius, 1.0])
            matrix[:3, 3] = x, y, z
            joint = ball(balls).transformed(matrix)
            assert joint.uvs is not None
            uvs = joint.uvs.copy()
            uvs[:, 1] = (first + i) / total
            pieces.append(Mesh(joint.vertices, joint.faces, joint.normals, uvs, name="curve"))
        if i + 1 < len(points):
            pieces += _cone(points[i], points[i + 1], np.array([first + i, first + i + 1]) / total, sides)
    return pieces


def _cone(start: Array, end: Array, v: Array, sides: int) -> list[Mesh]:
    """Return the cone that touches two balls, or nothing where one ball holds the other."""
    along = end[:3] - start[:3]
    length = norm(along)
    if length <= abs(start[3] - end[3]) or max(start[3], end[3]) == 0.0:
        return []
    axis = along / length
    lean = (start[3] - end[3]) / length
    x, y = (each[0] for each in _mitsuba_frames(axis[None]))
    angle = 2.0 * math.pi * (np.arange(sides + 1) % sides) / sides
    out = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
    normals = math.sqrt(1.0 - lean * lean) * out + lean * axis
    points = np.concatenate([start[:3] + start[3] * normals, end[:3] + end[3] * normals])
    u = np.arange(sides + 1) / sides
    uvs = np.stack([np.tile(u, 2), np.repeat(v, sides + 1)], axis=-1)
    faces = _faces(2, sides)
    # At a radius of 0, the triangles of that end have no area.
    solid = np.repeat([start[3] > 0.0, end[3] > 0.0], sides)
    return [Mesh(points, faces[solid], np.tile(normals, (2, 1)), uvs, name="curve")]
