"""The material of glTF files against the specification and its extensions, in double precision, and its models."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support import principled_reference as reference
from support.bsdfs import FLAT, Case, Tilted, hemisphere

import wrt

P = wrt.Principled
GOLD, WOOD = (1.0, 0.71, 0.29), (0.8, 0.5, 0.1)


def pairs(n: int = 1000, *, below: bool = False) -> tuple[NDArray, NDArray]:
    """Return pairs of directions, as float32 holds them, above the cosine of 0.01 at which sheen is cut."""
    wo, wi = hemisphere(n, seed=50), hemisphere(n, seed=51)
    keep = (wo[:, 2] > 0.01) & (wi[:, 2] > 0.01)
    wo, wi = wo[keep], wi[keep] * np.array([1.0, 1.0, -1.0 if below else 1.0])
    return wo.astype(np.float32).astype(np.float64), wi.astype(np.float32).astype(np.float64)


def regular(p: wrt.Principled, wo: NDArray, wi: NDArray, front: bool) -> tuple[NDArray, NDArray]:
    """Return the pairs away from the critical angle, where the reflectance has a vertical tangent."""
    if front or not p.transmission or p.thin_walled:
        return wo, wi
    m = reference.unit(wo + wi * (1.0 if wi[0, 2] > 0.0 else 1.0 / p.ior))
    keep = np.abs(1.0 - (1.0 - reference.dot(wo, m) ** 2) * p.ior**2) > 0.02
    return wo[keep], wi[keep]


def relative_error(found: NDArray, expected: NDArray) -> float:
    scale = np.maximum(np.abs(expected), 1e-4 * np.abs(expected).max())
    return float((np.abs(found - expected) / scale).max())


# --- The specification --------------------------------------------------------------------------------


MATERIALS = {
    "half metal": P(WOOD, metallic=0.5, roughness=0.5),
    "ior": P(WOOD, ior=2.2, specular=0.4),
    "specular colour": P(WOOD, specular_color=(0.2, 1.0, 40.0), metallic=0.2),
    "specular-glossiness": P((0.2, 0.1, 0.0), ior=0.0, specular_color=(0.9, 0.5, 0.1)),
    "anisotropy": P(GOLD, metallic=0.5, roughness=0.4, anisotropy=0.7, anisotropy_rotation=0.8),
    "sheet": P((0.9, 0.6, 0.3), roughness=0.4, transmission=0.7, thin_walled=True, metallic=0.2),
    "body": P((0.9, 0.6, 0.3), transmission=0.7, ior=1.7, metallic=0.2, specular_color=(0.2, 1.0, 2.0)),
    "coat": P(WOOD, roughness=0.7, coat=0.8, coat_roughness=0.3),
    "sheen": P(WOOD, sheen_color=(0.9, 0.5, 0.1), sheen_roughness=0.35),
    "coated velvet": P(WOOD, sheen_color=(0.9, 0.5, 0.1), sheen_roughness=0.8, coat=1.0, coat_roughness=0.5),
}
MATERIALS["everything"] = dataclasses.replace(
    MATERIALS["coated velvet"], metallic=0.3, anisotropy=0.6, anisotropy_rotation=0.5, transmission=0.5, coat=0.5
)
QUICK = ("half metal", "coated velvet")


def slow_but_quick(names: Iterable[str]) -> list[Any]:
    return [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in names]


@pytest.mark.parametrize("name", slow_but_quick(MATERIALS))
def test_agrees_with_the_extensions_in_double_precision(name: str, device: str, report: Report) -> None:
    """On both sides, seen from both."""
    p = MATERIALS[name]
    for front, below in ((True, False), (False, False), (True, True), (False, True)):
        wo, wi = regular(p, *pairs(below=below), front)
        found = Case(p, front).evaluate(wo, wi, device)[0]
        if below and not p.transmission:
            assert not found.any()
            continue
        expected = reference.value(p, wo, wi, device, front=front)
        assert (expected > 0.0).mean() > 0.15
        error = relative_error(found, expected)
        report(f"{name}, front {front}, below {below}: largest relative error", error, "< 1e-4")
        assert error < 1e-4


@pytest.mark.slow
def test_an_image_gives_direction_and_strength_of_the_grain(device: str) -> None:
    """Red and green from [0, 1] to [−1, 1], blue the strength: KHR_materials_anisotropy. A rotation turns it."""
    image = wrt.ImageTexture(np.full((1, 1, 3), 0.5, np.float32))
    textured = P(GOLD, metallic=1.0, roughness=0.3, anisotropy=image, anisotropy_rotation=0.2)
    turned = Case(P(GOLD, metallic=1.0, roughness=0.3, anisotropy=0.8, anisotropy_rotation=0.7))
    assert textured.model == turned.material.model
    slots = list(textured.slots)
    slots[textured.slots.index(image)] = (0.5 + 0.5 * math.cos(0.5), 0.5 + 0.5 * math.sin(0.5), 0.8)
    wo, wi = pairs()
    found = Case(SimpleNamespace(slots=slots, model=textured.model, table_key=None)).evaluate(wo, wi, device)[0]
    np.testing.assert_allclose(found, turned.evaluate(wo, wi, device)[0], rtol=2e-5)


def about(normal: tuple[float, float, float], w: NDArray) -> NDArray:
    """Return directions in a frame about a normal; isotropic lobes are the same in all such frames."""
    z = np.array(normal) / np.linalg.norm(normal)
    x = np.cross(z, [0.3, 1.0, 0.2])
    x /= np.linalg.norm(x)
    return w @ np.stack([x, np.cross(z, x), z], axis=1)


def test_a_coat_with_normals_of_its_own_is_turned_and_its_base_is_not(device: str, report: Report) -> None:
    """KHR_materials_clearcoat: the coat reflects as a flat one in its own frame, and leaves as much to the base."""
    coat, base = (0.4, -0.2, 1.0), (-0.3, 0.1, 1.0)
    coated = P(WOOD, roughness=0.6, coat=0.8, coat_roughness=0.4)
    coat_alone = dataclasses.replace(coated, base_color=0.0, specular=0.0)
    base_alone = dataclasses.replace(coated, coat=0.0)
    wo, wi = pairs(4000)
    keep = np.all([about(n, w)[:, 2] > 0.05 for n in (coat, base) for w in (wo, wi)], axis=0)
    wo, wi = wo[keep], wi[keep]

    def tilted(p: wrt.Principled) -> NDArray:
        return Tilted(dataclasses.replace(p, coat_normal_map=FLAT), True, coat, base).evaluate(wo, wi, device)[0]

    def flat(p: wrt.Principled, normal: tuple[float, float, float]) -> NDArray:
        return Case(p).evaluate(about(normal, wo), about(normal, wi), device)[0]

    left = (flat(coated, coat) - flat(coat_alone, coat)) / flat(base_alone, coat)
    for what, found, expected in (
        ("the coat", tilted(coat_alone), flat(coat_alone, coat)),
        ("its base", tilted(coated) - tilted(coat_alone), flat(base_alone, base) * left),
    ):
        error = relative_error(found, expected)
        report(f"{what}: largest relative error", error, "< 1e-4")
        assert error < 1e-4


# --- Description --------------------------------------------------------------------------------------------
