"""Read the shape `sdfgrid`: triangles of the surface where a grid of signed distances, interpolated, is zero."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.volume.read import read_volume
from wrt.linalg import product
from wrt.scene.mesh import Mesh

Array = NDArray[np.float64]

MOST_CELLS = 2_000_000  # most parts of cells that are examined
_PARTS = 4  # parts of a cell along each axis; fewer for large grids
_NEWTON = 3  # steps by which vertices are moved onto the surface
_LEAST_GRADIENT = 1e-12

# The six tetrahedra of a cube around its diagonal from (0, 0, 0) to (1, 1, 1): Kuhn's subdivision, which meets that of
# neighbouring cubes at the faces. Corner k is at bits 0, 1 and 2 of k along x, y and z.
_TETRAHEDRA = np.array([[0, 1 << a, (1 << a) | (1 << b), 7] for a, b, _ in itertools.permutations(range(3))])

# Corner k of a cell, by x, y and z.
_CORNERS = np.array([[k >> axis & 1 for axis in range(3)] for k in range(8)])


def read_sdfgrid(plugin: Plugin) -> Mesh:
    """Return the surface of an `sdfgrid` in its unit cube."""
    path = plugin.file()
    smooth = plugin.choice("normals", "smooth", "analytic") == "smooth"
    plugin.ignore("watertight")
    with plugin.locating():
        values = read_volume(path).values
        if values.ndim != 3:
            raise InputError(f"{path.name}: has {values.shape[3]} channels, and distances have one")
        # A surface crosses about as many cells as three sides of the cube have.
        crossed = 6 * max(values.shape) ** 2
        parts = max(1, min(_PARTS, int((MOST_CELLS / crossed) ** (1.0 / 3.0))))
        return isosurface(values.astype(float), parts, smooth=smooth)


def isosurface(values: Array, parts: int, *, smooth: bool) -> Mesh:
    """Return the zero surface of a grid in the unit cube, facing growing values.

    The (z, y, x) values are those at corners of cells, which are cut into `parts` along each axis. Smooth normals are
    those of Hansson-Söderlund, Evans and Akenine-Möller (2022), section 4: at each point the gradients of the eight
    cells around the nearest corner, interpolated.
    """
    if min(values.shape) < 2:
        raise InputError("a grid of distances needs two values at least along each axis")
    cells = np.array(values.shape[::-1]) - 1
    windows = np.lib.stride_tricks.sliding_window_view(values, (2, 2, 2)).reshape(*np.array(values.shape) - 1, 8)
    corners = np.argwhere((windows.min(axis=-1) < 0.0) & (windows.max(axis=-1) >= 0.0))[:, ::-1]
    if not len(corners):
        raise InputError("the distances of a grid have one sign, so that there is no surface")
    if len(corners) * parts**3 > MOST_CELLS:
        raise InputError("the surface of a grid of distances is too large")
    # Lattice points of the finer grid, as integers, so that neighbours share their vertices.
    offsets = np.stack(np.meshgrid(*[np.arange(parts)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    fine = (corners[:, None] * parts + offsets).reshape(-1, 3)
    lattice = fine[:, None] + _CORNERS
    at = _interpolated(values, lattice.reshape(-1, 3) / parts).reshape(-1, 8)
    crossed = (at.min(axis=1) < 0.0) & (at.max(axis=1) >= 0.0)
    width, height, _ = cells * parts + 1
    x, y, z = np.moveaxis(lattice[crossed], -1, 0)
    points, faces = _march((z * height + y) * width + x, at[crossed], lattice[crossed] / parts)
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


def _march(keys: NDArray[np.int64], at: Array, places: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return vertices on edges of tetrahedra, and triangles between them, in any order of corners.

    Cubes have (N, 8) keys of their corners, values there, and (N, 8, 3) positions.
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
            cut = [(a, b) for a in range(4) if code >> a & 1 for b in range(4) if not code >> b & 1]
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


def _cell_of(values: Array, points: Array) -> NDArray[np.int64]:
    """Return the cells around points, (N, 3)."""
    return np.clip(np.floor(points).astype(np.int64), 0, np.array(values.shape[::-1]) - 2)


def _weighted_corners(values: Array, points: Array, cell: NDArray[np.int64]) -> Iterator[tuple[Array, Array, Array]]:
    """Yield for each corner of cells its bits (3,), its values (N,), and its weights along x, y and z at points."""
    share = points - cell
    for corner in _CORNERS:
        x, y, z = (cell + corner).T
        yield corner, np.asarray(values[z, y, x], np.float64), np.where(corner, share, 1.0 - share).T


def _interpolated(values: Array, points: Array) -> Array:
    """Return values at points, whose unit is a cell."""
    total = np.zeros(len(points))
    for _, value, (x, y, z) in _weighted_corners(values, points, _cell_of(values, points)):
        total += value * x * y * z
    return total


def _gradient(values: Array, points: Array, cell: NDArray[np.int64] | None = None) -> Array:
    """Return (N, 3) gradients per cell at points, of the cell around each or of another cell, continued."""
    result = np.zeros((len(points), 3))
    for corner, value, (x, y, z) in _weighted_corners(
        values, points, _cell_of(values, points) if cell is None else cell
    ):
        for axis, (first, second) in enumerate(((y, z), (x, z), (x, y))):
            result[:, axis] += value * (1.0 if corner[axis] else -1.0) * first * second
    return result


def _smooth_gradient(values: Array, points: Array) -> Array:
    """Return the gradients of the cells around the nearest corner of each point, interpolated between their centres."""
    first = np.floor(points - 0.5).astype(np.int64)
    share = points - 0.5 - first
    result = np.zeros((len(points), 3))
    for corner in _CORNERS:
        cell = np.clip(first + corner, 0, np.array(values.shape[::-1]) - 2)
        x, y, z = np.where(corner, share, 1.0 - share).T
        gradient = _gradient(values, points, cell)
        gradient /= np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), _LEAST_GRADIENT)
        result += gradient * (x * y * z)[:, None]
    return result
