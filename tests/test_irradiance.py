"""Light from each kind of light on a plane, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.statistics import sidak, t_test_mean

import wrt

REFLECTANCE = 0.5
SIZE = 16
POINTS = np.linspace(-1.5, 1.5, SIZE)


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
    renderer = wrt.Renderer(scene, width=SIZE, height=SIZE, max_depth=2, device=device, filter="box", seed=3, **options)
    for _ in renderer.passes(spp=spp):
        pass
    x, z = np.meshgrid(POINTS, POINTS)
    scale = math.pi / REFLECTANCE
    return np.stack([x, z]), renderer.image()[..., 0] * scale, renderer.variance()[..., 0] * scale**2


def pixel_mean(function, where: NDArray) -> NDArray:
    """Return the mean of a function over each pixel, by a 4x4 Gauss-Legendre rule."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half = 0.5 * (POINTS[1] - POINTS[0])
    x, z = where
    total = 0.0
    for a, wa in zip(nodes, weights, strict=True):
        for b, wb in zip(nodes, weights, strict=True):
            total = total + 0.25 * wa * wb * function(x + half * a, z + half * b)
    return total


def check(claim: str, measured: NDArray, variance: NDArray, expected: NDArray, n: int, report: Report) -> None:
    p = t_test_mean(measured, variance, n, expected)
    report(f"{claim}: mean irradiance", float(measured.mean()), float(expected.mean()), p=float(p.min()))
    assert p.min() > sidak(0.01, p.size)
    # All pixels together see a bias that none shows alone.
    total_p = float(t_test_mean(measured.mean(), variance.sum() / variance.size**2, n * p.size, expected.mean()))
    report(f"{claim}: all pixels", float(measured.mean() / expected.mean()), 1.0, p=total_p)
    assert total_p > 0.01


@pytest.mark.parametrize("given", ["intensity", "power"])
def test_point_light(given: str, device: str, report: Report) -> None:
    """E = I cosθ / r²; isotropic power P is the intensity P / 4π."""
    scene = floor_scene()
    intensity = 3.0
    amount = {"intensity": intensity} if given == "intensity" else {"power": intensity * 4.0 * math.pi}
    scene.add_light(wrt.PointLight((0.4, 1.2, -0.3), **amount))
    where, measured, variance = irradiance(scene, device, 4096)

    def expected(x: NDArray, z: NDArray) -> NDArray:
        r2 = (x - 0.4) ** 2 + 1.2**2 + (z + 0.3) ** 2
        return intensity * 1.2 / r2**1.5

    check(f"point light by {given}", measured, variance, pixel_mean(expected, where), 4096, report)


def test_directional_light(device: str) -> None:
    """E = irradiance · cosθ everywhere, with no variance."""
    scene = floor_scene()
    scene.add_light(wrt.DirectionalLight((1.0, -2.0, 0.5), irradiance=2.0))
    _, measured, _ = irradiance(scene, device, 4)
    np.testing.assert_allclose(measured, 2.0 * 2.0 / math.sqrt(5.25), rtol=1e-5)


def rectangle_irradiance(x: NDArray, z: NDArray, height: float, half: tuple[float, float]) -> NDArray:
    """Irradiance of a horizontal rectangle of radiance 1 above (0, 0), facing down.

    The configuration factor of a parallel rectangle over a corner (Howell, B-4) summed over the
    four rectangles that meet above the point.
    """

    def corner(a: NDArray, b: NDArray) -> NDArray:
        a, b = a / height, b / height
        ra, rb = np.sqrt(1.0 + a * a), np.sqrt(1.0 + b * b)
        return (a / ra * np.arctan(b / ra) + b / rb * np.arctan(a / rb)) / (2.0 * math.pi)

    total = 0.0
    for sa, ea in ((1.0, half[0] - x), (-1.0, -half[0] - x)):
        for sb, eb in ((1.0, half[1] - z), (-1.0, -half[1] - z)):
            total = total + sa * sb * corner(ea, eb)
    return math.pi * total


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_rectangular_light(strategy: str, device: str, report: Report) -> None:
    scene = floor_scene(eye=0.9)
    # Edges so ordered that the front faces down.
    scene.add(wrt.quad((-0.6, 1.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8)), material=wrt.Diffuse(0.0), emission=1.0)
    spp = 4096
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)
    expected = pixel_mean(lambda x, z: rectangle_irradiance(x, z, 1.0, (0.6, 0.4)), where)
    check(f"rectangle, {strategy}", measured, variance, expected, spp, report)


def test_one_sided_light_is_dark_behind(device: str) -> None:
    scene = floor_scene(eye=0.9)
    scene.add(wrt.quad((-0.6, 1.0, -0.4), (0.0, 0.0, 0.8), (1.2, 0.0, 0.0)), material=wrt.Diffuse(0.0), emission=1.0)
    _, measured, _ = irradiance(scene, device, 16)
    assert measured.max() == 0.0


@pytest.mark.parametrize("strategy", ["mis", "light"])
def test_image_environment_of_one_value_is_a_constant_one(strategy: str, device: str, report: Report) -> None:
    """E = π L on an open floor, whatever the image's resolution."""
    scene = floor_scene()
    scene.environment = wrt.ImageEnvironment(np.full((7, 13, 3), 0.8, np.float32), rotation_degrees=33.0)
    where, measured, variance = irradiance(scene, device, 1024, strategy=strategy)
    check(f"uniform image, {strategy}", measured, variance, np.full_like(where[0], 0.8 * math.pi), 1024, report)


def test_emission_is_seen_as_it_is(device: str) -> None:
    scene = floor_scene()
    light = wrt.quad((-9.0, 1.0, -9.0), (18.0, 0.0, 0.0), (0.0, 0.0, 18.0))
    scene.add(light, material=wrt.Diffuse(0.0), emission=(1.0, 2.0, 3.0), two_sided_emission=True)
    image = wrt.render(scene, width=8, height=8, spp=2, device=device)
    np.testing.assert_array_equal(image, np.broadcast_to(np.float32([1.0, 2.0, 3.0]), image.shape))
