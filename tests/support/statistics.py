"""Hypothesis tests that decide whether a sampler or a picture is right.

A Monte Carlo result is never equal to its expectation, so a test asks how improbable the result
would be if the code were right. Where many are asked at once, each gets the smaller significance
that keeps the whole at the one stated (Šidák 1967). Seeds are fixed, once, so that a test which
passes goes on passing until the code changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

FloatArray = NDArray[np.float64]


def sidak(alpha: float, n: int) -> float:
    """Return the significance of each of `n` independent tests so that all together have `alpha`.

    1 − (1 − α)^(1/n): Šidák, "Rectangular confidence regions for the means of multivariate normal
    distributions", JASA 62 (1967). Written with log1p and expm1, as n may be a million.
    """
    if not 0.0 < alpha < 1.0 or n < 1:
        raise ValueError(f"significance {alpha} of {n} tests: it must lie in (0, 1), with at least one test")
    return float(-np.expm1(np.log1p(-alpha) / n))


def sidak_combined(p: ArrayLike, n: int) -> FloatArray:
    """Return the probability that the smallest of `n` independent p-values is at most `p`."""
    return np.asarray(-np.expm1(n * np.log1p(-np.minimum(np.asarray(p, np.float64), 1.0 - 1e-16))))


# --- Histograms -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class ChiSquareResult:
    """The outcome of `chi_square_test`."""

    passed: bool
    p: float
    dof: int
    statistic: float
    message: str


def chi_square_test(
    observed: ArrayLike,
    expected: ArrayLike,
    *,
    alpha: float = 0.01,
    tests: int = 1,
    min_expected: float = 5.0,
    samples: int | None = None,
    total_tolerance: float = 1e-3,
) -> ChiSquareResult:
    """Test counts against expected counts by Pearson's χ² (Pearson 1900; Knuth TAOCP 2, 3.3.1).

    Args:
        observed: counts, any shape.
        expected: expected counts, same shape.
        alpha: significance of all `tests` together.
        tests: how many such tests are made; each is held to `sidak(alpha, tests)`.
        min_expected: cells expecting less are pooled, smallest first, until the pool expects this much:
            the χ² distribution is a poor approximation below about 5 (Cochran 1954).
        samples: how many samples were drawn, where a sampler may return none: the missing ones make
            one more cell. By default all of them are in `observed`.
        total_tolerance: greatest relative error of the sum of `expected`: a density that does not integrate
            to 1 is wrong, whatever its shape.

    Fails at once if a sample lies where the density is zero.
    """
    counts = np.asarray(observed, np.float64).ravel()
    means = np.asarray(expected, np.float64).ravel()
    if counts.shape != means.shape:
        raise ValueError(f"{counts.size} observed cells for {means.size} expected ones")
    if not np.isfinite(means).all() or (means < 0.0).any():
        return ChiSquareResult(False, 0.0, 0, np.inf, "the density is negative or not finite somewhere")
    if samples is not None:
        counts = np.append(counts, samples - counts.sum())
        means = np.append(means, max(samples - means.sum(), 0.0))
    total = counts.sum()
    if abs(means.sum() - total) > total_tolerance * total:
        message = f"the density integrates to {means.sum() / total:.6f}, not 1"
        return ChiSquareResult(False, 0.0, 0, np.inf, message)
    stray = counts[means == 0.0].sum()
    if stray > 0:
        return ChiSquareResult(False, 0.0, 0, np.inf, f"{stray:.0f} of {total:.0f} samples where the density is zero")

    counts, means = _pool(counts, means, min_expected)
    dof = len(means) - 1
    if dof < 1:
        return ChiSquareResult(False, 0.0, dof, 0.0, f"{total:.0f} samples are too few: one cell is left after pooling")
    statistic = float(np.sum((counts - means) ** 2 / means))
    p = float(stats.chi2.sf(statistic, dof))
    limit = sidak(alpha, tests)
    message = f"χ² {statistic:.1f} for {dof} degrees of freedom: p {p:.3g}, must exceed {limit:.3g}"
    return ChiSquareResult(p > limit, p, dof, statistic, message)


def _pool(counts: FloatArray, means: FloatArray, min_expected: float) -> tuple[FloatArray, FloatArray]:
    order = np.argsort(means, kind="stable")
    counts, means = counts[order], means[order]
    cumulative = np.cumsum(means)
    small = int(np.searchsorted(means, min_expected))
    if small == 0:
        return counts, means
    # The pool takes every small cell, then larger ones until it expects enough itself.
    cut = max(small, int(np.searchsorted(cumulative, min_expected)) + 1)
    return np.append(counts[cut:], counts[:cut].sum()), np.append(means[cut:], means[:cut].sum())


def sphere_histogram(directions: ArrayLike, resolution: tuple[int, int] = (51, 101)) -> FloatArray:
    """Count unit vectors in equal-area cells of cos θ (rows, −1 to 1) and φ (columns, −π to π).

    Odd resolutions put the horizon and the axes in the middle of cells, where a sampler that is wrong
    there cannot hide behind a cell's edge.
    """
    d = np.asarray(directions, np.float64)
    if d.ndim != 2 or d.shape[1] != 3 or not np.isfinite(d).all():
        raise ValueError("directions must be (N, 3) and finite")
    if np.abs(np.linalg.norm(d, axis=1) - 1.0).max(initial=0.0) > 1e-4:
        raise ValueError("directions must have unit length")
    rows, columns = resolution
    i = np.clip(((d[:, 2] + 1.0) * 0.5 * rows).astype(np.int64), 0, rows - 1)
    j = np.clip(((np.arctan2(d[:, 1], d[:, 0]) / np.pi + 1.0) * 0.5 * columns).astype(np.int64), 0, columns - 1)
    return np.bincount(i * columns + j, minlength=rows * columns).reshape(rows, columns).astype(np.float64)


def integrate_pdf_over_bins(
    pdf: Callable[[FloatArray], ArrayLike],
    resolution: tuple[int, int] = (51, 101),
    *,
    tolerance: float = 1e-8,
    order: int = 4,
    min_levels: int = 2,
    max_levels: int = 12,
) -> FloatArray:
    """Integrate a density over solid angle in the cells of `sphere_histogram`.

    Gauss-Legendre quadrature in (cos θ, φ), whose area element is that of the sphere; a rectangle is
    split in four until that changes its integral by less than `tolerance`.

    Args:
        pdf: takes (N, 3) unit vectors and returns N densities per steradian.
        resolution: cells in cos θ and φ.
        tolerance: absolute, of the probability in a rectangle.
        order: Gauss points a side.
        min_levels: times a cell is split in any case, lest a step that clips a corner go unseen.
        max_levels: most times a cell is split; a step in the density needs them.

    Returns:
        Array of the shape `resolution`: the probability of each cell.
    """
    rows, columns = resolution
    z = np.linspace(-1.0, 1.0, rows + 1)
    phi = np.linspace(-np.pi, np.pi, columns + 1)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    cell = i * columns + j
    rectangles = np.stack([z[i], z[i + 1], phi[j], phi[j + 1]], axis=1)
    coarse = _gauss(pdf, rectangles, order)
    result = np.zeros(rows * columns)
    for level in range(max_levels + 1):
        z0, z1, p0, p1 = rectangles.T
        zm, pm = 0.5 * (z0 + z1), 0.5 * (p0 + p1)
        children = np.stack(
            [np.stack(q, axis=1) for q in ((z0, zm, p0, pm), (z0, zm, pm, p1), (zm, z1, p0, pm), (zm, z1, pm, p1))]
        )
        fine = _gauss(pdf, children.reshape(-1, 4), order).reshape(4, -1)
        changed = np.abs(fine.sum(axis=0) - coarse) > tolerance
        split = (changed | (level < min_levels)) & (level < max_levels)
        np.add.at(result, cell[~split], fine.sum(axis=0)[~split])
        if not split.any():
            break
        rectangles = children[:, split].reshape(-1, 4)
        coarse = fine[:, split].ravel()
        cell = np.tile(cell[split], 4)
    return result.reshape(rows, columns)


def _gauss(pdf: Callable[[FloatArray], ArrayLike], rectangles: FloatArray, order: int) -> FloatArray:
    node, weight = np.polynomial.legendre.leggauss(order)
    z0, z1, p0, p1 = rectangles.T[:, :, None, None]
    z = 0.5 * ((z0 + z1) + (z1 - z0) * node[:, None])
    phi = 0.5 * ((p0 + p1) + (p1 - p0) * node[None, :])
    z, phi = np.broadcast_arrays(z, phi)
    r = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    directions = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1).reshape(-1, 3)
    values = np.asarray(pdf(directions), np.float64).reshape(z.shape)
    area = 0.25 * (z1 - z0) * (p1 - p0)
    return np.asarray(np.sum(values * weight[:, None] * weight[None, :] * area, axis=(1, 2)))


# --- Means ----------------------------------------------------------------------------------------


def t_test_mean(mean: ArrayLike, variance_of_mean: ArrayLike, n: ArrayLike, expected: ArrayLike) -> FloatArray:
    """Return two-sided p-values of means of `n` samples against exact values (Student 1908).

    Args:
        mean: estimates, any shape.
        variance_of_mean: their estimated variances: the samples' unbiased variance divided by n.
        n: samples behind each, at least 2.
        expected: what they should be.
    """
    z = two_sample_z(mean, variance_of_mean, expected, 0.0, n_a=n)
    return np.asarray(2.0 * stats.norm.sf(np.abs(z)))


def two_sample_z(
    mean_a: ArrayLike,
    var_a: ArrayLike,
    mean_b: ArrayLike,
    var_b: ArrayLike,
    *,
    n_a: ArrayLike = np.inf,
    n_b: ArrayLike = np.inf,
    floor: float = 0.0,
) -> FloatArray:
    """Return how far two means are apart, in standard errors.

    With `n_a` or `n_b` finite the variances count as estimated from that many samples: Welch's t (1947), turned
    into the normal deviate of the same probability. A plain z would find differences that are none: with 32
    samples, 5 standard errors are 40 times as likely as under the normal distribution.

    Args:
        mean_a: means of the first, any shape.
        var_a: variances of these means.
        mean_b: means of the second.
        var_b: variances of these means.
        n_a: independent samples behind each of the first.
        n_b: independent samples behind each of the second.
        floor: relative difference that counts as one standard error in itself.
    """
    a, va, b, vb, na, nb = np.broadcast_arrays(
        *(np.asarray(x, np.float64) for x in (mean_a, var_a, mean_b, var_b, n_a, n_b))
    )
    if not all(np.isfinite(x).all() for x in (a, va, b, vb)) or (va < 0.0).any() or (vb < 0.0).any():
        raise ValueError("means and variances must be finite, variances not negative")
    if (na < 2).any() or (nb < 2).any():
        raise ValueError("a variance takes at least two samples")
    difference = a - b
    extra = (floor * np.maximum(np.abs(a), np.abs(b))) ** 2
    variance = va + vb + extra
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(difference == 0.0, 0.0, difference / np.sqrt(variance))
        spread = va**2 / (na - 1.0) + vb**2 / (nb - 1.0)
        dof = np.where(spread > 0.0, variance**2 / spread, np.inf)
    finite = np.minimum(dof, 1e12)
    tail = np.where(np.isinf(t), -np.inf, stats.t.logsf(np.where(np.isinf(t), 0.0, np.abs(t)), finite))
    # Beyond 37 standard errors the probability is below the smallest double; the deviate stops there.
    z = np.minimum(stats.norm.isf(np.exp(np.maximum(tail, -700.0))), 37.0)
    return np.asarray(np.sign(t) * np.maximum(z, 0.0))


# --- Pictures -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ImageTest:
    """The outcome of `image_z_test`; every p-value holds for the whole picture and all its channels.

    Attributes:
        pass_fraction: of the values whose own p-value is above the Šidák limit.
        p_min: of the smallest p-value of a pixel.
        block_p: of the smallest p-value of a block: finds differences in a region.
        spread_p: that block scores spread no wider than the unit normal: finds small differences everywhere.
        mean_p: that the mean over the picture is the same.
        tail_fraction: of values beyond two standard errors; 4.6 % if all is well.
        relative_difference: of the picture's mean, first against second, per channel.
        z: (H, W, C) normal deviates.
        message: all of these in a line.
    """

    pass_fraction: float
    p_min: float
    block_p: float
    spread_p: float
    mean_p: float
    tail_fraction: float
    relative_difference: tuple[float, ...]
    z: FloatArray
    message: str

    def agrees(self, *, significance: float = 0.01, pass_fraction: float = 0.995) -> bool:
        """Return whether nothing speaks against the two pictures being the same."""
        limit = sidak(significance, 3)
        return self.pass_fraction >= pass_fraction and min(self.block_p, self.spread_p, self.mean_p) > limit


def image_z_test(
    mean_a: ArrayLike,
    var_of_mean_a: ArrayLike,
    mean_b: ArrayLike,
    var_of_mean_b: ArrayLike,
    *,
    n_a: ArrayLike = np.inf,
    n_b: ArrayLike = np.inf,
    significance: float = 0.01,
    block: int = 4,
    floor: float = 1e-5,
) -> ImageTest:
    """Test whether two Monte Carlo pictures have the same expectation.

    The z-test per pixel with Šidák's correction is Subr and Arvo's ("Statistical hypothesis testing for
    assessing Monte Carlo estimators: applications to image synthesis", 2007). By itself it sees only gross
    errors, as a pixel must be off by five standard errors; so blocks of pixels and the whole picture are
    tested as well, where the noise is `block` and √(H·W) times smaller.

    Args:
        mean_a: (H, W, C) first picture.
        var_of_mean_a: (H, W, C) variance of its values, their noise included.
        mean_b: (H, W, C) second picture.
        var_of_mean_b: (H, W, C) variance of its values.
        n_a: independent samples behind the first variance, scalar or broadcastable to (H, W, C).
        n_b: independent samples behind the second.
        significance: of the test of all pixels together.
        block: side of a block, pixels.
        floor: relative difference that is rounding: it counts as one standard error, so that values
            without noise may differ by it.
    """
    arrays = [np.asarray(x, np.float64) for x in (mean_a, var_of_mean_a, mean_b, var_of_mean_b)]
    shape = arrays[0].shape
    if len(shape) != 3 or any(x.shape != shape for x in arrays):
        raise ValueError(f"pictures must be (H, W, C) and alike, not {[x.shape for x in arrays]}")
    a, va, b, vb = arrays
    na, nb = (np.broadcast_to(np.asarray(n, np.float64), shape) for n in (n_a, n_b))
    z = two_sample_z(a, va, b, vb, n_a=na, n_b=nb, floor=floor)
    p = 2.0 * stats.norm.sf(np.abs(z))
    pass_fraction = float(np.mean(p > sidak(significance, z.size)))

    blocks, degenerate = _grouped_scores(a, va, b, vb, na, nb, block, floor)
    block_p = sidak_combined(2.0 * stats.norm.sf(np.abs(blocks).max()), blocks.size)
    # Channels of a pixel share their paths: only within a channel are the blocks independent.
    spread = [
        stats.chi2.sf(np.sum(blocks[..., c][~degenerate[..., c]] ** 2), max(int((~degenerate[..., c]).sum()), 1))
        for c in range(shape[2])
    ]
    spread_p = sidak_combined(min(spread), shape[2])
    whole, _ = _grouped_scores(a, va, b, vb, na, nb, max(shape[:2]), floor)
    mean_p = sidak_combined(2.0 * stats.norm.sf(np.abs(whole).max()), shape[2])

    p_min = sidak_combined(p.min(), p.size)
    tail_fraction = float(np.mean(np.abs(z[va + vb > 0.0]) > 2.0)) if (va + vb).any() else 0.0
    reference = b.mean(axis=(0, 1))
    relative = tuple(
        float(x) for x in (a.mean(axis=(0, 1)) - reference) / np.where(reference == 0.0, 1.0, np.abs(reference))
    )
    message = (
        f"{100.0 * pass_fraction:.2f} % of pixels pass; p: pixel {p_min:.3g}, block {block_p:.3g}, "
        f"spread {spread_p:.3g}, mean {mean_p:.3g}; |z| > 2 in {100.0 * tail_fraction:.1f} %; "
        f"mean off by {', '.join(f'{100.0 * x:+.3f}' for x in relative)} %"
    )
    return ImageTest(
        pass_fraction=pass_fraction,
        p_min=float(p_min),
        block_p=float(block_p),
        spread_p=float(spread_p),
        mean_p=float(mean_p),
        tail_fraction=tail_fraction,
        relative_difference=relative,
        z=z,
        message=message,
    )


def _grouped_scores(
    a: FloatArray,
    va: FloatArray,
    b: FloatArray,
    vb: FloatArray,
    na: FloatArray,
    nb: FloatArray,
    block: int,
    floor: float,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the scores of the sums over blocks, and which blocks have no noise."""

    def total(x: FloatArray) -> FloatArray:
        rows, columns = (np.arange(0, n, block) for n in x.shape[:2])
        return np.asarray(np.add.reduceat(np.add.reduceat(x, rows, axis=0), columns, axis=1))

    sum_va, sum_vb = total(va), total(vb)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Welch-Satterthwaite once more: the degrees of freedom behind a sum of estimated variances.
        groups_a, groups_b = (
            1.0 + np.where(s > 0.0, s**2 / total(v**2 / (n - 1.0)), np.inf)
            for s, v, n in ((sum_va, va, na), (sum_vb, vb, nb))
        )
    scores = two_sample_z(total(a), sum_va, total(b), sum_vb, n_a=groups_a, n_b=groups_b, floor=floor)
    return scores, sum_va + sum_vb == 0.0
