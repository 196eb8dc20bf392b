"""The film: its sums lose nothing, and its mean, variance and noise are those of the samples."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray

import wrt
from wrt.backend.device import Device
from wrt.rendering.film import STATE_ARRAYS, Film

EMISSION = (0.1, 1.0 / 3.0, 12345.678)


def rendered(renderer: wrt.Renderer, spp: int) -> wrt.Renderer:
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


def glowing_wall() -> wrt.Scene:
    """Every sample of every pixel sees the same radiance."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)))
    scene.add(wrt.quad((-99, -99, 0), (198, 0, 0), (0, 198, 0)), material=wrt.Diffuse(0.0), emission=EMISSION)
    return scene


def mottled_sky() -> wrt.Scene:
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 1.0, 3.0), (0.0, 0.0, 0.0)))
    scene.environment = wrt.ImageEnvironment(np.random.default_rng(1).random((4, 8, 3)).astype(np.float32))
    scene.add(wrt.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), material=wrt.Diffuse(0.7))
    return scene


def half_lit_wall() -> wrt.Scene:
    """Left black, right shining; the middle pixel sees both."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)))
    scene.add(wrt.quad((0, -99, 0), (99, 0, 0), (0, 198, 0)), material=wrt.Diffuse(0.0), emission=EMISSION)
    return scene


@pytest.mark.slow
def test_a_hundred_thousand_samples_lose_nothing(device: str, report: Report) -> None:
    renderer = wrt.Renderer(glowing_wall(), width=2, height=2, max_depth=1, device=device)
    exact = np.array(EMISSION, np.float32).astype(np.float64)
    for spp in (100_000, 200_003):
        rendered(renderer, spp)
        state = renderer.film.state()
        assert (state["count"] == spp).all()
        # A float32 fills 24 bits of 53, so the sum of equal ones is exact. Squares fill 48: each addition may
        # round, and equal numbers all to one side.
        for name, value, limit in (("total", exact, 1e-12), ("total_of_squares", exact**2, spp * 2.0**-53)):
            error = np.abs(state[name] / spp / value - 1.0).max()
            report(f"relative error of the {name} of {spp} samples", float(error), 0.0)
            assert error < limit
    np.testing.assert_array_equal(renderer.image(), np.broadcast_to(np.array(EMISSION, np.float32), (2, 2, 3)))
    # The samples are alike: what variance is left is rounding.
    assert (np.sqrt(renderer.variance()) < 1e-8 * exact).all()


def test_late_samples_count_as_much_as_early_ones(device: str, report: Report) -> None:
    """A film of 2^17 samples is the mean of two halves, to the last digits of float64."""
    renderer = wrt.Renderer(half_lit_wall(), width=1, height=1, max_depth=1, filter="box", device=device)
    first = rendered(renderer, 2**16).film.state()["total"].copy()
    both = rendered(renderer, 2**17).film.state()["total"]
    radiance = np.array(EMISSION, np.float32).astype(np.float64)
    lit_first, lit_both = first / radiance, both / radiance
    # Totals are whole numbers of lit samples, and every second sample is lit.
    np.testing.assert_allclose(lit_first, np.round(lit_first), rtol=1e-12)
    np.testing.assert_allclose(lit_both, np.round(lit_both), rtol=1e-12)
    for count, n in ((lit_first[0, 0], 2**16), (lit_both[0, 0], 2**17), (lit_both[0, 0] - lit_first[0, 0], 2**16)):
        z = (count - n / 2) / np.sqrt(n / 4)
        report(f"lit of {n}", float(count / n), 0.5)
        assert abs(z) < 3.5


def single_samples(renderer: wrt.Renderer, n: int) -> NDArray[np.float64]:
    """Render one sample a pixel at a time and return them all, (n, H, W, 3)."""
    totals = [renderer.film.state()["total"]]
    for spp in range(1, n + 1):
        totals.append(rendered(renderer, spp).film.state()["total"])
    # A sum in double precision gives back the float32 that was added.
    samples = np.diff(np.stack(totals), axis=0).astype(np.float32).astype(np.float64)
    return samples.reshape(n, renderer.height, renderer.width, 3)


def test_mean_variance_and_noise_are_those_of_the_samples(device: str) -> None:
    renderer = wrt.Renderer(mottled_sky(), width=9, height=7, max_depth=3, device=device)
    samples = single_samples(renderer, 50)
    assert samples.std() > 0.0
    np.testing.assert_allclose(renderer.image(), samples.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(renderer.variance(), samples.var(axis=0, ddof=1) / 50, rtol=1e-9, atol=1e-15)
    noise = np.sqrt(samples.var(axis=0, ddof=1) / 50).mean() / samples.mean()
    assert renderer.film.noise() == pytest.approx(noise, rel=1e-9)
    assert renderer.film.rays == renderer.rays > 0


def test_noise_of_uneven_counts(device: str) -> None:
    """Pixels without two samples are left out of the sums; the rest is plain arithmetic."""
    width, height = 5, 3
    rng = np.random.default_rng(2)
    film = Film(width, height, Device(device))
    state = film.state()
    count = np.array([0, 1, 2, 3, 1000] * 3, np.int32)
    samples = [rng.random((n, 3)) for n in count]
    state["count"] = count
    state["total"] = np.stack([s.sum(axis=0) for s in samples])
    state["total_of_squares"] = np.stack([(s**2).sum(axis=0) for s in samples])
    film.restore(state)
    means = sum(s.mean(axis=0).sum() for s in samples if len(s) > 1)
    errors = sum(np.sqrt(s.var(axis=0, ddof=1) / len(s)).sum() for s in samples if len(s) > 1)
    assert film.noise() == pytest.approx(errors / means, rel=1e-9)
    variance = film.variance().reshape(-1, 3)
    assert np.isnan(variance[count < 2]).all()
    for pixel in np.flatnonzero(count > 1):
        np.testing.assert_allclose(variance[pixel], samples[pixel].var(axis=0, ddof=1) / count[pixel], rtol=1e-9)


def test_an_empty_film(device: str) -> None:
    film = Film(4, 3, Device(device))
    assert film.noise() is None
    assert (film.mean() == 0.0).all()
    assert np.isnan(film.variance()).all()
    assert film.counts.shape == (3, 4)
    assert film.rays == film.rejected == 0


def test_a_black_picture_has_no_noise_to_state(device: str) -> None:
    scene = half_lit_wall()
    scene.camera = wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 9.0))
    renderer = rendered(wrt.Renderer(scene, width=3, height=3, device=device), 4)
    assert (renderer.image() == 0.0).all()
    assert (renderer.variance() == 0.0).all()
    assert renderer.film.noise() is None


def test_state_round_trip(device: str) -> None:
    renderer = rendered(wrt.Renderer(mottled_sky(), width=6, height=5, device=device), 5)
    state = renderer.film.state()
    assert set(state) == set(STATE_ARRAYS)
    other = Film(6, 5, Device(device))
    other.restore(state)
    for name, array in other.state().items():
        np.testing.assert_array_equal(array, state[name])
    np.testing.assert_array_equal(other.mean(), renderer.image())
    # A state is a copy: rendering on does not change it.
    kept = {name: array.copy() for name, array in state.items()}
    rendered(renderer, 9)
    for name, array in state.items():
        np.testing.assert_array_equal(array, kept[name])


def test_samples_that_overflow_are_counted_and_black(device: str) -> None:
    """Either of two suns, over the chance of choosing it, is more than a float32 holds; the sky is not."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 3.0, 3.0), (0.0, 0.0, 0.0)))
    scene.add(wrt.quad((0, 0, 99), (99, 0, 0), (0, 0, -198)), material=wrt.Diffuse(1.0))
    scene.environment = wrt.ImageEnvironment(np.full((1, 1, 3), 0.5))
    for _ in range(2):
        scene.add_light(wrt.DirectionalLight((0, -1, 0), 3e38))
    width, height, spp = 8, 4, 16
    renderer = wrt.Renderer(scene, width=width, height=height, max_depth=2, filter="box", device=device)
    rendered(renderer, spp)
    image, rejected = renderer.image(), renderer.film.state()["rejected"].reshape(height, width)
    assert np.isfinite(image).all()
    assert np.isfinite(renderer.variance()).all()
    assert (renderer.film.counts == spp).all()
    left, right = slice(0, width // 2), slice(width // 2, None)
    assert (rejected[:, left] == 0).all()
    assert (image[:, left] == np.float32(0.5)).all()
    assert (rejected[:, right] == spp).all()
    assert (image[:, right] == 0.0).all()
    assert renderer.film.rejected == rejected.sum()
