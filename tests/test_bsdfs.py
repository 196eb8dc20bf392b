"""Every reflection model: what it samples is what it evaluates, and no energy is made."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from support.bsdfs import ANGLES, EPS, Case, albedo, assert_weights, chi_square, hemisphere, reciprocity_error, viewer
from support.kernels import uniforms
from support.statistics import sidak
from test_fresnel import complex_fresnel, cook_torrance

import wrt
from wrt.kernels.bsdf import make_bsdf
from wrt.kernels.bsdf.record import Bsdf

N = 2**20

BUBBLE = wrt.Dielectric(1.0, exterior_ior=1.33)
CASES = {
    "diffuse": Case(wrt.Diffuse((0.8, 0.5, 0.0))),
    "diffuse, back": Case(wrt.Diffuse(1.0), front=False),
    "mirror": Case(wrt.Mirror((0.9, 0.5, 0.0))),
    "copper": Case(wrt.Conductor((0.200, 0.924, 1.102), (3.912, 2.452, 2.142))),
    "glass from outside": Case(wrt.Dielectric(1.5)),
    "glass from inside": Case(wrt.Dielectric(1.5), front=False),
    "bubble from outside": Case(BUBBLE),
    "bubble from inside": Case(BUBBLE, front=False),
    "diamond from inside": Case(wrt.Dielectric(2.42), front=False),
}
SMOOTH = [name for name, case in CASES.items() if not case.model.delta]
DELTA = [name for name, case in CASES.items() if case.model.delta]
DIELECTRIC = [name for name, case in CASES.items() if isinstance(case.material, wrt.Dielectric)]


def relative_ior(case: Case) -> float:
    """Return n_t / n_i of a dielectric, as float32 holds it."""
    assert isinstance(case.material, wrt.Dielectric)
    eta = float(np.float32(case.material.relative_ior))
    return eta if case.front else 1.0 / eta


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", SMOOTH)
def test_samples_follow_the_density(name: str, degrees: float, device: str, report: Report) -> None:
    result = chi_square(CASES[name], degrees, device, tests=len(SMOOTH) * len(ANGLES), samples=N)
    report(f"{name} at {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", SMOOTH)
def test_weight_is_value_over_density(name: str, degrees: float, device: str) -> None:
    assert_weights(CASES[name], degrees, device, rtol=1e-5)


@pytest.mark.parametrize("name", SMOOTH)
def test_reciprocity(name: str, device: str) -> None:
    """f(wo, wi) = f(wi, wo), where `evaluate` has the cosine of its second direction in it."""
    assert reciprocity_error(CASES[name], device) < 1e-5


@pytest.mark.parametrize("name", SMOOTH)
def test_nothing_goes_through_a_reflector(name: str, device: str) -> None:
    below = hemisphere(10_000, seed=4) * np.array([1.0, 1.0, -1.0])
    value, pdf, _ = CASES[name].evaluate(viewer(30.0), below, device)
    assert (value == 0.0).all()
    assert (pdf == 0.0).all()


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", CASES)
def test_no_energy_is_made(name: str, degrees: float, device: str, report: Report) -> None:
    """The mean weight is the albedo. Refraction squeezes light into another solid angle: that is not energy."""
    mean, error = albedo(CASES[name], degrees, device, samples=N)
    report(f"{name} at {degrees:g}°: largest albedo", float(mean.max()), "<= 1")
    assert (mean <= 1.0 + 3.0 * error + 4.0 * EPS).all()


def test_albedos_are_the_stated_ones(device: str) -> None:
    for name in SMOOTH + ["mirror"]:
        case = CASES[name]
        found = case.sample(viewer(60.0), uniforms(N, 3, seed=6), device)
        weight = found["weight"].astype(np.float64)
        error = weight.std(axis=0, ddof=1) / np.sqrt(N)
        assert (np.abs(weight.mean(axis=0) - case.material.reflectance) <= 3.5 * error + 1e-6).all(), name


@pytest.mark.parametrize("name", DELTA)
def test_deltas_have_no_value_for_chosen_directions(name: str, device: str) -> None:
    case = CASES[name]
    wo = hemisphere(10_000, seed=7)
    wi = np.concatenate([hemisphere(5_000, seed=8), -hemisphere(5_000, seed=9)])
    wi[::3] = (wo * np.array([-1.0, -1.0, 1.0]))[::3]
    value, pdf, delta = case.evaluate(wo, wi, device)
    assert (value == 0.0).all()
    assert (pdf == 0.0).all()
    assert delta.all()
    found = case.sample(wo, uniforms(10_000, 3, seed=10), device)
    assert found["delta"].all()
    assert (found["pdf"] == 0.0).all()


@pytest.mark.parametrize("name", ["mirror", "copper"])
def test_mirrors_reflect(name: str, device: str) -> None:
    case = CASES[name]
    wo = np.concatenate([[viewer(a) for a in ANGLES], hemisphere(10_000, seed=11)]).astype(np.float32)
    found = case.sample(wo, uniforms(len(wo), 3, seed=12), device)
    np.testing.assert_array_equal(found["wi"], wo * np.array([-1, -1, 1], np.float32))
    assert (found["eta"] == 1.0).all()
    if isinstance(case.material, wrt.Conductor):
        eta, k = np.array(case.material.eta), np.array(case.material.k)
        expected = complex_fresnel(wo[:, 2:].astype(np.float64), eta, k)
    else:
        expected = np.broadcast_to(case.material.slots[0], wo.shape)
    np.testing.assert_allclose(found["weight"], expected, atol=32.0 * EPS)


def dielectric_samples(name: str, device: str) -> tuple[NDArray, NDArray, NDArray]:
    """Return viewers of all angles, the number that chooses the lobe, and the samples."""
    angles = np.concatenate([np.linspace(0.0, 89.9, 20_000), np.repeat(ANGLES, 100)])
    wo = np.stack([viewer(a, azimuth) for azimuth, a in enumerate(angles)]).astype(np.float32)
    u = uniforms(len(wo), 3, seed=13)
    return wo.astype(np.float64), u[:, 2].astype(np.float64), CASES[name].sample(wo, u, device)


@pytest.mark.parametrize("name", DIELECTRIC)
def test_refraction_obeys_snell(name: str, device: str, report: Report) -> None:
    eta = relative_ior(CASES[name])
    wo, _, found = dielectric_samples(name, device)
    wi = found["wi"].astype(np.float64)
    through = wi[:, 2] < 0.0
    assert 0.05 < through.mean() < 1.0
    # Reflected: exactly the mirrored direction.
    np.testing.assert_array_equal(wi[~through], wo[~through] * np.array([-1.0, -1.0, 1.0]))
    assert (found["eta"][~through] == 1.0).all()
    assert (found["weight"][~through] == 1.0).all()
    # n_i sinθi = n_t sinθt, in the plane of incidence, on the other side of the normal.
    np.testing.assert_allclose(wi[through, :2], -wo[through, :2] / eta, atol=2.0 * EPS)
    # cos²θt is good to two roundings; cosθt to that over twice itself.
    cos2_t = np.maximum(1.0 - (1.0 - wo[through, 2] ** 2) / eta**2, 0.0)
    error = np.abs(wi[through, 2] ** 2 - cos2_t)
    report(f"{name}: largest error of cos²θt", float(error.max()), 0.0)
    assert (error < 4.0 * EPS * max(1.0, 1.0 / eta**2)).all()
    np.testing.assert_allclose(found["eta"][through], eta, rtol=2.0 * EPS)
    # Radiance scales with (n_i / n_t)².
    np.testing.assert_allclose(found["weight"][through], 1.0 / eta**2, rtol=8.0 * EPS)


@pytest.mark.parametrize("name", DIELECTRIC)
def test_lobes_are_chosen_by_fresnel(name: str, device: str) -> None:
    eta = relative_ior(CASES[name])
    wo, u_lobe, found = dielectric_samples(name, device)
    reflected = found["wi"][:, 2] > 0.0
    reflectance = cook_torrance(wo[:, 2], np.full(len(wo), eta))
    # Within float32's reach of the limit either is right; at the critical angle that reach is wider.
    close = np.abs(u_lobe - reflectance) < 1e-4
    assert close.mean() < 0.01
    np.testing.assert_array_equal(reflected[~close], (u_lobe < reflectance)[~close])


@pytest.mark.parametrize("name", DIELECTRIC)
def test_share_of_reflected_light(name: str, device: str, report: Report) -> None:
    eta = relative_ior(CASES[name])
    critical = np.degrees(np.arcsin(eta)) if eta < 1.0 else 90.0
    angles = [a for a in (*ANGLES, 0.5 * critical, 0.99 * critical) if abs(a - critical) > 0.01]
    n = 2**18
    for degrees in angles:
        wo = viewer(degrees).astype(np.float32)
        found = CASES[name].sample(wo, uniforms(n, 3, seed=14), device)
        reflected = int((found["wi"][:, 2] > 0.0).sum())
        expected = float(cook_torrance(np.array([wo[2]], np.float64), np.array([eta]))[0])
        if degrees > critical:
            assert reflected == n
            continue
        p = stats.binomtest(reflected, n, expected).pvalue
        report(f"{name} at {degrees:.1f}°: reflected", reflected / n, expected, p=float(p))
        assert p > sidak(0.01, len(angles) * len(DIELECTRIC))


def test_a_model_that_the_kernel_lacks_is_black(device: str) -> None:
    evaluate, pdf, _, is_delta, _ = make_bsdf(("mirror",))

    @wp.kernel(enable_backward=False, module="unique")
    def ask(bsdf: Bsdf, wo: wp.vec3, out: wp.array(dtype=float)):
        out[0] = wp.max(evaluate(bsdf, wo, wo)) + pdf(bsdf, wo, wo)
        out[1] = float(is_delta(bsdf))

    out = wp.full(2, -1.0, dtype=float, device=device)
    wp.launch(ask, 1, [CASES["diffuse"].record(device), wp.vec3(0.0, 0.0, 1.0)], [out], device=device)
    assert out.numpy().tolist() == [0.0, 1.0]
