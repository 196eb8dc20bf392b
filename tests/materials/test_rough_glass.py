"""Rough boundaries: Walter's refraction, and the limit of none."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from scipy.special import beta
from support.bsdfs import Case, hemisphere, viewer
from support.fresnel import cook_torrance
from support.kernels import uniforms
from support.principled_reference import dot, ggx, smith, unit

import wrt

MULTIPLE = [False, pytest.param(True, marks=pytest.mark.slow)]


def test_refraction_is_walters(device: str, report: Report) -> None:
    """Walter 2007, eq. 21, over eta² for radiance, but masked by B(1 + Λo, 1 + Λi) (Heitz and others 2016)."""
    alpha, eta = 0.4, 1.3
    wo, wi = viewer(20.0, 0.3)[None], hemisphere(300, seed=4) * [1.0, 1.0, -1.0]
    m = unit(wo + eta * wi)
    m = np.where(m[:, 2:] < 0.0, -m, m)
    o, i = dot(wo, m), dot(wi, m)
    is_visible = (o > 0.0) & (i < 0.0)
    masking = beta(1.0 + smith(wo, (alpha, alpha)), 1.0 + smith(wi, (alpha, alpha)))
    transmitted = 1.0 - cook_torrance(np.where(is_visible, o, 1.0), eta)
    expected = transmitted * np.abs(o * i) / (wo[:, 2] * (o + eta * i) ** 2) * ggx(m, (alpha, alpha)) * masking
    expected[~is_visible] = 0.0
    found = Case(wrt.RoughDielectric(eta, alpha=alpha)).evaluate(wo, wi, device)[0][:, 0]
    report("f, largest error", float(np.abs(found - expected).max()))
    assert (np.abs(found - expected) <= 1.5e-4 * expected + 1e-9).all()


@pytest.mark.parametrize("multiple", MULTIPLE)
@pytest.mark.parametrize("front", [True, False])
def test_a_boundary_between_equal_media_is_none(front: bool, multiple: bool, device: str) -> None:
    wo = np.concatenate([hemisphere(1000, seed=1), [viewer(a) for a in (0.0, 89.0, 89.99)]])
    material = wrt.RoughDielectric(1.3304, 1.33, alpha=0.5, multiple_bounces=multiple)
    found = Case(material, front).sample(wo, uniforms(len(wo), 3, seed=2), device)
    np.testing.assert_array_equal(found["wi"], -wo.astype(np.float32))
    assert (found["weight"] == 1.0).all()
    assert (found["eta"] == 1.0).all()
    assert found["delta"].all()
    value, pdf, _ = Case(material, front).evaluate(wo, -wo, device)
    assert not value.any()
    assert not pdf.any()
