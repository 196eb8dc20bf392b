"""A cumulus cloud on a grid, for docs/media.md."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import wrt

CELLS = (96, 72, 128)
"""Numbers of cells along z, y and x."""


def noise(shape: tuple[int, int, int], frequency: float, seed: int) -> NDArray[np.float32]:
    """Return random values on a coarse lattice, 0 to 1, interpolated smoothly at the centres of cells.

    Args:
        shape: numbers of cells.
        frequency: lattice steps along the last axis; along the others as many for each cell.
        seed: of the random values.
    """
    step = frequency / shape[2]
    places = [(np.arange(n) + 0.5) * step for n in shape]
    values = np.random.default_rng(seed).random([int(p[-1]) + 2 for p in places], dtype=np.float32)
    for axis, place in enumerate(places):
        first = place.astype(int)
        t = (place - first).astype(np.float32)
        weight = (t * t * (3.0 - 2.0 * t)).reshape([-1 if k == axis else 1 for k in range(3)])
        values = values.take(first, axis) * (1.0 - weight) + values.take(first + 1, axis) * weight
    return values


def cumulus() -> NDArray[np.float32]:
    """Return the densities, 0 to 1, of a cloud: balls that grow out of one another, frayed by noise, on a flat base."""
    places = [((np.arange(n) + 0.5) / CELLS[2]).astype(np.float32) for n in CELLS]
    z, y, x = np.meshgrid(*places, indexing="ij")
    rng = np.random.default_rng(11)
    depth = np.full(CELLS, -1.0, np.float32)
    for _ in range(60):
        across, height = rng.normal(0.0, 1.0, 2), rng.random() ** 1.6
        center = (0.5 + 0.15 * across[0] * (1.0 - 0.7 * height), 0.13 + 0.3 * height, 0.375 + 0.1 * across[1])
        radius = (0.12 - 0.05 * height) * (0.6 + 0.5 * rng.random())
        distance = np.sqrt((x - center[0]) ** 2 + (y - center[1]) ** 2 + (z - center[2]) ** 2)
        depth = np.maximum(depth, 1.0 - distance / radius)
    frayed = sum(2.0**-k * (noise(CELLS, 9.0 * 2.0**k, k) - 0.5) for k in range(4))
    above_base = np.clip((y - 0.085 + 0.03 * noise(CELLS, 7.0, 9)) / 0.03, 0.0, 1.0)
    return np.asarray(np.clip(4.0 * (depth + 1.1 * frayed - 0.05), 0.0, 1.0) * above_base, np.float32)


def cloud() -> wrt.Scene:
    """A cumulus half a kilometre wide in the light of a low sun."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 20.0, 900.0), (-15.0, 232.0, 0.0), fov_degrees=25.0))
    sky = wrt.SunSkyEnvironment(elevation_degrees=28.0, azimuth_degrees=-115.0, turbidity=2.5, ground_albedo=0.25)
    scene.environment = sky
    nz, ny, nx = CELLS
    size = 640.0
    lower = np.array([-0.5 * size, 80.0, -0.5 * size * nz / nx])
    grid = wrt.DensityGrid(cumulus(), lower, lower + size * np.array([nx, ny, nz]) / nx, name="cumulus")
    droplets = wrt.Medium.from_albedo(1.0, 0.09, g=0.5, density=grid)
    scene.add(grid.boundary, material=wrt.Null(interior=droplets), name="cloud")
    scene.settings.exposure = -5.0
    scene.settings.max_depth = 8
    return scene
