"""Measurements made by code: tables of random numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene.materials.measured import Measurement

Array = NDArray[np.float64]

ISOTROPIC = np.zeros(1, np.float32)
THETA = np.array([0.0, 0.4, 0.9, 1.5], np.float32)


def azimuths(share: int, count: int) -> NDArray[np.float32]:
    """Return nodes from −π on over the circle, or over one of `share` parts of it."""
    return np.linspace(-np.pi, -np.pi + 2.0 * np.pi / share, count).astype(np.float32)


def arbitrary(phi_i: NDArray[Any], *, seed: int = 0, steep: float = 2.0, side: int = 9, **replaced: Any) -> Measurement:
    """Return tables of random numbers that span `steep` e-folds; visible normals besides go by solid angle."""
    random = np.random.default_rng(seed)

    def numbers(*shape: int) -> NDArray[np.float32]:
        return np.exp(steep * (random.random(shape) - 0.5)).astype(np.float32)

    slices = len(phi_i), len(THETA)
    tables: dict[str, Any] = {
        "ndf": numbers(5, 7),
        "sigma": numbers(3, 6),
        "vndf": numbers(*slices, 11, 8),
        "luminance": numbers(*slices, side, side),
        "rgb": 0.1 * numbers(*slices, 3, side, side),
    }
    tables["vndf"] *= solid_angle(np.linspace(0.0, 1.0, 8)).astype(np.float32)
    if len(phi_i) < 3:
        tables["sigma"][:] = tables["sigma"][0]  # the area of facets is the same from all sides
    return Measurement(phi_i, THETA, **{**tables, **replaced})


def solid_angle(x: Array) -> Array:
    """Return the solid angle that a unit of the square's area stands for."""
    return np.asarray(2.0 * np.pi**2 * x * np.sin(0.5 * np.pi * x**2))
