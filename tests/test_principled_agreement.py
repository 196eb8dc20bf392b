"""The material of glTF files against the specification, line by line, and against Mitsuba's `principled`."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support import principled_reference as reference
from support.bsdfs import Case, hemisphere, viewer
from support.kernels import map_function, uniforms
from support.mitsuba_scene import load_mitsuba
from support.principled_reference import APPENDIX_B, MITSUBA, WRT, Albedos, Choices

import wrt
from wrt.kernels.bsdf.lobes import albedo_fits

P = wrt.Principled
GOLD = (1.0, 0.71, 0.29)


def albedos_of(device: str) -> Albedos:
    """Return the kernels' albedos for the reference: `test_albedo_fits.py` tests them by themselves."""

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


ABOVE = {"facets": (0.004, 0.009), "sheen": 0.022, "averages": 1e-3, "least": 5e-4}
"""By how much the fits may exceed the albedos and fall short of them: `test_albedo_fits.py` shows these limits."""


@functools.cache
def specular(mu: float, alpha: float) -> tuple[float, float]:
    """Return W and G by quadrature over the lobe."""
    white, grazing = reference.load_fits().specular_albedos(mu, alpha, 64)
    return white, grazing


@functools.cache
def velvet(mu: float, roughness: float) -> float:
    """Return the albedo of white sheen by quadrature over the lobe."""
    return float(reference.load_fits().sheen_albedo(mu, roughness, 64))


def integrated_albedos(*, highest: bool) -> Albedos:
    """Return albedos by quadrature over the published lobes, moved to that end of what the fits may return.

    Every value of the model falls as the albedos of its directions rise, and rises with their averages.
    """
    slack = np.array(ABOVE["facets"]) if highest else np.full(2, -ABOVE["least"])

    def facets(w: NDArray, alpha: tuple[float, float]) -> tuple[NDArray, NDArray]:
        assert alpha[0] == alpha[1]
        found = np.array([specular(mu, alpha[0]) for mu in w[:, 2].tolist()]) + slack
        return np.minimum(found[:, 0], 1.0), found[:, 1]

    def average(alpha: tuple[float, float]) -> tuple[float, float]:
        x, weights = reference.load_fits().nodes(32)
        found = (6.0 * weights * x**5) @ np.array([specular(mu, alpha[0]) for mu in (x**3).tolist()])
        # Where directions are high, their mean is low: both make the value smallest.
        found = found - ABOVE["averages"] - ABOVE["least"] if highest else found + ABOVE["facets"]
        return float(found[0]), float(found[1])

    def sheen(w: NDArray, roughness: float) -> NDArray:
        found = np.array([velvet(mu, roughness) for mu in w[:, 2].tolist()])
        return np.asarray(found + np.maximum(found, 1.0) * (ABOVE["sheen"] if highest else -ABOVE["least"]))

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
    "everything": P(
        (0.9, 0.6, 0.3),
        metallic=0.3,
        anisotropy=0.6,
        anisotropy_rotation=0.5,
        transmission=0.5,
        coat=0.5,
        coat_roughness=0.3,
        sheen_color=(0.5, 0.3, 0.1),
        sheen_roughness=0.4,
    ),
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


INTEGRATED = {
    **{name: PLAIN[name] for name in ("plastic", "wood", "half metal")},
    **{name: EXTENDED[name] for name in ("ior", "specular colour", "body", "coat", "sheen", "coated velvet")},
}


@pytest.mark.parametrize("name", INTEGRATED)
def test_agrees_with_integrals_of_its_lobes(name: str, device: str, report: Report) -> None:
    """What diffuse, coat and sheen leave to each other, by quadrature in place of the kernels' albedos."""
    p = INTEGRATED[name]
    wo, wi = pairs(80)
    keep = (wo[:, 2] > 0.01) & (wi[:, 2] > 0.01)
    wo, wi = wo[keep], wi[keep]
    found = Case(p).evaluate(wo, wi, device)[0]
    low, high = (reference.value(p, WRT, wo, wi, integrated_albedos(highest=highest)) for highest in (True, False))
    width = float(((high - low) / high.clip(min=1e-9)).mean())
    report(f"{name}: mean width of the interval", width, "< 0.05")
    assert width < 0.05
    slack = 1e-4 * high + 1e-7
    assert ((low - slack <= found) & (found <= high + slack)).all()


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


NAMED = ["metal", "black plastic", "plastic", "half metal", "glass", "coat", "velvet"]


@pytest.mark.parametrize(("name", "below"), [*((name, False) for name in NAMED), ("glass", True)])
def test_differences_from_mitsuba_have_names(name: str, below: bool, device: str, report: Report) -> None:
    """From Mitsuba's choices to wrt's one field at a time: the last of them is what the kernel computes."""
    p = LIKE_MITSUBA[name]
    wo, wi = pairs(below=below)
    keep = (wo[:, 2] > 0.01) & (np.abs(wi[:, 2]) > 0.01)
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
