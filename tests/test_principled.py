"""The material of glTF files as every reflection model: sampling, energy, reciprocity; and how it is described."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from conftest import Report
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
)
from support.principled_reference import load_fits

import wrt
from wrt.kernels.bsdf import model_of
from wrt.scene.materials.presets import dielectric_ior

pytestmark = pytest.mark.slow

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


@pytest.mark.parametrize("degrees", [45.0, 89.0])
@pytest.mark.parametrize("name", CASES)
def test_weight_is_value_over_density(name: str, degrees: float, device: str) -> None:
    # On an H200 two of 100,000 samples of brushed metal at 89 degrees differ by 1.7e-5: products are fused there.
    assert_weights(CASES[name], degrees, device, rtol=3e-5)


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
    assert_nothing_goes_through(WIDE[name], device)


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
    expected = load_fits().specular_albedos(math.cos(math.radians(degrees)), max(roughness**2, 1e-4))[0]
    assert abs(single[0] - expected) < 3.5 * error[0] + 2e-4


@pytest.mark.parametrize("front", [True, False])
def test_clear_glass_loses_nothing(front: bool, device: str) -> None:
    for degrees in (0.0, 30.0, 60.0, 85.0):
        mean, error = albedo(Case(P(1.0, roughness=0.0, transmission=1.0), front), degrees, device, samples=2**16)
        assert abs(mean[0] - 1.0) < 1e-3 + 3.0 * error[0]


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
        ({"ior": 0, "transmission": 0.5}, "ior 0 means infinite"),
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
            "multiple_bounces needs roughness",
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
