"""Triangles of the surface where a grid of signed distances, interpolated trilinearly, is zero."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.linalg import product
from wrt.scene.mesh import Mesh

Array = NDArray[np.float64]

MOST_CELLS = 2_000_000
"""Most parts of cells that are looked at."""

_NEWTON = 3
"""Steps by which vertices are moved onto the surface."""

_LEAST_GRADIENT = 1e-12

# The six tetrahedra of a cube around its diagonal from (0, 0, 0) to (1, 1, 1): Kuhn's subdivision, which meets that of
# neighbouring cubes at the faces. Corner k is at bits 0, 1 and 2 of k along x, y and z.
_TETRAHEDRA = np.array([[0, 1 << a, (1 << a) | (1 << b), 7] for a, b, _ in itertools.permutations(range(3))])


def isosurface(values: Array, parts: int, *, smooth: bool) -> Mesh:
    """Return the zero surface of a grid in the unit cube, facing growing values.

    Args:
        values: (z, y, x) values at the corners of cells, two at least along each axis.
        parts: subdivisions of a cell along each axis.
        smooth: whether normals are those of Hansson-Söderlund, Evans and Akenine-Möller (2022), section 4: at each
            point the gradients of the eight cells around the nearest corner, interpolated; otherwise the triangles'.

    Raises:
        InputError: if the values have one sign, or the surface takes too many triangles.
    """
    if min(values.shape) < 2:
        raise InputError("a grid of distances needs two values at least along each axis")
    cells = np.array(values.shape[::-1]) - 1
    corners = _crossed_cells(values)
    if not len(corners):
        raise InputError("the distances of a grid have one sign, so that there is no surface")
    if len(corners) * parts**3 > MOST_CELLS:
        raise InputError("the surface of a grid of distances is too large")
    # Lattice points of the finer grid, as integers, so that neighbours share their vertices.
    offsets = np.stack(np.meshgrid(*[np.arange(parts)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    fine = (corners[:, None] * parts + offsets).reshape(-1, 3)
    bits = np.stack([(np.arange(8) >> k) & 1 for k in range(3)], axis=-1)
    lattice = fine[:, None] + bits
    at = _interpolated(values, lattice.reshape(-1, 3) / parts).reshape(-1, 8)
    crossed = (at.min(axis=1) < 0.0) & (at.max(axis=1) >= 0.0)
    keys = _keys(lattice[crossed], cells * parts + 1)
    points, faces = _march(keys, at[crossed], lattice[crossed] / parts)
    for _ in range(_NEWTON):
        gradient = _gradient(values, points)
        slope = np.maximum((gradient**2).sum(axis=1, keepdims=True), _LEAST_GRADIENT)
        step = gradient * (_interpolated(values, points)[:, None] / slope)
        points = np.clip(points - np.clip(step, -0.5 / parts, 0.5 / parts), 0.0, cells)
    faces = _facing(points, faces, _gradient(values, points))
    normals = None
    if smooth:
        normals = _smooth_gradient(values, points) * cells
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), _LEAST_GRADIENT)
    return Mesh(points / cells, faces, normals, name="sdfgrid")


def _crossed_cells(values: Array) -> NDArray[np.int64]:
    """Return (N, 3) the x, y and z of cells with corners of both signs."""
    low, high = values, values
    for axis in range(3):
        size = values.shape[axis]
        ends = [np.take(low, range(size - 1), axis), np.take(low, range(1, size), axis)]
        low, high = (
            np.minimum(*ends),
            np.maximum(np.take(high, range(size - 1), axis), np.take(high, range(1, size), axis)),
        )
    return np.argwhere((low < 0.0) & (high >= 0.0))[:, ::-1]


def _keys(lattice: NDArray[np.int64], size: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return one number for each lattice point."""
    return np.asarray((lattice[..., 2] * size[1] + lattice[..., 1]) * size[0] + lattice[..., 0])


def _march(keys: NDArray[np.int64], at: Array, places: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return vertices on edges of tetrahedra, and triangles between them, in any order of corners.

    Args:
        keys: (N, 8) numbers of the corners of cubes.
        at: (N, 8) values there.
        places: (N, 8, 3) where they are.
    """
    count = np.int64(keys.max()) + 1
    ends: list[Array] = []
    edges: list[NDArray[np.int64]] = []
    triangles: list[NDArray[np.int64]] = []
    total = 0
    for tetrahedron in _TETRAHEDRA:
        inside = at[:, tetrahedron] < 0.0
        pattern = product(inside, (1, 2, 4, 8))
        for code in range(1, 15):
            chosen = np.flatnonzero(pattern == code)
            if not len(chosen):
                continue
            within = [k for k in range(4) if code >> k & 1]
            without = [k for k in range(4) if not code >> k & 1]
            cut = [(a, b) for a in within for b in without]
            if len(cut) == 4:  # in the order around the quadrilateral
                cut = [cut[0], cut[1], cut[3], cut[2]]
            for a, b in cut:
                a, b = tetrahedron[a], tetrahedron[b]
                first, second = keys[chosen, a], keys[chosen, b]
                edges.append(np.minimum(first, second) * count + np.maximum(first, second))
                share = (at[chosen, a] / (at[chosen, a] - at[chosen, b]))[:, None]
                ends.append(places[chosen, a] * (1.0 - share) + places[chosen, b] * share)
            numbers = total + np.arange(len(cut))[:, None] * len(chosen) + np.arange(len(chosen))
            triangles.append(numbers[[0, 1, 2]].T)
            if len(cut) == 4:
                triangles.append(numbers[[0, 2, 3]].T)
            total += len(cut) * len(chosen)
    _, first_of, number_of = np.unique(np.concatenate(edges), return_index=True, return_inverse=True)
    faces = number_of.reshape(-1)[np.concatenate(triangles)]
    return np.concatenate(ends)[first_of], faces


def _facing(points: Array, faces: NDArray[np.int64], gradient: Array) -> NDArray[np.int64]:
    """Return faces with their fronts towards growing values, without those of no area."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    along = np.einsum("ij,ij->i", normals, gradient[faces].mean(axis=1))
    turned = np.where((along < 0.0)[:, None], faces[:, ::-1], faces)
    return np.asarray(turned[np.linalg.norm(normals, axis=1) > 1e-14])


# --- Trilinear interpolation -----------------------------------------------------------------------


def _cell_of(values: Array, points: Array) -> tuple[NDArray[np.int64], Array]:
    cells = np.array(values.shape[::-1]) - 1
    cell = np.clip(np.floor(points).astype(np.int64), 0, cells - 1)
    return cell, points - cell


def _corner(values: Array, cell: NDArray[np.int64], k: int) -> Array:
    x, y, z = (cell[:, axis] + (k >> axis & 1) for axis in range(3))
    return np.asarray(values[z, y, x], np.float64)


def _interpolated(values: Array, points: Array) -> Array:
    """Return values at points, whose unit is a cell."""
    cell, share = _cell_of(values, points)
    total = np.zeros(len(points))
    for k in range(8):
        weights = [share[:, axis] if k >> axis & 1 else 1.0 - share[:, axis] for axis in range(3)]
        total += _corner(values, cell, k) * weights[0] * weights[1] * weights[2]
    return total


def _gradient(values: Array, points: Array, cell: NDArray[np.int64] | None = None) -> Array:
    """Return (N, 3) gradients per cell at points, of the cell around each or of another, continued."""
    if cell is None:
        cell, share = _cell_of(values, points)
    else:
        share = points - cell
    result = np.zeros((len(points), 3))
    for k in range(8):
        corner = _corner(values, cell, k)
        weights = [share[:, axis] if k >> axis & 1 else 1.0 - share[:, axis] for axis in range(3)]
        for axis in range(3):
            others = [weights[other] for other in range(3) if other != axis]
            result[:, axis] += corner * (1.0 if k >> axis & 1 else -1.0) * others[0] * others[1]
    return result


def _smooth_gradient(values: Array, points: Array) -> Array:
    """Return the gradients of the cells around the nearest corner of each point, interpolated between their centres."""
    cells = np.array(values.shape[::-1]) - 1
    first = np.floor(points - 0.5).astype(np.int64)
    share = points - 0.5 - first
    result = np.zeros((len(points), 3))
    for k in range(8):
        corner = np.array([k >> axis & 1 for axis in range(3)])
        cell = np.clip(first + corner, 0, cells - 1).astype(np.int64)
        weights = [share[:, axis] if k >> axis & 1 else 1.0 - share[:, axis] for axis in range(3)]
        gradient = _gradient(values, points, cell)
        gradient /= np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), _LEAST_GRADIENT)
        result += gradient * (weights[0] * weights[1] * weights[2])[:, None]
    return result
