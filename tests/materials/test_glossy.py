"""Gloss by a jittered mirror direction: what is drawn is a square, and its density is exact."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import Case, viewer
from support.kernels import uniforms
from support.statistics import chi_square_test

import wrt

COLOR = (0.9, 0.5, 0.0)
SQUARES = [(0.01, 45.0), (0.1, 0.0), (0.1, 89.0), (1.0, 45.0), (1.0, 80.0)]
"""Sides and degrees of incidence; the last but two and the last are cut by the horizon."""


def rounded(degrees: float) -> NDArray:
    return viewer(degrees).astype(np.float32).astype(np.float64)


def square_of(wo: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return the mirrored direction, and U and V of the square around it: V lies in the plane of incidence."""
    r = wo * np.array([-1.0, -1.0, 1.0])
    across = np.array([wo[1], -wo[0], 0.0]) if wo[0] or wo[1] else np.array([0.0, 1.0, 0.0])
    u = across / np.linalg.norm(across)
    return r, u, np.cross(r, u)


@pytest.mark.parametrize(("side", "degrees"), SQUARES)
def test_the_density_is_that_of_the_square(side: float, degrees: float, device: str, report: Report) -> None:
    """Per solid angle 1 / (a² cos³α), 0 outside; over the whole square it integrates to 1 less what is below."""
    wo = rounded(degrees)
    case = Case(wrt.Glossy(1.0, side))
    r, u, v = square_of(wo)
    node, weight = np.polynomial.legendre.leggauss(64)
    x, y = (a.ravel() for a in np.meshgrid(node, node, indexing="ij"))
    point = r + 0.5 * side * (x[:, None] * u + y[:, None] * v)
    distance = np.linalg.norm(point, axis=1)
    wi = point / distance[:, None]
    pdf = case.evaluate(wo, wi, device)[1]
    up = wi[:, 2] > 1e-6
    np.testing.assert_allclose(pdf[up], (distance**3 / side**2)[up], rtol=2e-6 / side + 1e-5)
    outside = r + 0.5 * side * (1.0 + 1e-5 / side) * np.array([u, v, -u, -v])
    outside /= np.linalg.norm(outside, axis=1)[:, None]
    assert not case.evaluate(wo, outside, device)[1].any()
    # dω = dA cosα / d² = dA / d³; the horizon is a step, so only squares that it does not cut come out exactly.
    total = float(np.sum(np.outer(weight, weight).ravel() * pdf * (0.5 * side) ** 2 / distance**3))
    report(f"a = {side}, {degrees:g}°: integral", total, 1.0)
    assert total <= 1.0 + 2e-6 / side + 1e-5
    if up.all():
        assert total == pytest.approx(1.0, abs=2e-6 / side + 1e-5)


@pytest.mark.parametrize("degrees", [0.0, 80.0])
@pytest.mark.parametrize("exponent", [1.0, 20.0, 5000.0])
def test_density_of_phong_is_its_formula(exponent: float, degrees: float, device: str) -> None:
    """(n + 1) / 2π cosⁿα; cosⁿ⁺¹α of samples is uniform where the horizon cuts nothing off."""
    wo = rounded(degrees)
    case = Case(wrt.Glossy(COLOR, exponent=exponent))
    found = case.sample(wo, uniforms(2**17, 3, seed=45 + int(degrees)), device)
    up = found["weight"][:, 0] > 0.0
    np.testing.assert_array_equal(found["weight"][up], np.broadcast_to(np.float32(COLOR), (up.sum(), 3)))
    wi = found["wi"][up].astype(np.float64)
    one_minus_cosine = 0.5 * ((wi - square_of(wo)[0]) ** 2).sum(axis=1)
    expected = (exponent + 1.0) / (2.0 * np.pi) * np.exp(exponent * np.log1p(-one_minus_cosine))
    np.testing.assert_allclose(case.evaluate(wo, wi, device)[1], expected, rtol=1e-3)
    np.testing.assert_allclose(found["pdf"][up], expected, rtol=1e-3)
    if degrees == 0.0 or exponent == 5000.0:
        counts = np.histogram(np.exp((exponent + 1.0) * np.log1p(-one_minus_cosine)), bins=100, range=(0.0, 1.0))[0]
        assert chi_square_test(counts, np.full(100, len(wi) / 100), tests=4).passed
