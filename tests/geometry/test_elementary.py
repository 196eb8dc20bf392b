"""Elementary functions without calls, against those of NumPy in double precision, and frames around normals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from support.kernels import map_function

from wrt.kernels.geometry.rays import TURNS, make_frame
from wrt.kernels.math.exponential import exponential, logarithm
from wrt.kernels.math.trigonometry import arc_tangent, sine_cosine

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
    inputs = [x.astype(np.float32) for x in inputs]
    expected = exact(*(x.astype(np.float64) for x in inputs))
    found = map_function(function, *inputs, device=device)
    off = float(np.max(np.abs(found - expected) / np.spacing(np.abs(expected).astype(np.float32))))
    report("units of the last place", off, f"at most {units:g}")
    assert off <= units


def test_sine_and_cosine(device: str) -> None:
    angles = GENERATOR.uniform(-8192.0, 8192.0, 200_000).astype(np.float32)
    found = map_function(sine_cosine, angles, device=device)
    exact = np.stack([np.sin(angles.astype(np.float64)), np.cos(angles.astype(np.float64))], axis=1)
    # Relative to 1: near a root the reduced angle is as accurate as the angle.
    assert np.abs(found - exact).max() <= UNITS * np.spacing(np.float32(1.0))


def test_where_they_end(device: str) -> None:
    x = np.array([-np.inf, -3e38, -88.0, -0.0, 0.0, 89.0, 3e38, np.inf], np.float32)
    np.testing.assert_array_equal(map_function(exponential, x, device=device), [0, 0, 0, 1, 1, *[np.inf] * 3])
    x = np.array([-np.inf, -1.0, -0.0, 0.0, 1.0], np.float32)
    np.testing.assert_array_equal(map_function(logarithm, x, device=device), [*[-np.inf] * 4, 0.0])
    zero = np.zeros(1, np.float32)
    assert map_function(arc_tangent, zero, zero, device=device)[0] == 0.0


@wp.func
def axes(n: wp.vec3) -> wp.mat33:
    frame = make_frame(n)
    return wp.matrix_from_rows(frame.s, frame.t, frame.n)


def test_axes_are_orthonormal_and_right_handed(device: str) -> None:
    normals = np.random.default_rng(5).normal(size=(30_000, 3))
    # A third of them are about as steep as the normals at which frames turn.
    normals[::3, 2] = float(TURNS) * np.linspace(-3.0, 3.0, 10_000) * np.linalg.norm(normals[::3, :2], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = map_function(axes, normals, device=device).astype(np.float64)
    products = found @ found.transpose(0, 2, 1)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-6)
    np.testing.assert_allclose(np.cross(found[:, 0], found[:, 1]), found[:, 2], atol=1e-6)
    np.testing.assert_allclose(found[:, 2], normals, atol=1e-6)


def test_frames_of_upright_walls_do_not_depend_on_rounding(device: str) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 1_000)
    exact = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    expected = map_function(axes, exact, device=device)
    for z in (-0.0, -1e-10, 1e-10, -3e-7, 3e-7):
        np.testing.assert_allclose(map_function(axes, exact + (0.0, 0.0, z), device=device), expected, atol=1e-6)
