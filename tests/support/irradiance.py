"""A floor under lights, whose irradiance is known in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from conftest import Report
from numpy.typing import NDArray

import wrt
from support.covering_kernels import covering
from support.small_scenes import finish
from support.statistics import sidak, t_test_mean
from wrt.kernels.lights.shapes import BUILT_IN

REFLECTANCE = 0.5
SIZE = 16
POINTS = np.linspace(-1.5, 1.5, SIZE)

EVERY_LIGHT = replace(covering("diffuse", composite="holes"), light_shapes=(*BUILT_IN, "projector"))
"""Features of a kernel for matt scenes with lights of all kinds, by the sampler "independent"."""


def floor_scene(eye: float = 50.0) -> wrt.Scene:
    """A floor of one reflectance, seen from straight above at a height; pixel centres meet it at POINTS."""
    scene = wrt.Scene()
    scene.add(wrt.quad((-8.0, 0.0, 8.0), (16.0, 0.0, 0.0), (0.0, 0.0, -16.0)), material=wrt.Diffuse(REFLECTANCE))
    extent = 3.0 * SIZE / (SIZE - 1)
    fov = 2.0 * math.degrees(math.atan(0.5 * extent / eye))
    scene.camera = wrt.PerspectiveCamera((0.0, eye, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov_degrees=fov)
    return scene


def irradiance(scene: wrt.Scene, device: str, spp: int, **options: object) -> tuple[NDArray, NDArray, NDArray]:
    """Return where the pixel centres meet the floor, the irradiance there and the variance of that."""
    options = {"sampler": "independent", "max_depth": 2, "filter": "box", "seed": 3, **options}
    renderer = finish(wrt.Renderer(scene, width=SIZE, height=SIZE, device=device, **options), spp)
    scale = math.pi / REFLECTANCE
    where = np.stack(np.meshgrid(POINTS, POINTS))
    return where, renderer.image()[..., 0] * scale, renderer.variance()[..., 0] * scale**2


def pixel_mean(function: Callable[[NDArray, NDArray], NDArray], where: NDArray) -> NDArray:
    """Return the mean of a function over each pixel, by a 4x4 Gauss-Legendre rule."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half = 0.5 * (POINTS[1] - POINTS[0])
    x, z = where
    total = np.zeros_like(x)
    for a, wa in zip(nodes, weights, strict=True):
        for b, wb in zip(nodes, weights, strict=True):
            total = total + 0.25 * wa * wb * function(x + half * a, z + half * b)
    return total


def check(claim: str, measured: NDArray, variance: NDArray, expected: NDArray, n: int, report: Report) -> None:
    """Test each pixel, and all pixels together, which see a bias that none shows alone."""
    p = t_test_mean(measured, variance, n, expected)
    report(f"{claim}: mean irradiance", float(measured.mean()), float(expected.mean()), p=float(p.min()))
    assert p.min() > sidak(0.01, p.size)
    total_p = mean_p(measured, variance, n, expected)
    report(f"{claim}: all pixels", float(measured.mean() / expected.mean()), 1.0, p=total_p)
    assert total_p > 0.01


def mean_p(measured: NDArray, variance: NDArray, n: int, expected: NDArray) -> float:
    """Return how probable the mean over all pixels is if it should be that of `expected`."""
    return float(t_test_mean(measured.mean(), variance.sum() / variance.size**2, n * measured.size, expected.mean()))


def rectangle_irradiance(x: NDArray, z: NDArray, height: float, half: tuple[float, float]) -> NDArray:
    """Irradiance of a horizontal rectangle of radiance 1 above (0, 0), facing down.

    The configuration factor of a parallel rectangle over a corner (Howell, B-4) summed over the four rectangles that
    meet above the point.
    """

    def corner(a: NDArray, b: NDArray) -> NDArray:
        a, b = a / height, b / height
        ra, rb = np.sqrt(1.0 + a * a), np.sqrt(1.0 + b * b)
        return (a / ra * np.arctan(b / ra) + b / rb * np.arctan(a / rb)) / (2.0 * math.pi)

    total = np.zeros_like(x)
    for sa, ea in ((1.0, half[0] - x), (-1.0, -half[0] - x)):
        for sb, eb in ((1.0, half[1] - z), (-1.0, -half[1] - z)):
            total = total + sa * sb * corner(ea, eb)
    return math.pi * total


def disk_irradiance(x: NDArray, z: NDArray, height: float, radius: float) -> NDArray:
    """Irradiance of a horizontal disk of radiance 1 above (0, 0), facing down (Howell, B-13)."""
    r2, h2, a2 = x * x + z * z, height * height, radius * radius
    return 0.5 * math.pi * (1.0 - (h2 + r2 - a2) / np.sqrt((h2 + r2 + a2) ** 2 - 4.0 * a2 * r2))
