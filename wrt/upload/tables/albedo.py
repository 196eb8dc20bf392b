"""Tables of the energy that single scattering by rough surfaces loses.

`kernels/bsdf/lobes/albedo.py` reads those of metals, `kernels/bsdf/lobes/albedo_dielectric.py` those of dielectrics.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.linalg import gauss_legendre
from wrt.scene.materials.dielectrics import mean_transmittance

LATTICE_POINTS = 4096
"""Directions per value: accurate to 6e-4."""

FEW_LATTICE_POINTS = {"beckmann": 2048}
"""Distributions for which a direction takes longer, but fewer are as accurate."""

GRAZING = 0.15
"""Cosine of the first row of a table of a dielectric relative to the second: towards the horizon, E outside falls as a
small power of cosθ. With this value the table is accurate to 8e-3 up to 89.9 degrees; beyond, it returns up to 15 % too
little, but at most 8e-3 too much."""

Floats = NDArray[np.float64]
Shape = tuple[float, float, float] | None
"""Shape parameters of one surface, whose columns are azimuths; or None, for a table of all roughnesses."""


def reflection_table(distribution: str, masking: str, shape: Shape, device: Device) -> NDArray[np.float32]:
    """Return the table of 1 − E for white microfacets, of names in `kernels.microfacet`."""
    kernel = current_backend().call("wrt.kernels.bsdf.lobes.albedo", "make_missing_kernel", distribution, masking)
    return _missing_table(distribution, shape, device, kernel)


def dielectric_table(
    distribution: str, masking: str, shape: Shape, relative_ior: float, device: Device
) -> NDArray[np.float32]:
    """Return the tables of 1 − E outside and inside, and the mean transmittances of a smooth boundary."""
    kernel = current_backend().call(
        "wrt.kernels.bsdf.lobes.albedo_dielectric", "make_missing_dielectric_kernel", distribution, masking
    )
    indices = (relative_ior, 1.0 / relative_ior)
    sides = [_missing_table(distribution, shape, device, kernel, eta, grazing=GRAZING) for eta in indices]
    return np.concatenate([*sides, [mean_transmittance(eta) for eta in indices]]).astype(np.float32)


def dispersive_table(
    distribution: str, masking: str, shape: Shape, red: float, green: float, blue: float, device: Device
) -> NDArray[np.float32]:
    """Return the tables for the relative indices of the three channels, one after the other."""
    tables = [dielectric_table(distribution, masking, shape, index, device) for index in (red, green, blue)]
    return np.concatenate(tables)


def _missing_table(
    distribution: str, shape: Shape, device: Device, kernel: Any, *parameters: float, grazing: float = 0.0
) -> NDArray[np.float32]:
    """Return the table that a kernel computes, one thread a value, from its parameters after the number of points."""
    backend = current_backend()
    albedo = backend.kernels("wrt.kernels.bsdf.lobes.albedo")
    columns = np.linspace(0.0, 1.0, int(albedo.COLUMNS))
    if shape is None:
        along, azimuth, toward = (0.0, 0.0), np.zeros_like(columns), _roughness_at(columns)
        shapes = np.stack([toward, toward, np.zeros_like(toward)], axis=1)
    else:
        along = _roughness(distribution, shape)
        azimuth, toward = _azimuth_at(columns, along)
        shapes = np.broadcast_to(np.asarray(shape, np.float64), (len(columns), 3))

    logs, scale = _rows(int(albedo.ROWS), toward)
    cosine = np.clip(scale * np.expm1(logs), 1e-6, 1.0)
    cosine[0] = np.maximum(cosine[0], grazing * cosine[1])
    sine = np.sqrt(1.0 - cosine**2)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)
    if along[0] == along[1] > 0.0:  # the same at every azimuth
        directions, shapes = directions[:, :1], shapes[:1]
    directions = directions.reshape(-1, 3)
    out = backend.empty(len(directions), float, device.name)
    inputs = [
        FEW_LATTICE_POINTS.get(distribution, LATTICE_POINTS),
        *parameters,
        backend.array(directions.astype(np.float32), "vec3", device.name),
        backend.array(np.tile(shapes, (len(logs), 1)).astype(np.float32), "vec3", device.name),
        out,
    ]
    device.launch(kernel, len(directions), inputs)
    missing = np.clip(out.numpy().reshape(len(logs), -1).astype(np.float64), 0.0, 1.0)
    missing = np.broadcast_to(missing, cosine.shape)

    masses = _masses(missing, logs, scale)
    totals = masses.sum(axis=0)
    cumulative = np.concatenate([np.zeros((1, len(columns))), np.cumsum(masses, axis=0)])
    # The distribution must be valid even if no energy is lost, where it is never sampled.
    cumulative = np.where(totals > 0.0, cumulative / np.where(totals > 0.0, totals, 1.0), 1.0)
    cumulative[0], cumulative[-1] = 0.0, 1.0
    averages = _averages(missing, None if shape is None else along)
    return np.concatenate([along, averages, missing.ravel(), cumulative.ravel()]).astype(np.float32)


def _roughness_at(column: Floats) -> Floats:
    """Return the roughness at a column position, 0 to 1 (`kernels.albedo.table_column_of_alpha`)."""
    microfacet = current_backend().kernels("wrt.kernels.microfacet")
    least = float(microfacet.LEAST_ALPHA) ** 0.25
    return np.asarray((least + (1.0 - least) * column) ** 4)


def _azimuth_at(column: Floats, along: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return the azimuth φ in the first quadrant at a column position, 0 to 1, and the roughness in that direction.

    tan(π/2 · column) = √(αv/αu) tanφ.
    """
    angle = 0.5 * np.pi * column
    azimuth = np.arctan2(np.sqrt(along[0]) * np.sin(angle), np.sqrt(along[1]) * np.cos(angle))
    return azimuth, np.hypot(along[0] * np.cos(azimuth), along[1] * np.sin(azimuth))


def _rows(count: int, toward: Floats) -> tuple[Floats, Floats]:
    """Return (rows, columns) ln(1 + μ / scale) of the rows' cosines μ, and the scale for each column's roughness."""
    albedo = current_backend().kernels("wrt.kernels.bsdf.lobes.albedo")
    scale = float(albedo.ROW_SCALE) * toward
    return np.linspace(0.0, 1.0, count)[:, None] * np.log1p(1.0 / scale), scale


def _roughness(distribution: str, shape: tuple[float, float, float]) -> tuple[float, float]:
    """Return an approximate Beckmann roughness of the peak along x and y, which spaces the rows of a table."""
    first, second, _ = shape
    if distribution == "abc":  # (1 + B θ²/2)^−C ≈ exp(−θ² / α²)
        first = second = min(np.sqrt(2.0 / (first * max(second, 1.0))), 1.0)
    if distribution == "sgd":
        first = second = min(np.sqrt(first), 1.0)
    return max(first, 1e-4), max(second, 1e-4)


def _masses(missing: Floats, logs: Floats, scale: Floats) -> Floats:
    """Return ∫ (1 − E) 2μ dμ between rows, of 1 − E as the kernels interpolate it.

    With that average, a white surface reflects exactly 1 wherever 1 − E is exact. 1 − E, (rows, columns), is linear in
    `logs`, ln(1 + μ / scale), with a scale of the cosines μ for each column.
    """
    nodes, weights = gauss_legendre(8)
    x = 0.5 * (nodes[:, None, None] + 1.0)
    low, step = logs[:-1], np.diff(logs, axis=0)
    mu = scale * np.expm1(low + x * step)
    slope = (mu + scale) * step  # dμ/dx
    values = missing[:-1] + np.diff(missing, axis=0) * x
    return np.asarray((weights[:, None, None] * values * mu * slope).sum(axis=0))


def _averages(missing: Floats, along: tuple[float, float] | None) -> Floats:
    """Return the mean of 1 − E, (rows, columns), over the hemisphere between columns, as the kernels read it.

    If columns are azimuths, `along` is the roughness along x and y. Otherwise they are roughnesses, and the mean is
    over α².
    """
    albedo = current_backend().kernels("wrt.kernels.bsdf.lobes.albedo")
    rows, columns = missing.shape
    steps = (columns - 1) * int(albedo.STEPS)
    place = np.arange(steps + 1) / steps
    j = np.minimum((place * (columns - 1)).astype(np.int64), columns - 2)
    between = missing[:, j] + (missing[:, j + 1] - missing[:, j]) * (place * (columns - 1) - j)
    if along is None:
        toward = _roughness_at(place)
        return np.asarray(_masses(between, *_rows(rows, toward)).sum(axis=0) / toward**2)
    azimuth, toward = _azimuth_at(place, along)
    means = _masses(between, *_rows(rows, toward)).sum(axis=0)
    mean = float((0.5 * (means[1:] + means[:-1]) * np.diff(azimuth)).sum() / (0.5 * np.pi))
    return np.full(len(place), mean)
