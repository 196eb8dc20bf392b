"""The tables by which directions towards an environment's image are drawn.

The image is cut into cells, and each cell into a tile of bins. A bin is drawn within its cell by what shines in it; a
cell by that times the cosine to the receiver's normal, for which there is a table of each of some hundred normals. So
half of the sphere, which a surface never sees, is hardly looked at: products of light and reflectance by tables, as
Clarberg, Jarosz, Akenine-Möller and Jensen (2005) have them of wavelets, here of a grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrt.build.piecewise import integrals, pooled, tiles

ROWS, COLUMNS = 16, 32
"""Cells of an image: 11 degrees each way at the horizon."""

MOST_BINS = 64
"""Bins along the side of a cell, at most: a fifth of a degree, 4 MB in all."""

COARSEST = 1.05
"""Bins are as coarse as adds this much less one to the relative variance of the whole light."""

STEPS = 16
"""Normals are those at the nodes of a net of STEPS + 1 by STEPS + 1 over the octahedron; axes are among them."""

SOFTNESS = 0.1
"""How far, in radians, a normal is off its node, more or less; the cosine ends so softly."""

OFFSET, LEAST = 0.5, 0.1
"""Of the mean radiance, this much is taken off the density, and this much of the radiance is left at least."""


@dataclass(frozen=True)
class EnvironmentTables:
    """What kernels/environment_sampling.py reads.

    Attributes:
        cells: (normals + 1, ROWS + ROWS COLUMNS) uint16 tile of cells by number of the normal's node; the last is for
            receivers without a normal.
        bins: (ROWS COLUMNS, S + S S) uint16 tile of each cell.
        side: S, bins along the side of a cell, a power of two.
        flux: luminance integrated over all directions.
    """

    cells: NDArray[np.uint16]
    bins: NDArray[np.uint16]
    side: int
    flux: float


def environment_tables(luminance: NDArray[np.floating], image_to_world: NDArray[np.float64]) -> EnvironmentTables:
    """Return the tables of an image.

    Args:
        luminance: (H, W) of each texel.
        image_to_world: (3, 3) rotation.
    """
    light = bin_light(luminance, finest_side(luminance.shape))
    solid_angle = np.broadcast_to(solid_angles(*light.shape), light.shape)
    flux = float(light.sum())
    weights = compensated(light, solid_angle)
    side = coarsest_side(weights)
    height, width = ROWS * side, COLUMNS * side
    bins = pooled(weights, height, width).reshape(ROWS, side, COLUMNS, side).transpose(0, 2, 1, 3)
    cells = by_normal(weights, image_to_world)
    return EnvironmentTables(tiles(cells), tiles(bins.reshape(-1, side, side)), side, flux)


def solid_angles(height: int, width: int) -> NDArray[np.float64]:
    """Return (H, 1) the solid angle of a texel in each row."""
    edges = np.cos(np.linspace(0.0, np.pi, height + 1))
    angles: NDArray[np.float64] = (edges[:-1] - edges[1:])[:, None] * (2.0 * np.pi / width)
    return angles


def finest_side(shape: tuple[int, ...]) -> int:
    """Return how many bins a cell has along its side where bins are as fine as texels."""
    side = 1
    while side < MOST_BINS and (ROWS * side < shape[0] or COLUMNS * side < shape[1]):
        side *= 2
    return side


def bin_light(luminance: NDArray[np.floating], side: int) -> NDArray[np.float64]:
    """Return (ROWS S, COLUMNS S) the light from each bin: the interpolated luminance times the solid angle."""
    height, width = ROWS * side, COLUMNS * side
    sums = integrals(integrals(luminance, width, 1, "wrap"), height, 0, "edge")
    area = luminance.size / (height * width)
    return sums / area * solid_angles(height, width)


def compensated(light: NDArray[np.float64], solid_angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the light less a part of its mean, which the BSDF finds well enough.

    What multiple importance sampling has too much of where all is dim, it gets where it is bright (Karlík, Šik, Vévoda,
    Skřivan and Křivánek 2019). Nothing that shines is left without a density: without the BSDF's samples the estimate
    would be wrong.
    """
    mean = float(light.sum() / solid_angle.sum())
    return np.maximum(light - OFFSET * mean * solid_angle, LEAST * light)


def coarsest_side(weights: NDArray[np.float64]) -> int:
    """Return the fewest bins along the side of a cell that are fine enough: small tables stay in caches."""
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
    """Return (normals + 1, ROWS, COLUMNS): what cells give to receivers with each normal, and to those without."""
    parts = 4
    height, width = parts * ROWS, parts * COLUMNS
    coarse = pooled(weights, min(height, len(weights)), min(width, weights.shape[1]))
    repeats = height // len(coarse)
    fine = np.repeat(np.repeat(coarse, repeats, axis=0), repeats, axis=1) / repeats**2
    polar = np.pi * (np.arange(height) + 0.5)[:, None] / height
    azimuth = 2.0 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    sine = np.sin(polar)
    local = [sine * np.sin(azimuth), np.cos(polar) + 0.0 * azimuth, -sine * np.cos(azimuth)]
    directions = np.stack(local, axis=2) @ image_to_world.T
    normals = octahedral_nodes()
    found = np.empty((len(normals) + 1, ROWS, COLUMNS))
    for row in range(ROWS):
        block = slice(parts * row, parts * (row + 1))
        cosines = np.tensordot(normals, directions[block], axes=(1, 2))
        softened = 0.5 * (cosines + np.sqrt(cosines * cosines + SOFTNESS * SOFTNESS))
        seen = (softened * fine[block]).sum(axis=1)
        found[:-1, row] = seen.reshape(len(normals), COLUMNS, parts).sum(axis=2)
    found[-1] = pooled(weights, ROWS, COLUMNS)
    return found


def octahedral_nodes() -> NDArray[np.float64]:
    """Return ((STEPS + 1)², 3) the unit normals that tables are for, as kernels/environment_sampling.py numbers them.

    The octahedron |x| + |y| + |z| = 1 seen from above, its lower half folded outwards (Cigolle and others 2014).
    """
    steps = 2.0 * np.arange(STEPS + 1) / STEPS - 1.0
    z, x = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
    y = 1.0 - np.abs(x) - np.abs(z)
    below = y < 0.0
    folded_x = (1.0 - np.abs(z)) * np.copysign(1.0, x)
    folded_z = (1.0 - np.abs(x)) * np.copysign(1.0, z)
    found = np.stack([np.where(below, folded_x, x), y, np.where(below, folded_z, z)], axis=1)
    normals: NDArray[np.float64] = found / np.linalg.norm(found, axis=1, keepdims=True)
    return normals
