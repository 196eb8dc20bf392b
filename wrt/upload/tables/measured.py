"""The table that `kernels/bsdf/measured.py` reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.backend.device import Device
from wrt.scene.materials.measured import Measurement


def measured_table(measurement: Measurement, device: Device) -> NDArray[np.float32]:
    """Return the tables of a measurement as one array, with the integrals that sampling needs."""
    m = measurement
    sizes = (
        *(m.is_isotropic, m.reduction, m.jacobian, len(m.phi_i), len(m.theta_i)),
        *(*m.ndf.shape[::-1], *m.sigma.shape[::-1], *m.vndf.shape[:1:-1], m.luminance.shape[2]),
    )
    plain = (np.array(sizes, np.float32), m.phi_i, m.theta_i, m.ndf, m.sigma)
    parts = (*plain, *_with_integrals(m.vndf), *_with_integrals(m.luminance), np.moveaxis(m.rgb, 2, -1))
    return np.concatenate([np.ravel(part) for part in parts])


def _with_integrals(density: NDArray[np.float32]) -> tuple[NDArray[np.float32], ...]:
    """Return normalised slices of densities, the integrals along their rows, and those over whole rows.

    They are as `Grid` of `kernels/sampling/bilinear.py` has them. A slice without any density becomes an even one.
    """
    values = density.astype(np.float64)
    values[~values.any(axis=(2, 3))] = 1.0
    columns = _integrals(values)
    rows = _integrals(columns[..., -1])
    total = rows[..., -1:]
    parts = values / total[..., None], columns / total[..., None], rows / total
    return tuple(part.astype(np.float32) for part in parts)


def _integrals(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the integrals from 0 to each node along the last axis, which has length 1."""
    result = np.zeros_like(values)
    np.cumsum(0.5 * (values[..., 1:] + values[..., :-1]) / (values.shape[-1] - 1), axis=-1, out=result[..., 1:])
    return result
