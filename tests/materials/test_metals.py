"""Rough metals: lobes too narrow for histograms, colours of one and of many bounces, Mitsuba, and descriptions."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from support.bsdfs import Case, albedo, ask_mitsuba, hemisphere, mean_albedo, viewer, walked
from support.fresnel import complex_fresnel, schlick
from support.kernels import uniforms
from support.microfacet import g1_fit, smith_lambda_beckmann, stretched_cotangent
from support.scene_files import QUAD

import wrt
from wrt.backend.device import Device
from wrt.kernels.bsdf.lobes.albedo import VALUES
from wrt.scene.materials.microfacet import MASKINGS
from wrt.scene.materials.presets import metal_f0, metal_ior
from wrt.upload.tables import material_tables as tables
from wrt.upload.tables.material_tables import pack_tables

WHITE = {"f0": 1.0, "multiple_bounces": True}
F0 = (0.9, 0.5, 0.1)


def metal(alpha: Any, distribution: str = "ggx", masking: str = "smith", **rest: Any) -> Case:
    """Return a case of a rough metal, copper by default."""
    return Case(wrt.RoughConductor(alpha, distribution=distribution, masking=masking, **rest))


MITSUBA = [("ggx", (0.4, 0.4)), *(("beckmann", pair) for pair in ((0.1, 0.1), (1.0, 1.0))), ("ggx", (0.1, 0.5))]


@pytest.mark.parametrize(("distribution", "alpha"), [*MITSUBA, ("beckmann", (0.1, 0.5))])
def test_agrees_with_mitsuba(distribution: str, alpha: tuple[float, float], device: str, report: Report) -> None:
    """Value and density at a thousand pairs of directions.

    Mitsuba multiplies both directions' G1, which of Beckmann's distribution is Walter's fit. It takes that in the
    density too, where what it samples has the exact G1 as ours has: its density is ours times fit / exact. Just below
    a = 1.6 the fit exceeds 1, by up to 5.7e-5; Mitsuba's value then does, and ours does not. It leaves out values of
    D cosθ below 1e-20.
    """
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
    eta, k = (0.2, 0.924, 1.102), (3.912, 2.452, 2.142)
    index = {name: {"type": "rgb", "value": list(value)} for name, value in (("eta", eta), ("k", k))}
    kind = {"type": "roughconductor", "distribution": distribution, "alpha_u": alpha[0], "alpha_v": alpha[1]}
    masking = {"ggx": "smith-separable", "beckmann": "walter"}[distribution]
    case = metal(alpha, distribution, masking, eta=eta, k=k)
    wo, wi = hemisphere(1000, seed=34).astype(np.float32), hemisphere(1000, seed=35).astype(np.float32)
    # Half of them anywhere, half where the lobe is.
    wi[500:] = case.sample(wo[500:], uniforms(500, 3, seed=36), device)["wi"]
    expected, expected_pdf = ask_mitsuba(kind | index, wo, wi)
    value, pdf, _ = case.evaluate(wo, wi, device)
    if distribution == "beckmann":
        a, b = (stretched_cotangent(w.astype(np.float64), alpha) for w in (wo, wi))
        pdf = pdf * g1_fit(a) * (1.0 + smith_lambda_beckmann(a))
        value = value * (np.maximum(g1_fit(a), 1.0) * np.maximum(g1_fit(b), 1.0))[:, None]
    there = expected_pdf > 0.0
    assert there.sum() > 600
    assert (value[~there] < 1e-18).all()
    difference = float(np.abs(value[there] / expected[there] - 1.0).max())
    difference_pdf = float(np.abs(pdf[there] / expected_pdf[there] - 1.0).max())
    report(f"{distribution} {alpha}: largest relative difference of value, density", difference, difference_pdf)
    assert difference < 1e-4
    assert difference_pdf < 1e-4


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
    "schlick": ({"f0": F0}, mean_of(lambda mu: schlick(mu, F0))),
    "gold": ({"metal": "gold"}, mean_of(lambda mu: complex_fresnel(mu, *metal_ior("gold")))),
    "factor": ({"f0": F0, "reflectance": (0.3, 1.0, 0.6)}, mean_of(lambda mu: schlick(mu, F0)) * (0.3, 1.0, 0.6)),
    "gold, factor": (
        {"metal": "gold", "reflectance": (0.3, 1.0, 0.6)},
        mean_of(lambda mu: complex_fresnel(mu, *metal_ior("gold"))) * (0.3, 1.0, 0.6),
    ),
    "principled metal": (wrt.Principled(F0, metallic=1.0), mean_of(lambda mu: schlick(mu, F0))),
    "principled coat": (
        wrt.Principled(0.0, ior=0.0, specular_color=F0, specular=0.8),
        mean_of(lambda mu: 0.8 * schlick(mu, F0)),
    ),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if "principled" in name else ()) for name in COLORED]
)
def test_further_bounces_have_their_colours(name: str, device: str, report: Report) -> None:
    """The lobe over that of white facets: the mean Fresnel reflectance of each channel to the power of the bounces.

    These are a random walk's, from the second bounce on, which light leaves by the mean albedo of one (Kulla and Conty
    2017; Hill 2018). That albedo is integrated over the value of white facets.
    """
    material, reflectance = COLORED[name]
    if isinstance(material, dict):
        material = wrt.RoughConductor(0.8, **material)
    else:
        material = dataclasses.replace(material, roughness=math.sqrt(0.8))
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


def test_tables_are_made_once(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    key, other = ("reflection", "ggx", "smith", None), ("reflection", "ggx", "smith", (0.05, 0.5, 0.0))
    where = Device(device)
    first, _ = pack_tables([key, other], where)
    monkeypatch.setattr(tables, "MAKERS", {})
    second, places = pack_tables([None, key, other, key], where)
    np.testing.assert_array_equal(first, second)
    assert places == {key: 0, other: len(second) // 2}


# --- Descriptions -----------------------------------------------------------------------------------


def test_every_combination_has_a_model() -> None:
    for distribution, maskings in MASKINGS.items():
        for masking, f0, bounces in itertools.product(maskings, (None, 0.5), (False, True)):
            alpha = (1.0, 1.0) if distribution in ("abc", "sgd") else 0.3
            case = metal(alpha, distribution, masking, f0=f0, multiple_bounces=bounces)
            assert case.model.slots == len(case.material.slots)
            assert case.model.widens == (distribution != "sgd")


@pytest.mark.parametrize("make", [wrt.Conductor, wrt.RoughConductor])
def test_a_metal_is_given_in_one_way(make: type) -> None:
    copper = make()
    assert (copper.eta, copper.k, copper.f0) == ((0.200, 0.924, 1.102), (3.912, 2.452, 2.142), None)
    assert make(k=2.0).eta == copper.eta
    assert make(metal="gold") == make(eta=metal_ior("gold")[0], k=metal_ior("gold")[1]) == make(metal="Au")
    assert make(metal="zinc") == make(f0=metal_f0("zinc"))
    assert make(f0=0.5).f0 == (0.5, 0.5, 0.5)
    assert dataclasses.replace(make(metal="gold"), opacity=0.5).eta == make(metal="gold").eta
    for wrong, message in (
        ({"eta": 1.0, "f0": 0.5}, "by eta and k, by f0 or by metal"),
        ({"f0": 0.5, "metal": "gold"}, "by eta and k, by f0 or by metal"),
        ({"metal": "gould"}, "metal: 'gould'.*gold"),
        ({"f0": 1.5}, "f0.*at most 1"),
        ({"eta": 0.0}, "eta must be greater than 0"),
    ):
        with pytest.raises(wrt.InputError, match=message):
            make(**wrong)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"alpha": 1e-5}, "alpha must be at least 0.0001"),
        ({"alpha": (0.1, 0.0)}, r"alpha\[1\] must be at least"),
        ({"alpha": (0.1, 0.2, 0.3)}, "two numbers"),
        ({"alpha": "rough"}, "alpha must be a number"),
        ({"alpha": (0.1, 0.2), "distribution": "blinn-phong"}, "one number for distribution 'blinn-phong'"),
        ({"alpha": 0.1, "distribution": "abc", "masking": "implicit"}, "two numbers, B and C"),
        ({"alpha": (0.1, 99), "distribution": "sgd", "masking": "implicit"}, r"alpha\[1\] \(p\) must be at most 10"),
        ({"distribution": "phong"}, "distribution must be one of ggx"),
        ({"masking": "walter"}, "masking must be one of smith, .* for distribution 'ggx'"),
        ({"distribution": "blinn-phong", "alpha": 0.5, "masking": "walter"}, "at most 0.3"),
        ({"multiple_bounces": 1}, "multiple_bounces must be true or false"),
        ({"alpha": wrt.VertexColor(), "multiple_bounces": True}, "multiple_bounces needs an alpha"),
    ],
)
def test_mistakes_are_named(arguments: dict, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.RoughConductor(**arguments)


def test_tangents_are_needed_where_roughness_has_a_direction() -> None:
    grey = wrt.ImageTexture(np.full((2, 2, 3), 0.3, np.float32))
    brushed = wrt.ImageTexture(np.full((2, 2, 3), (0.1, 0.4, 0.0), np.float32))
    needed = {
        wrt.RoughConductor(0.3): False,
        wrt.RoughConductor((0.3, 0.3)): False,
        wrt.RoughConductor((0.1, 0.3)): True,
        wrt.RoughConductor(grey): False,
        wrt.RoughConductor(brushed): True,
        wrt.RoughConductor(brushed, distribution="blinn-phong"): False,
        wrt.RoughConductor((0.1, 0.3), distribution="sgd", masking="implicit"): False,
        wrt.Conductor(): False,
    }
    for material, expected in needed.items():
        assert material.needs_tangents == expected, material


def test_scene_files_describe_metals(tmp_path: Path) -> None:
    file = tmp_path / "metals.toml"
    wrt.save_image(tmp_path / "rough.png", np.full((2, 2, 3), 0.25, np.float32))
    materials = {
        "brushed": 'type = "rough-conductor"\nmetal = "gold"\nalpha = [0.1, 0.4]\nmultiple_bounces = true',
        "worn": 'type = "rough-conductor"\nf0 = { texture = "rough.png" }\nalpha = { texture = "rough.png" }',
        "shiny": 'type = "conductor"\nf0 = [0.9, 0.8, 0.7]',
    }
    text = "".join(f"[materials.{name}]\n{keys}\n" for name, keys in materials.items())
    file.write_text(text + "".join(f'{QUAD}material = "{name}"\n' for name in materials))
    brushed, worn, shiny = (shape.material for shape in wrt.load(file).shapes)
    assert brushed == wrt.RoughConductor((0.1, 0.4), metal="gold", multiple_bounces=True)
    assert isinstance(worn.alpha, wrt.ImageTexture)
    assert isinstance(worn.f0, wrt.ImageTexture)
    assert shiny == wrt.Conductor(f0=(0.9, 0.8, 0.7))
    file.write_text('[materials.odd]\ntype = "rough-conductor"\nf0 = 0.5\nmetal = "gold"\n')
    with pytest.raises(wrt.InputError, match=r"metals.toml: materials.odd: a metal is given by"):
        wrt.load(file)
