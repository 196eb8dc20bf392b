"""Gloss by a jittered mirror direction: what is drawn is a square, and its density is exact."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import ANGLES, EPS, Case, albedo, assert_finite, assert_weights, hemisphere, viewer
from support.kernels import uniforms
from support.statistics import chi_square_test

import wrt

COLOR = (0.9, 0.5, 0.0)
SIDES = (0.01, 0.1, 1.0)


def square_of(wo: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return the mirrored direction, and U and V of the square around it: V lies in the plane of incidence."""
    r = wo * np.array([-1.0, -1.0, 1.0])
    across = np.array([wo[1], -wo[0], 0.0]) if wo[0] or wo[1] else np.array([0.0, 1.0, 0.0])
    u = across / np.linalg.norm(across)
    return r, u, np.cross(r, u)


def in_square(wo: NDArray, wi: NDArray) -> NDArray:
    """Return (N, 2) where directions meet the plane of the square."""
    r, u, v = square_of(wo)
    return np.stack([wi @ u, wi @ v], axis=1) / (wi @ r)[:, None]


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("side", SIDES)
def test_directions_fill_the_square_evenly(side: float, degrees: float, device: str, report: Report) -> None:
    """The lecture's own words: r' = r + u U + v V with u and v uniform in ±a/2; what falls below is absorbed."""
    n = 2**19
    wo = viewer(degrees).astype(np.float32).astype(np.float64)
    found = Case(wrt.Glossy(1.0, side)).sample(wo, uniforms(n, 3, seed=40 + int(degrees)), device)
    up = found["weight"][:, 0] > 0.0
    place = in_square(wo, found["wi"][up].astype(np.float64)) / side
    assert np.abs(place).max() <= 0.5 + 1e-6 / side
    cells = 31
    # Rounding may take one just over the edge.
    counts = np.histogram2d(*np.clip(place, -0.5, 0.5).T, bins=cells, range=[[-0.5, 0.5]] * 2)[0]
    # The share of each cell above the horizon, which cuts it along a line of constant v.
    r, _, v = square_of(wo)
    edges = np.linspace(-0.5, 0.5, cells + 1)
    horizon = -r[2] / (side * v[2]) if v[2] != 0.0 else -np.inf if v[2] >= 0.0 else np.inf
    low, high = edges[:-1], edges[1:]
    above = np.clip((high - horizon) * cells, 0.0, 1.0) if v[2] >= 0.0 else np.clip((horizon - low) * cells, 0.0, 1.0)
    expected = np.broadcast_to(above, (cells, cells)) * (n / cells**2)
    result = chi_square_test(counts, expected, tests=len(SIDES) * len(ANGLES), samples=n)
    report(f"a = {side}, {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("side", SIDES)
def test_the_density_is_that_of_the_square(side: float, degrees: float, device: str, report: Report) -> None:
    """Per solid angle 1 / (a² cos³α), 0 outside; over the whole square it integrates to 1 less what is below."""
    wo = viewer(degrees).astype(np.float32).astype(np.float64)
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
    assert (case.evaluate(wo, outside, device)[1] == 0.0).all()
    # dω = dA cosα / d² = dA / d³; the horizon is a step, so only squares that it does not cut come out exactly.
    total = float(np.sum(np.outer(weight, weight).ravel() * pdf * (0.5 * side) ** 2 / distance**3))
    report(f"a = {side}, {degrees:g}°: integral", total, 1.0)
    assert total <= 1.0 + 2e-6 / side + 1e-5
    if up.all():
        assert total == pytest.approx(1.0, abs=2e-6 / side + 1e-5)


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("exponent", [1.0, 20.0, 5000.0])
def test_directions_follow_the_lobe_of_phong(exponent: float, degrees: float, device: str, report: Report) -> None:
    """(n + 1) / 2π cosⁿα in double precision; of each ring around the mirrored ray the share above the horizon."""
    n = 2**18
    wo = viewer(degrees).astype(np.float32).astype(np.float64)
    case = Case(wrt.Glossy(COLOR, exponent=exponent))
    r, u, v = square_of(wo)
    found = case.sample(wo, uniforms(n, 3, seed=45 + int(degrees)), device)
    up = found["weight"][:, 0] > 0.0
    np.testing.assert_array_equal(found["weight"][up], np.broadcast_to(np.float32(COLOR), (up.sum(), 3)))
    wi = found["wi"][up].astype(np.float64)
    less = 0.5 * ((wi - r) ** 2).sum(axis=1)
    expected = (exponent + 1.0) / (2.0 * np.pi) * np.exp(exponent * np.log1p(-less))
    np.testing.assert_allclose(case.evaluate(wo, wi, device)[1], expected, rtol=1e-3)
    np.testing.assert_allclose(found["pdf"][up], expected, rtol=1e-3)
    # Rings and sectors of equal probability: cosⁿ⁺¹α is uniform. Points on a fine grid tell what is above the horizon.
    rings, sectors, fine = 24, 15, 64
    y = (np.arange(rings * fine) + 0.5) / (rings * fine)
    phi = (np.arange(sectors * fine) + 0.5) / (sectors * fine) * 2.0 * np.pi - np.pi
    cos_a = y ** (1.0 / (exponent + 1.0))
    sin_a = np.sqrt(-np.expm1(2.0 * np.log(y) / (exponent + 1.0)))
    height = cos_a[:, None] * r[2] + sin_a[:, None] * (np.cos(phi) * u[2] + np.sin(phi) * v[2])
    above = (height > 0.0).reshape(rings, fine, sectors, fine).mean(axis=(1, 3))
    places = np.stack([np.exp((exponent + 1.0) * np.log1p(-less)), np.arctan2(wi @ v, wi @ u)])
    counts = np.histogram2d(*places, bins=(rings, sectors), range=[[0.0, 1.0], [-np.pi, np.pi]])[0]
    result = chi_square_test(counts, above * (n / above.size), tests=12, samples=n)
    report(f"n = {exponent:g}, {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("side", SIDES)
def test_weight_is_the_reflectance(side: float, degrees: float, device: str) -> None:
    case = Case(wrt.Glossy(COLOR, side), front=degrees < 60.0)
    assert_weights(case, degrees, device)
    found = case.sample(viewer(degrees), uniforms(10_000, 3, seed=41), device)
    up = found["wi"][:, 2] > 0.0
    np.testing.assert_array_equal(found["weight"][up], np.broadcast_to(np.float32(COLOR), (up.sum(), 3)))
    assert (found["weight"][~up] == 0.0).all()
    assert (found["pdf"][~up] == 0.0).all()


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("side", [1e-4, *SIDES])
def test_no_energy_is_made(side: float, degrees: float, device: str) -> None:
    mean, error = albedo(Case(wrt.Glossy(1.0, side)), degrees, device, samples=2**17)
    assert (mean <= 1.0 + 3.0 * error + 4.0 * EPS).all()
    if 0.5 * side * np.sin(np.radians(degrees)) < np.cos(np.radians(degrees)):
        assert (mean == 1.0).all()


def test_it_is_not_reciprocal(device: str, report: Report) -> None:
    """f(wo, wi) cosθi and f(wi, wo) cosθo are equal inside both squares, so f itself is off by the cosines."""
    case = Case(wrt.Glossy(1.0, 0.2))
    wo = hemisphere(2000, seed=42)
    wi = case.sample(wo, uniforms(len(wo), 3, seed=43), device)["wi"].astype(np.float64)
    there, back = case.evaluate(wo, wi, device)[0][:, 0], case.evaluate(wi, wo, device)[0][:, 0]
    both = (there > 0.0) & (back > 0.0)
    assert both.mean() > 0.9
    np.testing.assert_allclose(there[both], back[both], rtol=1e-5)
    ratio = (there[both] / wi[both, 2]) / (back[both] / wo[both, 2])
    np.testing.assert_allclose(ratio, wo[both, 2] / wi[both, 2], rtol=1e-5)
    report("largest f(wo, wi) / f(wi, wo)", float(ratio.max()), "1 were it reciprocal")
    assert ratio.max() > 1.5


def test_it_looks_the_same_when_turned(device: str) -> None:
    """The square follows the plane of incidence, so the surface has no direction of its own."""
    case = Case(wrt.Glossy(1.0, 0.3))
    u = uniforms(1000, 3, seed=44)
    first = case.sample(viewer(50.0, 0.0), u, device)["wi"]
    for azimuth in (1.0, 2.5, -2.0):
        c, s = np.cos(azimuth), np.sin(azimuth)
        turned = first @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        np.testing.assert_allclose(case.sample(viewer(50.0, azimuth), u, device)["wi"], turned, atol=1e-6)


@pytest.mark.parametrize("reflectance", [0.0, 1.0])
@pytest.mark.parametrize("side", [1e-12, 1e-4, 1.0, 100.0])
def test_everything_is_finite(side: float, reflectance: float, device: str) -> None:
    assert_finite(Case(wrt.Glossy(reflectance, side)), device)


@pytest.mark.parametrize(
    "bad", [{"side": 0.0}, {"side": -1.0}, {"side": 101.0}, {"reflectance": 2.0}, {"exponent": -1.0}]
)
def test_impossible_values_are_refused(bad: dict) -> None:
    with pytest.raises(wrt.InputError, match=next(iter(bad))):
        wrt.Glossy(**bad)


@pytest.mark.slow
def test_all_estimators_find_the_same_blur(device: str) -> None:
    """A lamp in a blurred mirror, by light sampling, by the BSDF and by both."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(0.0, 1.0, 2.0), target=(0.0, 0.0, 0.0), fov_degrees=40))
    scene.add(wrt.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), material=wrt.Glossy(0.8, 0.3))
    scene.add(wrt.quad((-0.3, 0.6, -2.0), (0.6, 0, 0), (0, 0.6, 0)), emission=1.0)
    means, errors = [], []
    for strategy in ("mis", "light", "bsdf"):
        renderer = wrt.Renderer(
            scene, sampler="independent", width=24, height=24, seed=3, strategy=strategy, device=device
        )
        for _ in renderer.passes(spp=256):
            pass
        means.append(float(renderer.image()[..., 0].astype(np.float64).mean()))
        errors.append(float(np.sqrt(renderer.variance()[..., 0].sum())) / 24**2)
    assert max(errors) < 0.02 * min(means)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert abs(means[i] - means[j]) < 4.0 * np.hypot(errors[i], errors[j])


@pytest.mark.parametrize("exponent", [0.0, 1.0, 1e5])
def test_everything_is_finite_for_phong(exponent: float, device: str) -> None:
    assert_finite(Case(wrt.Glossy(1.0, exponent=exponent)), device)


def test_a_lobe_is_a_square_or_that_of_phong() -> None:
    assert wrt.Glossy().side == 0.1
    with pytest.raises(wrt.InputError, match="side or by exponent"):
        wrt.Glossy(side=0.1, exponent=10.0)
