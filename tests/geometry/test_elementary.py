"""Elementary functions without calls, against those of NumPy in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from support.kernels import map_function

from wrt.kernels.core.elementary import arc_tangent, exponential, logarithm, sine_cosine

UNITS = 2.0
UNITS_OF_ARC_TANGENT = 3.0
"""Of the last place: what the modules promise."""

GENERATOR = np.random.default_rng(11)
EXPONENTS = np.concatenate([GENERATOR.uniform(*ends, 100_000) for ends in ((-87.0, 88.0), (-1.0, 1.0), (-1e-3, 1e-3))])
POSITIVE = np.concatenate([10.0 ** GENERATOR.uniform(*ends, 100_000) for ends in ((-37.0, 38.0), (-0.3, 0.3))])
BOTH_SIGNS = GENERATOR.normal(size=(2, 200_000))


@pytest.mark.parametrize(
    ("function", "exact", "inputs", "units"),
    [
        (exponential, np.exp, [EXPONENTS], UNITS),
        (logarithm, np.log, [POSITIVE], UNITS),
        (arc_tangent, np.arctan2, BOTH_SIGNS, UNITS_OF_ARC_TANGENT),
    ],
)
def test_errors_in_the_last_place(
    function: wp.Function, exact: np.ufunc, inputs: Any, units: float, device: str, report: Report
) -> None:
    given = [x.astype(np.float32) for x in inputs]
    expected = exact(*(x.astype(np.float64) for x in given))
    found = map_function(function, *given, device=device)
    off = float(np.max(np.abs(found - expected) / np.spacing(np.abs(expected).astype(np.float32))))
    report("units of the last place", off, f"at most {units:g}")
    assert off <= units


def test_sine_and_cosine(device: str) -> None:
    angles = GENERATOR.uniform(-8192.0, 8192.0, 200_000).astype(np.float32)
    found = map_function(sine_cosine, angles, device=device)
    exact = np.stack([np.sin(angles.astype(np.float64)), np.cos(angles.astype(np.float64))], axis=1)
    # Of one: near a root what is left of the angle is as exact as the angle's parts are.
    assert np.abs(found - exact).max() <= UNITS * np.spacing(np.float32(1.0))


def test_where_they_end(device: str) -> None:
    x = np.array([-np.inf, -3e38, -88.0, -0.0, 0.0, 89.0, 3e38, np.inf], np.float32)
    np.testing.assert_array_equal(map_function(exponential, x, device=device), [0, 0, 0, 1, 1, *[np.inf] * 3])
    x = np.array([-np.inf, -1.0, -0.0, 0.0, 1.0], np.float32)
    np.testing.assert_array_equal(map_function(logarithm, x, device=device), [*[-np.inf] * 4, 0.0])
    zero = np.zeros(1, np.float32)
    assert map_function(arc_tangent, zero, zero, device=device)[0] == 0.0
