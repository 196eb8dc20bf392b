"""Mirrors, smooth metals, clear boundaries and panes: directions, shares and colours of what they send on."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import ANGLES, EPS, Case, hemisphere, viewer
from support.fresnel import complex_fresnel, cook_torrance, schlick
from support.kernels import uniforms

import wrt

RED, BLUE = (0.9, 0.1, 0.0), (0.0, 0.2, 0.8)
F0 = (0.9, 0.5, 0.1)
MIRRORS = {
    "mirror": (wrt.Mirror(RED), lambda cos: np.broadcast_to(RED, (len(cos), 3))),
    "copper": (wrt.Conductor(), lambda cos: complex_fresnel(cos, wrt.Conductor().eta, wrt.Conductor().k)),
    "by its colour": (wrt.Conductor(f0=F0), lambda cos: schlick(cos, F0)),
}


@pytest.mark.parametrize("name", MIRRORS)
def test_mirrors_reflect(name: str, device: str) -> None:
    material, reflectance = MIRRORS[name]
    wo = np.concatenate([[viewer(a) for a in (*ANGLES, 89.99)], hemisphere(10_000, seed=11)]).astype(np.float32)
    found = Case(material).sample(wo, uniforms(len(wo), 3, seed=12), device)
    np.testing.assert_array_equal(found["wi"], wo * np.array([-1, -1, 1], np.float32))
    assert (found["eta"] == 1.0).all()
    np.testing.assert_allclose(found["weight"], reflectance(wo[:, 2:].astype(np.float64)), atol=32.0 * EPS)


BUBBLE = wrt.Dielectric(1.0, exterior_ior=1.33)
DIELECTRICS = {
    "glass from outside": Case(wrt.Dielectric(1.5)),
    "glass from inside": Case(wrt.Dielectric(1.5), front=False),
    "bubble from outside": Case(BUBBLE),
    "bubble from inside": Case(BUBBLE, front=False),
    "diamond from inside": Case(wrt.Dielectric(2.42), front=False),
}


def relative_ior(case: Case) -> float:
    """Return n_t / n_i of a dielectric, as float32 holds it."""
    assert isinstance(case.material, wrt.Dielectric)
    eta = float(np.float32(case.material.relative_ior))
    return eta if case.front else 1.0 / eta


def dielectric_samples(name: str, device: str) -> tuple[NDArray, NDArray, NDArray]:
    """Return viewers of all angles, the number that chooses the lobe, and the samples."""
    angles = np.concatenate([np.linspace(0.0, 89.9, 20_000), np.repeat(ANGLES, 100)])
    wo = np.stack([viewer(a, azimuth) for azimuth, a in enumerate(angles)]).astype(np.float32)
    u = uniforms(len(wo), 3, seed=13)
    return wo.astype(np.float64), u[:, 2].astype(np.float64), DIELECTRICS[name].sample(wo, u, device)


@pytest.mark.parametrize("name", DIELECTRICS)
def test_refraction_obeys_snell_and_lobes_are_chosen_by_fresnel(name: str, device: str, report: Report) -> None:
    eta = relative_ior(DIELECTRICS[name])
    wo, u_lobe, found = dielectric_samples(name, device)
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
    # Within float32's reach of the limit either lobe is right; at the critical angle that reach is wider.
    reflectance = cook_torrance(wo[:, 2], eta)
    close = np.abs(u_lobe - reflectance) < 1e-4
    assert close.mean() < 0.01
    np.testing.assert_array_equal(~through[~close], (u_lobe < reflectance)[~close])


@pytest.mark.parametrize("make", [wrt.Dielectric, wrt.ThinDielectric, wrt.RoughDielectric])
def test_tints_multiply_each_way(make: type, device: str) -> None:
    wo, u = hemisphere(10_000, seed=7), uniforms(10_000, 3, seed=8)
    plain = Case(make()).sample(wo, u, device)
    tinted = Case(make(specular_reflectance=RED, specular_transmittance=BLUE)).sample(wo, u, device)
    np.testing.assert_array_equal(tinted["wi"], plain["wi"])
    tint = np.where(tinted["wi"][:, 2:] > 0.0, RED, BLUE)
    np.testing.assert_allclose(tinted["weight"], plain["weight"] * tint, rtol=1e-6)
