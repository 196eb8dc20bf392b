"""Reconstruction filters: samples are spread as each filter's profile says."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy import integrate
from support.kernels import uniforms, upload
from support.statistics import chi_square_test

from wrt.kernels.film.filters import filter_offset
from wrt.scene.scene import FILTERS
from wrt.upload.filters import filter_table

N = 2**20

# Half widths in pixels and profiles, written down here a second time on purpose.
PROFILES: dict[str, tuple[float, Callable[[float], float]]] = {
    "box": (0.5, lambda x: 1.0),
    "tent": (1.0, lambda x: 1.0 - abs(x)),
    # Standard deviation half a pixel, cut off and lowered to zero at two pixels.
    "gaussian": (2.0, lambda x: float(np.exp(-2.0 * x * x) - np.exp(-8.0))),
    # Harris, "On the use of windows for harmonic analysis with the discrete Fourier transform", Proc. IEEE
    # 66(1), 1978, table 1: 4-term, −92 dB; its middle at 0, three pixels wide.
    "blackman-harris": (
        1.5,
        lambda x: float(
            0.35875
            + 0.48829 * np.cos(2.0 * np.pi * x / 3.0)
            + 0.14128 * np.cos(4.0 * np.pi * x / 3.0)
            + 0.01168 * np.cos(6.0 * np.pi * x / 3.0)
        ),
    ),
}


@wp.kernel(enable_backward=False)
def offsets(table: wp.array(dtype=float), u: wp.array(dtype=float), offset_out: wp.array(dtype=float)):
    i = wp.tid()
    offset_out[i] = filter_offset(table, u[i])


def offset(name: str, u: NDArray, device: str) -> NDArray[np.float64]:
    out = wp.zeros(len(u), dtype=float, device=device)
    inputs = [upload(filter_table(name), float, device), upload(u, float, device)]
    wp.launch(offsets, len(u), inputs, [out], device=device)
    return out.numpy().astype(np.float64)


def test_every_filter_is_tested() -> None:
    assert set(PROFILES) == set(FILTERS)


@pytest.mark.parametrize("name", PROFILES)
def test_offsets_follow_the_profile(name: str, device: str, report: Report) -> None:
    half_width, profile = PROFILES[name]
    x = offset(name, uniforms(N, 1, seed=1)[:, 0], device)
    edges = np.linspace(-half_width, half_width, 102)
    mass = np.array([integrate.quad(profile, a, b)[0] for a, b in itertools.pairwise(edges)])
    counts, _ = np.histogram(x, edges)
    result = chi_square_test(counts, N * mass / mass.sum(), tests=len(PROFILES))
    report(name, result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


@pytest.mark.parametrize("name", PROFILES)
def test_cumulative_distribution_is_the_profiles(name: str, device: str, report: Report) -> None:
    """Without noise: the offset at u lies where the profile's integral is u, to a table's step."""
    half_width, profile = PROFILES[name]
    u = np.linspace(0.0, 1.0 - 2.0**-24, 4001)
    x = offset(name, u, device)
    total = integrate.quad(profile, -half_width, half_width)[0]
    reached = np.array([integrate.quad(profile, -half_width, b)[0] for b in x]) / total
    error = float(np.abs(reached - u).max())
    report(f"{name}: largest error of the distribution", error, 0.0)
    assert error < 1.0 / 1024.0
    assert (np.diff(x) >= 0.0).all()


@pytest.mark.parametrize("name", PROFILES)
def test_offsets_are_symmetric_and_within_the_support(name: str, device: str) -> None:
    half_width, _ = PROFILES[name]
    u = np.arange(0, 2**24 + 1, 1024, dtype=np.float64) / 2.0**24
    left, right = offset(name, u[:-1], device), offset(name, 1.0 - u[1:], device)
    np.testing.assert_allclose(left, -offset(name, 1.0 - u[:-1], device), atol=1e-6)
    for x in (left, right, offset(name, np.array([0.0, 2.0**-24, 1.0 - 2.0**-24]), device)):
        assert np.abs(x).max() <= half_width
    assert offset(name, np.array([0.5]), device)[0] == pytest.approx(0.0, abs=1e-6)
    # The whole support is used.
    assert offset(name, np.array([0.0]), device)[0] == -half_width
