"""The material of glTF files against the specification, against Mitsuba's, and as every reflection model."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Report
from numpy.typing import NDArray
from support import principled_reference as reference
from support.bsdfs import (
    ANGLES,
    EPS,
    Case,
    albedo,
    assert_finite,
    assert_weights,
    chi_square,
    hemisphere,
    reciprocity_error,
    viewer,
)
from support.kernels import map_function, uniforms
from support.mitsuba_scene import load_mitsuba
from support.principled_reference import APPENDIX_B, MITSUBA, WRT, Albedos, Choices

import wrt
from wrt.kernels import albedo_fits
from wrt.kernels.bsdf import model_of
from wrt.presets import dielectric_ior

P = wrt.Principled
GOLD = (1.0, 0.71, 0.29)
EVERYTHING = P(
    (0.9, 0.6, 0.3),
    metallic=0.3,
    roughness=0.5,
    anisotropy=0.6,
    anisotropy_rotation=0.5,
    transmission=0.5,
    coat=0.5,
    coat_roughness=0.3,
    sheen_color=(0.5, 0.3, 0.1),
    sheen_roughness=0.4,
    multiple_bounces=True,
)

WIDE = {
    "plain": Case(P()),
    "metal": Case(P(GOLD, metallic=1.0, roughness=0.6)),
    "half metal": Case(P((0.8, 0.2, 0.0), metallic=0.5, roughness=0.4)),
    "matt": Case(P(1.0, roughness=1.0)),
    "strong reflection": Case(P(0.5, roughness=0.5, specular_color=(12.0, 6.0, 1.0))),
    "brushed": Case(P(GOLD, metallic=0.7, roughness=0.4, anisotropy=0.8, anisotropy_rotation=0.5)),
    "glass": Case(P(1.0, roughness=0.5, transmission=1.0)),
    "glass, inside": Case(P(1.0, roughness=0.5, transmission=1.0), front=False),
    "milk glass": Case(P((0.9, 0.7, 0.5), roughness=0.6, transmission=0.5, specular=0.5)),
    "milk glass, inside": Case(P((0.9, 0.7, 0.5), roughness=0.6, transmission=0.5, specular=0.5), front=False),
    "sheet": Case(P((0.9, 0.7, 0.5), roughness=0.5, transmission=0.8, thin_walled=True)),
    "coated": Case(P((0.8, 0.1, 0.1), coat=1.0, coat_roughness=0.4)),
    "velvet": Case(P((0.2, 0.0, 0.1), sheen_color=(0.9, 0.5, 0.7), sheen_roughness=0.5)),
    "all bounces": Case(P(1.0, metallic=0.5, roughness=0.8, multiple_bounces=True)),
    "everything": Case(EVERYTHING),
    "everything, inside": Case(EVERYTHING, front=False),
}
"""Lobes wide enough for the cells of the sphere."""

CORNERS = {
    "mirror": Case(P(1.0, metallic=1.0, roughness=0.0)),
    "roughness 1e-4": Case(P(0.5, metallic=0.5, roughness=1e-4)),
    "black": Case(P(0.0, specular=0.0)),
    "black coal": Case(P(0.0, roughness=1.0)),
    "white": Case(P(1.0, roughness=0.1)),
    "white, all bounces": Case(P(1.0, roughness=0.5, multiple_bounces=True)),
    "white metal, all bounces": Case(P(1.0, metallic=1.0, roughness=1.0, multiple_bounces=True)),
    "white, brushed": Case(P(1.0, roughness=0.1, anisotropy=1.0)),
    "no boundary": Case(P(1.0, ior=1.0, roughness=0.3)),
    "diamond": Case(P(1.0, ior=2.42, roughness=0.2, transmission=1.0), front=False),
    "specular-glossiness": Case(P(0.0, ior=0.0, specular_color=(0.9, 0.5, 0.1), roughness=0.3)),
    "index matched": Case(P(1.0, ior=1.0, roughness=0.3, transmission=1.0)),
    "index matched, inside": Case(P(1.0, ior=1.0, roughness=0.3, transmission=1.0), front=False),
    "clear glass": Case(P(1.0, roughness=0.0, transmission=1.0)),
    "clear glass, inside": Case(P(1.0, roughness=0.0, transmission=1.0), front=False),
    "no specular, inside": Case(P(1.0, roughness=0.3, transmission=1.0, specular=0.0), front=False),
    "clear sheet": Case(P(1.0, roughness=0.0, transmission=1.0, thin_walled=True)),
    "smooth sheen": Case(P(1.0, sheen_color=1.0, sheen_roughness=0.0)),
    "matt sheen": Case(P(1.0, sheen_color=1.0, sheen_roughness=1.0)),
    "smooth coat": Case(P(1.0, coat=1.0)),
    "coated velvet": Case(P(1.0, coat=1.0, coat_roughness=1.0, sheen_color=1.0, sheen_roughness=0.2)),
    "coated glass, inside": Case(P(1.0, roughness=0.3, transmission=1.0, coat=1.0), front=False),
}
CASES = {**WIDE, **CORNERS}


# --- As every model ---------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", WIDE)
def test_samples_follow_the_density(name: str, degrees: float, device: str, report: Report) -> None:
    """One more cell holds facets' reflections below the horizon, which are no samples: what the integral lacks to 1."""
    tests = len(WIDE) * len(ANGLES)
    result = chi_square(WIDE[name], degrees, device, tests=tests, samples=2**17, min_levels=1, tolerance=3e-6)
    report(f"{name} at {degrees:g}°", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("name", CASES)
def test_weight_is_value_over_density(name: str, degrees: float, device: str) -> None:
    assert_weights(CASES[name], degrees, device, rtol=1e-5)


@pytest.mark.parametrize("name", CASES)
def test_reciprocity(name: str, device: str, report: Report) -> None:
    error = reciprocity_error(CASES[name], device)
    report(f"{name}: largest relative difference", error, "< 2e-5")
    assert error < 2e-5


@pytest.mark.parametrize("name", [n for n, case in CASES.items() if case.front and case.model.transmits])
def test_transmission_is_reciprocal(name: str, device: str, report: Report) -> None:
    """f(wo, wi) / η² from outside is f(wi, wo) from inside, where z points inwards and y is turned with it."""
    case = CASES[name]
    outside, inside = hemisphere(50_000, seed=2), hemisphere(50_000, seed=3) * np.array([1.0, 1.0, -1.0])
    eta2 = 1.0 if case.material.thin_walled else max(case.material.ior, 1.001) ** 2
    there = case.evaluate(outside, inside, device)[0] / -inside[:, 2:] * eta2
    flip = np.array([1.0, 1.0, -1.0])
    behind = dataclasses.replace(case, front=False)
    back = behind.evaluate(inside * flip, outside * flip, device)[0] / outside[:, 2:]
    scale = np.maximum(np.maximum(there, back), 1e-3 * np.maximum(there, back).max())
    error = float((np.abs(there - back) / scale).max())
    report(f"{name}: largest relative difference", error, "< 1e-3")
    assert error < 1e-3
    assert there.max() > 0.0 or case.material.ior == 1.0


@pytest.mark.parametrize("degrees", [*ANGLES, 89.9])
@pytest.mark.parametrize("name", CASES)
def test_no_energy_is_made(name: str, degrees: float, device: str) -> None:
    """To 3σ; with multiple bounces to the error of their table as well, as for the rough metal."""
    mean, error = albedo(CASES[name], degrees, device, samples=2**16)
    table = 3e-3 if CASES[name].material.table_key else 0.0
    assert (mean <= 1.0 + table + 3.0 * error + 4.0 * EPS).all()


@pytest.mark.parametrize("name", CASES)
def test_values_are_finite(name: str, device: str) -> None:
    assert_finite(CASES[name], device)


@pytest.mark.parametrize("name", [n for n, case in WIDE.items() if not case.model.transmits])
def test_nothing_goes_through(name: str, device: str) -> None:
    below = hemisphere(10_000, seed=4) * np.array([1.0, 1.0, -1.0])
    value, pdf, delta = WIDE[name].evaluate(viewer(30.0), below, device)
    assert (value == 0.0).all()
    assert (pdf == 0.0).all()
    assert not delta.any()


# --- White furnace ------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [*ANGLES, 89.9])
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3, 0.5, 0.7, 1.0])
@pytest.mark.parametrize(
    "material",
    [P(1.0), P(1.0, ior=2.4), P(1.0, specular_color=(20.0, 5.0, 1.0)), P(1.0, multiple_bounces=True)],
    ids=["plain", "diamond", "tinted", "all bounces"],
)
def test_a_white_dielectric_reflects_all_light(
    material: wrt.Principled, roughness: float, degrees: float, device: str
) -> None:
    """Less what the albedo of its surface is overestimated by: 1 %; and of a tinted one, where it tints."""
    case = Case(dataclasses.replace(material, roughness=roughness))
    mean, error = albedo(case, degrees, device, samples=2**16)
    assert abs(mean.max() - 1.0) < 0.01 + 3.0 * error.max()


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.5, 0.7, 1.0])
def test_a_white_metal_reflects_all_light_in_many_bounces(roughness: float, degrees: float, device: str) -> None:
    """Within 1 %; and in a single one as much as is known of GGX."""
    case = Case(P(1.0, metallic=1.0, roughness=roughness, multiple_bounces=True))
    mean, error = albedo(case, degrees, device, samples=2**16)
    assert abs(mean[0] - 1.0) < 0.01 + 3.0 * error[0]
    single, error = albedo(Case(P(1.0, metallic=1.0, roughness=roughness)), degrees, device, samples=2**16)
    expected = FITS.specular_albedos(math.cos(math.radians(degrees)), max(roughness**2, 1e-4))[0]
    assert abs(single[0] - expected) < 3.5 * error[0] + 2e-4


@pytest.mark.parametrize("front", [True, False])
def test_clear_glass_loses_nothing(front: bool, device: str) -> None:
    for degrees in (0.0, 30.0, 60.0, 85.0):
        mean, error = albedo(Case(P(1.0, roughness=0.0, transmission=1.0), front), degrees, device, samples=2**16)
        assert abs(mean[0] - 1.0) < 1e-3 + 3.0 * error[0]


# --- Albedos of layers --------------------------------------------------------------------------------


def load_fits() -> ModuleType:
    """Return scripts/albedo_fits.py, whose quadratures have nothing to do with the kernels."""
    spec = importlib.util.spec_from_file_location("albedo_fits_script", ROOT / "scripts" / "albedo_fits.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FITS = load_fits()


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
            value = reference.facets(wo, wi, (alpha, alpha), "correlated") * wi[:, 2] * weights
            found = FITS.specular_albedos(math.cos(math.radians(degrees)), alpha)
            grazing = (1.0 - reference.dot(wo, reference.unit(wo + wi))) ** 5
            np.testing.assert_allclose(found, (value.sum(), (value * grazing).sum()), atol=3e-4)
        expected = (reference.charlie(wo, wi, 0.6) * wi[:, 2] * weights).sum()
        found = FITS.sheen_albedo(math.cos(math.radians(degrees)), 0.6)
        report(f"sheen at {degrees:g}°", found, expected)
        assert found == pytest.approx(expected, abs=1e-3)


def test_fits_are_above_the_albedos(device: str, report: Report) -> None:
    rng = np.random.default_rng(40)
    n = 200
    mu = (rng.random(n) ** 2 + 1e-5).clip(max=1.0)
    alpha = 10.0 ** rng.uniform(-4.0, 0.0, n)
    expected = np.array([FITS.specular_albedos(x, a, 96) for x, a in zip(mu, alpha, strict=True)])
    excess = map_function(albedo_fits.specular_albedo, mu, alpha, device=device) - expected
    for name, values, most in (("W", excess[:, 0], 0.004), ("G", excess[:, 1], 0.009)):
        report(f"{name}: least and most above", float(values.min()), float(values.max()))
        assert values.min() > -2e-4
        assert values.max() < most
    roughness = rng.uniform(0.07, 1.0, n)
    expected = np.array([FITS.sheen_albedo(x, r, 96) for x, r in zip(mu, roughness, strict=True)])
    excess = (map_function(albedo_fits.sheen_albedo, mu, roughness, device=device) - expected) / expected.clip(min=1.0)
    report("sheen: least and most above", float(excess.min()), float(excess.max()))
    assert excess.min() > -5e-4
    assert excess.max() < 0.022


def test_anisotropic_albedo_is_not_underestimated(device: str, report: Report) -> None:
    """For both extremes of reflectance at normal incidence, between which all others lie."""
    rng = np.random.default_rng(41)
    n = 300
    rough = 10.0 ** rng.uniform(-2.0, 0.0, n)
    smooth = np.maximum(rough * 10.0 ** rng.uniform(-2.0, 0.0, n), 1e-4)
    azimuth = 0.5 * np.pi * (1.0 - rng.random(n) ** 2)
    mu = rng.random(n) ** 3 + 1e-3
    mu = np.minimum(mu, 1.0)
    w = np.stack([np.sqrt(1 - mu**2) * np.cos(azimuth), np.sqrt(1 - mu**2) * np.sin(azimuth), mu], axis=1)
    shape = np.stack([rough, smooth, np.zeros(n)], axis=1)
    found = map_function(albedo_fits.facet_albedo, w, shape, device=device).astype(np.float64)
    expected = np.array([anisotropic_albedos(w[i], (rough[i], smooth[i])) for i in range(n)])
    for f0, most in ((0.04, 0.03), (1.0, 0.06)):
        excess = f0 * (found[:, 0] - expected[:, 0]) + (1.0 - f0) * (found[:, 1] - expected[:, 1])
        report(f"F0 {f0}: least, mean above", float(excess.min()), float(excess.mean()))
        assert excess.min() > -2e-3
        assert excess.mean() < most
    # Turned by a quarter it is the same.
    turned = map_function(albedo_fits.facet_albedo, w[:, [1, 0, 2]], shape[:, [1, 0, 2]], device=device)
    np.testing.assert_allclose(turned, found, atol=1e-6)


def anisotropic_albedos(wo: NDArray, alpha: tuple[float, float], n: int = 48) -> tuple[float, float]:
    """Return W and G of an anisotropic surface, by the map of the isotropic quadrature."""
    x, weights = FITS.nodes(n)
    phi, z = np.meshgrid(np.concatenate([np.pi * x, np.pi * (x + 1.0)]), x, indexing="ij")
    view = np.array([alpha[0] * wo[0], alpha[1] * wo[1], wo[2]])
    view /= np.linalg.norm(view)
    cap = z * (1.0 + view[2]) - view[2]
    radius = np.sqrt(np.maximum(1.0 - cap**2, 0.0))
    stretched = np.stack([radius * np.cos(phi), radius * np.sin(phi), cap], axis=-1) + view
    m = reference.unit((stretched * np.array([*alpha, 1.0])).reshape(-1, 3))
    cos_m = m @ wo
    light = 2.0 * cos_m[:, None] * m - wo
    up = light[:, 2] > 0.0
    hidden = reference.smith(wo[None], alpha)
    light[~up] = (0.0, 0.0, 1.0)
    seen = np.where(up, (1.0 + hidden) / (1.0 + hidden + reference.smith(light, alpha)), 0.0)
    seen *= np.outer(np.concatenate([weights, weights]) * 0.5, weights).ravel()
    return float(seen.sum()), float((seen * (1.0 - np.minimum(cos_m, 1.0)) ** 5).sum())


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


# --- The specification ----------------------------------------------------------------------------------


def albedos_of(device: str) -> Albedos:
    """Return the kernels' albedos, tested above, for the reference."""

    def each(alpha: tuple[float, float], n: int) -> NDArray:
        return np.broadcast_to(np.array([*alpha, 0.0]), (n, 3))

    def facets(w: NDArray, alpha: tuple[float, float]) -> tuple[NDArray, NDArray]:
        found = map_function(albedo_fits.facet_albedo, w, each(alpha, len(w)), device=device).astype(np.float64)
        return found[:, 0], found[:, 1]

    def average(alpha: tuple[float, float]) -> tuple[float, float]:
        white, grazing = map_function(albedo_fits.average_facet_albedo, each(alpha, 1), device=device)[0].tolist()
        return white, grazing

    def sheen(w: NDArray, roughness: float) -> NDArray:
        found = map_function(albedo_fits.sheen_albedo, w[:, 2], np.full(len(w), roughness), device=device)
        return np.asarray(found, np.float64)

    return Albedos(facets, average, sheen)


def pairs(n: int = 1000, *, below: bool = False) -> tuple[NDArray, NDArray]:
    """Return n pairs of directions, as float32 holds them."""
    wo, wi = hemisphere(n, seed=50), hemisphere(n, seed=51)
    if below:
        wi *= np.array([1.0, 1.0, -1.0])
    return wo.astype(np.float32).astype(np.float64), wi.astype(np.float32).astype(np.float64)


def regular(p: wrt.Principled, wo: NDArray, wi: NDArray, front: bool) -> tuple[NDArray, NDArray]:
    """Return the pairs away from the critical angle, where the reflectance has a vertical tangent."""
    if front or not p.transmission or p.thin_walled:
        return wo, wi
    m = reference.unit(wo + wi * (1.0 if wi[0, 2] > 0.0 else 1.0 / p.ior))
    keep = np.abs(1.0 - (1.0 - reference.dot(wo, m) ** 2) * p.ior**2) > 0.02
    return wo[keep], wi[keep]


def literal_appendix_b(p: wrt.Principled, wo: NDArray, wi: NDArray) -> NDArray:
    """Return f by the code of appendix B, section "Metal BRDF and dielectric BRDF", line by line."""
    n_l, n_v = wi[:, 2], wo[:, 2]
    h = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    n_h, v_h = h[:, 2], np.abs((wo * h).sum(axis=1))
    alpha2 = p.roughness**4
    distribution = alpha2 / (np.pi * (n_h**2 * (alpha2 - 1.0) + 1.0) ** 2)
    visibility = 1.0 / (n_l + np.sqrt(alpha2 + (1.0 - alpha2) * n_l**2))
    visibility = visibility / (n_v + np.sqrt(alpha2 + (1.0 - alpha2) * n_v**2))
    base_color = np.array(p.base_color)
    fresnel_w = ((1.0 - v_h) ** 5)[:, None]
    diffuse_brdf = base_color / np.pi
    specular_brdf = (visibility * distribution)[:, None]
    dielectric_fresnel = 0.04 + (1.0 - 0.04) * fresnel_w
    dielectric_brdf = diffuse_brdf * (1.0 - dielectric_fresnel) + specular_brdf * dielectric_fresnel
    metal_brdf = (base_color + (1.0 - base_color) * fresnel_w) * specular_brdf
    return dielectric_brdf * (1.0 - p.metallic) + metal_brdf * p.metallic


def test_reference_is_appendix_b(device: str) -> None:
    for p in (P(GOLD, metallic=1.0, roughness=0.4), P((0.8, 0.5, 0.1), metallic=0.3, roughness=0.7)):
        wo, wi = pairs()
        found = reference.value(p, APPENDIX_B, wo, wi, albedos_of(device)) / wi[:, 2:]
        np.testing.assert_allclose(found, literal_appendix_b(p, wo, wi), rtol=1e-6)


PLAIN = {
    "metal": P(GOLD, metallic=1.0, roughness=0.3),
    "rough metal": P(GOLD, metallic=1.0, roughness=0.9),
    "plastic": P((0.8, 0.5, 0.1), roughness=0.3),
    "wood": P((0.8, 0.5, 0.1), roughness=0.8),
    "half metal": P((0.8, 0.5, 0.1), metallic=0.5, roughness=0.5),
}


@pytest.mark.parametrize("name", PLAIN)
def test_is_appendix_b_but_for_masking_and_coupling(name: str, device: str, report: Report) -> None:
    """With the two parts replaced which the appendix itself calls more accurate; the table shows what each changes."""
    p = PLAIN[name]
    wo, wi = pairs()
    albedos = albedos_of(device)
    found = Case(p).evaluate(wo, wi, device)[0]
    better = dataclasses.replace(APPENDIX_B, masking="correlated", diffuse="coupled")
    assert better == dataclasses.replace(WRT, coat="appendix")
    np.testing.assert_allclose(found, reference.value(p, better, wo, wi, albedos), rtol=1e-4)
    for field in ("masking", "diffuse"):
        other = reference.value(p, dataclasses.replace(better, **{field: getattr(APPENDIX_B, field)}), wo, wi, albedos)
        report(f"{name}: {field} changes the mean by", float(other.mean() / found.mean() - 1.0))


def test_appendix_b_makes_energy(device: str, report: Report) -> None:
    """Why its coupling is not taken: a smooth white dielectric seen at 85° would reflect more light than it gets."""
    p, wo = P(1.0, roughness=0.3), viewer(85.0)
    found = Case(p).sample(wo, uniforms(2**16, 3, seed=52), device)
    wi = found["wi"][found["pdf"] > 0.0].astype(np.float64)
    appendix = reference.value(p, APPENDIX_B, np.broadcast_to(wo, wi.shape), wi, albedos_of(device))
    energy = (appendix / found["pdf"][found["pdf"] > 0.0, None]).sum() / (3.0 * len(found))
    report("reflected by appendix B and by wrt", float(energy), float(found["weight"].mean()))
    assert energy > 1.25
    assert found["weight"].mean() < 1.01


EXTENDED = {
    "ior": P((0.8, 0.5, 0.1), ior=2.2),
    "specular": P((0.8, 0.5, 0.1), specular=0.4),
    "specular colour": P((0.8, 0.5, 0.1), specular_color=(0.2, 1.0, 40.0), metallic=0.2),
    "specular-glossiness": P((0.2, 0.1, 0.0), ior=0.0, specular_color=(0.9, 0.5, 0.1)),
    "anisotropy": P(GOLD, metallic=0.5, roughness=0.4, anisotropy=0.7, anisotropy_rotation=0.8),
    "sheet": P((0.9, 0.6, 0.3), roughness=0.4, transmission=0.7, thin_walled=True, metallic=0.2),
    "body": P((0.9, 0.6, 0.3), roughness=0.5, transmission=0.7, ior=1.7, metallic=0.2, specular_color=(0.2, 1.0, 2.0)),
    "coat": P((0.8, 0.5, 0.1), roughness=0.7, coat=0.8, coat_roughness=0.3),
    "sheen": P((0.8, 0.5, 0.1), sheen_color=(0.9, 0.5, 0.1), sheen_roughness=0.35),
    "smooth sheen": P(0.1, sheen_color=(0.9, 0.5, 0.1), sheen_roughness=0.15),
    "coated velvet": P((0.8, 0.5, 0.1), sheen_color=(0.9, 0.5, 0.1), sheen_roughness=0.8, coat=1.0, coat_roughness=0.5),
    "everything": dataclasses.replace(EVERYTHING, multiple_bounces=False),
}


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("below", [False, True])
@pytest.mark.parametrize("name", EXTENDED)
def test_agrees_with_the_extensions_in_double_precision(
    name: str, below: bool, front: bool, device: str, report: Report
) -> None:
    p = EXTENDED[name]
    wo, wi = pairs(below=below)
    # The reference has sheen without its cut at cosines of 0.01, below which nothing is compared.
    keep = (wo[:, 2] > 0.01) & (np.abs(wi[:, 2]) > 0.01)
    wo, wi = regular(p, wo[keep], wi[keep], front)
    found = Case(p, front).evaluate(wo, wi, device)[0]
    if below and not p.transmission:
        assert (found == 0.0).all()
        return
    expected = reference.value(p, WRT, wo, wi, albedos_of(device), front=front)
    assert (expected > 0.0).mean() > 0.15
    scale = np.maximum(np.abs(expected), 1e-4 * np.abs(expected).max())
    error = float((np.abs(found - expected) / scale).max())
    report(f"{name}: largest relative error", error, "< 1e-4")
    assert error < 1e-4


def test_coat_is_the_extension_where_the_viewer_is_lower(device: str) -> None:
    """min(1 − E(θo), 1 − E(θi)) of a smooth coat is 1 − F(θo) of KHR_materials_clearcoat for θo ≥ θi."""
    p = P((0.8, 0.5, 0.1), roughness=0.8, coat=1.0, coat_roughness=0.02)
    wo, wi = pairs()
    appendix = dataclasses.replace(WRT, coat="appendix")
    apart = reference.unit(wo + wi)[:, 2] < 0.98  # from the mirror direction
    lower = (wo[:, 2] <= wi[:, 2]) & (wo[:, 2] > 0.2) & apart
    higher = (wo[:, 2] > wi[:, 2]) & apart
    found = Case(p).evaluate(wo, wi, device)[0]
    expected = reference.value(p, appendix, wo, wi, albedos_of(device))
    # By the fit, albedos are up to 0.007 too large.
    np.testing.assert_allclose(found[lower], expected[lower], rtol=0.02)
    assert (found[higher] < expected[higher]).all()


def test_rotation_turns_the_grain(device: str) -> None:
    along = Case(P(GOLD, metallic=1.0, roughness=0.3, anisotropy=0.8))
    across = Case(P(GOLD, metallic=1.0, roughness=0.3, anisotropy=0.8, anisotropy_rotation=0.5 * math.pi))
    wo, wi = pairs()
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(
        across.evaluate(wo @ quarter, wi @ quarter, device)[0], along.evaluate(wo, wi, device)[0], rtol=2e-5
    )


def test_an_image_gives_direction_and_strength(device: str) -> None:
    """Red and green from [0, 1] to [−1, 1], blue the strength: KHR_materials_anisotropy."""
    image = wrt.ImageTexture(np.full((1, 1, 3), 0.5, np.float32))
    textured = P(GOLD, metallic=1.0, roughness=0.3, anisotropy=image, anisotropy_rotation=0.2)
    turned = Case(P(GOLD, metallic=1.0, roughness=0.3, anisotropy=0.8, anisotropy_rotation=0.7))
    assert textured.model == turned.material.model
    row = textured.slots.index(image)
    slots = list(textured.slots)
    slots[row] = (0.5 + 0.5 * math.cos(0.5), 0.5 + 0.5 * math.sin(0.5), 0.8)
    wo, wi = pairs()
    found = Case(_Slots(tuple(slots), textured.model)).evaluate(wo, wi, device)[0]  # type: ignore[arg-type]
    np.testing.assert_allclose(found, turned.evaluate(wo, wi, device)[0], rtol=2e-5)


@dataclasses.dataclass(frozen=True)
class _Slots:
    """What Case asks of a material, to put into a slot what a texture would."""

    slots: tuple[Any, ...]
    model: str
    table_key: None = None


# --- Mitsuba ----------------------------------------------------------------------------------------------


def mitsuba_values(p: wrt.Principled, wo: NDArray, wi: NDArray, *, front: bool = True) -> tuple[NDArray, NDArray]:
    """Return what Mitsuba's `principled` of the same parameters gives: (N, 3) values and (N,) densities."""
    mi = load_mitsuba()
    bsdf = mi.load_dict(
        {
            "type": "principled",
            "base_color": {"type": "rgb", "value": list(p.base_color)},
            "metallic": p.metallic,
            "roughness": p.roughness,
            "anisotropic": p.anisotropy,
            "eta": p.ior,
            "spec_trans": p.transmission,
            "clearcoat": p.coat,
            "clearcoat_gloss": 1.0 - p.coat_roughness,
            "sheen": p.sheen_color[0],
        }
    )
    flip = np.array([1.0, 1.0, 1.0 if front else -1.0])
    surface, context = mi.SurfaceInteraction3f(), mi.BSDFContext()
    values, densities = np.empty((len(wo), 3)), np.empty(len(wo))
    for i, (view, light) in enumerate(zip(wo * flip, wi * flip, strict=True)):
        surface.wi = mi.Vector3f(*view.tolist())
        direction = mi.Vector3f(*light.tolist())
        values[i] = np.array(bsdf.eval(context, surface, direction)).ravel()
        densities[i] = bsdf.pdf(context, surface, direction)
    return values, densities


LIKE_MITSUBA = {
    "metal": P(GOLD, metallic=1.0, roughness=0.4),
    "brushed metal": P(GOLD, metallic=1.0, roughness=0.5, anisotropy=0.7),
    "black plastic": P(0.0, roughness=0.3),
    "plastic": P((0.8, 0.5, 0.1), roughness=0.6),
    "half metal": P((0.8, 0.5, 0.1), metallic=0.5, roughness=0.5),
    "glass": P((0.9, 0.6, 0.3), roughness=0.5, transmission=1.0, ior=1.5),
    "milk glass": P((0.9, 0.6, 0.3), roughness=0.5, transmission=0.5, ior=1.7),
    "coat": P((0.8, 0.5, 0.1), coat=0.8, coat_roughness=0.9),
    "velvet": P((0.8, 0.5, 0.1), sheen_color=0.7, sheen_roughness=0.5),
}


@pytest.mark.parametrize("below", [False, True])
@pytest.mark.parametrize("name", LIKE_MITSUBA)
def test_reference_with_its_choices_is_mitsuba(name: str, below: bool, device: str, report: Report) -> None:
    """So that wrt and Mitsuba differ by the fields of `Choices`, and by nothing else."""
    p = LIKE_MITSUBA[name]
    if below and not p.transmission:
        pytest.skip("opaque")
    for front in (True, False) if p.transmission else (True,):
        wo, wi = regular(p, *pairs(below=below), front)
        value, density = mitsuba_values(p, wo, wi, front=front)
        expected = reference.value(p, MITSUBA, wo, wi, albedos_of(device), front=front)
        scale = np.maximum(np.abs(expected), 1e-4 * np.abs(expected).max())
        error = float((np.abs(value - expected) / scale).max())
        report(f"{name}, front {front}: largest relative error", error, "< 1e-4")
        assert error < 1e-4
        if front and not p.coat:
            expected_density = reference.mitsuba_density(p, wo, wi)
            np.testing.assert_allclose(density, expected_density, rtol=1e-4, atol=1e-6 * expected_density.max())


@pytest.mark.parametrize("name", ["metal", "black plastic", "plastic", "half metal", "glass", "coat", "velvet"])
def test_differences_from_mitsuba_have_names(name: str, device: str, report: Report) -> None:
    """From Mitsuba's choices to wrt's one field at a time: the last of them is what the kernel computes."""
    p = LIKE_MITSUBA[name]
    wo, wi = pairs()
    keep = (wo[:, 2] > 0.01) & (wi[:, 2] > 0.01)
    wo, wi = wo[keep], wi[keep]
    albedos = albedos_of(device)
    choices = dataclasses.asdict(MITSUBA)
    values = reference.value(p, MITSUBA, wo, wi, albedos)
    for field, choice in dataclasses.asdict(WRT).items():
        choices[field] = choice
        before, values = values, reference.value(p, Choices(**choices), wo, wi, albedos)
        if not np.allclose(before, values):
            report(f"{name}: {field} changes the mean by", float(values.mean() / before.mean() - 1.0))
    np.testing.assert_allclose(Case(p).evaluate(wo, wi, device)[0], values, rtol=1e-4, atol=1e-4 * values.max())


def test_metal_agrees_with_mitsuba_but_for_masking(device: str, report: Report) -> None:
    """The quotient is that of both G: G1 G1 there, height-correlated here; densities are the same."""
    p = P(GOLD, metallic=1.0, roughness=0.5)
    wo, wi = pairs()
    theirs, their_density = mitsuba_values(p, wo, wi)
    ours, density, _ = Case(p).evaluate(wo, wi, device)
    alpha = (0.25, 0.25)
    quotient = reference.masking(wo, wi, alpha, "correlated") / reference.masking(wo, wi, alpha, "separable")
    report("masking brightens by at most", float(quotient.max() - 1.0))
    np.testing.assert_allclose(ours, theirs * quotient[:, None], rtol=1e-4)
    np.testing.assert_allclose(density, their_density, rtol=1e-4)


# --- Description --------------------------------------------------------------------------------------------


def test_a_plain_material_has_a_plain_model() -> None:
    assert P().model == "principled"
    assert P(GOLD, metallic=1.0, roughness=0.2).model == "principled"
    assert P(transmission=1.0).model == "principled:transmission"
    assert P(transmission=1.0, thin_walled=True).model == "principled:thin"
    assert P(thin_walled=True).model == "principled"
    assert EVERYTHING.model == "principled:anisotropic:transmission:coat:sheen:bounces"
    texture = wrt.ImageTexture(np.ones((1, 1, 3), np.float32))
    assert P(coat=texture, sheen_color=texture).model == "principled:coat:sheen"
    for p in (P(), EVERYTHING, P(transmission=0.5, thin_walled=True, coat=1.0)):
        assert len(p.slots) == model_of(p.model).slots <= 16
    assert not P(coat_roughness=0.5, sheen_roughness=0.5, anisotropy_rotation=1.0).features


def test_models_are_asked_for_in_order() -> None:
    for name in ("principled:sheen:coat", "principled:gold", "principled:transmission:thin", "principled:coat:coat"):
        with pytest.raises(ValueError, match="no principled model"):
            model_of(name)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"metallic": 1.5}, "metallic must be at most 1"),
        ({"roughness": -0.1}, "roughness must be at least 0"),
        ({"ior": 0.5}, "ior must be at least 1"),
        ({"ior": "gold"}, "ior: "),
        ({"ior": 0, "transmission": 0.5}, "ior 0 stands for infinite"),
        ({"base_color": (1.2, 0.0, 0.0)}, r"base_color\[0\] must be at most 1"),
        ({"specular_color": (-1.0, 0.0, 0.0)}, r"specular_color\[0\] must be at least 0"),
        ({"anisotropy": wrt.VertexColor()}, "anisotropy must be a number, or an image"),
        ({"emission": "red"}, "emission must be"),
        ({"thin_walled": 1}, "thin_walled must be true or false"),
        ({"multiple_bounces": "yes"}, "multiple_bounces must be true or false"),
        (
            {
                "multiple_bounces": True,
                "anisotropy": 0.5,
                "roughness": wrt.ImageTexture(np.ones((1, 1, 3), np.float32)),
            },
            "multiple_bounces needs a roughness",
        ),
    ],
)
def test_what_cannot_be_used_is_told(values: dict[str, Any], message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        P(**values)


def test_index_by_name() -> None:
    assert P(ior="water").ior == dielectric_ior("water")


def test_in_a_scene(device: str) -> None:
    """In a white room a white body is invisible, however it is textured; and it shines by its emission."""
    grey = wrt.ImageTexture(np.full((2, 2, 3), 0.5, np.float32))
    material = P(wrt.ImageTexture(np.ones((2, 2, 3), np.float32)), roughness=grey, emission=(0.5, 0.0, 0.0))
    scene = wrt.Scene(
        shapes=[wrt.Shape(wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)), material)],
        environment=wrt.ConstantEnvironment(1.0),
        camera=wrt.PerspectiveCamera(origin=(0, 0, 2), target=(0, 0, 0), fov_degrees=30),
    )
    image = wrt.render(scene, width=16, height=16, spp=256, device=device)
    np.testing.assert_allclose(image[..., 0], 1.5, atol=0.05)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), (1.5, 1.0, 1.0), atol=0.01)
