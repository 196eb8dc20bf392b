"""A mountain range of as many triangles as one asks for, the same on every machine's every run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.scene.mesh import Mesh
from wrt.values import integer

SIDE = 4000.0
"""Metres along x and z."""

RELIEF = 900.0
"""Metres that the sum of all ridges can rise."""

MINIMUM, MAXIMUM = 1_000, 10_000_000

_CELLS = 2  # lattice cells of the coarsest octave along a side
_OCTAVES = 11
_GAIN = 2.4  # how strongly a ridge lets detail grow on it
_POINTS_PER_CELL = 4.0  # an octave finer than the grid can show is left out

Array = NDArray[np.float32]


def terrain(triangles: int) -> Mesh:
    """Return a mountain range with normals and colours, centred on the origin, y up.

    It is a ridged multifractal (F. K. Musgrave, in Ebert et al., "Texturing and Modeling", 3rd ed.,
    2003, chapter 16) over gradient noise (K. Perlin, "Improving Noise", SIGGRAPH 2002). More triangles
    show the same mountains in more detail. Colours are snow, rock, scree and grass by height and slope.

    Args:
        triangles: 1,000 to 10,000,000. The mesh has the most that a nearly square grid allows
            without exceeding it: never 2 % fewer, and exactly a thousand or a million when asked.

    Raises:
        InputError: on a number outside that range.
    """
    rows, columns = grid_size(integer(triangles, "triangles", minimum=MINIMUM, maximum=MAXIMUM))
    height = _heights(rows + 1, columns + 1)
    normals = _normals(height)
    colors = _colors(height, normals[..., 1])
    vertices = np.empty((*height.shape, 3), dtype=np.float32)
    vertices[..., 0] = np.linspace(-0.5 * SIDE, 0.5 * SIDE, columns + 1, dtype=np.float32)
    vertices[..., 1] = height
    vertices[..., 2] = np.linspace(-0.5 * SIDE, 0.5 * SIDE, rows + 1, dtype=np.float32)[:, None]
    return Mesh.taking(
        vertices.reshape(-1, 3),
        _faces(rows, columns),
        normals=normals.reshape(-1, 3),
        colors=colors.reshape(-1, 3),
        name="many-triangles",
    )


def grid_size(triangles: int) -> tuple[int, int]:
    """Return rows and columns of cells, two triangles each: the most, then the squarest, up to about 3:4."""
    side = (0.5 * triangles) ** 0.5
    rows = np.arange(np.floor(0.87 * side), side + 1.0).astype(np.int64)
    columns = triangles // (2 * rows)
    best = np.lexsort((np.abs(rows - columns), -rows * columns))[0]
    return int(rows[best]), int(columns[best])


def _faces(rows: int, columns: int) -> NDArray[np.int32]:
    corner = np.arange(rows, dtype=np.int32)[:, None] * np.int32(columns + 1) + np.arange(columns, dtype=np.int32)
    faces = np.empty((rows, columns, 2, 3), dtype=np.int32)
    below = corner + np.int32(columns + 1)  # the neighbour towards +z
    faces[..., 0, 0], faces[..., 0, 1], faces[..., 0, 2] = corner, below, below + 1
    faces[..., 1, 0], faces[..., 1, 1], faces[..., 1, 2] = corner, below + 1, corner + 1
    return faces.reshape(-1, 3)


def _heights(rows: int, columns: int) -> Array:
    """Return a (rows, columns) grid of heights, metres."""
    total = np.zeros((rows, columns), dtype=np.float32)
    weight = np.ones((rows, columns), dtype=np.float32)
    amplitude = 1.0
    for octave in range(_OCTAVES):
        cells = _CELLS * 2**octave
        if cells * _POINTS_PER_CELL > min(rows, columns):
            break
        ridge = _gradient_noise(rows, columns, cells, octave)
        np.abs(ridge, out=ridge)
        np.subtract(np.float32(1.0), ridge, out=ridge)
        ridge *= ridge
        ridge *= weight
        total += np.float32(amplitude) * ridge
        np.clip(np.float32(_GAIN) * ridge, 0.0, 1.0, out=weight)
        amplitude *= 0.47
    total *= np.float32(RELIEF * (1.0 - 0.47))
    return total


def _gradient_noise(rows: int, columns: int, cells: int, seed: int) -> Array:
    """Return gradient noise in about [-1, 1] on a grid over cells × cells lattice cells.

    Blending by a product of weights makes the noise a sum of separable terms: for each of the two
    components of the lattice gradients, interpolate along z, then along x. So a whole row costs a few
    array operations, however many cells it crosses.
    """
    angle = np.random.default_rng([2025, seed]).uniform(0.0, 2.0 * np.pi, (cells + 1, cells + 1))
    at_x, near_x, far_x, offset_x = _lattice(columns, cells)
    at_z, near_z, far_z, offset_z = _lattice(rows, cells)
    result = np.zeros((rows, columns), dtype=np.float32)
    for gradient, bend_x, bend_z in ((np.cos(angle), True, False), (np.sin(angle), False, True)):
        lattice = gradient.astype(np.float32)
        near, far = (near_x * offset_x, far_x * (offset_x - 1.0)) if bend_x else (near_x, far_x)
        along_x = lattice[:, at_x] * near + lattice[:, at_x + 1] * far
        near, far = (near_z * offset_z, far_z * (offset_z - 1.0)) if bend_z else (near_z, far_z)
        result += along_x[at_z] * near[:, None]
        result += along_x[at_z + 1] * far[:, None]
    # The largest value of unit-gradient noise is sqrt(1/2), in the middle of a cell.
    result *= np.float32(2.0**0.5)
    return result


def _lattice(count: int, cells: int) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Return, for `count` points across `cells`: the cell, the weights of its two ends, the place in it."""
    place = np.linspace(0.0, cells, count)
    cell = np.minimum(place.astype(np.int64), cells - 1)
    t = place - cell
    far = t**3 * (t * (6.0 * t - 15.0) + 10.0)
    return cell, (1.0 - far).astype(np.float32), far.astype(np.float32), t.astype(np.float32)


def _normals(height: Array) -> Array:
    """Return the (rows, columns, 3) unit normals of a height field, by central differences."""
    rows, columns = height.shape
    normals = np.empty((rows, columns, 3), dtype=np.float32)
    normals[..., 2], normals[..., 0] = (
        -slope for slope in np.gradient(height, np.float32(SIDE / (rows - 1)), np.float32(SIDE / (columns - 1)))
    )
    normals[..., 1] = 1.0
    normals /= np.sqrt(np.einsum("ijk,ijk->ij", normals, normals))[..., None]
    return normals


def _colors(height: Array, up: Array) -> Array:
    """Return (rows, columns, 3) linear Rec. 709 reflectances by height and by how level the ground is."""
    grass, scree, rock, snow = np.array(
        [[0.075, 0.090, 0.030], [0.200, 0.165, 0.125], [0.125, 0.112, 0.105], [0.800, 0.820, 0.850]], np.float32
    )
    level = height / np.float32(RELIEF)
    colors = np.empty((*height.shape, 3), dtype=np.float32)
    colors[:] = rock
    for color, amount in (
        (scree, _step(up, 0.60, 0.78)),
        (grass, _step(up, 0.66, 0.84) * _step(level, 0.56, 0.44)),
        (snow, _step(up, 0.50, 0.72) * _step(level + np.float32(0.2) * (up - np.float32(0.8)), 0.58, 0.70)),
    ):
        colors += amount[..., None] * (color - colors)
    return _smoothed(_smoothed(colors, 0), 1)


def _smoothed(values: Array, axis: int) -> Array:
    """Return values averaged with their neighbours, 1:2:1 along an axis.

    What changes from one point to the next looks like a comb, all cells being cut along the same diagonal.
    """
    count = values.shape[axis]
    at = np.arange(count)
    before, after = np.maximum(at - 1, 0), np.minimum(at + 1, count - 1)
    smooth = np.take(values, before, axis)
    smooth += np.take(values, after, axis)
    smooth *= np.float32(0.5)
    smooth += values
    smooth *= np.float32(0.5)
    return smooth


def _step(value: Array, low: float, high: float) -> Array:
    """Return 0 at `low`, 1 at `high`, a smooth cubic in between."""
    t: Array = np.clip((value - np.float32(low)) * np.float32(1.0 / (high - low)), 0.0, 1.0)
    return t * t * (np.float32(3.0) - np.float32(2.0) * t)
