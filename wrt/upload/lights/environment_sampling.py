"""Tables for sampling directions towards an environment image.

The image is divided into cells, and each cell into a tile of bins. A bin is sampled within its cell in proportion to
its light; a cell in proportion to its light times the cosine to the receiver's normal, from one table for each of a few
hundred normals. This avoids the half of the sphere that a surface never sees. Clarberg, Jarosz, Akenine-Möller and
Jensen (2005) sample such products of light and reflectance with wavelets; here it is a grid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import product
from wrt.scene.environment import image_directions
from wrt.upload.lights.piecewise import integrals, pooled, tiles

ROWS, COLUMNS = 16, 32
"""Cells of an image, 11 degrees wide and high at the horizon."""

MOST_BINS = 64
"""Most bins along the side of a cell: a fifth of a degree, 4 MB in all."""

COARSEST = 1.05
"""Bins may be coarse enough to raise the second moment of the estimate by this factor."""

STEPS = 16
"""The normals are the nodes of a grid of STEPS + 1 by STEPS + 1 over the octahedron, which include the axes."""

SOFTNESS = 0.1
"""Typical angle in radians between a normal and its nearest node; the clamped cosine is smoothed by this much."""

OFFSET, LEAST = 0.5, 0.1
"""The density is the radiance minus OFFSET times its mean, but at least LEAST times the radiance."""


class EnvironmentTables:
    """The tables that kernels/lights/environment.py reads.

    Attributes:
        cells: (normals + 1, ROWS + ROWS COLUMNS) uint16 tile of cells for each normal; the last is for receivers
            without a normal.
        bins: (ROWS COLUMNS, S + S S) uint16 tile of each cell.
        side: S, bins along the side of a cell, a power of two.
        flux: luminance integrated over all directions.
    """

    def __init__(self, luminance: NDArray[np.floating], image_to_world: NDArray[np.float64]) -> None:
        """Make the tables of an image from the luminance of its texels, (H, W), and its rotation, (3, 3)."""
        light = bin_light(luminance, finest_side(luminance.shape))
        solid_angle = np.broadcast_to(solid_angles(*light.shape), light.shape)
        self.flux = float(light.sum())
        weights = compensated(light, solid_angle)
        self.side = side = coarsest_side(weights)
        bins = pooled(weights, ROWS * side, COLUMNS * side).reshape(ROWS, side, COLUMNS, side).transpose(0, 2, 1, 3)
        self.cells = tiles(by_normal(weights, image_to_world))
        self.bins = tiles(bins.reshape(-1, side, side))


def solid_angles(height: int, width: int) -> NDArray[np.float64]:
    """Return (H, 1) solid angles of a texel in each row."""
    edges = np.cos(np.linspace(0.0, np.pi, height + 1))
    return np.asarray((edges[:-1] - edges[1:])[:, None] * (2.0 * np.pi / width))


def finest_side(shape: tuple[int, ...]) -> int:
    """Return the bins along the side of a cell that are as fine as texels."""
    side = 1
    while side < MOST_BINS and (ROWS * side < shape[0] or COLUMNS * side < shape[1]):
        side *= 2
    return side


def bin_light(luminance: NDArray[np.floating], side: int) -> NDArray[np.float64]:
    """Return (ROWS S, COLUMNS S) light from each bin: the interpolated luminance times the solid angle."""
    height, width = ROWS * side, COLUMNS * side
    sums = integrals(integrals(luminance, width, 1, "wrap"), height, 0, "edge")
    area = luminance.size / (height * width)
    return sums / area * solid_angles(height, width)


def compensated(light: NDArray[np.float64], solid_angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the light minus a part of its mean, which BSDF sampling covers well enough.

    This moves samples from dim to bright regions, where multiple importance sampling needs them (MIS compensation,
    Karlík, Šik, Vévoda, Skřivan and Křivánek 2019). All light keeps a positive density, so that the estimate is
    unbiased without BSDF samples too.
    """
    mean = float(light.sum() / solid_angle.sum())
    return np.maximum(light - OFFSET * mean * solid_angle, LEAST * light)


def coarsest_side(weights: NDArray[np.float64]) -> int:
    """Return the fewest bins along the side of a cell that are fine enough; small tables stay in caches."""
    finest = len(weights) // ROWS
    total = weights.sum()
    side = 1
    while side < finest:
        coarse = pooled(weights, ROWS * side, COLUMNS * side)
        squares = pooled(weights * weights, ROWS * side, COLUMNS * side)
        parts = (finest // side) ** 2
        moment = parts * np.divide(squares, coarse, out=np.zeros_like(coarse), where=coarse > 0.0).sum()
        if moment <= COARSEST * total:
            break
        side *= 2
    return side


def by_normal(weights: NDArray[np.float64], image_to_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (normals + 1, ROWS, COLUMNS) light from each cell for each normal, and without a normal."""
    parts = 4
    height, width = parts * ROWS, parts * COLUMNS
    coarse = pooled(weights, min(height, len(weights)), min(width, weights.shape[1]))
    repeats = height // len(coarse)
    fine = np.repeat(np.repeat(coarse, repeats, axis=0), repeats, axis=1) / repeats**2
    directions = product(image_directions(height, width), image_to_world.T)
    normals = octahedral_nodes()
    cells = np.empty((len(normals) + 1, ROWS, COLUMNS))
    for row in range(ROWS):
        block = slice(parts * row, parts * (row + 1))
        cosines = np.einsum("nk,ijk->nij", normals, directions[block])
        softened = 0.5 * (cosines + np.sqrt(cosines * cosines + SOFTNESS * SOFTNESS))
        received = (softened * fine[block]).sum(axis=1)
        cells[:-1, row] = received.reshape(len(normals), COLUMNS, parts).sum(axis=2)
    cells[-1] = pooled(weights, ROWS, COLUMNS)
    return cells


def octahedral_nodes() -> NDArray[np.float64]:
    """Return ((STEPS + 1)², 3) unit normals of the tables, in the order of the device.

    They are nodes of the octahedron |x| + |y| + |z| = 1 with its lower half folded outwards (Cigolle et al. 2014).
    """
    steps = 2.0 * np.arange(STEPS + 1) / STEPS - 1.0
    z, x = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
    y = 1.0 - np.abs(x) - np.abs(z)
    below = y < 0.0
    folded_x = (1.0 - np.abs(z)) * np.copysign(1.0, x)
    folded_z = (1.0 - np.abs(x)) * np.copysign(1.0, z)
    nodes = np.stack([np.where(below, folded_x, x), y, np.where(below, folded_z, z)], axis=1)
    return np.asarray(nodes / np.linalg.norm(nodes, axis=1, keepdims=True))
