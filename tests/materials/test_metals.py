"""Rough metals: colours of one and of many bounces, and descriptions."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from support.bsdfs import Case, albedo, hemisphere, mean_albedo, viewer, walked
from support.fresnel import complex_fresnel, schlick

import wrt
from wrt.backend.device import Device
from wrt.kernels.bsdf.lobes.albedo import VALUES
from wrt.scene.materials.presets import metal_f0, metal_ior
from wrt.upload.tables.material_tables import pack_tables

WHITE = {"f0": 1.0, "multiple_bounces": True}
F0 = (0.9, 0.5, 0.1)


def metal(alpha: Any, distribution: str = "ggx", masking: str = "smith", **options: Any) -> Case:
    """Return a case of a rough metal, copper by default."""
    return Case(wrt.RoughConductor(alpha, distribution=distribution, masking=masking, **options))


def test_reflectance_is_fresnels_at_the_facet(device: str) -> None:
    """A metal's value over that of white is its reflectance at the half vector times the factor; on both sides."""
    wo, wi = hemisphere(2000, seed=37), hemisphere(2000, seed=38)
    half = (wo + wi) / np.linalg.norm(wo + wi, axis=1, keepdims=True)
    cosine = np.sum(wo * half, axis=1)[:, None]
    white = metal(0.5, f0=1.0).evaluate(wo, wi, device)[0]
    gold = metal(0.5, metal="gold", reflectance=(1.0, 0.5, 0.25))
    expected = complex_fresnel(cosine, *metal_ior("gold")) * [1.0, 0.5, 0.25]
    for case in (gold, dataclasses.replace(gold, front=False)):
        np.testing.assert_allclose(case.evaluate(wo, wi, device)[0], white * expected, rtol=2e-5)
    np.testing.assert_allclose(metal(0.5, f0=F0).evaluate(wo, wi, device)[0], white * schlick(cosine, F0), rtol=2e-5)


# --- Many bounces -----------------------------------------------------------------------------------


def mean_of(reflectance: Callable[[NDArray], ArrayLike]) -> NDArray:
    """Return 2 ∫ F μ dμ per channel, by the midpoint rule."""
    mu = (np.arange(20_000) + 0.5)[:, None] / 20_000
    return np.asarray(np.mean(2.0 * mu * reflectance(mu), axis=0))


COLORED = {
    "schlick": (wrt.RoughConductor(0.8, f0=F0), mean_of(lambda mu: schlick(mu, F0))),
    "gold, factor": (
        wrt.RoughConductor(0.8, metal="gold", reflectance=(0.3, 1.0, 0.6)),
        mean_of(lambda mu: complex_fresnel(mu, *metal_ior("gold"))) * (0.3, 1.0, 0.6),
    ),
    "principled": (
        wrt.Principled(0.0, roughness=math.sqrt(0.8), ior=0.0, specular_color=F0, specular=0.8),
        mean_of(lambda mu: 0.8 * schlick(mu, F0)),
    ),
}


@pytest.mark.parametrize("name", ["schlick", "gold, factor", pytest.param("principled", marks=pytest.mark.slow)])
def test_further_bounces_have_their_colours(name: str, device: str, report: Report) -> None:
    """The lobe over that of white facets: the mean Fresnel reflectance of each channel to the power of the bounces.

    These are a random walk's, from the second bounce on, which light leaves by the mean albedo of one (Kulla and Conty
    2017; Hill 2018). That albedo is integrated over the value of white facets.
    """
    material, reflectance = COLORED[name]
    wo, wi = viewer(50.0), hemisphere(500, seed=42)
    wi = wi[wi[:, 2] > 0.1]

    def lobe(material: wrt.Material) -> NDArray:
        single, every = (
            Case(dataclasses.replace(material, multiple_bounces=bounces)).evaluate(wo, wi, device)[0]
            for bounces in (False, True)
        )
        return every - single

    escapes = float(mean_albedo(metal(0.8, f0=1.0), device)[0])
    found = (lobe(material) / lobe(wrt.RoughConductor(0.8, f0=1.0))).mean(axis=0)
    expected, error = walked(escapes, reflectance, first=2)
    report(f"{name}: colour of further bounces, and by a random walk", str(found), str(expected))
    assert (np.abs(found - expected) < 4.0 * error + 5e-3 * expected).all()


def test_missing_energy_has_its_closed_form(device: str) -> None:
    """GGX of α = 1 straight on: D = 1/π, Λ = (1/μ − 1)/2, so that E = ∫ μ/(1 + μ) dμ = 1 − ln 2."""
    values, places = pack_tables([("reflection", "ggx", "smith", None)], Device(device))
    assert places == {("reflection", "ggx", "smith", None): 0}
    missing = values[VALUES : VALUES + 1024].reshape(32, 32)
    assert missing[-1, -1] == pytest.approx(math.log(2.0), abs=1e-4)
    assert (missing >= 0.0).all()
    # Rougher surfaces lose more straight on, and a mirror nothing.
    assert (np.diff(missing[-1]) > -1e-4).all()
    assert missing[-1, 0] < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("alpha", "distribution", "masking"),
    [((100.0, 1.2), "abc", "cook-torrance"), ((0.1, 0.6), "sgd", "kelemen"), (0.3, "blinn-phong", "walter")],
)
def test_other_distributions_are_white_too(
    alpha: object, distribution: str, masking: str, device: str, report: Report
) -> None:
    """But where one bounce alone reflects more than it gets, as masking that ignores the distribution may let it."""
    for degrees in (0.0, 45.0, 80.0):
        single, _ = albedo(metal(alpha, distribution, masking, f0=1.0), degrees, device, samples=2**17)
        mean, error = albedo(metal(alpha, distribution, masking, **WHITE), degrees, device, samples=2**17)
        report(f"{distribution} at {degrees:g}°: one bounce, all", float(single[0]), float(mean[0]))
        assert abs(mean[0] - max(single[0], 1.0)) < 0.01 + 3.0 * error[0]


# --- Descriptions -----------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [wrt.Conductor, wrt.RoughConductor])
def test_a_metal_is_given_in_one_way(make: type) -> None:
    copper = make()
    assert (copper.eta, copper.k, copper.f0) == ((0.200, 0.924, 1.102), (3.912, 2.452, 2.142), None)
    assert make(metal="gold") == make(eta=metal_ior("gold")[0], k=metal_ior("gold")[1])
    assert make(metal="zinc") == make(f0=metal_f0("zinc"))
    assert dataclasses.replace(make(metal="gold"), opacity=0.5).eta == make(metal="gold").eta


def test_tangents_are_needed_where_roughness_has_a_direction() -> None:
    grey = wrt.ImageTexture(np.full((2, 2, 3), 0.3, np.float32))
    brushed = wrt.ImageTexture(np.full((2, 2, 3), (0.1, 0.4, 0.0), np.float32))
    for alpha, expected in ((0.3, False), ((0.3, 0.3), False), ((0.1, 0.3), True), (grey, False), (brushed, True)):
        assert wrt.RoughConductor(alpha).needs_tangents == expected, alpha
    assert not wrt.RoughConductor(brushed, distribution="blinn-phong").needs_tangents
    assert not wrt.RoughConductor((0.1, 0.3), distribution="sgd", masking="implicit").needs_tangents
