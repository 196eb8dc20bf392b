"""Linear algebra whose last digits do not depend on the processor.

NumPy leaves products, inverses and decompositions of matrices to a library (BLAS and LAPACK) that chooses its code by
the model of the processor, with other last digits for each. What leads to a picture takes these functions instead.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

_EPSILON = float(np.finfo(np.float64).eps)

_SWEEPS = 30
"""More sweeps than the columns of three need: a matrix of condition 1e12 takes five."""


def product(a: ArrayLike, b: ArrayLike) -> NDArray[Any]:
    """Return what the operator @ does for vectors, matrices and stacks of matrices."""
    a, b = np.asarray(a), np.asarray(b)
    axes_of_a, axes_of_b = ("j" if a.ndim == 1 else "...ij"), ("j" if b.ndim == 1 else "...jk")
    result = "..." + ("" if a.ndim == 1 else "i") + ("" if b.ndim == 1 else "k")
    return np.asarray(np.einsum(f"{axes_of_a},{axes_of_b}->{result}", a, b))


def dot(a: ArrayLike, b: ArrayLike) -> float:
    """Return the inner product of two vectors."""
    return float(product(a, b))


def norm(vector: ArrayLike) -> float:
    """Return the Euclidean length of a vector."""
    return math.sqrt(dot(vector, vector))


def weighted_sum(colors: NDArray[Any], weights: Sequence[float] | FloatArray) -> NDArray[Any]:
    """Return the sums of channels (..., n) times n weights, such as luminance, in the type of the colors."""
    kind = colors.dtype.type
    total = colors[..., 0] * kind(weights[0])
    for channel in range(1, len(weights)):
        total = total + colors[..., channel] * kind(weights[channel])
    return np.asarray(total)


def inverse(matrices: ArrayLike) -> FloatArray:
    """Return the inverses of (..., n, n) matrices, by elimination with partial pivots.

    Cofactors would take less, but the error of their determinant grows with the square of the condition.

    Raises:
        numpy.linalg.LinAlgError: if a matrix is singular.
    """
    entries = _entries(np.asarray(matrices, np.float64))
    rows = [[*row, *(float(i == j) for j in range(len(entries)))] for i, row in enumerate(entries)]
    # A determinant of numbers that are not 0 may underflow to 0; pivots do not.
    if np.any(_reduce(rows)[1]):
        raise np.linalg.LinAlgError("Singular matrix")
    result = np.array([row[len(entries) :] for row in rows])
    return result if result.ndim == 2 else np.ascontiguousarray(np.moveaxis(result, (0, 1), (-2, -1)))


def determinant(matrices: ArrayLike) -> Any:
    """Return the determinants (...) of (..., n, n) matrices, by elimination with partial pivots."""
    return _reduce(_entries(np.asarray(matrices, np.float64)))[0]


def _entries(matrices: FloatArray) -> list[list[Any]]:
    """Return the rows of one matrix as numbers, or those of a stack as arrays of numbers.

    Arithmetic with Python's numbers is 20 times as fast as with arrays of one.
    """
    if matrices.ndim == 2:
        rows: list[list[Any]] = matrices.tolist()
        return rows
    return [[matrices[..., i, j] for j in range(matrices.shape[-1])] for i in range(matrices.shape[-2])]


@np.errstate(all="ignore")
def _reduce(rows: list[list[Any]]) -> tuple[Any, Any]:
    """Reduce the square at the left of rows to the identity; return its determinant, and whether a pivot was 0."""
    result: Any = 1.0
    singular: Any = False
    for k in range(len(rows)):
        for i in range(k + 1, len(rows)):
            larger = abs(rows[i][k]) > abs(rows[k][k])
            if isinstance(larger, bool):
                if larger:
                    rows[k], rows[i], result = rows[i], rows[k], -result
            elif larger.any():
                pairs = list(zip(rows[k], rows[i], strict=True))
                rows[k] = [np.where(larger, below, above) for above, below in pairs]
                rows[i] = [np.where(larger, above, below) for above, below in pairs]
                result = np.where(larger, -result, result)
        pivot = rows[k][k]
        result = result * pivot
        zero = pivot == 0.0
        singular = singular | zero
        divisor = pivot + zero
        top = rows[k] = [entry / divisor for entry in rows[k]]
        for i in range(len(rows)):
            if i != k:
                factor = rows[i][k]
                rows[i] = [entry - factor * above for entry, above in zip(rows[i], top, strict=True)]
    return result, singular


def polar(matrices: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return orthogonal and symmetric positive definite factors of (..., n, n) invertible matrices, in this order."""
    columns, axes = _orthogonal_columns(matrices)
    sizes = np.sqrt((columns * columns).sum(axis=-2, keepdims=True))
    transposed = np.swapaxes(axes, -1, -2)
    return product(columns / sizes, transposed), product(axes * sizes, transposed)


def singular_values(matrices: ArrayLike) -> FloatArray:
    """Return the singular values (..., n) of (..., m, n) matrices, n at most m, the largest first."""
    columns, _ = _orthogonal_columns(matrices)
    return np.sort(np.sqrt((columns * columns).sum(axis=-2)), axis=-1)[..., ::-1]


def _orthogonal_columns(matrices: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return (M·V, V) of (..., m, n) matrices M: rotations V for which the columns of M·V are orthogonal.

    Pairs of columns are turned until all are orthogonal (one-sided Jacobi, Hestenes 1958), which keeps small singular
    values accurate.
    """
    matrices = np.asarray(matrices, np.float64)
    size = matrices.shape[-1]
    columns = matrices.reshape(-1, *matrices.shape[-2:]).copy()
    axes = np.tile(np.eye(size), (len(columns), 1, 1))
    for _ in range(_SWEEPS):
        turned = False
        for p in range(size):
            for q in range(p + 1, size):
                x, y = columns[:, :, p], columns[:, :, q]
                xx, yy, xy = ((a * b).sum(axis=1) for a, b in ((x, x), (y, y), (x, y)))
                slanted = np.abs(xy) > 2.0 * _EPSILON * np.sqrt(xx) * np.sqrt(yy)
                if not slanted.any():
                    continue
                turned = True
                cotangent = (yy - xx) / np.where(slanted, 2.0 * xy, 1.0)
                tangent = np.where(cotangent < 0.0, -1.0, 1.0) / (np.abs(cotangent) + np.hypot(1.0, cotangent))
                tangent = np.where(slanted, tangent, 0.0)
                cosine = (1.0 / np.sqrt(1.0 + tangent * tangent))[:, None]
                sine = cosine * tangent[:, None]
                for m in (columns, axes):
                    m[:, :, p], m[:, :, q] = (
                        cosine * m[:, :, p] - sine * m[:, :, q],
                        sine * m[:, :, p] + cosine * m[:, :, q],
                    )
        if not turned:
            break
    return columns.reshape(matrices.shape), axes.reshape(*matrices.shape[:-2], size, size)


@functools.lru_cache(maxsize=64)
def gauss_legendre(count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes, ascending in (−1, 1), and weights of Gauss and Legendre's quadrature, by Newton's method.

    The arrays are read-only, as all callers share them.
    """
    x = -np.cos(math.pi * (np.arange(count) + 0.75) / (count + 0.5))
    slope = np.ones(count)
    for _ in range(8):
        before, value = np.ones(count), x
        for n in range(2, count + 1):
            before, value = value, ((2 * n - 1) * x * value - (n - 1) * before) / n
        slope = count * (before - x * value) / (1.0 - x * x)
        x = x - value / slope
    # Nodes are symmetric; rounding is not.
    x, slope = 0.5 * (x - x[::-1]), 0.5 * (np.abs(slope) + np.abs(slope[::-1]))
    weights = 2.0 / ((1.0 - x * x) * slope * slope)
    for array in (x, weights):
        array.setflags(write=False)
    return x, weights
