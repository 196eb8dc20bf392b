"""Rough metals: sampling, energy, agreement with Mitsuba, and how they are described."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import special, stats
from support.bsdfs import (
    ANGLES,
    EPS,
    Case,
    albedo,
    assert_finite,
    assert_nothing_goes_through,
    assert_weights,
    chi_square,
    hemisphere,
    reciprocity_error,
    viewer,
)
from support.kernels import uniforms
from support.mitsuba_scene import load_mitsuba
from support.statistics import sidak
from test_fresnel import complex_fresnel

import wrt
from wrt.backend.device import Device
from wrt.scene.materials.metals import average_reflectance
from wrt.scene.materials.microfacet import MASKINGS
from wrt.scene.materials.presets import metal_f0, metal_ior
from wrt.upload.scene_data import build_scene

WHITE = {"f0": 1.0, "multiple_bounces": True}


def metal(alpha: object, distribution: str = "ggx", masking: str = "smith", **rest: object) -> Case:
    """Return a case of a rough metal, copper by default."""
    return Case(wrt.RoughConductor(alpha, distribution=distribution, masking=masking, **rest))  # type: ignore[arg-type]


WIDE = {
    "ggx 0.1": metal(0.1),
    "ggx 1": metal(1.0),
    "ggx 0.1, 0.5": metal((0.1, 0.5)),
    "beckmann 0.1": metal(0.1, "beckmann"),
    "beckmann 0.7, 0.2": metal((0.7, 0.2), "beckmann"),
    "blinn-phong 0.3": metal(0.3, "blinn-phong", "walter"),
    "abc 100, 1.2": metal((100.0, 1.2), "abc", "cook-torrance"),
    "sgd 0.1, 0.6": metal((0.1, 0.6), "sgd", "kelemen"),
    "ggx 0.3, all bounces": metal(0.3, **WHITE),
    "beckmann 0.1, 0.4, all bounces": metal((0.1, 0.4), "beckmann", **WHITE),
}
"""Lobes wide enough for the cells of the sphere."""

NARROW = {
    "ggx 1e-4": metal(1e-4),
    "ggx 0.01": metal(0.01),
    "beckmann 1e-4": metal(1e-4, "beckmann"),
    "beckmann 1e-3, 0.5": metal((1e-3, 0.5), "beckmann"),
    "blinn-phong 1e-4": metal(1e-4, "blinn-phong", "walter"),
    "ggx 1e-4, all bounces": metal(1e-4, **WHITE),
    "beckmann 1e-2, all bounces": metal(0.01, "beckmann", **WHITE),
}
"""Lobes between which and their density those cells cannot tell."""

CORNERS = {
    "beckmann 1, all bounces": metal(1.0, "beckmann", **WHITE),
    "black": metal(0.3, reflectance=0.0),
    "white": metal(1.0, reflectance=1.0),
    "black, all bounces": metal(0.3, f0=0.0, multiple_bounces=True),
    "abc, flat": metal((0.1, 0.0), "abc", "cook-torrance"),
    "abc, sharp": metal((1e8, 3.0), "abc", "cook-torrance"),
    "sgd, sharp": metal((1e-5, 1.4), "sgd", "kelemen"),
    "sgd, flat": metal((10.0, 0.0), "sgd", "kelemen"),
}
CASES = {**WIDE, **NARROW, **CORNERS}


@pytest.mark.slow
@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", WIDE)
def test_samples_follow_the_density(name: str, degrees: float, device: str, report: Report) -> None:
    """One more cell holds the samples below the horizon, whose weight is 0: by them the density integrates to less."""
    tests = len(WIDE) * len(ANGLES)
    result = chi_square(WIDE[name], degrees, device, tests=tests, samples=2**18, min_levels=1)
    report(f"{name} at {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


SLOPES: dict[str, Callable[[NDArray], NDArray]] = {"ggx": lambda t: t / (1.0 + t), "beckmann": lambda t: -np.expm1(-t)}
"""Share of normals, as seen from straight above, of tan²θ / α² up to t."""


@pytest.mark.parametrize("alpha", [1e-4, 1e-3, 0.03])
@pytest.mark.parametrize("distribution", SLOPES)
def test_mirror_like_lobes_have_their_shape(distribution: str, alpha: float, device: str, report: Report) -> None:
    """Where cells of the sphere see one point: the slopes of half vectors, by Kolmogorov and Smirnov's test."""
    wo = viewer(0.0)
    found = metal(alpha, distribution).sample(wo, uniforms(2**17, 3, seed=31), device)
    wi = found["wi"].astype(np.float64)
    # tanθ of the half vector of +z and wi is tan(θi / 2) = sinθi / (1 + cosθi).
    slopes = np.hypot(wi[:, 0], wi[:, 1]) / (1.0 + np.sqrt(1.0 - wi[:, 0] ** 2 - wi[:, 1] ** 2)) / alpha
    slopes = slopes[wi[:, 2] > 0.9]  # the root has digits
    share = SLOPES[distribution](np.array([(math.tan(0.5 * math.acos(0.9)) / alpha) ** 2]))[0]
    assert len(slopes) > 0.999 * share * len(wi)
    p = float(stats.kstest(slopes**2, lambda t: SLOPES[distribution](t) / share).pvalue)
    report(f"{distribution} {alpha:g}: slopes", len(slopes), p=p)
    assert p > sidak(0.01, 6)


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", CASES)
def test_weight_is_value_over_density(name: str, degrees: float, device: str) -> None:
    assert_weights(CASES[name], degrees, device, rtol=1e-5)


@pytest.mark.parametrize("name", CASES)
def test_reciprocity(name: str, device: str, report: Report) -> None:
    error = reciprocity_error(CASES[name], device)
    report(f"{name}: largest relative difference", error, "< 1e-5")
    assert error < 1e-5


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", CASES)
def test_no_energy_is_made(name: str, degrees: float, device: str) -> None:
    """To 3σ; with multiple bounces a white surface reflects 1, to the error of the table's interpolation."""
    mean, error = albedo(CASES[name], degrees, device, samples=2**17)
    table = 3e-3 if CASES[name].material.table_key else 0.0
    assert (mean <= 1.0 + table + 3.0 * error + 4.0 * EPS).all()


@pytest.mark.parametrize("name", CASES)
def test_values_are_finite(name: str, device: str) -> None:
    assert_finite(CASES[name], device)


@pytest.mark.parametrize("name", WIDE)
def test_nothing_goes_through(name: str, device: str) -> None:
    assert_nothing_goes_through(WIDE[name], device)


def test_both_sides_reflect_alike(device: str) -> None:
    wi = hemisphere(1000, seed=33)
    front, back = (dataclasses.replace(metal(0.3), front=side).evaluate(viewer(50.0), wi, device) for side in (1, 0))
    np.testing.assert_array_equal(front[0], back[0])


# --- Against Mitsuba --------------------------------------------------------------------------------


def stretched_cotangent(w: NDArray, alpha: tuple[float, float]) -> NDArray:
    """Return a = 1 / (α tanθ); where it is 100 and more, nothing is hidden."""
    return np.minimum(w[:, 2] / np.maximum(np.hypot(alpha[0] * w[:, 0], alpha[1] * w[:, 1]), 1e-10), 100.0)


def smith_lambda_beckmann(a: NDArray) -> NDArray:
    """Return Λ of Beckmann's distribution (Walter 2007): G1 = 1 / (1 + Λ)."""
    return 0.5 * (np.exp(-a * a) / (a * np.sqrt(np.pi)) - special.erfc(a))


def g1_fit(a: NDArray) -> NDArray:
    """Return Walter's rational fit of 1 / (1 + Λ): Walter 2007, eq. 27."""
    return np.where(a >= 1.6, 1.0, (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a))


@pytest.mark.parametrize("alpha", [(0.1, 0.1), (0.4, 0.4), (1.0, 1.0), (0.1, 0.5)])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_agrees_with_mitsuba(distribution: str, alpha: tuple[float, float], device: str, report: Report) -> None:
    """Value and density at a thousand pairs of directions.

    Mitsuba multiplies both directions' G1, which of Beckmann's distribution is Walter's fit. It takes that in the
    density too, where what it samples has the exact G1 as ours has: its density is ours times fit / exact. Just below
    a = 1.6 the fit exceeds 1, by up to 5.7e-5; Mitsuba's value then does, and ours does not. It leaves out values of
    D cosθ below 1e-20.
    """
    mi = load_mitsuba()
    eta, k = (0.2, 0.924, 1.102), (3.912, 2.452, 2.142)
    bsdf = mi.load_dict(
        {
            "type": "roughconductor",
            "distribution": distribution,
            "alpha_u": alpha[0],
            "alpha_v": alpha[1],
            "eta": {"type": "rgb", "value": list(eta)},
            "k": {"type": "rgb", "value": list(k)},
        }
    )
    masking = {"ggx": "smith-separable", "beckmann": "walter"}[distribution]
    case = metal(alpha, distribution, masking, eta=eta, k=k)
    wo, wi = hemisphere(1000, seed=34).astype(np.float32), hemisphere(1000, seed=35).astype(np.float32)
    # Half of them anywhere, half where the lobe is.
    for i, drawn in enumerate(case.sample(wo[500:], uniforms(500, 3, seed=36), device), start=500):
        wi[i] = drawn["wi"]
    context = mi.BSDFContext()
    surface = mi.SurfaceInteraction3f()
    expected = np.empty((1000, 3))
    expected_pdf = np.empty(1000)
    for i in range(1000):
        surface.wi = mi.Vector3f(*wo[i].tolist())
        direction = mi.Vector3f(*wi[i].tolist())
        expected[i] = np.array(bsdf.eval(context, surface, direction))
        expected_pdf[i] = bsdf.pdf(context, surface, direction)
    value, pdf, _ = case.evaluate(wo, wi, device)
    if distribution == "beckmann":
        a, b = (stretched_cotangent(w.astype(np.float64), alpha) for w in (wo, wi))
        pdf = pdf * g1_fit(a) * (1.0 + smith_lambda_beckmann(a))
        value = value * (np.maximum(g1_fit(a), 1.0) * np.maximum(g1_fit(b), 1.0))[:, None]
    there = expected_pdf > 0.0
    assert there.sum() > 600
    assert (value[~there] < 1e-18).all()
    difference = np.abs(value / np.where(expected > 0.0, expected, 1.0) - 1.0)[there].max()
    difference_pdf = np.abs(pdf / np.where(there, expected_pdf, 1.0) - 1.0)[there].max()
    report(f"{distribution} {alpha}: largest relative difference of value, density", f"{difference:.2g}",
           f"{difference_pdf:.2g}")  # fmt: skip
    assert difference < 1e-4
    assert difference_pdf < 1e-4


# --- Fresnel ----------------------------------------------------------------------------------------


def test_reflectance_is_fresnels_at_the_facet(device: str) -> None:
    """A metal's value over that of a white one is its reflectance at the half vector, times the factor."""
    wo, wi = hemisphere(2000, seed=37), hemisphere(2000, seed=38)
    half = (wo + wi) / np.linalg.norm(wo + wi, axis=1, keepdims=True)
    cosine = np.sum(wo * half, axis=1)[:, None]
    white = metal(0.5, f0=1.0).evaluate(wo, wi, device)[0]
    eta, k = metal_ior("gold")
    gold = metal(0.5, metal="gold", reflectance=(1.0, 0.5, 0.25)).evaluate(wo, wi, device)[0]
    expected = complex_fresnel(cosine, np.array(eta), np.array(k)) * [1.0, 0.5, 0.25]
    np.testing.assert_allclose(gold, white * expected, rtol=2e-5)
    f0 = np.array([0.9, 0.5, 0.1])
    schlick = metal(0.5, f0=tuple(f0)).evaluate(wo, wi, device)[0]
    np.testing.assert_allclose(schlick, white * (f0 + (1.0 - f0) * (1.0 - cosine) ** 5), rtol=2e-5)


def test_smooth_metal_by_its_colour(device: str) -> None:
    f0 = (0.9, 0.5, 0.1)
    case = Case(wrt.Conductor(f0=f0))
    assert case.model.delta
    wo = np.stack([viewer(a) for a in np.linspace(0.0, 89.99, 500)]).astype(np.float32)
    found = case.sample(wo, uniforms(500, 3, seed=39), device)
    np.testing.assert_array_equal(found["wi"], wo * np.array([-1, -1, 1], np.float32))
    expected = np.array(f0) + (1.0 - np.array(f0)) * (1.0 - wo[:, 2:].astype(np.float64)) ** 5
    np.testing.assert_allclose(found["weight"], expected, atol=8.0 * EPS)


def test_average_reflectance() -> None:
    """Of a dielectric without absorption it is known: 1 − Σ of the light let in (Ryde 1931; Egan and Hilgeman)."""
    eta = 1.5
    # Diffuse reflectance of a dielectric surface from outside, exact: Walsh 1926, as in Duntley 1942.
    e2 = eta * eta
    exact = (
        0.5
        + (eta - 1.0) * (3.0 * eta + 1.0) / (6.0 * (eta + 1.0) ** 2)
        + e2 * (e2 - 1.0) ** 2 / (e2 + 1.0) ** 3 * math.log((eta - 1.0) / (eta + 1.0))
        - 2.0 * eta**3 * (e2 + 2.0 * eta - 1.0) / ((e2 + 1.0) * (e2 * e2 - 1.0))
        + 8.0 * e2 * e2 * (e2 * e2 + 1.0) / ((e2 + 1.0) * (e2 * e2 - 1.0) ** 2) * math.log(eta)
    )
    assert average_reflectance((eta,) * 3, (0.0,) * 3)[0] == pytest.approx(exact, abs=1e-6)


# --- Descriptions -----------------------------------------------------------------------------------


def test_maskings_are_those_of_the_kernels() -> None:
    from wrt.kernels.microfacet import DISTRIBUTIONS, LEAST_ALPHA, maskings_of
    from wrt.scene.materials.microfacet import LEAST_ALPHA as LEAST

    known = {name: set(maskings_of(name)) for name in DISTRIBUTIONS}
    known["blinn-phong"].remove("smith")  # borrowed, and makes light at grazing angles whatever the roughness
    assert known == {name: set(maskings) for name, maskings in MASKINGS.items()}
    assert float(LEAST_ALPHA) == LEAST


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
    assert make(metal="gold") == make(eta=metal_ior("gold")[0], k=metal_ior("gold")[1])
    assert make(metal="Au") == make(metal="gold")
    assert make(metal="zinc") == make(f0=metal_f0("zinc"))
    assert make(f0=0.5).f0 == (0.5, 0.5, 0.5)
    gold = make(metal="gold")
    assert dataclasses.replace(gold, opacity=0.5).eta == gold.eta
    for wrong in ({"eta": 1.0, "f0": 0.5}, {"k": 1.0, "metal": "gold"}, {"f0": 0.5, "metal": "gold"}):
        with pytest.raises(wrt.InputError, match="by eta and k, by f0 or by metal"):
            make(**wrong)
    with pytest.raises(wrt.InputError, match=r"metal: 'gould'.*gold"):
        make(metal="gould")
    with pytest.raises(wrt.InputError, match=r"f0.*at most 1"):
        make(f0=1.5)
    with pytest.raises(wrt.InputError, match="eta must be greater than 0"):
        make(eta=0.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"alpha": 1e-5}, "alpha must be at least 0.0001"),
        ({"alpha": 1.1}, "alpha must be at most 1"),
        ({"alpha": (0.1, 0.0)}, r"alpha\[1\] must be at least"),
        ({"alpha": (0.1, 0.2, 0.3)}, "two numbers"),
        ({"alpha": "rough"}, "alpha must be a number"),
        ({"alpha": (0.1, 0.2), "distribution": "blinn-phong"}, "one number for distribution 'blinn-phong'"),
        ({"alpha": 0.1, "distribution": "abc", "masking": "implicit"}, "two numbers, B and C"),
        ({"alpha": (0.1, 99), "distribution": "sgd", "masking": "implicit"}, r"alpha\[1\] \(p\) must be at most 10"),
        ({"distribution": "phong"}, "distribution must be one of ggx"),
        ({"masking": "walter"}, "masking must be one of smith, .* for distribution 'ggx'"),
        ({"distribution": "abc", "alpha": (9.0, 1.0), "masking": "smith"}, "masking must be one of cook-torrance"),
        ({"distribution": "blinn-phong", "alpha": 0.5, "masking": "walter"}, "at most 0.3"),
        ({"multiple_bounces": 1}, "multiple_bounces must be true or false"),
        ({"reflectance": 2.0}, "reflectance must be at most 1"),
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
        scene = wrt.Scene()
        scene.add(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), material=material)
        assert build_scene(scene, Device("cpu")).features.tangents == expected


def test_scene_files_describe_rough_metals(tmp_path: Path) -> None:
    file = tmp_path / "metals.toml"
    wrt.save_image(tmp_path / "rough.png", np.full((2, 2, 3), 0.25, np.float32))
    quad = '[[shapes]]\ntype = "quad"\norigin = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\nmaterial = "{}"\n'
    materials = {
        "brushed": 'type = "rough-conductor"\nmetal = "gold"\nalpha = [0.1, 0.4]\nmultiple_bounces = true',
        "worn": 'type = "rough-conductor"\nf0 = { texture = "rough.png" }\nalpha = { texture = "rough.png" }',
        "shiny": 'type = "conductor"\nf0 = [0.9, 0.8, 0.7]',
    }
    text = "".join(f"[materials.{name}]\n{keys}\n" for name, keys in materials.items())
    file.write_text(text + "".join(quad.format(name) for name in materials))
    brushed, worn, shiny = (shape.material for shape in wrt.load(file).shapes)
    assert brushed == wrt.RoughConductor((0.1, 0.4), metal="gold", multiple_bounces=True)
    assert isinstance(worn, wrt.RoughConductor)
    assert isinstance(worn.alpha, wrt.ImageTexture)
    assert isinstance(worn.f0, wrt.ImageTexture)
    assert shiny == wrt.Conductor(f0=(0.9, 0.8, 0.7))
    file.write_text('[materials.odd]\ntype = "rough-conductor"\nf0 = 0.5\nmetal = "gold"\n')
    with pytest.raises(wrt.InputError, match=r"metals.toml: materials.odd: a metal is given by"):
        wrt.load(file)
