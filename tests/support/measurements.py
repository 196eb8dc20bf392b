"""Measurements made by code: a rough metal tabulated as if it had been measured, and arbitrary tables."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene.materials.measured import Measurement

Array = NDArray[np.float64]

PARTS = {"isotropic": (np.zeros(1),), "circle": (1,), "half": (2,), "quarter": (4,)}


def angles(u: Array) -> Array:
    """Return the angle to the normal of a coordinate of the square."""
    return np.asarray(0.5 * np.pi * u**2)


def directions(x: Array, y: Array) -> Array:
    """Return (..., 3) directions of points of the square."""
    theta, phi = np.broadcast_arrays(angles(x), np.pi * (2.0 * y - 1.0))
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def azimuths(share: int, count: int) -> NDArray[np.float32]:
    """Return nodes over the circle from −π on, or over one of `share` parts of it."""
    return np.linspace(-np.pi, -np.pi + 2.0 * np.pi / share, count).astype(np.float32)


def arbitrary(phi_i: NDArray[Any], *, seed: int = 0, steep: float = 1.0, side: int = 9, **given: Any) -> Measurement:
    """Return tables of positive random numbers; `steep` is how many e-folds they span."""
    random = np.random.default_rng(seed)

    def numbers(*shape: int) -> NDArray[np.float32]:
        return np.exp(steep * (random.random(shape) - 0.5)).astype(np.float32)

    slices = len(phi_i), 4
    tables: dict[str, Any] = {
        "phi_i": phi_i,
        "theta_i": np.array([0.0, 0.4, 0.9, 1.5], np.float32),
        "ndf": numbers(5, 7),
        "sigma": numbers(3, 6),
        "vndf": numbers(*slices, 11, 8),
        "luminance": numbers(*slices, side, side),
        "rgb": 0.1 * numbers(*slices, 3, side, side),
    }
    if len(phi_i) < 3:
        tables["sigma"][:] = tables["sigma"][0]  # the area of facets is the same from all sides
    return Measurement(**{**tables, **given})
