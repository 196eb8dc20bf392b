"""Transparent boundaries have the values, densities, weights and probabilities of Mitsuba, another renderer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import special
from support.bsdfs import Case, hemisphere, sphere
from support.kernels import uniforms

import wrt

pytest.importorskip("mitsuba", reason="the independent renderer is not installed")

from support.mitsuba_scene import load_mitsuba
from test_rough_dielectric import SIDES, glass


def interaction(wo: NDArray[np.float64]) -> Any:
    """Return a place seen from the local direction wo."""
    mi = load_mitsuba()
    result = mi.SurfaceInteraction3f()
    result.wi = mi.Vector3f(*wo.tolist())
    return result


def beckmann_masking(w: NDArray, alpha: tuple[float, float], *, exact: bool) -> NDArray:
    """Return Smith's G1 of Beckmann's distribution, or its rational fit (Walter et al. 2007, eq. 27)."""
    a = w[:, 2] / np.hypot(alpha[0] * w[:, 0], alpha[1] * w[:, 1])
    if exact:
        return 2.0 / (1.0 + special.erf(a) + np.exp(-a * a) / (a * np.sqrt(np.pi)))
    fit = (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a)
    return np.where(a < 1.6, fit, 1.0)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("alpha", [0.05, 0.3, (0.2, 0.6), 1.0])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_rough_boundaries(distribution: str, alpha: Any, side: str, device: str, report: Report) -> None:
    """The same values and densities to 1e-4, Smith's functions not correlated, as Mitsuba has them.

    For Beckmann's distribution Mitsuba takes Walter's rational fit of Smith's function, in the density of visible
    normals as well, where here the exact one stands: that ratio is taken out.

    Facets to which a direction has a cosine below 0.03 are left out: rounding leaves few digits of that, and 1 − F is
    proportional to it.
    """
    mi = load_mitsuba()
    pair = alpha if isinstance(alpha, tuple) else (alpha, alpha)
    plugin = {"type": "roughdielectric", "int_ior": 1.5, "ext_ior": 1.0, "distribution": distribution}
    bsdf = mi.load_dict({**plugin, "alpha_u": pair[0], "alpha_v": pair[1]})
    masking = "walter" if distribution == "beckmann" else "smith-separable"
    case = Case(glass(alpha, distribution=distribution, masking=masking), SIDES[side])
    wo = hemisphere(1000, seed=31).astype(np.float32).astype(np.float64)
    # Half of the lights anywhere, half where this surface sends light.
    drawn = case.sample(wo[500:], uniforms(500, 3, seed=33), device)["wi"]
    wi = np.concatenate([sphere(500, seed=32), drawn]).astype(np.float32).astype(np.float64)
    up = 1.0 if SIDES[side] else -1.0
    context = mi.BSDFContext()
    there = [
        (
            bsdf.eval(context, interaction(up * o), mi.Vector3f(*(up * i))),
            bsdf.pdf(context, interaction(up * o), up * i),
        )
        for o, i in zip(wo, wi, strict=True)
    ]
    expected = np.array([[value[0], density] for value, density in there])
    value, pdf, _ = case.evaluate(wo, wi, device)
    if distribution == "beckmann":
        pdf = pdf * beckmann_masking(wo, pair, exact=False) / beckmann_masking(wo, pair, exact=True)
    found = np.stack([value[:, 0], pdf], axis=1)

    eta = 1.5 if SIDES[side] else 1.0 / 1.5
    m = wo + wi * np.where(wi[:, 2:] > 0.0, 1.0, eta)
    m /= np.linalg.norm(m, axis=1, keepdims=True)
    cosine = np.minimum(np.abs((wo * m).sum(axis=1)), np.abs((wi * m).sum(axis=1)))
    lit = (np.maximum(found, expected).min(axis=1) > 1e-15) & (cosine > 0.03)
    assert lit.sum() > 400
    error = (np.abs(found - expected) / np.maximum(found, expected).clip(1e-30))[lit]
    report(f"{distribution} {alpha} {side}: largest difference", float(error.max()), 0.0)
    assert error.max() < 1e-4


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("kind", ["dielectric", "thindielectric"])
def test_smooth_boundaries(kind: str, side: str, device: str) -> None:
    """The same directions, weights and probabilities: at a hair below or above it the choice is the other one."""
    mi = load_mitsuba()
    tints = {"specular_reflectance": (0.9, 0.5, 0.1), "specular_transmittance": (0.2, 0.6, 1.0)}
    rgb = {name: {"type": "rgb", "value": list(tint)} for name, tint in tints.items()}
    bsdf = mi.load_dict({"type": kind, "int_ior": 1.5, "ext_ior": 1.2, **rgb})
    make = wrt.Dielectric if kind == "dielectric" else wrt.ThinDielectric
    case = Case(make(1.5, 1.2, **tints), SIDES[side])
    wo = hemisphere(1000, seed=41).astype(np.float32).astype(np.float64)
    up = 1.0 if SIDES[side] else -1.0
    context = mi.BSDFContext()
    for through in (False, True):
        rows = []
        for o in wo:
            sample, weight = bsdf.sample(context, interaction(up * o), 1.0 - 1e-7 if through else 0.0, [0.5, 0.5])
            rows.append([*(up * np.array(sample.wo)), *weight, sample.pdf, sample.eta])
        expected = np.array(rows)
        probability = expected[:, 6]
        goes = (expected[:, 2] < 0.0) == through
        assert goes.sum() > 300
        nudge = 3e-6 + 1e-4 * np.minimum(probability, 1.0 - probability)
        u = np.zeros((len(wo), 3), np.float32)
        u[:, 2] = np.where(through, 1.0 - probability + nudge, probability - nudge)
        assert u[goes, 2].min() >= 0.0
        found = case.sample(wo, u, device)[goes]
        np.testing.assert_allclose(found["wi"], expected[goes, :3], atol=3e-6)
        np.testing.assert_allclose(found["weight"], expected[goes, 3:6], rtol=1e-5)
        # Mitsuba tells the index of a pane; but light that has gone through it is where it was.
        if kind == "dielectric":
            np.testing.assert_allclose(found["eta"], expected[goes, 7], rtol=1e-6)
        u[:, 2] = np.where(through, 1.0 - probability - nudge, probability + nudge)
        unsure = (u[:, 2] < 0.0) | (u[:, 2] >= 1.0)
        other = case.sample(wo, u, device)["wi"][:, 2] < 0.0
        assert (other[goes & ~unsure] != through).all()
