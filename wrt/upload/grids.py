"""Upload media, their grids of densities, and the majorants of these."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.linalg import inverse, norm, product
from wrt.scene.medium import DensityGrid, Medium
from wrt.upload.arrays import packed, require_countable

CELLS_PER_MAJORANT = 8
"""Cells along each axis that share a majorant: a cloud of 128 x 72 x 96 cells had 1.53 times the paths per second of
one majorant for all, by 4 cells 1.47 and by 16 cells 1.38."""

GREATEST_DEPTH = 1e6
"""Optical depth across a grid. Tracking takes as many steps, and float32 resolves no more along a ray."""

LEAST_DEPTH = 4.0
"""Optical depth of tentative collisions across a grid that emits: emission is found at collisions alone."""


def majorants(values: NDArray[np.float32], size: int = CELLS_PER_MAJORANT) -> NDArray[np.float32]:
    """Return the greatest interpolated value within each block of cells.

    Values, (nz, ny, nx), are at the centres of cells. The blocks, of at most `size` cells along an axis, divide the box
    evenly, also where `size` does not divide the number of cells.
    """
    result = values
    for axis, cells in enumerate(values.shape):
        blocks = -(-cells // size)
        parts = []
        for block in range(blocks):
            # Centres of cells are at k + 1/2; interpolation within the block reads one beyond each of its ends.
            low = int(np.floor(block * cells / blocks - 0.5))
            high = int(np.ceil((block + 1) * cells / blocks - 0.5))
            part = np.arange(max(low, 0), min(high, cells - 1) + 1)
            parts.append(result.take(part, axis).max(axis, keepdims=True))
        result = np.concatenate(parts, axis)
    return result


def minorants(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the least interpolated value within each block of cells, as `majorants` has them."""
    return -majorants(-values)


def upload_media(data: Any, media: Sequence[Medium], device: Device, *, grids_too: bool = True) -> None:
    """Fill the media of a SceneData struct, and their grids if `grids_too`.

    Raises:
        InputError: when a medium is too dense to track rays through, or grids have more cells than 32 bits can count.
    """
    backend = current_backend()
    k = backend.kernels("wrt.kernels.core.scene_data")
    grids = list(dict.fromkeys(medium.density for medium in media if medium.density is not None))
    records = packed((_medium_record(medium, grids) for medium in media), k.MediumRecord)
    data.media = backend.array(records, k.MediumRecord, device.name)
    if not grids or not grids_too:
        return
    values: list[NDArray[np.float32]] = []
    colors: list[NDArray[np.float32]] = []

    def add(lattice: NDArray[np.float32]) -> tuple[int, int, int, int]:
        """Add numbers (nz, ny, nx) or colours (nz, ny, nx, 3) to the arrays of all grids; return their Lattice."""
        nz, ny, nx, *channels = lattice.shape
        arrays, flat = colors if channels else values, lattice.reshape(-1, *channels)
        first = sum(len(array) for array in arrays)
        require_countable(first + len(flat), "cells of the grids of the scene's media")
        arrays.append(flat)
        return first, nx, ny, nz

    def grid_record(grid: DensityGrid) -> dict[str, Any]:
        rows = zip(("to_unit_x", "to_unit_y", "to_unit_z"), inverse(grid.to_world), strict=False)
        record: dict[str, Any] = dict(rows)
        for name, make in (("density", np.asarray), ("majorants", majorants), ("minorants", minorants)):
            record[name] = add(make(grid.values))
        if grid.albedo is not None:
            record["albedo"] = add(grid.albedo)
        if grid.emission is not None:
            emission = grid.emission if grid.emission.ndim == 4 else grid.emission[..., None]
            record["emission"] = add(np.broadcast_to(emission, (*emission.shape[:3], 3)))
        return record

    data.grids = backend.array(packed(map(grid_record, grids), k.GridRecord), k.GridRecord, device.name)
    data.grid_values = backend.array(np.concatenate(values), float, device.name)
    if colors:
        data.grid_colors = backend.array(np.concatenate(colors), "vec3", device.name)


def _medium_record(medium: Medium, grids: list[DensityGrid]) -> dict[str, Any]:
    grid = medium.density
    factor = 1.0 if grid is None else grid.factor
    record = {name: np.multiply(getattr(medium, name), factor) for name in ("absorption", "scattering", "emission")}
    if grid is None:
        return {**record, "g": medium.g, "grid": -1}
    return {**record, "g": medium.g, "grid": grids.index(grid), "tracking": _tracking(medium, grid)}


def _tracking(medium: Medium, grid: DensityGrid) -> float:
    """Return the coefficient of tentative collisions where the density is 1."""
    corners = product(grid.to_world[:3, :3], np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1))
    across = norm(corners.max(axis=1) - corners.min(axis=1))
    extinction = grid.factor * max(medium.extinction)
    depth = extinction * float(grid.values.max()) * across
    if depth > GREATEST_DEPTH:
        raise InputError(
            f"density {grid.name}: its optical depth across the box reaches {depth:.3g}; the limit is "
            f"{GREATEST_DEPTH:g}; lower the medium's coefficients or the density"
        )
    if any(medium.emission) and depth < LEAST_DEPTH:  # type: ignore[arg-type]
        return LEAST_DEPTH / (float(grid.values.max()) * across)
    return extinction
