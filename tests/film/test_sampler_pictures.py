"""Pictures by every sampler: the same expectation, and the expected rate of convergence."""

import functools

import numpy as np
import pytest
from support.small_scenes import image_of
from support.statistics import image_z_test, sidak

import wrt
from wrt.scene.scene import SAMPLERS

SIZE = {"width": 24, "height": 18}
SEEDS = 16
SKY = np.random.default_rng(1).random((4, 8, 3)).astype(np.float32)


def scene():
    """Return a block under a lamp and a sky, and a moving camera with a lens: all blocks of dimensions are in use."""
    motion = wrt.Motion.translation((0.2, 0.0, 0.0))
    lens = {"aperture_radius": 0.05, "shutter_close": 1.0, "motion": motion}
    result = wrt.Scene(camera=wrt.PerspectiveCamera((1.0, 1.5, 2.5), (0.0, 0.3, 0.0), **lens))
    result.settings.max_depth = 4
    result.environment = wrt.ImageEnvironment(SKY)
    result.add(wrt.quad((-9, 0, 9), (18, 0, 0), (0, 0, -18)), material=wrt.Diffuse(0.5))
    result.add(wrt.box((-0.4, 0.0, -0.4), (0.4, 0.8, 0.4)), material=wrt.Diffuse((0.8, 0.6, 0.3)))
    result.add(wrt.quad((-1.0, 2.0, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), emission=6.0)
    return result


@pytest.mark.slow
def test_every_sampler_has_the_expectation_of_independent_samples(device, report):
    """The error is estimated from several seeds, as samples of a pixel are not independent."""

    def of_seeds(sampler):
        how = {**SIZE, "sampler": sampler, "device": device}
        images = [image_of(wrt.Renderer(scene(), seed=seed, **how), 12).astype(np.float64) for seed in range(SEEDS)]
        return np.mean(images, axis=0), np.var(images, axis=0, ddof=1) / SEEDS

    expected, expected_variance = of_seeds("independent")
    for sampler in SAMPLERS[1:]:
        mean, variance = of_seeds(sampler)
        result = image_z_test(mean, variance, expected, expected_variance, n_a=SEEDS, n_b=SEEDS)
        report(f"{sampler}: pixels that agree", result.pass_fraction, ">= 0.995", p=result.block_p)
        assert result.agrees(significance=sidak(0.01, 3)), result.message
        wrong = image_z_test(1.02 * mean, 1.02**2 * variance, expected, expected_variance, n_a=SEEDS, n_b=SEEDS)
        assert not wrong.agrees(significance=sidak(0.01, 3)), "2 % too bright is not noticed"


# --- Stratification --------------------------------------------------------------------------------

FEW, MANY, EXACT = 16, 256, 4096


def soft_shadow(sampler, spp, device, seed=0):
    """Render the penumbra of a ball on a floor, where the light's two numbers decide.

    The lamp is a single triangle, so that no number chooses among triangles, and sampled by "light" alone, so that no
    other noise hides its own. Pixels are small beside the penumbra: what film and light vary together falls as 1/N for
    every sampler.
    """
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.75, 2.0, 0.01), (0.75, 0.0, 0.0), fov_degrees=20.0))
    scene.environment = wrt.ImageEnvironment(np.zeros((1, 1, 3)))
    scene.add(wrt.quad((-9, 0, 9), (18, 0, 0), (0, 0, -18)), material=wrt.Diffuse(0.5))
    scene.add(wrt.sphere((0.0, 1.0, 0.0), 0.6, subdivisions=4), material=wrt.Diffuse(0.5))
    lamp = wrt.Mesh(np.array([[-1.2, 2.5, -1.0], [0.6, 2.5, -0.8], [-0.5, 2.5, 1.2]]), np.array([[0, 1, 2]]))
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=4.0)
    how = {"width": 16, "height": 16, "max_depth": 2, "strategy": "light", "filter": "box", "device": device}
    return image_of(wrt.Renderer(scene, sampler=sampler, seed=seed, **how), spp)[..., 1].astype(np.float64)


@functools.cache
def exact_picture(device):
    return soft_shadow("sobol", EXACT, device, seed=99)


@pytest.mark.parametrize(
    "sampler",
    ["sobol", *(pytest.param(s, marks=pytest.mark.slow) for s in ("independent", "stratified", "blue-noise"))],
)
def test_errors_fall_faster_for_stratified_samples(sampler, device, report):
    """From 16 to 256 samples the mean squared error falls 16 times if they are independent, 64 times on steps if even.

    The bound lies between: 24. What is measured must be on its side of it by four standard errors of the mean over
    eight seeds of the ratio's logarithm.
    """
    exact = exact_picture(device)
    falls = []
    for seed in range(8):
        early, late = (soft_shadow(sampler, spp, device, seed) - exact for spp in (FEW, MANY))
        falls.append(np.log((early**2).mean() / (late**2).mean()))
    margin = 4.0 * np.std(falls, ddof=1) / np.sqrt(len(falls))
    report(f"{sampler}: the squared error falls by", float(np.exp(np.mean(falls))), "16 or 64")
    side = -1.0 if sampler == "independent" else 1.0
    assert side * (np.mean(falls) - np.log(24.0)) > margin
