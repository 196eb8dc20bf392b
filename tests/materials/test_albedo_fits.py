"""Albedos of layers in closed form, which nothing below may exceed, against quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Report
from support import albedo_quadrature as quadrature
from support import principled_reference as reference
from support.bsdfs import viewer
from support.kernels import map_function

from wrt.kernels.bsdf.lobes import albedo_fits


def test_quadrature_is_right(report: Report) -> None:
    """That over visible normals against one over directions, where the lobe is wide."""
    x, w = np.polynomial.legendre.leggauss(200)
    cos, phi = np.meshgrid(0.5 * (x + 1.0), np.pi * (x + 1.0), indexing="ij")
    weights = np.outer(0.5 * w, np.pi * w).ravel()
    sine = np.sqrt(1.0 - cos**2)
    wi = np.stack([sine * np.cos(phi), sine * np.sin(phi), cos], axis=-1).reshape(-1, 3)
    for degrees in (0.0, 45.0, 80.0):
        wo = np.broadcast_to(viewer(degrees), wi.shape)
        for alpha in (0.3, 1.0):
            value = reference.facets(wo, wi, (alpha, alpha)) * wi[:, 2] * weights
            found = quadrature.specular_albedos(math.cos(math.radians(degrees)), alpha)
            grazing = (1.0 - reference.dot(wo, reference.unit(wo + wi))) ** 5
            np.testing.assert_allclose(found, (value.sum(), (value * grazing).sum()), atol=3e-4)
        expected = (reference.charlie(wo, wi, 0.6) * wi[:, 2] * weights).sum()
        found = quadrature.sheen_albedo(math.cos(math.radians(degrees)), 0.6)
        report(f"sheen at {degrees:g}°", found, expected)
        assert found == pytest.approx(expected, abs=1e-3)


@pytest.mark.slow
def test_fits_are_above_the_albedos(device: str, report: Report) -> None:
    rng = np.random.default_rng(40)
    n = 80
    mu = (rng.random(n) ** 2 + 1e-5).clip(max=1.0)
    alpha = 10.0 ** rng.uniform(-4.0, 0.0, n)
    expected = np.array([quadrature.specular_albedos(x, a, 96) for x, a in zip(mu, alpha, strict=True)])
    excess = map_function(albedo_fits.specular_albedo, mu, alpha, device=device) - expected
    for name, values, most in (("W", excess[:, 0], 0.004), ("G", excess[:, 1], 0.009)):
        report(f"{name}: least and most above", float(values.min()), float(values.max()))
        assert values.min() > -2e-4
        assert values.max() < most
    roughness = rng.uniform(0.07, 1.0, n)
    expected = np.array([quadrature.sheen_albedo(x, r, 96) for x, r in zip(mu, roughness, strict=True)])
    excess = (map_function(albedo_fits.sheen_albedo, mu, roughness, device=device) - expected) / expected.clip(min=1.0)
    report("sheen: least and most above", float(excess.min()), float(excess.max()))
    assert excess.min() > -5e-4
    assert excess.max() < 0.022


@pytest.mark.slow
def test_averages_are_below_those_of_the_fits(device: str, report: Report) -> None:
    """2 ∫ E μ dμ: from below, because 1 − E_avg divides."""
    x, w = np.polynomial.legendre.leggauss(200)
    mu, weights = (0.5 * (x + 1.0)) ** 3, 0.5 * w * 3.0 * (0.5 * (x + 1.0)) ** 2
    for alpha in (1e-4, 1e-3, 0.01, 0.1, 0.3, 1.0):
        each = map_function(albedo_fits.specular_albedo, mu, np.full_like(mu, alpha), device=device)
        expected = (2.0 * weights * mu) @ each
        found = map_function(albedo_fits.average_specular_albedo, np.array([alpha]), device=device)[0]
        report(f"α {alpha:g}: W, G below", float(expected[0] - found[0]), float(expected[1] - found[1]))
        assert (found <= expected + 2e-5).all()
        assert (found >= expected - 1e-3).all()
