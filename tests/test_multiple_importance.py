"""The power heuristic, and that it has less variance than the balance heuristic where it should."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.kernels import map_function

from wrt.kernels.integrators.next_event import STRATEGY_BSDF, STRATEGY_LIGHT, STRATEGY_MIS, mis_weight

Array = NDArray[np.float64]


def weights(pdf_this: Array, pdf_other: Array, this: int, device: str, strategy: int = STRATEGY_MIS) -> Array:
    """Return the kernels' weights of samples that were drawn in one of two ways."""
    n = len(pdf_this)
    strategies, ways = (np.full(n, int(which), np.int32) for which in (strategy, this))
    return map_function(mis_weight, strategies, pdf_this, pdf_other, ways, device=device).astype(np.float64)


def test_weights_are_those_of_the_power_heuristic(device: str) -> None:
    """Veach 1997, equation 9.13, with the exponent 2: p² / (p² + q²); both ways together count once."""
    p, q = np.exp(np.random.default_rng(1).uniform(-8.0, 8.0, (2, 500)))
    first, second = weights(p, q, STRATEGY_LIGHT, device), weights(q, p, STRATEGY_BSDF, device)
    np.testing.assert_allclose(first, p**2 / (p**2 + q**2), rtol=2e-6)
    np.testing.assert_allclose(first + second, 1.0, rtol=2e-6)
    np.testing.assert_array_equal(weights(p, q, STRATEGY_LIGHT, device, STRATEGY_LIGHT), 1.0)
    np.testing.assert_array_equal(weights(p, q, STRATEGY_LIGHT, device, STRATEGY_BSDF), 0.0)


def test_variance_is_less_than_with_the_balance_heuristic(device: str, report: Report) -> None:
    """Made for it: a narrow lobe under a wide lamp, where one of the ways alone is nearly perfect.

    The lobe is Gaussian with σ 0.02, as the BSDF's samples are, and the lamp uniform in [−1, 1]. Then the power
    heuristic leaves the tails of the other way out (Veach 1997, section 9.2.3); both are unbiased.
    """
    rng, sigma, n = np.random.default_rng(2), 0.02, 200_000
    lobe = lambda x: np.exp(-0.5 * (x / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))  # noqa: E731
    by_bsdf, by_lamp = rng.normal(0.0, sigma, n), rng.uniform(-1.0, 1.0, n)
    ends = {}
    for name in ("power", "balance"):
        parts = []
        for x, this in ((by_bsdf, STRATEGY_BSDF), (by_lamp, STRATEGY_LIGHT)):
            p, q = np.maximum(lobe(x), 1e-12), np.full(n, 0.5)
            mine, other = (p, q) if this == STRATEGY_BSDF else (q, p)
            weight = weights(mine, other, this, device) if name == "power" else mine / (mine + other)
            parts.append(weight * lobe(x) / mine)
        both = parts[0] + parts[1]
        assert both.mean() == pytest.approx(1.0, abs=4.0 * both.std() / np.sqrt(n))
        ends[name] = float(both.var())
    report("variance, power over balance heuristic", ends["power"] / ends["balance"], "< 0.75")
    assert ends["power"] < 0.75 * ends["balance"]
