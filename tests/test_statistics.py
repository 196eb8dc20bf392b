"""The helpers that decide over all other statistical tests hold their level and have power."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from support.statistics import (
    chi_square_test,
    image_z_test,
    integrate_pdf_over_bins,
    sidak,
    sidak_combined,
    sphere_histogram,
    t_test_mean,
    two_sample_z,
)

# Kolmogorov-Smirnov p-values below this would say that a helper is not calibrated.
KS_LIMIT = 1e-3


def cosine_directions(rng: np.random.Generator, n: int) -> np.ndarray:
    """Cosine-weighted directions by Malley's method."""
    r, phi = np.sqrt(rng.random(n)), 2.0 * np.pi * rng.random(n)
    return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1.0 - r * r)], axis=1)


def cosine_pdf(d: np.ndarray) -> np.ndarray:
    return np.maximum(d[:, 2], 0.0) / np.pi


def test_sidak_agrees_with_its_formula_and_inverse():
    assert sidak(0.01, 1) == pytest.approx(0.01, rel=1e-12)
    assert sidak(0.05, 10) == pytest.approx(1.0 - 0.95**0.1, rel=1e-12)
    assert float(sidak_combined(sidak(0.01, 10**6), 10**6)) == pytest.approx(0.01, rel=1e-9)
    with pytest.raises(ValueError, match="significance"):
        sidak(1.0, 3)


class TestChiSquare:
    def test_p_is_uniform_under_the_null(self, report):
        rng = np.random.default_rng(1)
        weights = rng.random(40) ** 3
        weights /= weights.sum()
        p = [chi_square_test(rng.multinomial(20_000, weights), 20_000 * weights).p for _ in range(400)]
        ks = stats.kstest(p, "uniform").pvalue
        report("p-values are uniform", float(np.mean(p)), 0.5, p=ks)
        assert ks > KS_LIMIT

    def test_two_per_cent_in_half_the_cells_is_found(self):
        rng = np.random.default_rng(2)
        wrong = np.tile([1.02, 0.98], 50) / 100.0
        assert not chi_square_test(rng.multinomial(1_000_000, wrong), np.full(100, 10_000.0)).passed

    def test_one_sample_where_the_density_is_zero_fails(self):
        expected = np.array([500.0, 500.0, 0.0])
        assert chi_square_test([503, 497, 0], expected).passed
        result = chi_square_test([502, 497, 1], expected)
        assert not result.passed
        assert "density is zero" in result.message

    def test_small_cells_are_pooled_until_they_expect_five(self):
        expected = np.concatenate([np.full(30, 0.1), [100.0, 100.0]])
        observed = np.zeros(32)
        observed[3] = 3
        observed[30:] = 100
        # The thirty expect 3 together, which is still too few: the pool takes one large cell as well.
        result = chi_square_test(observed, expected)
        assert (result.dof, result.statistic) == (1, pytest.approx(0.0))
        assert chi_square_test(observed, expected, min_expected=2.0).dof == 2

    def test_density_that_does_not_integrate_to_one_fails(self):
        assert "integrates to 1.02" in chi_square_test(np.full(10, 100.0), np.full(10, 102.0)).message

    def test_nan_density_fails(self):
        assert not chi_square_test(np.full(10, 100.0), np.full(10, np.nan)).passed

    def test_missing_samples_are_a_cell_of_their_own(self):
        expected = np.full(10, 80.0)
        assert chi_square_test(np.full(10, 80.0), expected, samples=1000).passed
        assert not chi_square_test(np.full(10, 100.0), expected, samples=1000).passed

    def test_sidak_over_tests_lowers_the_limit(self):
        expected = np.full(2, 500.0)
        observed = [550, 450]  # p = 0.0016
        assert not chi_square_test(observed, expected).passed
        assert chi_square_test(observed, expected, tests=100).passed


class TestSphere:
    def test_cells_integrate_smooth_densities_exactly(self):
        resolution = (7, 11)
        uniform = integrate_pdf_over_bins(lambda d: np.full(len(d), 0.25 / np.pi), resolution)
        np.testing.assert_allclose(uniform, np.full(resolution, 1.0 / 77.0), rtol=1e-12)

    @pytest.mark.parametrize("exponent", [0, 1, 20])
    def test_cells_integrate_a_lobe_with_a_step_at_the_horizon(self, exponent):
        rows, columns = 9, 5
        n = exponent

        def pdf(d):
            return np.where(d[:, 2] > 0.0, (n + 1) / (2.0 * np.pi) * np.abs(d[:, 2]) ** n, 0.0)

        edges = np.maximum(np.linspace(-1.0, 1.0, rows + 1), 0.0) ** (n + 1)
        exact = np.repeat(np.diff(edges)[:, None] / columns, columns, axis=1)
        np.testing.assert_allclose(integrate_pdf_over_bins(pdf, (rows, columns)), exact, atol=1e-7)

    def test_cells_integrate_a_tilted_cap(self):
        axis = np.array([0.48, 0.6, 0.64])  # a unit vector

        def cap(d):
            return np.where(d @ axis > 0.5, 1.0 / np.pi, 0.0)

        # A hundredth of the noise of a million samples, which is what the cells are compared with.
        assert integrate_pdf_over_bins(cap, (9, 15)).sum() == pytest.approx(1.0, abs=1e-5)

    def test_right_sampler_passes_and_a_slightly_wrong_one_fails(self, report):
        rng = np.random.default_rng(3)
        resolution, n = (25, 51), 1_000_000
        expected = n * integrate_pdf_over_bins(cosine_pdf, resolution)
        right = cosine_directions(rng, n)
        result = chi_square_test(sphere_histogram(right, resolution), expected)
        report("cosine sampler against its density", result.statistic, result.dof, p=result.p)
        assert result.passed, result.message
        wrong = right * [1.02, 1.0, 1.0]
        wrong /= np.linalg.norm(wrong, axis=1, keepdims=True)
        assert not chi_square_test(sphere_histogram(wrong, resolution), expected).passed

    def test_swapped_axes_are_noticed(self):
        rng = np.random.default_rng(4)
        d = cosine_directions(rng, 20_000)
        expected = len(d) * integrate_pdf_over_bins(cosine_pdf, (9, 9))
        assert not chi_square_test(sphere_histogram(d[:, [0, 2, 1]], (9, 9)), expected).passed

    def test_directions_must_be_unit_and_finite(self):
        with pytest.raises(ValueError, match="unit length"):
            sphere_histogram([[0.0, 0.0, 1.1]])
        with pytest.raises(ValueError, match="finite"):
            sphere_histogram([[0.0, 0.0, np.nan]])


class TestMeans:
    def test_student_p_is_uniform_even_for_five_samples(self, report):
        x = np.random.default_rng(5).normal(3.0, 2.0, (3000, 5))
        p = t_test_mean(x.mean(axis=1), x.var(axis=1, ddof=1) / 5, 5, 3.0)
        ks = stats.kstest(p, "uniform").pvalue
        report("p-values are uniform at n = 5", float(p.mean()), 0.5, p=ks)
        assert ks > KS_LIMIT
        expected = stats.ttest_1samp(x, 3.0, axis=1).pvalue
        np.testing.assert_allclose(p, expected, rtol=1e-6)

    def test_two_per_cent_bias_is_found(self):
        x = np.random.default_rng(6).exponential(1.0, 100_000)
        assert t_test_mean(x.mean(), x.var(ddof=1) / len(x), len(x), 1.0) > 0.01
        assert t_test_mean(x.mean(), x.var(ddof=1) / len(x), len(x), 1.02) < 1e-6

    def test_without_variance_only_the_exact_value_passes(self):
        assert t_test_mean(2.0, 0.0, 10, 2.0) == 1.0
        assert t_test_mean(2.0, 0.0, 10, 2.0001) < 1e-290

    def test_welch_scores_are_unit_normal_for_unequal_small_samples(self, report):
        rng = np.random.default_rng(7)
        a, b = rng.normal(1.0, 1.0, (4000, 12)), rng.normal(1.0, 3.0, (4000, 30))
        z = two_sample_z(
            a.mean(axis=1), a.var(axis=1, ddof=1) / 12, b.mean(axis=1), b.var(axis=1, ddof=1) / 30, n_a=12, n_b=30
        )
        ks = stats.kstest(z, "norm").pvalue
        report("scores are unit normal", float(z.std()), 1.0, p=ks)
        assert ks > KS_LIMIT

    def test_sign_and_size(self):
        assert two_sample_z(1.0, 0.16, 2.0, 0.09) == pytest.approx(-2.0, rel=1e-6)
        assert two_sample_z(1.0, 0.0, 2.0, 1e-12) == -37.0
        with pytest.raises(ValueError, match="finite"):
            two_sample_z(1.0, np.nan, 2.0, 1.0)


def noisy_picture(rng, truth, samples, noise="skewed"):
    """Mean and variance of the mean of `samples` samples: normal, or skewed as radiance is."""
    shape = (*truth.shape, samples)
    if noise == "skewed":
        x = rng.gamma(0.5, truth[..., None] / 0.5, shape)
    else:
        x = truth[..., None] * rng.normal(1.0, 1.0, shape)
    return x.mean(axis=-1), x.var(axis=-1, ddof=1) / samples


def truth_picture(rng, size=32):
    truth = 0.2 + rng.random((size, size, 3))
    truth[:4, :4] = 0.0  # a black corner: neither picture has noise there
    return truth


class TestPictures:
    @pytest.mark.parametrize(
        ("noise", "samples"), [("normal", 16), pytest.param("skewed", 256, marks=pytest.mark.slow)]
    )
    def test_levels_hold_under_the_null(self, noise, samples, report):
        rng = np.random.default_rng(8)
        values = []
        for _ in range(80):
            truth = truth_picture(rng, 16)
            a, va = noisy_picture(rng, truth, samples, noise)
            b, vb = noisy_picture(rng, truth, samples, noise)
            result = image_z_test(a, va, b, vb, n_a=samples, n_b=samples)
            values.append((result.p_min, result.block_p, result.spread_p, result.mean_p))
            assert result.pass_fraction > 0.998
            assert result.agrees(significance=1e-4), result.message
        # Skewed samples have fewer far outliers once divided by their own standard error, which only
        # makes the test of pixels more lenient: there, p-values must not be smaller than uniform ones.
        side = "two-sided" if noise == "normal" else "greater"
        for name, column in zip(("pixel", "block", "spread", "mean"), np.array(values).T, strict=True):
            ks = stats.kstest(column, "uniform", alternative=side).pvalue
            report(f"{name} p-values are uniform", float(column.mean()), 0.5, p=ks)
            assert ks > KS_LIMIT

    def test_two_per_cent_more_light_is_found_though_every_pixel_passes(self, report):
        rng = np.random.default_rng(9)
        truth = truth_picture(rng)
        a, va = noisy_picture(rng, 1.02 * truth, 256)
        b, vb = noisy_picture(rng, truth, 256)
        result = image_z_test(a, va, b, vb, n_a=256, n_b=256)
        report("picture 2 % too bright", result.relative_difference[0], 0.02, p=result.mean_p)
        assert result.pass_fraction > 0.998
        assert result.mean_p < 1e-6
        assert not result.agrees()

    def test_a_wrong_region_with_the_right_mean_is_found(self):
        rng = np.random.default_rng(10)
        truth = truth_picture(rng)
        wrong = truth.copy()
        wrong[8:16, 8:16] *= 1.15
        wrong[16:24, 8:16] *= 0.85
        a, va = noisy_picture(rng, wrong, 256)
        b, vb = noisy_picture(rng, truth, 256)
        result = image_z_test(a, va, b, vb, n_a=256, n_b=256)
        assert result.spread_p < 1e-6
        assert not result.agrees()

    def test_one_channel_of_one_pixel_is_found(self):
        rng = np.random.default_rng(11)
        truth = truth_picture(rng)
        a, va = noisy_picture(rng, truth, 256)
        b, vb = noisy_picture(rng, truth, 256)
        assert image_z_test(a, va, b, vb).p_min > 0.01
        a[10, 20, 1] *= 3.0
        assert image_z_test(a, va, b, vb).p_min < 1e-6

    def test_pixels_without_noise_must_agree_to_rounding(self):
        ones, zeros = np.ones((8, 8, 3)), np.zeros((8, 8, 3))
        assert image_z_test(ones, zeros, ones * (1.0 + 2e-6), zeros).agrees()
        result = image_z_test(ones, zeros, ones * 1.001, zeros)
        assert result.pass_fraction == 0.0
        assert not result.agrees()

    def test_shapes_and_values_are_checked(self):
        ones = np.ones((4, 4, 3))
        with pytest.raises(ValueError, match="alike"):
            image_z_test(ones, ones, ones[:2], ones)
        with pytest.raises(ValueError, match="finite"):
            image_z_test(ones, ones * np.nan, ones, ones)
