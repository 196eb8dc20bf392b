"""Materials made of others, and scenes that show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from conftest import Report

import wrt
from support.covering_kernels import covering
from support.small_scenes import finish
from support.statistics import t_test_mean

A, B, C = wrt.Diffuse((0.8, 0.1, 0.2)), wrt.Diffuse((0.1, 0.7, 0.3)), wrt.Mirror(0.6)
BLACK = wrt.Diffuse(0.0)
WITH_OPACITY = covering("diffuse", "mirror", "dielectric", "thin_dielectric", aovs=True, composite="holes")
"""Features of a kernel for anything made of these models, with layers, by the sampler "independent"."""


def expected_shares(material: wrt.Material, front: bool = True) -> dict[int, float]:
    """Return how often each part must answer, by identity, and nothing under 0, for constant weights."""
    if isinstance(material, wrt.Mix):
        inner = [
            (expected_shares(material.first, front), 1.0 - material.weight),
            (expected_shares(material.second, front), material.weight),
        ]
    elif isinstance(material, wrt.TwoSided):
        inner = [(expected_shares(material.front if front else material.back, front), 1.0)]
    else:
        inner = [({id(material): 1.0}, 1.0)]
    result = {0: 1.0 - material.opacity}
    for shares, weight in inner:
        for key, share in shares.items():
            result[key] = result.get(key, 0.0) + material.opacity * weight * share
    return result


def chain(depth: int, weight: float = 0.4) -> wrt.Material:
    """Return a mixture nested so deep, each part of another reflectance and somewhat transparent."""
    material: wrt.Material = wrt.Diffuse(0.9, opacity=0.7)
    for i in range(depth):
        part = wrt.Diffuse(0.1 * i, opacity=0.9 if i % 2 else 1.0)
        ends = (material, part) if i % 3 else (part, material)
        material = wrt.Mix(*ends, weight=weight if i % 2 else 1.0 - weight, opacity=0.95 if i == 3 else 1.0)
    return material


def render(scene: wrt.Scene, device: str, spp: int = 64, size: int = 16, **options: Any) -> wrt.Renderer:
    options = {"sampler": "independent", "layers": ("alpha",), "seed": 5, **options}
    return finish(wrt.Renderer(scene, width=size, height=size, device=device, **options), spp)


ROOM = (wrt.Diffuse((0.6, 0.5, 0.4)), wrt.Diffuse(wrt.VertexColor()), wrt.Mirror(0.9), wrt.Diffuse())


def room(materials: Sequence[wrt.Material] = ROOM) -> wrt.Scene:
    """A floor, a box and a ball under a lamp, a point light and an image of a sky; the last material is the lamp's."""
    sky = np.random.default_rng(4).random((4, 8, 3)).astype(np.float32)
    scene = wrt.Scene(environment=wrt.ImageEnvironment(sky))
    scene.camera = wrt.PerspectiveCamera((0.0, 1.2, 4.0), (0.0, 0.5, 0.0))
    floor, box, ball, *lamp = materials
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=floor)
    scene.add(wrt.box((-1.0, 0.0, -0.5), (-0.3, 0.8, 0.2)), material=box)
    scene.add(wrt.sphere((0.7, 0.5, 0.0), 0.5, subdivisions=3), material=ball)
    for material in lamp:
        scene.add(wrt.quad((-0.5, 2.5, -0.5), (1, 0, 0), (0, 0, 1)), material=material, emission=4.0)
    scene.add_light(wrt.PointLight((1.0, 2.0, 1.0), power=20.0))
    return scene


def assert_mean(renderer: wrt.Renderer, expected: tuple[float, ...], report: Report, claim: str) -> None:
    """The mean over the picture of each channel is as expected, all pixels expecting the same."""
    pixels = renderer.width * renderer.height
    mean = renderer.image().astype(np.float64).mean(axis=(0, 1))
    variance = renderer.variance().sum(axis=(0, 1)) / pixels**2
    p = t_test_mean(mean, np.maximum(variance, (1e-6 * np.array(expected)) ** 2), renderer.spp * pixels, expected)
    report(claim, ", ".join(f"{x:.5f}" for x in mean), ", ".join(f"{x:.5f}" for x in expected), p=float(p.min()))
    assert p.min() > 0.01 / 3.0
