"""GGX under a filtered normal map: near the convolution of both distributions of slopes, and what it is made into."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Bumpy, Case, hemisphere
from support.kernels import map_function

import wrt
from wrt.kernels.microfacet import bumpy_ggx

Array = NDArray[np.float64]
VARIANCE = (0.03, 0.01)


@wp.func
def density_of_slope(slope: wp.vec2, alpha: wp.vec2, variance: wp.vec2) -> float:
    """Return D cos⁴θ."""
    m = wp.normalize(wp.vec3(-slope[0], -slope[1], 1.0))
    facets = wp.vec3(alpha[0], alpha[1], 0.0)
    shape = bumpy_ggx.bumpy_shape(facets, bumpy_ggx.rough_as_bumpy(facets, variance))
    return bumpy_ggx.d(m, shape) * m[2] * m[2] * m[2] * m[2]


def convolved(slope: Array, alpha: Array, sigma: Array) -> Array:
    """Return the convolution of GGX's slopes with Gaussian ones, (N,), from arrays (N, 2).

    The mean over t of Beckmann's distributions of α²/t + 2σ², where t is exponential; by the trapezoid rule in ln t.
    """
    log_t = np.linspace(-20.0, 3.6, 400)
    t = np.exp(log_t)
    weights = np.exp(-t) * t * (log_t[1] - log_t[0])
    variance = alpha[:, None, :] ** 2 / t[:, None] + 2.0 * sigma[:, None, :] ** 2
    gaussian = np.exp(-(slope[:, None, :] ** 2 / variance).sum(axis=-1)) / (np.pi * np.sqrt(variance.prod(axis=-1)))
    return np.asarray(gaussian @ weights)


def grid(most: float, ratio: float) -> tuple[Array, Array, Array]:
    """Return slopes, roughnesses and slopes of bumps (N, 2): up to `most` widths out, any axis up to 3 times rougher.

    Bumps of at most three times the roughness, `ratio` times as high along one axis as along the other at least.
    """
    rng = np.random.default_rng(5)
    n = 2000
    alpha = 0.02 * 3.0 ** rng.uniform(-0.5, 0.5, (n, 2))
    sigma = alpha * (3.0 * rng.uniform(0.0, 1.0, (n, 1)) ** 2)
    sigma[:, 0] *= rng.uniform(ratio, 1.0, n)
    around, out = rng.uniform(0.0, 2.0 * np.pi, n), most * rng.uniform(0.0, 1.0, n)
    width = np.sqrt(alpha**2 + 2.0 * sigma**2)
    return width * (out * np.stack([np.cos(around), np.sin(around)])).T, alpha, sigma


@pytest.mark.parametrize(
    ("most", "ratio", "limit"),
    [
        (1.5, 1.0, 0.015),
        (1.5, 0.0, 0.025),
        pytest.param(2.0, 1.0, 0.02, marks=pytest.mark.slow),
        pytest.param(1.5, 0.32, 0.02, marks=pytest.mark.slow),
    ],
)
def test_slopes_are_those_of_both(most: float, ratio: float, limit: float, report: Report) -> None:
    """In the middle and to the given widths out; a single GGX of α² + 2σ² is a quarter off. Without bumps it is GGX."""
    slope, alpha, sigma = grid(most, ratio)
    expected = convolved(slope, alpha, sigma)
    wide = np.sqrt(alpha**2 + 2.0 * sigma**2)
    found = map_function(density_of_slope, slope, alpha, sigma**2, device="cpu").astype(np.float64)
    error = np.abs(found / expected - 1.0)
    single = 1.0 / (np.pi * wide.prod(axis=1) * (1.0 + ((slope / wide) ** 2).sum(axis=1)) ** 2)
    report("error of the mixture, and of one GGX", float(error.max()), float(np.abs(single / expected - 1.0).max()))
    assert error.max() < limit
    assert np.abs(single / expected - 1.0).max() > 0.2
    plain = 1.0 / (np.pi * alpha.prod(axis=1) * (1.0 + ((slope / alpha) ** 2).sum(axis=1)) ** 2)
    found = map_function(density_of_slope, slope, alpha, np.zeros_like(alpha), device="cpu")
    np.testing.assert_allclose(found, plain, rtol=3e-5)


@pytest.mark.slow
def test_principled_metal_is_the_rough_metal(device: str) -> None:
    """With the grain along x and across it."""
    wo, wi = hemisphere(2000, seed=60), hemisphere(2000, seed=61)
    rough, alpha = 0.4, 0.4**2
    along = alpha + (1.0 - alpha) * 0.6**2
    for turned, shape in ((0.0, (along, alpha)), (0.5 * math.pi, (alpha, along))):
        principled = wrt.Principled(1.0, metallic=1.0, roughness=rough, anisotropy=0.6, anisotropy_rotation=turned)
        found = Bumpy(principled, variance=VARIANCE).evaluate(wo, wi, device)[0]
        expected = Bumpy(wrt.RoughConductor(shape, f0=1.0), variance=VARIANCE).evaluate(wo, wi, device)[0]
        np.testing.assert_allclose(found, expected, rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize(
    "material",
    [
        wrt.RoughConductor(0.2, f0=1.0),
        pytest.param(wrt.Principled((0.9, 0.6, 0.3), metallic=0.3, transmission=0.5), marks=pytest.mark.slow),
    ],
)
def test_what_is_not_filtered_is_plain_ggx(material: wrt.Material, device: str) -> None:
    """No variance, no change: where texels are wider than pixels."""
    wo, wi = hemisphere(2000, seed=62), hemisphere(2000, seed=63)
    found, expected = (case.evaluate(wo, wi, device)[0] for case in (Bumpy(material), Case(material)))
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7)
