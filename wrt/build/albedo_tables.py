"""Tables of the energy that microfacet reflection of a single bounce loses (kernels/albedo.py says how they lie)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.device import Device

LATTICE_POINTS = {"ggx": 4096, "beckmann": 4096}
"""Directions per value where visible normals are sampled: right to 3e-4."""

MORE_LATTICE_POINTS = 32768
"""For distributions whose visible normals are not sampled: right to 2e-3 at grazing angles."""

Floats = NDArray[np.float64]


def reflection_table(
    distribution: str, masking: str, shape: tuple[float, float, float] | None, device: Device
) -> NDArray[np.float32]:
    """Return the table of 1 − E for white microfacets.

    Args:
        distribution: a name in `kernels.microfacet.DISTRIBUTIONS`.
        masking: a name in `kernels.microfacet.MASKINGS` that goes with it.
        shape: of the distribution, for one surface whose columns are azimuths; or None, for all roughnesses.
        device: where it is computed.
    """
    from wrt.kernels.albedo import make_missing_kernel

    return missing_table(distribution, shape, device, make_missing_kernel(distribution, masking))


def missing_table(
    distribution: str,
    shape: tuple[float, float, float] | None,
    device: Device,
    kernel: Any,
    *parameters: float,
    grazing: float = 0.0,
) -> NDArray[np.float32]:
    """Return the table that a kernel fills, one thread a value.

    Args:
        distribution: a name in `kernels.microfacet.DISTRIBUTIONS`.
        shape: of the distribution, for one surface whose columns are azimuths; or None, for all roughnesses.
        device: where it is computed.
        kernel: such as `kernels.albedo.make_missing_kernel` makes.
        parameters: what it takes after the number of points.
        grazing: cosine that stands for the first row, in units of the second's: not 0 where the function is steep.
    """
    import warp as wp

    from wrt.kernels.albedo import COLUMNS, ROW_SCALE, ROWS

    columns = np.linspace(0.0, 1.0, int(COLUMNS))
    if shape is None:
        along, azimuth, toward = (0.0, 0.0), np.zeros_like(columns), roughnesses_of_columns()
        shapes = np.stack([toward, toward, np.zeros_like(toward)], axis=1)
    else:
        along = _roughness(distribution, shape)
        azimuth = _azimuth(columns, along)
        toward = np.hypot(along[0] * np.cos(azimuth), along[1] * np.sin(azimuth))
        shapes = np.broadcast_to(np.asarray(shape, np.float64), (len(columns), 3))

    scale = float(ROW_SCALE) * toward
    logs = np.linspace(0.0, 1.0, int(ROWS))[:, None] * np.log1p(1.0 / scale)
    cosine = np.clip(scale * np.expm1(logs), 1e-6, 1.0)
    cosine[0] = np.maximum(cosine[0], grazing * cosine[1])
    sine = np.sqrt(1.0 - cosine**2)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1).reshape(-1, 3)
    out = wp.empty(len(directions), dtype=float, device=device.name)
    inputs = [
        LATTICE_POINTS.get(distribution, MORE_LATTICE_POINTS),
        *parameters,
        wp.array(directions.astype(np.float32), dtype=wp.vec3, device=device.name),
        wp.array(np.tile(shapes, (len(logs), 1)).astype(np.float32), dtype=wp.vec3, device=device.name),
        out,
    ]
    device.launch(kernel, len(directions), inputs)
    missing = np.clip(out.numpy().reshape(cosine.shape).astype(np.float64), 0.0, 1.0)

    masses = _masses(missing, logs, scale)
    averages = masses.sum(axis=0)
    cumulative = np.concatenate([np.zeros((1, len(columns))), np.cumsum(masses, axis=0)])
    # Where nothing is lost there is nothing to sample, but a distribution there must be.
    cumulative = np.where(averages > 0.0, cumulative / np.where(averages > 0.0, averages, 1.0), 1.0)
    cumulative[0], cumulative[-1] = 0.0, 1.0
    if shape is None:
        averages = averages / toward**2
    else:
        averages = np.full_like(averages, _average_over_azimuth(averages, along))
    return np.concatenate([along, averages, missing.ravel(), cumulative.ravel()]).astype(np.float32)


def roughnesses_of_columns() -> Floats:
    """Return the (COLUMNS,) roughnesses that tables have columns for (`kernels.albedo.table_column_of_alpha`)."""
    from wrt.kernels.albedo import COLUMNS
    from wrt.kernels.microfacet import LEAST_ALPHA

    return np.geomspace(float(LEAST_ALPHA), 1.0, int(COLUMNS))


def _roughness(distribution: str, shape: tuple[float, float, float]) -> tuple[float, float]:
    """Return about the roughness along x and y, by which the rows of a table are laid out: its peak's as Beckmann's."""
    first, second, _ = shape
    if distribution == "abc":  # (1 + B θ²/2)^−C ≈ exp(−θ² / α²)
        first = second = min(np.sqrt(2.0 / (first * max(second, 1.0))), 1.0)
    if distribution == "sgd":
        first = second = min(np.sqrt(first), 1.0)
    return max(first, 1e-4), max(second, 1e-4)


def _azimuth(stretched: Floats, along: tuple[float, float]) -> Floats:
    """Return azimuths φ in the first quadrant where tan(π/2 · stretched) = √(αv/αu) tanφ."""
    angle = 0.5 * np.pi * stretched
    return np.arctan2(np.sqrt(along[0]) * np.sin(angle), np.sqrt(along[1]) * np.cos(angle))


def _masses(missing: Floats, logs: Floats, scale: Floats) -> Floats:
    """Return ∫ (1 − E) 2μ dμ between rows, of what the kernels interpolate and not of the values themselves.

    With the average of what is interpolated, a white surface reflects exactly 1 wherever 1 − E is exact.

    Args:
        missing: (rows, columns) 1 − E.
        logs: (rows, columns) ln(1 + μ / scale), of which the interpolated 1 − E is a linear function.
        scale: (columns,) scale of the cosines μ.
    """
    nodes, weights = np.polynomial.legendre.leggauss(8)
    x = 0.5 * (nodes[:, None, None] + 1.0)
    low, step = logs[:-1], np.diff(logs, axis=0)
    mu = scale * np.expm1(low + x * step)
    slope = (mu + scale) * step  # dμ/dx
    values = missing[:-1] + np.diff(missing, axis=0) * x
    masses: Floats = (weights[:, None, None] * values * mu * slope).sum(axis=0)
    return masses


def _average_over_azimuth(averages: Floats, along: tuple[float, float]) -> float:
    """Return the mean over the azimuth of values at even stretched azimuths, linear in between."""
    steps = 4096
    edges = _azimuth(np.linspace(0.0, 1.0, steps + 1), along)
    middles = (np.arange(steps) + 0.5) / steps
    values = np.interp(middles, np.linspace(0.0, 1.0, len(averages)), averages)
    return float((values * np.diff(edges)).sum() / (0.5 * np.pi))
