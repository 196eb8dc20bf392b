"""Fresnel reflectance against the same law written in other ways, in double precision; and what lets light in by it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import EPS, Case, viewer
from support.fresnel import by_angles, complex_fresnel, cook_torrance, diffuse_reflectance, schlick
from support.kernels import map_function

import wrt
from wrt.kernels.bsdf.lobes.fresnel import (
    fresnel_conductor,
    fresnel_conductor_channel,
    fresnel_dielectric,
    fresnel_schlick,
)
from wrt.scene.materials.dielectrics import mean_transmittance
from wrt.scene.materials.metals import average_reflectance
from wrt.scene.materials.plastics import internal_reflectance

ROUNDINGS = 32.0 * EPS
"""Error of a reflectance after some twenty operations in float32."""


def grid(*axes: NDArray) -> list[NDArray]:
    """Return all combinations as flat arrays, rounded to float32 so that both sides see the same numbers."""
    return [a.ravel().astype(np.float32).astype(np.float64) for a in np.meshgrid(*axes, indexing="ij")]


def spread(at: Callable[[NDArray], NDArray], argument: NDArray, error: NDArray) -> NDArray:
    """Return how far a function moves when its argument is off by `error`, either way."""
    middle = at(argument)
    return np.maximum(np.abs(at(argument + error) - middle), np.abs(at(argument - error) - middle))


COSINES = np.concatenate([np.linspace(0.001, 1.0, 500), np.cos(np.radians([45.0, 60.0, 80.0, 89.0, 89.9]))])
INDICES = np.concatenate([np.linspace(0.3, 0.98, 60), np.linspace(1.02, 4.0, 120)])


def test_dielectric_forms_agree(device: str, report: Report) -> None:
    """F_s and F_p, as the kernel has them, and the form in g and c.

    To 1e-6, but that reflectance has a vertical tangent at the critical angle: to what it moves by there when
    cos²θt = 1 − sin²θi / η² is off by two roundings of its terms.
    """
    cos_i, eta = grid(COSINES, INDICES)
    found = map_function(fresnel_dielectric, cos_i, eta, device=device).astype(np.float64)
    sin2_t = (1.0 - cos_i**2) / eta**2

    def reflectance(sin2_t: NDArray) -> NDArray:
        cos_t = np.sqrt(np.maximum(1.0 - sin2_t, 0.0))
        r_s, r_p = (cos_i - eta * cos_t) / (cos_i + eta * cos_t), (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
        return 0.5 * (r_s**2 + r_p**2)

    error = np.abs(found - cook_torrance(cos_i, eta))
    allowed = spread(reflectance, sin2_t, 2.0 * EPS * np.maximum(1.0, sin2_t))
    regular = allowed < 5e-7
    assert regular.mean() > 0.95
    report("largest difference", float(error[regular].max()), 0.0)
    report("largest difference near the critical angle", float(error[~regular].max()), 0.0)
    assert error[regular].max() < 1e-6
    assert (error < 1e-6 + allowed).all()
    assert found.min() >= 0.0
    assert found.max() <= 1.0 + EPS
    total = sin2_t > 1.0 + 4.0 * EPS
    assert total.any()
    assert (found[total] == 1.0).all()


def test_conductor_is_the_complex_law(device: str, report: Report) -> None:
    """But where light just begins to be reflected in total, by an index that absorbs little. Channels do not mix."""
    cos_i, eta, k = grid(COSINES, np.array([0.04, 0.2, 0.9, 1.1, 1.5, 3.0, 6.0]), np.array([0.0, 0.1, 1.0, 2.5, 7.0]))
    found = map_function(fresnel_conductor_channel, cos_i, eta, k, device=device).astype(np.float64)
    error = np.abs(found - complex_fresnel(cos_i, eta, k))
    root = np.sqrt((eta + 1j * k) ** 2 - (1.0 - cos_i**2) + 0j)
    steep = (k < 1.0) & (root.real < 0.15)
    report("largest difference", float(error[~steep].max()), 0.0)
    report("largest difference where it is steep", float(error[steep].max()), 0.0)
    assert error[~steep].max() < ROUNDINGS
    assert error.max() < 1e-3
    assert steep.mean() < 0.15
    assert found.min() >= 0.0
    assert found.max() <= 1.0 + ROUNDINGS
    index = np.array([[0.2, 0.924, 1.102]]), np.array([[3.912, 2.452, 2.142]])
    three = map_function(fresnel_conductor, np.array([0.3]), *index, device=device)
    np.testing.assert_allclose(three, complex_fresnel(np.array([[0.3]]), *index), atol=ROUNDINGS)


def test_metals_reflect_as_tabulated(device: str) -> None:
    """Silver, gold, copper, aluminium at 589.3 nm: Born and Wolf, "Principles of Optics", 7th edition, table 14.1."""
    eta, k = np.array([0.20, 0.47, 0.62, 1.44]), np.array([3.44, 2.83, 2.57, 5.23])
    found = map_function(fresnel_conductor_channel, np.ones(4), eta, k, device=device)
    np.testing.assert_allclose(found, [0.94, 0.82, 0.73, 0.83], atol=0.005)


def test_schlicks_error_for_dielectrics(device: str, report: Report) -> None:
    """Against the exact law: largest near 85°, least for indices around 1.6, and everywhere bounded."""
    cos_i = np.linspace(0.0, 1.0, 2001)
    for eta, bound in ((1.33, 0.07), (1.5, 0.04), (1.6, 0.035), (1.8, 0.035), (2.4, 0.08)):
        f0 = np.full((len(cos_i), 3), ((eta - 1.0) / (eta + 1.0)) ** 2)
        found = map_function(fresnel_schlick, cos_i, f0, device=device)[:, 0].astype(np.float64)
        error = np.abs(found - cook_torrance(cos_i, eta))
        report(f"index {eta}: largest error", float(error.max()), f"< {bound}")
        report(f"index {eta}: where, degrees", float(np.degrees(np.arccos(cos_i[error.argmax()]))))
        assert 0.5 * bound < error.max() < bound
        assert error[cos_i > np.cos(np.radians(60.0))].max() < 0.03


@pytest.mark.parametrize("ior", [1.0 / 1.5, 1.33, 2.42])
@pytest.mark.parametrize("front", [True, False])
def test_a_dielectric_by_schlick_is_the_shader_of_the_lecture(front: bool, ior: float, device: str) -> None:
    """Source 002, "Shader for Transparent Objects": R0 = (n − 1)² / (n + 1)², R = R0 + (1 − R0)(1 − c)⁵.

    c is the cosine in the air: of the incident ray, and from inside of the refracted one; without that R is 1.
    """
    case = Case(wrt.Dielectric(ior, fresnel="schlick", specular_transmittance=0.5), front=front)
    eta = ior if front else 1.0 / ior
    for degrees in (0.0, 20.0, 40.0, 55.0, 75.0, 89.0):
        wo = viewer(degrees).astype(np.float32).astype(np.float64)
        cos2_t = 1.0 - (1.0 - wo[2] ** 2) / eta**2
        c = wo[2] if eta > 1.0 else np.sqrt(max(cos2_t, 0.0))
        expected = 1.0 if cos2_t <= 0.0 else float(schlick(c, ((ior - 1.0) / (ior + 1.0)) ** 2))
        below, above = max(expected - 2e-5, 0.0), min(expected + 2e-5, 1.0 - EPS)
        found = case.sample(wo, np.array([[0.5, 0.5, below], [0.5, 0.5, above]]), device)
        assert found["wi"][0][2] > 0.0
        np.testing.assert_allclose(found["weight"][0], 1.0)
        if expected < 1.0 - 3e-5:
            assert found["wi"][1][2] < 0.0
            np.testing.assert_allclose(found["weight"][1], 0.5 / eta**2, rtol=1e-5)
            np.testing.assert_allclose(found["wi"][1][:2], -wo[:2] / eta, atol=1e-6)


# --- Means over the hemisphere ------------------------------------------------------------------------


@pytest.mark.parametrize("eta", [1.0001, 1.1, 1.33, 1.5, 2.42, 5.0])
def test_mean_reflectances_have_their_closed_form(eta: float) -> None:
    """From inside by 1 − R = (1 − R_outside) / η² (Stokes); of a metal without absorption as of the dielectric."""
    outside = diffuse_reflectance(eta)
    assert internal_reflectance(eta) == pytest.approx(1.0 - (1.0 - outside) / eta**2, abs=1e-8)
    assert internal_reflectance(1.0 / eta) == pytest.approx(outside, abs=1e-8)
    # One that has no step at grazing angles, where its integrand is steep.
    assert average_reflectance((1.5,) * 3, (0.0,) * 3)[0] == pytest.approx(diffuse_reflectance(1.5), abs=1e-6)
    mu = (np.arange(400_000) + 0.5) / 400_000
    for n in (eta, 1.0 / eta):
        np.testing.assert_allclose(mean_transmittance(n), np.mean(2.0 * mu * (1.0 - by_angles(mu, n))), atol=2e-5)
