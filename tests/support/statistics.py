"""Hypothesis tests that decide whether a sampler or a picture is right.

A Monte Carlo result never equals its expectation, so a test computes how improbable the result would be
if the code were right. If many tests are made at once, each has the smaller significance that keeps the
stated one for all together (Šidák 1967). Seeds are fixed once, so that a passing test keeps passing until
the code changes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from peers.picture_tests import ImageTest, image_z_test, sidak, sidak_combined, two_sample_z
from scipy import stats

from wrt.checking.distributions import (
    ChiSquareResult,
    chi_square_test,
    integrate_pdf_over_bins,
    sphere_histogram,
)

__all__ = [
    "ChiSquareResult",
    "ImageTest",
    "chi_square_test",
    "image_z_test",
    "integrate_pdf_over_bins",
    "sidak",
    "sidak_combined",
    "sphere_histogram",
    "t_test_mean",
    "two_sample_z",
]

FloatArray = NDArray[np.float64]


def t_test_mean(mean: ArrayLike, variance_of_mean: ArrayLike, n: ArrayLike, expected: ArrayLike) -> FloatArray:
    """Return two-sided p-values of means of `n` >= 2 samples against exact values (Student 1908).

    `variance_of_mean` is the samples' unbiased variance divided by n.
    """
    z = two_sample_z(mean, variance_of_mean, expected, 0.0, n_a=n)
    return np.asarray(2.0 * stats.norm.sf(np.abs(z)))
