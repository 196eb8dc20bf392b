"""Frames around normals: orthonormal, and the same on both sides of what rounding decides."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from support.kernels import map_function

from wrt.kernels.geometry.rays import TURNS, make_frame


@wp.func
def axes(n: wp.vec3) -> wp.mat33:
    frame = make_frame(n)
    return wp.matrix_from_rows(frame.s, frame.t, frame.n)


def directions(n: int) -> np.ndarray:
    """Return unit vectors, a third of them about as steep as the normals at which frames turn."""
    found = np.random.default_rng(5).normal(size=(n, 3))
    found[: n // 3, 2] = float(TURNS) * np.linspace(-3.0, 3.0, n // 3) * np.linalg.norm(found[: n // 3, :2], axis=1)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_axes_are_orthonormal(device: str) -> None:
    found = map_function(axes, directions(30_000), device=device).astype(np.float64)
    products = found @ found.transpose(0, 2, 1)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-6)
    # Right-handed.
    np.testing.assert_allclose(np.cross(found[:, 0], found[:, 1]), found[:, 2], atol=1e-6)


@pytest.mark.parametrize("z", [-0.0, -1e-10, 1e-10, -3e-7, 3e-7])
def test_frames_of_upright_walls_do_not_depend_on_rounding(z: float, device: str) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 1_000)
    exact = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    rounded = exact + (0.0, 0.0, z)
    found = [map_function(axes, normals, device=device) for normals in (exact, rounded)]
    np.testing.assert_allclose(found[1], found[0], atol=1e-6)
