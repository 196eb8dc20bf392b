"""Pictures by every sampler: the same expectation, and bits that depend on nothing that they should not."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.statistics import image_z_test, sidak, t_test_mean

import wrt
from wrt.scene.scene import SAMPLERS, RenderSettings

SIZE = {"width": 24, "height": 18}
DEFAULT = RenderSettings().sampler
SEEDS = 16


def scene() -> wrt.Scene:
    """A block and a moving, blurring camera under a lamp and a mottled sky: every block of dimensions is in use."""
    motion = wrt.Motion.translation((0.2, 0.0, 0.0))
    camera = wrt.PerspectiveCamera(
        (1.0, 1.5, 2.5), (0.0, 0.3, 0.0), aperture_radius=0.05, shutter_close=1.0, motion=motion
    )
    result = wrt.Scene(camera=camera)
    result.settings.max_depth = 4
    result.environment = wrt.ImageEnvironment(np.random.default_rng(1).random((4, 8, 3)).astype(np.float32))
    result.add(wrt.quad((-9, 0, 9), (18, 0, 0), (0, 0, -18)), material=wrt.Diffuse(0.5))
    result.add(wrt.box((-0.4, 0.0, -0.4), (0.4, 0.8, 0.4)), material=wrt.Diffuse((0.8, 0.6, 0.3)))
    result.add(wrt.quad((-1.0, 2.0, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), emission=6.0)
    return result


def picture(spp: int = 5, targets: tuple[int, ...] = (), **options: object) -> NDArray[np.float64]:
    renderer = wrt.Renderer(scene(), **{**SIZE, **options})  # type: ignore[arg-type]
    for target in (*targets, spp):
        for _ in renderer.passes(spp=target):
            pass
    return renderer.image().astype(np.float64)


@pytest.mark.slow
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_bits_depend_on_neither_passes_nor_threads_nor_crop(sampler: str) -> None:
    whole = picture(sampler=sampler)
    np.testing.assert_array_equal(picture(sampler=sampler, threads=1, targets=(1, 2, 4)), whole)
    left, top, right, bottom = 5, 3, 17, 14
    part = picture(sampler=sampler, crop=(left, top, right, bottom))
    np.testing.assert_array_equal(part, whole[top:bottom, left:right])
    assert (picture(sampler=sampler, seed=1) != whole).any()
    assert sampler == DEFAULT or (picture() != whole).any()


@pytest.mark.slow
def test_every_sampler_has_the_expectation_of_independent_samples(device: str, report: Report) -> None:
    """By the spread between seeds, as the samples of a pixel say nothing of it."""

    def of_seeds(sampler: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        pictures = np.stack([picture(12, sampler=sampler, seed=seed, device=device) for seed in range(SEEDS)])
        return pictures.mean(axis=0), pictures.var(axis=0, ddof=1) / SEEDS

    expected, expected_variance = of_seeds("independent")
    for sampler in SAMPLERS[1:]:
        mean, variance = of_seeds(sampler)
        result = image_z_test(mean, variance, expected, expected_variance, n_a=SEEDS, n_b=SEEDS)
        report(f"{sampler}: pixels that agree", result.pass_fraction, ">= 0.995", p=result.block_p)
        report(
            f"{sampler}: variance between seeds, over independent", float(variance.mean() / expected_variance.mean())
        )
        assert result.agrees(significance=sidak(0.01, 3)), result.message
        wrong = image_z_test(1.02 * mean, 1.02**2 * variance, expected, expected_variance, n_a=SEEDS, n_b=SEEDS)
        assert not wrong.agrees(significance=sidak(0.01, 3)), "2 % too bright is not noticed"


def test_the_films_variance_is_too_high_for_the_default(device: str, report: Report) -> None:
    """As `Renderer.variance` says."""
    stated, pictures = [], []
    for seed in range(SEEDS):
        renderer = wrt.Renderer(scene(), **SIZE, seed=seed, device=device)
        for _ in renderer.passes(spp=16):
            pass
        stated.append(renderer.variance())
        pictures.append(renderer.image().astype(np.float64))
    excess = (np.mean(stated, axis=0) - np.var(pictures, axis=0, ddof=1))[..., 1].ravel()
    p = float(t_test_mean(excess.mean(), excess.var(ddof=1) / excess.size, excess.size, 0.0))
    report("stated variance over that between seeds", float(np.mean(stated) / np.var(pictures, axis=0, ddof=1).mean()))
    assert excess.mean() > 0.0
    assert p < 0.01


@pytest.mark.parametrize("name", ["halton", "", "Sobol", 3, None])
def test_a_sampler_that_is_none_is_refused(name: object) -> None:
    with pytest.raises(wrt.InputError, match="sampler must be one of independent, stratified, sobol, blue-noise, not"):
        RenderSettings(sampler=name)  # type: ignore[arg-type]
    if name is not None:  # which is to say, the scene's own
        with pytest.raises(wrt.InputError, match="sampler must be one of"):
            wrt.Renderer(scene(), sampler=name)  # type: ignore[arg-type]
