"""The helpers of all statistical tests hold their significance level and have power."""

import numpy as np
import pytest
from scipy import stats
from support.statistics import (
    chi_square_test,
    image_z_test,
    sidak,
    sidak_combined,
    t_test_mean,
    two_sample_z,
)

KS_LIMIT = 1e-3
"""Kolmogorov-Smirnov p-values below this say that a helper is not calibrated."""


def test_sidak_agrees_with_its_formula_and_inverse():
    assert sidak(0.01, 1) == pytest.approx(0.01, rel=1e-12)
    assert sidak(0.05, 10) == pytest.approx(1.0 - 0.95**0.1, rel=1e-12)
    assert float(sidak_combined(sidak(0.01, 10**6), 10**6)) == pytest.approx(0.01, rel=1e-9)


def test_p_of_chi_square_is_uniform_under_the_null(report):
    rng = np.random.default_rng(1)
    weights = rng.random(40) ** 3
    weights /= weights.sum()
    p = [chi_square_test(rng.multinomial(20_000, weights), 20_000 * weights).p for _ in range(400)]
    ks = stats.kstest(p, "uniform").pvalue
    report("p-values are uniform", float(np.mean(p)), 0.5, p=ks)
    assert ks > KS_LIMIT


TENTH = np.full(10, 100.0)


@pytest.mark.parametrize(
    ("observed", "expected", "options", "passes", "message"),
    [
        # 2 % in half of the cells of a million samples.
        (np.random.default_rng(2).multinomial(10**6, np.tile([0.0102, 0.0098], 50)), TENTH[0] ** 2, {}, False, "p "),
        ([503, 497, 0], [500.0, 500.0, 0.0], {}, True, "p "),
        # Thirty cells that expect 3 together are pooled with one more, and are not judged one by one.
        ([3, *[0] * 29, 100, 100], [*[0.1] * 30, 100.0, 100.0], {}, True, "for 1 degrees"),
        ([502, 497, 1], [500.0, 500.0, 0.0], {}, False, "where the density is zero"),
        (TENTH, 1.02 * TENTH, {}, False, "integrates to 1.02"),
        # Missing samples are a cell of their own.
        (0.8 * TENTH, 0.8 * TENTH, {"samples": 1000}, True, "p "),
        (TENTH, 0.8 * TENTH, {"samples": 1000}, False, "p "),
        # p = 0.0016: more tests lower the limit.
        ([550, 450], [500.0, 500.0], {}, False, "p "),
        ([550, 450], [500.0, 500.0], {"tests": 100}, True, "p "),
    ],
)
def test_chi_square_decides(observed, expected, options, passes, message):
    result = chi_square_test(observed, np.broadcast_to(expected, np.shape(observed)), **options)
    assert result.passed is passes
    assert message in result.message


def test_means_are_told_apart():
    x = np.random.default_rng(5).normal(3.0, 2.0, (3000, 5))
    p = t_test_mean(x.mean(axis=1), x.var(axis=1, ddof=1) / 5, 5, 3.0)
    np.testing.assert_allclose(p, stats.ttest_1samp(x, 3.0, axis=1).pvalue, rtol=1e-6)
    # Without variance only the exact value passes.
    assert t_test_mean(2.0, 0.0, 10, 2.0) == 1.0
    assert t_test_mean(2.0, 0.0, 10, 2.0001) < 1e-290
    assert two_sample_z(1.0, 0.16, 2.0, 0.09) == pytest.approx(-2.0, rel=1e-6)
    with pytest.raises(ValueError, match="finite"):
        two_sample_z(1.0, np.nan, 2.0, 1.0)


# --- Pictures --------------------------------------------------------------------------------------


def noisy_picture(rng, truth, samples, skewed=True):
    """Return the mean of samples and its variance: normal, or skewed as radiance is."""
    shape = (*truth.shape, samples)
    relative = rng.gamma(0.5, 2.0, shape) if skewed else rng.normal(1.0, 1.0, shape)
    x = truth[..., None] * relative
    return x.mean(axis=-1), x.var(axis=-1, ddof=1) / samples


def truth_picture(rng, size=32):
    truth = 0.2 + rng.random((size, size, 3))
    truth[:4, :4] = 0.0  # a black corner: neither picture has noise there
    return truth


@pytest.mark.parametrize(("skewed", "samples"), [(False, 16), pytest.param(True, 256, marks=pytest.mark.slow)])
def test_levels_of_pictures_hold_under_the_null(skewed, samples, report):
    rng = np.random.default_rng(8)
    values = []
    for _ in range(80):
        truth = truth_picture(rng, 16)
        a, b = (noisy_picture(rng, truth, samples, skewed) for _ in range(2))
        result = image_z_test(*a, *b, n_a=samples, n_b=samples)
        values.append((result.p_min, result.block_p, result.spread_p, result.mean_p))
        assert result.pass_fraction > 0.998
        assert result.agrees(significance=1e-4), result.message
    # Skewed samples have fewer far outliers once divided by their own standard error, which only
    # makes the test of pixels more lenient: there, p-values must not be smaller than uniform ones.
    side = "greater" if skewed else "two-sided"
    for name, column in zip(("pixel", "block", "spread", "mean"), np.array(values).T, strict=True):
        ks = stats.kstest(column, "uniform", alternative=side).pvalue
        report(f"{name} p-values are uniform", float(column.mean()), 0.5, p=ks)
        assert ks > KS_LIMIT


def test_wrong_pictures_are_found(report):
    rng = np.random.default_rng(9)
    truth = truth_picture(rng)
    right = noisy_picture(rng, truth, 256)
    # 2 % more light is found though every pixel passes.
    result = image_z_test(*noisy_picture(rng, 1.02 * truth, 256), *right, n_a=256, n_b=256)
    report("picture 2 % too bright", result.relative_difference[0], 0.02, p=result.mean_p)
    assert result.pass_fraction > 0.998
    assert result.mean_p < 1e-6
    assert not result.agrees()
    # A wrong region with the right mean.
    region = truth.copy()
    region[8:16, 8:16] *= 1.15
    region[16:24, 8:16] *= 0.85
    result = image_z_test(*noisy_picture(rng, region, 256), *right, n_a=256, n_b=256)
    assert result.spread_p < 1e-6
    assert not result.agrees()
    # One channel of one pixel.
    mean, variance = noisy_picture(rng, truth, 256)
    assert image_z_test(mean, variance, *right).p_min > 0.01
    mean[10, 20, 1] *= 3.0
    assert image_z_test(mean, variance, *right).p_min < 1e-6


def test_pixels_without_noise_must_agree_to_rounding():
    ones, zeros = np.ones((8, 8, 3)), np.zeros((8, 8, 3))
    assert image_z_test(ones, zeros, ones * (1.0 + 2e-6), zeros).agrees()
    result = image_z_test(ones, zeros, ones * 1.001, zeros)
    assert result.pass_fraction == 0.0
    assert not result.agrees()
