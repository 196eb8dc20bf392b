"""Microfacet distributions are normalised and sampled as stated; masking is what its sources say."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from scipy import integrate, special
from support.kernels import map_function, uniforms, upload
from support.statistics import chi_square_test, integrate_pdf_over_bins, sphere_histogram

from wrt.distributions import sgd_normalization
from wrt.kernels.microfacet import DISTRIBUTIONS, MASKINGS, make_microfacet, maskings_of
from wrt.kernels.microfacet.abc import LEAST_B
from wrt.kernels.microfacet.beckmann import sample_visible_slope
from wrt.kernels.microfacet.masking import beta_from_one
from wrt.kernels.microfacet.numerics import expm1, log1p

N = 2**18
ANGLES = (0.0, 45.0, 80.0, 89.0)
LAST = 1.0 - 2.0**-24
"""The largest random number."""

SMITH = [(name, masking) for name in DISTRIBUTIONS for masking in maskings_of(name) if masking == "smith"]
EXACT = ["ggx", "beckmann"]
"""Distributions whose own Λ is known."""


# --- Running the device functions -------------------------------------------------------------------


@functools.cache
def kernels(name: str) -> tuple[wp.Kernel, wp.Kernel]:
    """Return kernels that evaluate and sample one distribution with all of its maskings, by their number."""

    def chain(maskings: tuple[str, ...]) -> tuple[wp.Function, wp.Function]:
        parts = make_microfacet(name, maskings[0])
        this_g, this_g1 = parts.g, parts.g1
        if len(maskings) == 1:
            return this_g, this_g1

        left = len(maskings)
        next_g, next_g1 = chain(maskings[1:])
        suffix = f"{name}_{left}".replace("-", "_")

        @wp.func(name=f"test_g_{suffix}")
        def g(wo: wp.vec3, wi: wp.vec3, m: wp.vec3, shape: wp.vec3):
            if WHICH == wp.static(left):
                return this_g(wo, wi, m, shape)
            return next_g(wo, wi, m, shape)

        return g, next_g1

    raise NotImplementedError
