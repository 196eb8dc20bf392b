"""Every reflection model at the ends of its parameters: finite, no light made, no fireflies."""

from __future__ import annotations

import dataclasses
import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from conftest import Report
from support.bsdfs import Case, assert_finite, viewer
from support.kernels import uniforms

import wrt
from wrt.scene.materials import Material

LEAST, MOST = 1e-4, 1.0
Choice = list[dict[str, Any]]


def each(name: str, *values: Any) -> Choice:
    return [{name: value} for value in values or (0.0, 1.0)]


def every(make: type, *choices: Choice) -> list[Material]:
    """Return the material for each combination of values."""
    return [make(**dict(item for part in chosen for item in part.items())) for chosen in product(*choices)]


STEPS = [
    {"ior": ior, "exterior_ior": exterior}
    for ior, exterior in ((1.0, 1.0), (1.0001, 1.0), (1.5, 1.0), (4.0, 1.0), (1.0, 1.5), (1.0, 4.0))
]
"""Indices the same, nearly so, common, high, and inverted."""
NOTHING = {"specular_reflectance": 0.0, "specular_transmittance": 0.0}
DIFFUSE, F0S, COLORS, ROUGHNESSES, METALS = map(each, ("reflectance", "f0", "base_color", "roughness", "metallic"))
ALPHAS = each("alpha", LEAST, MOST)
BRUSHED = each("alpha", LEAST, MOST, (LEAST, MOST), (MOST, LEAST))
ABC = each("alpha", (0.1, 0.0), (0.1, 100.0), (1e8, 0.0), (1e8, 3.0))
SGD = each("alpha", (1e-5, 0.0), (1e-5, 10.0), (10.0, 0.0), (1.0, 1.0))
LAYERED = {"coat": 1.0, "coat_roughness": 1.0, "sheen_color": 1.0, "anisotropy": 1.0, "multiple_bounces": True}
BURLEY = {"coat": 1.0, "coat_gloss": 1.0, "sheen": 1.0, "sheen_tint": 1.0, "specular_tint": 1.0, "anisotropy": 1.0}
LEAF = {"transmission": 0.5, "diffuse_transmission": 1.0, "thin_walled": True}
BLIND = wrt.Measured.example().measurement
"""Its facets face all ways alike. Black, it has visible normals at one node alone and brightness at another."""
VNDF, LUMINANCE = np.zeros((1, 2, 6, 6)), np.zeros((1, 2, 2, 2))
VNDF[:, :, 3, 4], LUMINANCE[..., 1, 0] = 1.0, 1.0
BLACK = dataclasses.replace(BLIND, vndf=VNDF, luminance=LUMINANCE, rgb=np.zeros_like(BLIND.rgb))

MODELS: dict[str, list[Material]] = {
    "matt": [
        *every(wrt.Diffuse, DIFFUSE),
        *every(wrt.Mirror, DIFFUSE),
        *every(wrt.OrenNayar, DIFFUSE, each("sigma", 0.0, 1e-4, 0.5 * math.pi)),
        *every(wrt.Glossy, DIFFUSE, [*each("side", 1e-12, 1e-4, 100.0), *each("exponent", 0.0, 1e5)]),
        *every(wrt.Conductor, [*F0S, {"eta": 1.0, "k": 0.0}, {"eta": 1e-3, "k": 100.0}]),
    ],
    "smooth boundaries": [
        *every(wrt.Dielectric, STEPS, [{}, NOTHING]),
        *every(wrt.ThinDielectric, STEPS, [{}, NOTHING]),
        *every(wrt.Plastic, STEPS, [*DIFFUSE, {"reflectance": 1.0, "nonlinear": True}]),
    ],
    "rough metals": [
        *every(wrt.RoughConductor, F0S, each("distribution", "ggx", "beckmann"), BRUSHED),
        *every(wrt.RoughConductor, F0S, [{"distribution": "blinn-phong"}, {"multiple_bounces": True}], ALPHAS),
        *every(wrt.RoughConductor, F0S, [{"distribution": "abc", "masking": "cook-torrance"}], ABC),
        *every(wrt.RoughConductor, F0S, [{"distribution": "sgd", "masking": "cook-torrance"}], SGD),
        wrt.RoughConductor(MOST, f0=1.0, distribution="beckmann", multiple_bounces=True),
        *(wrt.RoughConductor(LEAST, eta=1.0, k=0.0), wrt.RoughConductor(MOST, eta=1e-3, k=100.0)),
    ],
    "rough glass": [
        *every(
            wrt.RoughDielectric,
            [STEPS[0], {"ior": 1.0011}, STEPS[2], STEPS[4]],
            [*each("distribution", "ggx", "beckmann", "blinn-phong"), {"multiple_bounces": True}],
            ALPHAS,
        ),
        *(wrt.RoughDielectric(alpha=(LEAST, MOST)), wrt.RoughDielectric(alpha=LEAST, **NOTHING)),
    ],
    "rough plastic": [
        *every(wrt.RoughPlastic, [STEPS[0], STEPS[2], STEPS[4]], DIFFUSE, ALPHAS),
        *every(wrt.RoughPlastic, [{"reflectance": 1.0, "distribution": "beckmann", "nonlinear": True}], ALPHAS),
        wrt.RoughPlastic(1.0, alpha=LEAST, nonlinear=True, multiple_bounces=True),
    ],
    "principled": [
        *every(wrt.Principled, COLORS, ROUGHNESSES, METALS, [{}, {"ior": 1.0, **LAYERED}]),
        *every(wrt.Principled, COLORS, ROUGHNESSES, each("ior", 1.0, 1.5), [{"transmission": 1.0}]),
        *every(wrt.Principled, COLORS, ROUGHNESSES, [{"transmission": 1.0, "thin_walled": True}]),
        *every(wrt.Principled, COLORS, ROUGHNESSES, [{"ior": 0.0, "specular_color": 1.0}]),
        wrt.Principled(1.0, sheen_color=1.0, sheen_roughness=1.0),
    ],
    # Without `flatness`, whose published term grows without limit as both directions approach the surface.
    "burley": [
        *every(wrt.Burley, COLORS, ROUGHNESSES, METALS, [{}, {"ior": 1.0, **BURLEY}]),
        *every(wrt.Burley, COLORS, ROUGHNESSES, [{"ior": 1.0, "transmission": 1.0}, {"transmission": 1.0}, LEAF]),
    ],
    "measured": [
        *map(wrt.Measured, (BLIND, BLACK)),
        wrt.Measured(dataclasses.replace(BLACK, ndf=np.zeros_like(BLIND.ndf), sigma=np.zeros_like(BLIND.sigma))),
    ],
}


def brightest(material: Material) -> float:
    """Return the most energy: of Burley's highlights, a white base at grazing angles and sheen, which are added."""
    return 1.0 + 1.5 + 1.0 if isinstance(material, wrt.Burley) else 1.0


def tolerance(material: Material) -> float:
    """Return by how much the mean may exceed 1: tables interpolate, half vectors lose digits near the horizon."""
    return 0.01 if material.table_key else 3e-3


BRIGHTEST_SAMPLE = 20.0
"""Values over densities stay below 2 for a single lobe, and below 17 where one that is seldom chosen counts much."""


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_models_at_their_extremes(name: str, device: str, report: Report) -> None:
    """Energy is what is left of the weight's mean over η²; single weights are as large as good samplings have them."""
    largest = 0.0
    for material in MODELS[name]:
        body = isinstance(material, (wrt.Dielectric, wrt.RoughDielectric)) or getattr(material, "transmission", 0.0)
        for front in (True, False) if body else (True,):
            case = Case(material, front)
            assert_finite(case, device, n=4_000)
            limit = brightest(material)
            for degrees in (30.0, 85.0, 89.9):
                found = case.sample(viewer(degrees), uniforms(2**12, 3, seed=7), device)
                energy = found["weight"].astype(np.float64).max(axis=1) * found["eta"].astype(np.float64) ** 2
                largest = max(largest, float(energy.max()) / limit)
                error = 5.0 * energy.std() / math.sqrt(len(energy))
                assert energy.mean() <= limit + tolerance(material) + error, f"{case} at {degrees}°"
                assert energy.max() < BRIGHTEST_SAMPLE * limit, f"{case} at {degrees}°"
    report("the largest weight", largest, f"< {BRIGHTEST_SAMPLE}")
