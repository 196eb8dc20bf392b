"""Path tracing is unbiased: furnaces with a known radiance, and estimators that must agree.

A closed box of albedo a whose walls emit 1 has the radiance 1 / (1 − a) everywhere inside: every bounce finds the same
walls, so it is the geometric series 1 + a + a² + …
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.covering_kernels import render_with
from support.kernels import map_function
from support.media import KERNELS, render
from support.statistics import image_z_test, t_test_mean

import wrt
from wrt.kernels.integrators.next_event import STRATEGY_BSDF, STRATEGY_LIGHT, STRATEGY_MIS, mis_weight

Array = NDArray[np.float64]


@pytest.fixture(autouse=True)
def one_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    render_with(KERNELS, monkeypatch)


def check_mean(renderer: wrt.Renderer, claim: str, expected: float, report: Report) -> None:
    """Test the mean of all pixels; channels of a grey scene are equal, so one channel is the sample."""
    image, variance = renderer.image()[..., 0].astype(np.float64), renderer.variance()[..., 0]
    mean, error = float(image.mean()), float(np.sqrt(variance.sum())) / image.size
    report(claim, mean, expected, p=t_test_mean(mean, error**2, image.size * renderer.spp, expected))
    assert abs(mean - expected) < 3.0 * max(error, 1e-6 * expected)


def furnace(albedo: float) -> wrt.Scene:
    outside = wrt.box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(0.3, -0.2, 0.5), target=(-0.4, 0.3, -1.0), fov_degrees=90))
    inside = wrt.Mesh(outside.vertices, outside.faces[:, ::-1])
    scene.add(inside, material=wrt.Diffuse(albedo), emission=1.0)
    return scene


@pytest.mark.parametrize("strategy", ["mis", *(pytest.param(s, marks=pytest.mark.slow) for s in ("light", "bsdf"))])
def test_radiance_of_a_furnace(strategy: str, device: str, report: Report) -> None:
    renderer = render(furnace(0.8), device, size=(32, 32), spp=512, max_depth=1000, strategy=strategy, seed=1)
    check_mean(renderer, f"a = 0.8, {strategy}: radiance", 5.0, report)


def test_bsdf_sampling_alone_is_exact_but_for_roulette(device: str) -> None:
    """Below the roulette depth a furnace has no variance at all: each path sees 1 + a + … + a^(d−1)."""
    image = render(furnace(0.5), device, size=(8, 8), spp=16, max_depth=4, strategy="bsdf").image()
    np.testing.assert_allclose(image, 1.875, rtol=1e-6)


def test_a_glass_block_in_a_furnace_cannot_be_seen(device: str, report: Report) -> None:
    """Reflection and refraction together lose nothing, and η² cancels between entry and exit.

    A block, not a ball of facets: reflections in a block keep the size of each component of a direction, so light that
    came in can always leave. In a ball of facets some is caught for hundreds of reflections, and what roulette makes of
    that is too rare to be seen in a mean.
    """
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera(origin=(1.8, 1.3, 3.0), fov_degrees=30)
    scene.add(wrt.box((-0.7, -0.5, -0.6), (0.7, 0.5, 0.6)), material=wrt.Dielectric(ior=1.5))
    renderer = render(scene, device, size=(32, 32), spp=256, max_depth=1000)
    check_mean(renderer, "mean radiance through glass", 1.0, report)


@pytest.mark.parametrize("material", [wrt.Diffuse((0.1, 0.2, 0.3)), wrt.Mirror(0.7)])
def test_a_convex_body_under_a_constant_sky(material: wrt.Diffuse | wrt.Mirror, device: str) -> None:
    """Nothing blocks the sky, so a ball of facets shows its reflectance times the sky's radiance."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(2.0))
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 0.0, 4.0), fov_degrees=10)
    ball = wrt.sphere(subdivisions=3)
    scene.add(wrt.Mesh(ball.vertices, ball.faces), material=material)
    image = render(scene, device, size=(8, 8), spp=4).image()
    np.testing.assert_allclose(image, np.broadcast_to(2.0 * np.array(material.reflectance), image.shape), rtol=1e-5)


def under_an_image() -> wrt.Scene:
    pixels = np.random.default_rng(5).uniform(0.0, 0.5, (16, 32, 3)).astype(np.float32)
    pixels[3:5, 8:10] = 20.0
    scene = wrt.Scene(environment=wrt.ImageEnvironment(pixels, rotation_degrees=70.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 2.0, 4.0), (0.0, 0.3, 0.0))
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Diffuse(0.6))
    scene.add(wrt.box((-0.5, 0.0, -0.5), (0.5, 1.0, 0.5)), material=wrt.Diffuse((0.8, 0.3, 0.2)))
    scene.add(wrt.sphere((1.2, 0.5, 0.3), 0.5), material=wrt.Mirror(0.9))
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cornell-box", pytest.param("image", marks=pytest.mark.slow)])
def test_estimators_agree(name: str, device: str, report: Report) -> None:
    """Same light, other variance."""
    scene = under_an_image() if name == "image" else wrt.load(name)
    spp = {"mis": 256, "light": 256, "bsdf": 1024 if name == "image" else 2048}
    results = {}
    for seed, (strategy, count) in enumerate(spp.items()):
        renderer = render(scene, device, size=(32, 32), spp=count, max_depth=8, seed=seed + 10, strategy=strategy)
        results[strategy] = renderer.image(), renderer.variance()
    for a, b in combinations(results, 2):
        test = image_z_test(*results[a], *results[b])
        report(f"{a} against {b}: pixels that agree", test.pass_fraction, ">= 0.995", p=test.p_min)
        assert test.pass_fraction >= 0.995, test.message
        total = [float(results[k][0].astype(np.float64).mean()) for k in (a, b)]
        error = np.sqrt(sum(float(results[k][1].sum()) for k in (a, b))) / results[a][0].size
        # The channels of a pixel share their paths: at worst they are one sample, which widens the error of the mean by
        # the root of three.
        assert abs(total[0] - total[1]) < 3.0 * np.sqrt(3.0) * error


def weights(p: Array, q: Array, this: int, device: str, strategy: int = STRATEGY_MIS) -> Array:
    """Return the kernels' weights of samples that were drawn in one of two ways, with the density p."""
    strategies, ways = (np.full(len(p), int(which), np.int32) for which in (strategy, this))
    return map_function(mis_weight, strategies, p, q, ways, device=device).astype(np.float64)


def test_weights_are_those_of_the_power_heuristic(device: str) -> None:
    """Veach 1997, equation 9.13, with the exponent 2: p² / (p² + q²); both ways together count once."""
    p, q = np.exp(np.random.default_rng(1).uniform(-8.0, 8.0, (2, 500)))
    first, second = weights(p, q, STRATEGY_LIGHT, device), weights(q, p, STRATEGY_BSDF, device)
    np.testing.assert_allclose(first, p**2 / (p**2 + q**2), rtol=2e-6)
    np.testing.assert_allclose(first + second, 1.0, rtol=2e-6)
    np.testing.assert_array_equal(weights(p, q, STRATEGY_LIGHT, device, STRATEGY_LIGHT), 1.0)
    np.testing.assert_array_equal(weights(p, q, STRATEGY_LIGHT, device, STRATEGY_BSDF), 0.0)
