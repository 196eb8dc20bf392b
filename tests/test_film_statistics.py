"""The film's variance is that of its mean: what pictures of other seeds really differ by."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from scipy import stats
from support.statistics import sidak, t_test_mean

import wrt

SEEDS = 48
SIZE = (32, 24)
ALPHA = 0.01


def scene() -> wrt.Scene:
    """A block on a floor under a mottled sky: every pixel has noise, and none has outliers."""
    result = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(1.0, 3.0, 2.0), target=(0.0, 0.2, 0.0)))
    result.environment = wrt.ImageEnvironment(np.random.default_rng(1).random((4, 8, 3)).astype(np.float32))
    result.add(wrt.quad((-9, 0, 9), (18, 0, 0), (0, 0, -18)), material=wrt.Diffuse(0.5))
    result.add(wrt.box((-0.4, 0.0, -0.4), (0.4, 0.8, 0.4)), material=wrt.Diffuse((0.8, 0.6, 0.3)))
    return result


def rendered(seed: int, spp: int, device: str) -> tuple[np.ndarray, np.ndarray, float | None]:
    """Return the green channel of mean and variance, and the noise last reported."""
    width, height = SIZE
    renderer = wrt.Renderer(
        scene(), sampler="independent", width=width, height=height, seed=seed, max_depth=4, filter="box", device=device
    )
    noise = None
    for progress in renderer.passes(spp=spp):
        noise = progress.noise
    return renderer.image().astype(np.float64)[..., 1], renderer.variance()[..., 1], noise


def p_of_mean(values: np.ndarray) -> float:
    """Return the p-value of independent values having mean zero."""
    flat = values.ravel()
    return float(t_test_mean(flat.mean(), flat.var(ddof=1) / flat.size, flat.size, 0.0))


@pytest.mark.slow
@pytest.mark.parametrize("spp", [2, 3, 64])
def test_variance_is_the_spread_between_seeds(spp: int, device: str, report: Report) -> None:
    """Both are unbiased, so their difference has mean zero over pixels, down to two samples."""
    pictures = [rendered(seed, spp, device) for seed in range(SEEDS)]
    means, variances = (np.stack([picture[i] for picture in pictures]) for i in (0, 1))
    spread, stated = means.var(axis=0, ddof=1), variances.mean(axis=0)
    p = p_of_mean(spread - stated)
    report(f"{spp} samples: stated variance over that between seeds", float(stated.sum() / spread.sum()), 1.0, p=p)
    assert p > sidak(ALPHA, 3)


@pytest.mark.slow
def test_pixels_and_seeds_are_independent(device: str, report: Report) -> None:
    """Neighbouring pixels, and pictures of consecutive seeds, must not share their noise."""
    seeds = 4 * SEEDS
    means = np.stack([rendered(seed, 16, device)[0] for seed in range(100, 100 + seeds)])
    noise = (means - means.mean(axis=0)) / means.std(axis=0, ddof=1)
    pairs = {
        "pixel to the right": (noise[:, :, 1:], noise[:, :, :-1], 0.0),
        "pixel below": (noise[:, 1:], noise[:, :-1], 0.0),
        # Residuals of one mean lean against each other by 1 in their number.
        "next seed": (noise[1:], noise[:-1], -1.0 / seeds),
    }
    for name, (a, b, expected) in pairs.items():
        # One product a pixel and pair, averaged over seeds first: what is left is independent enough.
        product = (a * b).mean(axis=0)
        p = p_of_mean(product - expected)
        report(f"correlation with the {name}", float(product.mean()), expected, p=p)
        assert p > sidak(ALPHA, len(pairs)), name


@pytest.mark.slow
def test_scores_between_seeds_are_unit_normal(device: str, report: Report) -> None:
    a, var_a, _ = rendered(1, 256, device)
    b, var_b, _ = rendered(2, 256, device)
    z = (a - b) / np.sqrt(var_a + var_b)
    p = stats.kstest(z.ravel(), "norm").pvalue
    report("standard deviation of scores", float(z.std()), 1.0, p=p)
    assert p > ALPHA


def test_noise_is_the_relative_mean_standard_error(device: str) -> None:
    width, height = SIZE
    renderer = wrt.Renderer(
        scene(), sampler="independent", width=width, height=height, seed=5, max_depth=4, device=device
    )
    for progress in renderer.passes(spp=8):
        noise = progress.noise
    expected = np.sqrt(renderer.variance()).mean() / renderer.image().astype(np.float64).mean()
    assert noise == pytest.approx(expected, rel=1e-5)


def test_one_sample_has_no_variance(device: str) -> None:
    _, variance, noise = rendered(0, 1, device)
    assert np.isnan(variance).all()
    assert noise is None


def test_every_pixel_gets_the_samples_asked_for(device: str) -> None:
    renderer = wrt.Renderer(scene(), width=7, height=5, device=device)
    for _ in renderer.passes(spp=11):
        pass
    assert renderer.spp == 11
    assert (renderer.film.counts == 11).all()
