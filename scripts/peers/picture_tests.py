"""Hypothesis tests that decide whether two pictures, or two means, differ by more than their noise.

A Monte Carlo result is never equal to its expectation, so a test asks how improbable the result
would be if both were right. Where many are asked at once, each gets the smaller significance that keeps the whole at
the one stated (Šidák 1967).
"""

from __future__ import annotations

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
    total, _ = _grouped_scores(a, va, b, vb, na, nb, max(shape[:2]), floor)
    mean_p = sidak_combined(2.0 * stats.norm.sf(np.abs(total).max()), shape[2])

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
