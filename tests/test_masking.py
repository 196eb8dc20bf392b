"""Shadowing and masking of microfacets are what their sources say."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from scipy import special
from support.kernels import map_function, uniforms
from support.microfacet import ANGLES, CASES, LAST, VISIBLE, Array, Case, hemisphere, normalised, slopes, viewer

from wrt.kernels.microfacet import DISTRIBUTIONS, MASKINGS, make_microfacet, maskings_of
from wrt.kernels.microfacet.masking import beta_from_one


def smith_g1(case: Case, w: Array) -> Array:
    """Return Smith's G1 as printed (Heitz 2014, section 5), in double precision."""
    s = np.hypot(case.shape[0] * w[:, 0], case.shape[1] * w[:, 1])
    a = np.abs(w[:, 2]) / np.maximum(s, 1e-30)
    if case.name == "ggx":
        return 2.0 / (1.0 + np.sqrt(1.0 + 1.0 / a**2))
    with np.errstate(under="ignore"):
        return 2.0 / (1.0 + special.erf(a) + np.exp(-(np.minimum(a, 30.0) ** 2)) / (a * np.sqrt(np.pi)))


@pytest.mark.parametrize("name", [name for name in DISTRIBUTIONS if "smith" in maskings_of(name)])
def test_smith_is_exact(name: str, device: str, report: Report) -> None:
    wo = np.concatenate([hemisphere(20_000, seed=4), [viewer(a) for a in (*ANGLES, 89.9, 89.99)]])
    up = np.broadcast_to([0.0, 0.0, 1.0], wo.shape)
    worst = 0.0
    for case in (case for case in CASES if case.name == name):
        expected = smith_g1(case, wo)
        found = case.values(device, up, wo, masking="smith")[3]
        worst = max(worst, float(np.abs(found / expected - 1.0).max()))
    report(f"{name}: largest relative error of G1", worst, 0.0)
    assert worst < 5e-6


IDENTITIES = [
    *((case, "smith") for case in VISIBLE if case.shape[0] >= 0.1 or case.shape[0] == case.shape[1]),
    *((case, "cook-torrance") for case in CASES if case.shape[0] in (0.1, 0.5, 0.0148, 10.0)),
]


@pytest.mark.parametrize(("case", "masking"), IDENTITIES, ids=str)
def test_visible_microfacets_cover_the_surface(case: Case, masking: str, device: str, report: Report) -> None:
    """∫ G1(wo, m) max(0, wo·m) D(m) dm = cosθo (Heitz 2014, eq. 14), for any D where microfacets are grooves."""
    for degrees in (*ANGLES, 89.9):
        wo = viewer(degrees)

        def visible(m: Array, wo: Array = wo) -> Array:
            d, _, _, g1 = case.values(device, m, wo, masking=masking)
            return d * g1 * np.maximum(m @ wo, 0.0) / wo[2]

        found = case.integral(visible)
        report(f"{case}, {masking} at {degrees:g}°", found, 1.0)
        assert abs(found - 1.0) < 2e-4


def test_walters_fit(device: str, report: Report) -> None:
    """Within 0.5 % of Smith's G1 of Beckmann's distribution, at every angle and for Blinn's as well."""
    wo = np.array([viewer(a) for a in np.linspace(0.0, 89.99, 20_000)])
    up = np.broadcast_to([0.0, 0.0, 1.0], wo.shape)
    for case in (slopes("beckmann", 0.5), slopes("beckmann", 0.5, 0.05), slopes("blinn-phong", 0.8)):
        found = case.values(device, up, wo, masking="walter")[3]
        error = float(np.abs(found / smith_g1(case, wo) - 1.0).max())
        report(f"{case}: largest relative error", error, "< 0.005")
        assert error < 0.005
        assert found.max() == 1.0


def pairs(eta: float, seed: int) -> tuple[Array, Array, Array]:
    """Return viewers, lights on the same side (eta 1) or the other, and the normals that join them."""
    wo, wi = hemisphere(50_000, seed), hemisphere(50_000, seed + 1)
    if eta != 1.0:
        # The normal of refraction (Walter 2007, eq. 16), on the viewer's side; pairs it cannot join are left out.
        wi *= np.array([1.0, 1.0, -1.0])
        m = normalised(wo + eta * wi)
        m *= np.sign(m[:, 2:])
        joined = (np.sum(m * wo, axis=1) > 1e-4) & (np.sum(m * wi, axis=1) < -1e-4)
        return wo[joined], wi[joined], m[joined]
    return wo, wi, normalised(wo + wi)


@pytest.mark.parametrize("eta", [1.0, 1.5])
@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_masking_is_a_fraction_and_symmetric(name: str, eta: float, device: str) -> None:
    wo, wi, m = pairs(eta, seed=5)
    assert len(m) > 5_000
    for case in (case for case in CASES if case.name == name):
        values = {}
        for masking in maskings_of(name):
            _, _, g, g1 = case.values(device, m, wo, wi, masking)
            back = case.values(device, m, wi, wo, masking)[2]
            np.testing.assert_array_equal(g, back)
            assert g.min() >= 0.0
            assert max(g.max(), g1.max()) <= 1.0
            assert (g[g1 == 0.0] == 0.0).all()
            values[masking] = g
            # A direction behind the microfacet sees nothing of it.
            _, _, g, g1 = case.values(device, m * np.array([-1.0, -1.0, 1.0]), wo, wi, masking)
            mirrored = m * np.array([-1.0, -1.0, 1.0])
            behind = np.sum(mirrored * wo, axis=1) < -1e-6
            assert behind.sum() > 100
            assert (g[behind] == 0.0).all()
            assert (g1[behind] == 0.0).all()
        if "smith" in values:
            # Heights help each other on one side, and hinder each other across, where rounding is that of logarithms.
            difference = values["smith"] - values["smith-separable"]
            assert (difference.min() > -2e-7) if eta == 1.0 else (difference.max() < 2e-6)


def test_general_maskings_are_the_printed_ones(device: str) -> None:
    wo, wi, m = pairs(1.0, seed=7)
    case = slopes("ggx", 0.5)
    dot, nl, nv, nh = np.sum(wo * m, axis=1), wi[:, 2], wo[:, 2], m[:, 2]
    expected = {
        "implicit": nl * nv,
        "kelemen": nl * nv * 2.0 / (1.0 + np.sum(wo * wi, axis=1)),
        "cook-torrance": np.minimum(1.0, np.minimum(2.0 * nh * nv / dot, 2.0 * nh * nl / dot)),
    }
    clear = dot > 0.05
    for masking, value in expected.items():
        found = case.values(device, m, wo, wi, masking)[2]
        np.testing.assert_allclose(found[clear], value[clear], rtol=1e-4)
    for masking in ("smith", "smith-separable"):
        g_o, g_i = smith_g1(case, wo), smith_g1(case, wi)
        value = g_o * g_i if masking == "smith-separable" else 1.0 / (1.0 / g_o + 1.0 / g_i - 1.0)
        np.testing.assert_allclose(case.values(device, m, wo, wi, masking)[2], value, rtol=1e-5)


def test_masking_across_the_surface_is_a_beta_function(device: str, report: Report) -> None:
    a, b = (x.ravel() for x in np.meshgrid(*[np.concatenate([[0.0], np.geomspace(1e-6, 1e4, 80)])] * 2))
    found = map_function(beta_from_one, a, b, device=device)
    expected = special.betaln(1.0 + a, 1.0 + b)
    likely = expected > -40.0
    error = float(np.abs(found[likely] / np.exp(expected[likely]) - 1.0).max())
    report("largest relative error", error, 0.0)
    assert error < 2e-5
    assert (found[~likely] < 1e-17).all()


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_nothing_is_infinite(name: str, device: str) -> None:
    """At the least and the greatest roughness, along the surface, for the first and the last random number."""
    u = uniforms(20_000, 2, seed=8)
    edges = [0.0, 2.0**-24, 0.25, 0.5, 0.75, LAST]
    u[:36] = [(a, b) for a in edges for b in edges]
    grazing = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 1e-7], [0.6, 0.8, 1e-20], [0.0, 0.0, 1.0]])
    for case in (case for case in CASES if case.name == name):
        for wo in (*(viewer(a) for a in (0.0, 80.0, 89.99, 89.9999)), *grazing):
            m = case.sample(wo, u, device)
            assert np.isfinite(m).all()
            np.testing.assert_allclose(np.linalg.norm(m, axis=1), 1.0, atol=1e-6)
            assert m[:, 2].min() >= 0.0
            m = np.concatenate([m, grazing, hemisphere(1000, seed=9)])
            wi = hemisphere(len(m), seed=10)
            wi[::2, 2] *= -1.0
            for masking in maskings_of(name):
                values = case.values(device, m, wo, wi, masking)
                assert np.isfinite(values).all(), masking
                assert values.min() >= 0.0


# --- Names ------------------------------------------------------------------------------------------


def test_every_pair_is_made_or_refused() -> None:
    for name in DISTRIBUTIONS:
        for masking in MASKINGS:
            if masking in maskings_of(name):
                assert all(isinstance(part, wp.Function) for part in make_microfacet(name, masking))
                continue
            with pytest.raises(ValueError, match=f"'{masking}' is not known for the distribution '{name}'"):
                make_microfacet(name, masking)
    assert maskings_of("beckmann") == maskings_of("blinn-phong") == MASKINGS
    assert maskings_of("abc") == maskings_of("sgd") == ("cook-torrance", "kelemen", "implicit")
    with pytest.raises(ValueError, match="no distribution 'phong'"):
        make_microfacet("phong", "smith")
    with pytest.raises(ValueError, match="no masking 'none'"):
        make_microfacet("ggx", "none")
