"""Reconstruction filters: sample offsets follow the profile of each filter."""

import itertools

import numpy as np
import pytest
import warp as wp
from scipy import integrate
from support.kernels import uniforms, upload
from support.statistics import chi_square_test

from wrt.kernels.camera.models import filter_offset
from wrt.scene.scene import FILTERS
from wrt.upload.camera import filter_table

N = 2**20


def window(x):
    """Return the ends of a pixel around x within a window from -1 to 1, three quarters of a pixel."""
    return np.clip((x + 0.5) / 0.75, -1.0, 1.0), np.clip((x - 0.5) / 0.75, -1.0, 1.0)


# Half widths in pixels and profiles, written down here a second time on purpose.
PROFILES = {
    "box": (0.5, lambda x: 1.0),
    "tent": (1.0, lambda x: 1.0 - abs(x)),
    # Standard deviation half a pixel, cut off and lowered to zero at two pixels.
    "gaussian": (2.0, lambda x: np.exp(-2.0 * x * x) - np.exp(-8.0)),
    # Harris, "On the use of windows for harmonic analysis with the discrete Fourier transform", Proc. IEEE
    # 66(1), 1978, table 1: 4-term, −92 dB; its middle at 0, three pixels wide.
    "blackman-harris": (
        1.5,
        lambda x: np.cos(2.0 * np.pi / 3.0 * x * np.arange(4)) @ [0.35875, 0.48829, 0.14128, 0.01168],
    ),
    # A raised cosine of one and a half pixels, over the pixel around x.
    "shared": (
        1.25,
        lambda x: sum(s * (t + np.sin(np.pi * t) / np.pi) for s, t in zip((1, -1), window(x), strict=True)),
    ),
}


@wp.kernel(enable_backward=False)
def offsets(table: wp.array(dtype=float), u: wp.array(dtype=float), offset_out: wp.array(dtype=float)):
    i = wp.tid()
    offset_out[i] = filter_offset(table, u[i])


def offset(name, u, device):
    out = wp.zeros(len(u), dtype=float, device=device)
    inputs = [upload(filter_table(name), float, device), upload(u, float, device)]
    wp.launch(offsets, len(u), inputs, [out], device=device)
    return out.numpy().astype(np.float64)


@pytest.mark.parametrize("name", FILTERS)
def test_offsets_follow_the_profile(name, device, report):
    half_width, profile = PROFILES[name]
    x = offset(name, uniforms(N, 1, seed=1)[:, 0], device)
    edges = np.linspace(-half_width, half_width, 102)
    mass = np.array([integrate.quad(profile, a, b)[0] for a, b in itertools.pairwise(edges)])
    counts, _ = np.histogram(x, edges)
    result = chi_square_test(counts, N * mass / mass.sum(), tests=len(PROFILES), samples=N)
    report(name, result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    # Without noise: the offset at u lies where the profile's integral is u, to a table's step.
    u = np.linspace(0.0, 1.0 - 2.0**-24, 4001)
    x = offset(name, u, device)
    reached = np.array([integrate.quad(profile, -half_width, b)[0] for b in x]) / mass.sum()
    error = float(np.abs(reached - u).max())
    report(f"{name}: largest error of the distribution", error, 0.0)
    assert error < 1.0 / 1024.0
    assert (np.diff(x) >= 0.0).all()
    # Symmetric, and over the whole support.
    assert offset(name, np.array([0.0, 0.5, 1.0]), device) == pytest.approx([-half_width, 0.0, half_width], abs=1e-6)
