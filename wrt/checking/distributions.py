"""Whether directions follow a density: Pearson's χ² over cells of the sphere.

Samples never have exactly their expectation, so a test computes how improbable they would be if the code were right.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


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

    `alpha` is the significance of all `tests` together. Cells that expect less than `min_expected` are pooled, smallest
    first: the χ² distribution is a poor approximation below about 5 (Cochran 1954). Of `samples`, the ones that are not
    `observed` make one more cell, for samplers that may return none. `total_tolerance` is the greatest relative error
    of the sum of `expected`: a density that does not integrate to 1 is wrong, whatever its shape. Fails at once if a
    sample lies where the density is zero.
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
    p = chi_square_tail(statistic, dof)
    limit = 1.0 - (1.0 - alpha) ** (1.0 / tests)  # Šidák (1967)
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
    """Return the probability of each cell of `sphere_histogram` for a density `pdf` of (N, 3) unit vectors.

    Gauss-Legendre quadrature with `order` points a side in (cos θ, φ), which keep areas of the sphere; a rectangle
    is split in four until that changes its integral by less than `tolerance`: at least `min_levels` times,
    lest a step that clips a corner go unseen, and at most `max_levels` times, which a step in the density needs.
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


def chi_square_tail(statistic: float, dof: int) -> float:
    """Return the probability of a greater χ²: the regularised incomplete gamma function Q(dof / 2, χ² / 2).

    By its series, or by its continued fraction (Abramowitz and Stegun 1964, 6.5.29 and 6.5.31).
    """
    a, x = 0.5 * dof, 0.5 * statistic
    if x <= 0.0:
        return 1.0
    scale = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        term = total = 1.0 / a
        n = a
        while term > total * 1e-16:
            n += 1.0
            term *= x / n
            total += term
        return 1.0 - scale * total
    b = x + 1.0 - a
    c, d = 1e300, 1.0 / b
    fraction = d
    for i in range(1, 10_000):
        factor = -i * (i - a)
        b += 2.0
        d, c = 1.0 / (factor * d + b), b + factor / c
        fraction *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return scale * fraction
