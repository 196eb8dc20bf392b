"""wrt's own linear algebra agrees with NumPy's to the precision of the machine, for matrices that are hard too."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from wrt.errors import InputError
from wrt.linalg import determinant, dot, gauss_legendre, inverse, norm, polar, product, singular_values
from wrt.scene.motion import check_affine, rotation_matrix

EPS = float(np.finfo(np.float64).eps)
RANDOM = np.random.default_rng(11)
TURN = rotation_matrix((1.0, 2.0, 3.0), 50.0)
OTHER = rotation_matrix((-2.0, 1.0, 0.4), 130.0)

HARD = {
    "identity": np.eye(3),
    "rotation": TURN,
    "half turn": np.diag([-1.0, -1.0, 1.0]),
    "mirror": np.diag([1.0, 1.0, -1.0]) @ TURN,
    "permutation": np.eye(3)[[2, 0, 1]],
    "zero pivots": np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 3.0], [4.0, 0.0, 0.0]]),
    "one size": 1e-15 * TURN,
    "flat": TURN @ np.diag([1.0, 1.0, 1e-9]) @ OTHER,
    "needle": TURN @ np.diag([1e6, 1e-6, 1e-6]) @ OTHER,
    "ratios": TURN @ np.diag([1e5, 1.0, 1e-5]) @ OTHER,
    "sheared": np.array([[1.0, 1e6, 0.0], [0.0, 1.0, 1e6], [0.0, 0.0, 1.0]]),
    "huge": 1e30 * RANDOM.normal(size=(3, 3)),
    "tiny": 1e-30 * RANDOM.normal(size=(3, 3)),
}


@pytest.mark.parametrize("name", HARD)
def test_inverses_are_as_near_as_numpys(name: str) -> None:
    matrix = HARD[name]
    found, theirs = inverse(matrix), np.linalg.inv(matrix)
    condition = np.linalg.cond(matrix)
    assert np.abs(found - theirs).max() <= 8.0 * EPS * condition * np.abs(theirs).max()
    # NumPy's determinants are exponentials of sums of logarithms, which are less accurate.
    assert determinant(matrix) == pytest.approx(exact_determinant(matrix), rel=8.0 * EPS * condition)
    # The residual of one side is that of a backward stable method.
    assert np.abs(found @ matrix - np.eye(3)).max() <= 8.0 * EPS * condition


def exact_determinant(matrix: np.ndarray) -> float:
    a, b, c = ([Fraction(x) for x in row] for row in matrix.tolist())
    minors = (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
    return float(sum(x * y for x, y in zip(a, minors, strict=True)))


def test_a_stack_has_the_bits_of_its_matrices() -> None:
    stack = np.stack([*HARD.values(), *RANDOM.normal(size=(100, 3, 3))])
    assert (inverse(stack) == [inverse(matrix) for matrix in stack]).all()
    assert (determinant(stack) == [determinant(matrix) for matrix in stack]).all()
    assert inverse(stack[:12].reshape(3, 4, 3, 3)).shape == (3, 4, 3, 3)
    affine = np.tile(np.eye(4), (len(stack), 1, 1))
    affine[:, :3, :3], affine[:, :3, 3] = stack, 1.0
    assert (inverse(affine)[:, :3, :3] == inverse(stack)).all()


def test_matrices_that_have_no_inverse_are_refused() -> None:
    for matrix in (np.zeros((3, 3)), np.diag([1.0, 0.0, 2.0]), np.outer([1.0, 2.0, 4.0], [1.0, 0.5, 0.25])):
        assert determinant(matrix) == 0.0
        with pytest.raises(np.linalg.LinAlgError):
            inverse(matrix)
        with pytest.raises(np.linalg.LinAlgError):
            inverse(np.stack([np.eye(3), matrix]))
        affine = np.eye(4)
        affine[:3, :3] = matrix
        with pytest.raises(InputError, match="the place is not invertible"):
            check_affine(affine, "the place")
    affine[:3, :3] = np.diag([1.0, 1.0, 1e-39])
    with pytest.raises(InputError, match="the place scales by over 1e38 or by under 1e-38"):
        check_affine(affine, "the place")


@pytest.mark.parametrize("name", HARD)
def test_polar_factors_are_a_rotation_and_a_stretch(name: str) -> None:
    matrix = HARD[name]
    rotation, stretch = polar(matrix)
    size = np.linalg.norm(matrix, 2)
    assert np.abs(rotation.T @ rotation - np.eye(3)).max() <= 16.0 * EPS
    assert np.abs(stretch - stretch.T).max() <= 2.0 * EPS * size
    assert np.abs(rotation @ stretch - matrix).max() <= 16.0 * EPS * size
    u, sizes, vt = np.linalg.svd(matrix)
    assert np.abs(stretch - vt.T @ np.diag(sizes) @ vt).max() <= 32.0 * EPS * size
    # The rotation is as sure as the two smallest singular values are large.
    assert np.abs(rotation - u @ vt).max() <= 64.0 * EPS * size / (sizes[1] + sizes[2])
    assert np.abs(singular_values(matrix) - sizes).max() <= 8.0 * EPS * size


def test_singular_values_of_a_stack_are_those_of_its_matrices() -> None:
    stack = RANDOM.normal(size=(50, 3, 3)) * [1.0, 10.0, 1e-3]
    assert np.allclose(singular_values(stack), np.linalg.svd(stack, compute_uv=False), rtol=1e-12)
    flat = stack[:, :, :2]
    assert np.allclose(singular_values(flat), np.linalg.svd(flat, compute_uv=False), rtol=1e-12)
    rotations, stretches = polar(stack)
    assert np.allclose(rotations @ stretches, stack, atol=1e-13)


def test_products_are_those_of_the_operator() -> None:
    a, b, stack = RANDOM.normal(size=(4, 4)), RANDOM.normal(size=(4, 4)), RANDOM.normal(size=(7, 5, 4))
    for left, right in (
        (a, b),
        (a[0], b),
        (a, b[0]),
        (a[0], b[0]),
        (stack, a),
        (stack, a[0]),
        (stack[:, :4], stack[:, :4]),
    ):
        found = product(left, right)
        assert found.shape == np.shape(left @ right)
        assert np.allclose(found, left @ right, rtol=0.0, atol=32.0 * EPS)
    assert product(a.astype(np.float32), b.astype(np.float32)).dtype == np.float32
    assert product([1, 2], [3, 4]) == dot([1, 2], [3, 4]) == 11
    assert norm([2.0, 3.0, 6.0]) == 7.0
    with pytest.raises(ValueError, match="broadcast"):
        product(a, b[:3])


@pytest.mark.parametrize("count", [1, 2, 3, 8, 24, 32, 64, 128])
def test_quadrature_is_exact_for_polynomials(count: int) -> None:
    nodes, weights = gauss_legendre(count)
    assert np.abs(nodes - np.polynomial.legendre.leggauss(count)[0]).max() <= 2.0 * EPS
    assert (np.diff(nodes) > 0.0).all()
    for power in range(0, 2 * count, max(1, count // 8)):
        exact = 2.0 / (power + 1) if power % 2 == 0 else 0.0
        assert abs((weights * nodes**power).sum() - exact) <= 32.0 * EPS
