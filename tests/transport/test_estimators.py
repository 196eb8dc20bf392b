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
from support.covering_kernels import rendering_with
from support.kernels import map_function
from support.media import KERNELS, render
from support.statistics import image_z_test, sidak, t_test_mean

import wrt
from wrt.kernels.integrators.next_event import STRATEGY_BSDF, STRATEGY_LIGHT, STRATEGY_MIS, mis_weight

Array = NDArray[np.float64]


few_kernels = rendering_with(*KERNELS)


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


@pytest.mark.parametrize("dispersion", [0.0, pytest.param(0.5, marks=pytest.mark.slow)])
def test_a_glass_block_in_a_furnace_cannot_be_seen(dispersion: float, device: str, report: Report) -> None:
    """Reflection and refraction together lose nothing, and η² cancels between entry and exit.

    A block, not a ball of facets: reflections in a block keep the size of each component of a direction, so light that
    came in can always leave. In a ball of facets some is caught for hundreds of reflections, and what roulette makes of
    that is too rare to be seen in a mean.
    """
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera(origin=(1.8, 1.3, 3.0), fov_degrees=30)
    scene.add(wrt.box((-0.7, -0.5, -0.6), (0.7, 0.5, 0.6)), material=wrt.Dielectric(ior=1.5, dispersion=dispersion))
    renderer = render(scene, device, size=(32, 32), spp=256, max_depth=1000)
    check_mean(renderer, "mean radiance through glass", 1.0, report)


@pytest.mark.slow
def test_estimators_agree(device: str, report: Report) -> None:
    """Same light, other variance."""
    results = {}
    for seed, (strategy, count) in enumerate({"mis": 256, "light": 256, "bsdf": 2048}.items()):
        options = {"spp": count, "max_depth": 8, "seed": seed + 10, "strategy": strategy}
        renderer = render(wrt.load("cornell-box"), device, size=(32, 32), **options)
        results[strategy] = renderer.image(), renderer.variance()
    for a, b in combinations(results, 2):
        test = image_z_test(*results[a], *results[b])
        report(f"{a} against {b}: pixels that agree", test.pass_fraction, ">= 0.995", p=test.mean_p)
        assert test.pass_fraction >= 0.995, test.message
        assert test.mean_p > sidak(0.01, 3), test.message


def weights(p: Array, q: Array, this: int, device: str, strategy: int = STRATEGY_MIS) -> Array:
    """Return the kernels' weights of samples that were drawn in one of two ways, with the density p."""
    strategies, techniques = (np.full(len(p), int(which), np.int32) for which in (strategy, this))
    return map_function(mis_weight, strategies, p, q, techniques, device=device).astype(np.float64)


def test_weights_are_those_of_the_power_heuristic(device: str) -> None:
    """Veach 1997, equation 9.13, with the exponent 2: p² / (p² + q²); both ways together count once."""
    p, q = np.exp(np.random.default_rng(1).uniform(-8.0, 8.0, (2, 500)))
    first, second = weights(p, q, STRATEGY_LIGHT, device), weights(q, p, STRATEGY_BSDF, device)
    np.testing.assert_allclose(first, p**2 / (p**2 + q**2), rtol=2e-6)
    np.testing.assert_allclose(first + second, 1.0, rtol=2e-6)
    np.testing.assert_array_equal(weights(p, q, STRATEGY_LIGHT, device, STRATEGY_LIGHT), 1.0)
    np.testing.assert_array_equal(weights(p, q, STRATEGY_LIGHT, device, STRATEGY_BSDF), 0.0)
