"""Frames around normals: orthonormal, and the same on both sides of what rounding decides."""

import numpy as np
import warp as wp
from support.kernels import map_function

from wrt.kernels.core.rays import TURNS, make_frame


@wp.func
def axes(n: wp.vec3) -> wp.mat33:
    frame = make_frame(n)
    return wp.matrix_from_rows(frame.s, frame.t, frame.n)


def test_axes_are_orthonormal_and_right_handed(device):
    normals = np.random.default_rng(5).normal(size=(30_000, 3))
    # A third of them are about as steep as the normals at which frames turn.
    normals[::3, 2] = float(TURNS) * np.linspace(-3.0, 3.0, 10_000) * np.linalg.norm(normals[::3, :2], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = map_function(axes, normals, device=device).astype(np.float64)
    products = found @ found.transpose(0, 2, 1)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-6)
    np.testing.assert_allclose(np.cross(found[:, 0], found[:, 1]), found[:, 2], atol=1e-6)
    np.testing.assert_allclose(found[:, 2], normals, atol=1e-6)


def test_frames_of_upright_walls_do_not_depend_on_rounding(device):
    angles = np.linspace(0.0, 2.0 * np.pi, 1_000)
    exact = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    expected = map_function(axes, exact, device=device)
    for z in (-0.0, -1e-10, 1e-10, -3e-7, 3e-7):
        np.testing.assert_allclose(map_function(axes, exact + (0.0, 0.0, z), device=device), expected, atol=1e-6)
