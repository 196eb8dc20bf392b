"""Sampling lights, following the BSDF, and both together must agree: same light, other variance."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from conftest import Report
from support.statistics import image_z_test

import wrt


def estimates(scene: wrt.Scene, device: str, spp: dict[str, int], **options: object) -> dict:
    result = {}
    for seed, (strategy, count) in enumerate(spp.items()):
        renderer = wrt.Renderer(
            scene, sampler="independent", seed=seed + 10, strategy=strategy, device=device, **options
        )
        for _ in renderer.passes(spp=count):
            pass
        result[strategy] = renderer.image(), renderer.variance()
    return result


def compare(results: dict, report: Report) -> None:
    for a, b in combinations(results, 2):
        test = image_z_test(*results[a], *results[b])
        report(f"{a} against {b}: pixels that agree", test.pass_fraction, ">= 0.995", p=test.p_min)
        assert test.pass_fraction >= 0.995, test.message
        total = [float(results[k][0].astype(np.float64).mean()) for k in (a, b)]
        error = np.sqrt(sum(float(results[k][1].sum()) for k in (a, b))) / results[a][0].size
        # The channels of a pixel share their paths: at worst they are one sample, which widens
        # the error of the mean by the root of three.
        assert abs(total[0] - total[1]) < 3.0 * np.sqrt(3.0) * error


def test_estimators_agree_on_the_cornell_box(device: str, report: Report) -> None:
    scene = wrt.load("cornell-box")
    compare(
        estimates(scene, device, {"mis": 256, "light": 256, "bsdf": 2048}, width=32, height=32, max_depth=8), report
    )


@pytest.mark.slow
def test_estimators_agree_under_an_image(device: str, report: Report) -> None:
    rng = np.random.default_rng(5)
    pixels = rng.uniform(0.0, 0.5, (16, 32, 3)).astype(np.float32)
    pixels[3:5, 8:10] = 20.0
    scene = wrt.Scene(environment=wrt.ImageEnvironment(pixels, rotation_degrees=70.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 2.0, 4.0), (0.0, 0.3, 0.0))
    scene.add(wrt.quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0)), material=wrt.Diffuse(0.6))
    scene.add(wrt.box((-0.5, 0.0, -0.5), (0.5, 1.0, 0.5)), material=wrt.Diffuse((0.8, 0.3, 0.2)))
    scene.add(wrt.sphere((1.2, 0.5, 0.3), 0.5), material=wrt.Mirror(0.9))
    compare(estimates(scene, device, {"mis": 256, "light": 256, "bsdf": 1024}, width=32, height=32), report)
