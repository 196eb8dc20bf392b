"""The film: its sums are exact, and its mean, variance and noise are those of the samples."""

import numpy as np
import pytest
import warp as wp
from support.small_scenes import finish, image_of
from support.statistics import sidak, t_test_mean

import wrt
from wrt.backend.device import Device
from wrt.kernels.render import TILE_HEIGHT, TILE_WIDTH, pixel_of_thread
from wrt.rendering.film import Film

EMISSION = (0.1, 1.0 / 3.0, 12345.678)
ALPHA = 0.01
SKY = np.random.default_rng(1).random((4, 8, 3)).astype(np.float32)


def wall(edge):
    """Return a scene that has the same radiance everywhere right of x = edge, and is black left of it."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)))
    scene.environment = wrt.ImageEnvironment(np.zeros((1, 1, 3)))
    scene.add(wrt.quad((edge, -99, 0), (198, 0, 0), (0, 198, 0)), material=wrt.Diffuse(0.0), emission=EMISSION)
    return scene


def mottled():
    """Return a block on a floor under a mottled sky: every pixel has noise, without outliers."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(1.0, 3.0, 2.0), target=(0.0, 0.2, 0.0)))
    scene.environment = wrt.ImageEnvironment(SKY)
    scene.add(wrt.quad((-9, 0, 9), (18, 0, 0), (0, 0, -18)), material=wrt.Diffuse(0.5))
    scene.add(wrt.box((-0.4, 0.0, -0.4), (0.4, 0.8, 0.4)), material=wrt.Diffuse((0.8, 0.6, 0.3)))
    return scene


@pytest.mark.slow
def test_a_hundred_thousand_samples_lose_nothing(device, report):
    renderer = wrt.Renderer(wall(-99), width=2, height=2, max_depth=1, device=device)
    exact = np.array(EMISSION, np.float32).astype(np.float64)
    for spp in (100_000, 200_003):
        state = finish(renderer, spp).film.state()
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


def test_mean_variance_and_noise_are_those_of_the_samples(device):
    renderer = wrt.Renderer(mottled(), width=9, height=7, max_depth=3, device=device)
    totals = [renderer.film.state()["total"]]
    for spp in range(1, 51):
        *_, progress = renderer.passes(spp=spp)
        totals.append(renderer.film.state()["total"])
    # A sum in double precision gives back the float32 that was added.
    samples = np.diff(np.stack(totals), axis=0).astype(np.float32).astype(np.float64).reshape(50, 7, 9, 3)
    assert samples.std() > 0.0
    np.testing.assert_allclose(renderer.image(), samples.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(renderer.variance(), samples.var(axis=0, ddof=1) / 50, rtol=1e-9, atol=1e-15)
    noise = np.sqrt(samples.var(axis=0, ddof=1) / 50).mean() / samples.mean()
    assert renderer.film.noise() == progress.noise == pytest.approx(noise, rel=1e-9)
    assert renderer.film.rays == renderer.rays > 0
    assert (renderer.film.counts == renderer.spp).all()
    assert renderer.spp == 50


def test_noise_of_uneven_counts(device):
    """Pixels with fewer than two samples are excluded."""
    rng = np.random.default_rng(2)
    film = Film(5, 3, Device(device))
    state = film.state()
    state["count"] = count = np.array([0, 1, 2, 3, 1000] * 3, np.int32)
    samples = [rng.random((n, 3)) for n in count]
    state["total"] = np.stack([s.sum(axis=0) for s in samples])
    state["total_of_squares"] = np.stack([(s**2).sum(axis=0) for s in samples])
    film.restore(state)
    several = [s for s in samples if len(s) > 1]
    expected = np.array([s.var(axis=0, ddof=1) / len(s) for s in several])
    means = sum(s.mean(axis=0).sum() for s in several)
    assert film.noise() == pytest.approx(np.sqrt(expected).sum() / means, rel=1e-9)
    variance = film.variance().reshape(-1, 3)
    assert np.isnan(variance[count < 2]).all()
    np.testing.assert_allclose(variance[count > 1], expected, rtol=1e-9)


def test_films_without_light_or_samples_state_no_noise(device):
    black = wall(0.0)
    black.camera = wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 9.0))
    renderer = wrt.Renderer(black, width=3, height=3, device=device)
    assert renderer.film.noise() is None
    assert (renderer.film.mean() == 0.0).all()
    assert renderer.film.rays == renderer.film.rejected == 0
    (progress,) = renderer.passes(spp=1)
    assert progress.noise is None
    assert np.isnan(renderer.variance()).all()
    assert (image_of(renderer, 4) == 0.0).all()
    assert (renderer.variance() == 0.0).all()
    assert renderer.film.noise() is None


def test_samples_that_overflow_are_counted_and_black(device):
    """The radiance of a sun over the probability of choosing it overflows float32; the radiance of the sky does not."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 3.0, 3.0), (0.0, 0.0, 0.0)))
    scene.add(wrt.quad((0, 0, 99), (99, 0, 0), (0, 0, -198)), material=wrt.Diffuse(1.0))
    scene.environment = wrt.ImageEnvironment(np.full((1, 1, 3), 0.5))
    for _ in range(2):
        scene.add_light(wrt.DirectionalLight((0, -1, 0), 3e38))
    renderer = finish(wrt.Renderer(scene, width=8, height=4, max_depth=2, filter="box", device=device), 16)
    image, rejected = renderer.image(), renderer.film.state()["rejected"].reshape(4, 8)
    assert np.isfinite(image).all()
    assert np.isfinite(renderer.variance()).all()
    assert (renderer.film.counts == 16).all()
    assert (rejected == np.where(np.arange(8) < 4, 0, 16)).all()
    np.testing.assert_array_equal(image, np.float32(0.5) * (rejected == 0)[..., None] * np.ones(3, np.float32))
    assert renderer.film.rejected == rejected.sum()


@pytest.mark.slow
def test_pictures_of_other_seeds_spread_as_stated_and_share_no_noise(device, report):
    """The stated variance is unbiased; neighbouring pixels and consecutive seeds are independent."""
    seeds, spp = 96, 4
    how = {"sampler": "independent", "max_depth": 4, "filter": "box", "device": device}
    pictures = [finish(wrt.Renderer(mottled(), width=32, height=24, seed=seed, **how), spp) for seed in range(seeds)]
    means = np.stack([renderer.image().astype(np.float64)[..., 1] for renderer in pictures])
    stated = np.mean([renderer.variance()[..., 1] for renderer in pictures], axis=0)
    noise = (means - means.mean(axis=0)) / means.std(axis=0, ddof=1)
    # One product a pixel and pair, averaged over seeds first: what is left is independent enough.
    # Residuals of one mean lean against each other by 1 in their number.
    zero = {
        "stated variance less that between seeds": stated - means.var(axis=0, ddof=1),
        "correlation with the pixel to the right": (noise[:, :, 1:] * noise[:, :, :-1]).mean(axis=0),
        "correlation with the pixel below": (noise[:, 1:] * noise[:, :-1]).mean(axis=0),
        "correlation with the next seed": (noise[1:] * noise[:-1]).mean(axis=0) + 1.0 / seeds,
    }
    for name, values in zero.items():
        p = float(t_test_mean(values.mean(), values.var(ddof=1) / values.size, values.size, 0.0))
        report(name, float(values.mean()), 0.0, p=p)
        assert p > sidak(ALPHA, len(zero)), name


# --- Tiles ------------------------------------------------------------------------------------------


@wp.kernel(enable_backward=False, module="test_tiles")
def pixels(width: int, height: int, pixels_out: wp.array(dtype=int)):
    thread = wp.tid()
    pixels_out[thread] = pixel_of_thread(thread, width, height)


def taken(width, height):
    """Return the column and the row of each thread's pixel."""
    found = wp.empty(width * height, dtype=int, device="cpu")
    wp.launch(pixels, dim=width * height, inputs=[width, height, found], device="cpu")
    return found.numpy() % width, found.numpy() // width


@pytest.mark.parametrize("size", [(1, 1), (7, 3), (45, 31), (1, 100), (1919, 1079)], ids=str)
def test_threads_of_a_gpu_take_each_pixel_once(size):
    width, height = size
    x, y = taken(width, height)
    assert (np.bincount(y * width + x, minlength=width * height) == 1).all()


def test_a_warp_takes_a_tile():
    x, y = (each.reshape(-1, 32) for each in taken(64, 36))
    assert int(TILE_WIDTH) * int(TILE_HEIGHT) == 32
    assert (np.ptp(x, axis=1) == TILE_WIDTH - 1).all()
    assert (np.ptp(y, axis=1) == TILE_HEIGHT - 1).all()
    # One after the other along a row of tiles.
    assert (x[:8, 0].tolist(), y[8, 0]) == ([8 * i for i in range(8)], TILE_HEIGHT)
