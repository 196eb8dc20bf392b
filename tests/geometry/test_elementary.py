"""Elementary functions without calls, against those of NumPy in double precision."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.kernels import map_function

from wrt.kernels.math.exponential import exponential, logarithm
from wrt.kernels.math.trigonometry import arc_tangent, sine_cosine

UNITS = 2.0
UNITS_OF_ARC_TANGENT = 3.0
"""Of the last place: what the modules promise."""

GENERATOR = np.random.default_rng(11)
EXPONENTS = np.concatenate([GENERATOR.uniform(*ends, 100_000) for ends in ((-87.0, 88.0), (-1.0, 1.0), (-1e-3, 1e-3))])
POSITIVE = np.concatenate([10.0 ** GENERATOR.uniform(*ends, 100_000) for ends in ((-37.0, 38.0), (-0.3, 0.3))])


def units_off(values: NDArray[np.float32], exact: NDArray[np.float64]) -> float:
    """Return the largest error in units of the last place."""
    return float(np.max(np.abs(values - exact) / np.spacing(np.abs(exact).astype(np.float32))))


@pytest.mark.parametrize(
    ("function", "exact", "inputs"), [(exponential, np.exp, EXPONENTS), (logarithm, np.log, POSITIVE)]
)
def test_functions_of_one_number(
    function: wp.Function, exact: np.ufunc, inputs: NDArray[np.float64], device: str, report: Report
) -> None:
    x = inputs.astype(np.float32)
    off = units_off(map_function(function, x, device=device), exact(x.astype(np.float64)))
    report("units of the last place", off, f"at most {UNITS:g}")
    assert off <= UNITS


def test_where_they_end(device: str) -> None:
    x = np.array([-np.inf, -3e38, -88.0, -0.0, 0.0, 89.0, 3e38, np.inf], np.float32)
    np.testing.assert_array_equal(map_function(exponential, x, device=device), [0, 0, 0, 1, 1, *[np.inf] * 3])
    x = np.array([-np.inf, -1.0, -0.0, 0.0, 1.0], np.float32)
    np.testing.assert_array_equal(map_function(logarithm, x, device=device), [*[-np.inf] * 4, 0.0])


def test_sine_and_cosine(device: str) -> None:
    angles = GENERATOR.uniform(-8192.0, 8192.0, 200_000).astype(np.float32)
    found = map_function(sine_cosine, angles, device=device)
    exact = np.stack([np.sin(angles.astype(np.float64)), np.cos(angles.astype(np.float64))], axis=1)
    # Of one: near a root what is left of the angle is as exact as the angle's parts are.
    assert np.abs(found - exact).max() <= UNITS * np.spacing(np.float32(1.0))


def test_arc_tangent(device: str) -> None:
    x, y = (GENERATOR.normal(size=200_000).astype(np.float32) for _ in range(2))
    found = map_function(arc_tangent, y, x, device=device)
    assert units_off(found, np.arctan2(y.astype(np.float64), x.astype(np.float64))) <= UNITS_OF_ARC_TANGENT
    assert map_function(arc_tangent, np.zeros(1, np.float32), np.zeros(1, np.float32), device=device)[0] == 0.0
