"""Adaptive sampling: tiles that are good enough stop, whatever the passes, and the noise is the target."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray

import wrt
from wrt.rendering.noise.pilot import one_of_each_block
from wrt.rendering.noise.tile_budget import SIDE, Tiles, tiles_to_stop

SIZE = {"width": 96, "height": 72}
TARGET = 0.002


def ball(**options: Any) -> wrt.Renderer:
    """A matt ball under a lamp, small in a plain sky: most of the picture is free of noise."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.5, 9.0), (0.0, 0.0, 0.0)))
    scene.environment = wrt.ConstantEnvironment(0.1)
    scene.add(wrt.sphere(), material=wrt.Diffuse(0.5))
    scene.add(wrt.quad((-1.0, 3.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), emission=2.0)
    return wrt.Renderer(scene, **{**SIZE, **options})


def run(renderer: wrt.Renderer, **limits: Any) -> NDArray[np.float32]:
    for _ in renderer.passes(**limits):
        pass
    return renderer.image()


@pytest.mark.slow
def test_less_work_for_the_same_noise(report: Report) -> None:
    whole, adaptive, reference = ball(), ball(), ball(seed=5)
    run(whole, noise=TARGET)
    image = run(adaptive, noise=TARGET, adaptive=True)
    gain = whole.film.counts.sum() / adaptive.film.counts.sum()
    report("samples without over those with adaptive sampling", gain)
    assert gain > 1.5
    truth = run(reference, spp=4096, pass_seconds=5.0)
    true = np.sqrt(np.pi / 2.0) * np.abs(image - truth).mean() / truth.mean()
    report("true noise", true, TARGET)
    assert 0.7 * TARGET < true < 1.15 * TARGET
    assert image.mean() == pytest.approx(truth.mean(), rel=1e-3)
    counts = adaptive.film.counts
    assert counts.min() >= 32
    for y in range(0, counts.shape[0], SIDE):
        for x in range(0, counts.shape[1], SIDE):
            assert len(np.unique(counts[y : y + SIDE, x : x + SIDE])) == 1


@pytest.mark.parametrize("adaptive", [True, "unbiased"])
def test_tiles_do_not_depend_on_passes_threads_or_interruptions(adaptive: bool | str, tmp_path: Path) -> None:
    whole = ball(threads=1)
    expected = run(whole, noise=TARGET, adaptive=adaptive, pass_seconds=5.0)
    other = ball(threads=2)
    assert np.array_equal(run(other, noise=TARGET, adaptive=adaptive, pass_seconds=1e-6), expected)
    assert np.array_equal(other.film.counts, whole.film.counts)
    assert len(np.unique(whole.film.counts)) > 2

    first = ball()
    for progress in first.passes(noise=TARGET, adaptive=adaptive, pass_seconds=1e-6):
        if progress.spp >= 150:
            break
    assert len(np.unique(first.film.counts)) > 1
    first.save_checkpoint(tmp_path / "state")
    second = ball()
    second.load_checkpoint(tmp_path / "state")
    assert np.array_equal(run(second, noise=TARGET, adaptive=adaptive), expected)
    assert np.array_equal(second.film.counts, whole.film.counts)


def test_other_limits_take_up_the_tiles_that_have_stopped() -> None:
    renderer = ball()
    run(renderer, noise=TARGET, adaptive=True)
    assert len(np.unique(renderer.film.counts)) > 1
    stricter = run(renderer, noise=0.9 * TARGET, adaptive=True)
    assert np.isfinite(stricter).all()
    most = int(renderer.film.counts.max())
    run(renderer, spp=most + 3)
    assert (renderer.film.counts == most + 3).all()
    assert np.array_equal(renderer.image(), run(ball(), spp=most + 3))


def test_a_target_is_needed() -> None:
    with pytest.raises(wrt.InputError, match="needs a target of noise"):
        ball().passes(adaptive=True)
    with pytest.raises(wrt.InputError, match="adaptive must be true or false"):
        ball().passes(noise=0.1, adaptive="yes")


def test_the_last_sample_of_each_pixel_removes_as_much_error() -> None:
    """Without regard to neighbours: half of the tiles have errors of 1, half of 27, which is 1 to 9 samples at a = 1/2.

    Where the noisy ones are to have nine times their samples, the others have just as many as they need.
    """
    tiles = Tiles(2 * 9 * SIDE, SIDE)
    errors = np.where(np.arange(18) < 9, 1.0, 27.0)
    going = np.zeros(18, bool)
    for noisy, stopped in ((1.5, True), (9.0, True), (9.0 * 1.35, True), (9.0 * 1.5, False)):
        others = max(noisy / 9.0, 1.0)
        budget = (
            9.0 * 27.0 / np.sqrt(noisy) + 8.0 / np.sqrt(others) + 10.0 / np.sqrt(max(noisy * (10 / 27) ** (2 / 3), 1))
        )
        stop = tiles_to_stop(tiles, errors, going, 0.5, float(budget), float(budget))
        assert (stop[:8] == stopped).all(), noisy  # the ninth has a noisy neighbour
        assert not stop[9:].any()
    enough = float(errors.sum()) * 1.5
    assert not tiles_to_stop(tiles, errors, going, 0.5, enough, enough).any()  # all end before the next power of two


def test_tiles_cover_every_pixel_once() -> None:
    tiles = Tiles(SIDE + 3, 2 * SIDE + 1)
    assert tiles.count == 6
    assert tiles.pixels.tolist() == [256, 48, 256, 48, 16, 3]
    assert tiles.sums(np.ones((SIDE + 3) * (2 * SIDE + 1))).tolist() == tiles.pixels.tolist()
    around = tiles.around(np.arange(6.0))
    assert around[0] == pytest.approx((0 * 4 + 1 * 2 + 2 * 2 + 3) / 9)


@pytest.mark.parametrize("adaptive", [True, "unbiased"])
def test_with_a_pilot_the_picture_decides_nothing(adaptive: bool | str) -> None:
    """The mean of a pixel is unbiased if its number of samples is independent of their values."""
    clean, changed = ball(), ball()
    run(clean, noise=TARGET, adaptive=adaptive)
    for progress in changed.passes(noise=TARGET, adaptive=adaptive):
        if progress.spp == 16:
            values = changed.film.data.total.numpy()
            values *= np.random.default_rng(2).uniform(0.9, 1.1, values.shape)
    same = np.array_equal(changed.film.counts, clean.film.counts)
    assert same == (adaptive == "unbiased")
    assert clean.film.counts.min() < clean.film.counts.max()


def test_a_pilot_takes_a_quarter_more_samples_of_its_own() -> None:
    renderer = ball()
    run(renderer, noise=TARGET, adaptive="unbiased")
    assert renderer._pilot is not None
    pilot, own = renderer._pilot.film, renderer.film
    measured = pilot.counts > 0
    assert measured.mean() == 0.25
    assert np.array_equal(pilot.counts[measured], own.counts[measured])
    means = (film.data.total.numpy().reshape(*film.counts.shape, 3)[measured] for film in (pilot, own))
    noisy = renderer.variance().min(axis=2)[measured] > 1e-9
    assert noisy.sum() > 100
    assert np.equal(*means).any(axis=1)[noisy].mean() < 0.05  # at edges of the sky by chance


@pytest.mark.parametrize(("width", "height"), [(1, 1), (5, 4), (96, 72)])
def test_one_pixel_of_each_block_is_measured(width: int, height: int) -> None:
    measured = one_of_each_block(width, height).reshape(height, width)
    padded = np.zeros((height + height % 2, width + width % 2), bool)
    padded[:height, :width] = measured
    blocks = padded.reshape(padded.shape[0] // 2, 2, -1, 2).sum(axis=(1, 3))
    assert (blocks == 1).all()
    if width > 5:
        places = [measured[y::2, x::2].mean() for y in (0, 1) for x in (0, 1)]
        np.testing.assert_allclose(places, 0.25, atol=0.02)
