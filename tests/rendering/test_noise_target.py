"""A render ends at its noise target, with the same samples whatever the passes, kills and resumes."""

import numpy as np
import pytest
from support.small_scenes import finish, image_of

import wrt
from wrt.rendering.noise import SIDE, NoiseEstimate

TARGET = 0.002


def box(size=32, **options):
    return wrt.Renderer(wrt.load("cornell-box"), width=size, height=size, **options)


def ball(**options):
    """A matt ball under a lamp, small in a plain sky: most of the picture is free of noise."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.5, 9.0), (0.0, 0.0, 0.0)))
    scene.environment = wrt.ImageEnvironment(np.full((1, 1, 3), 0.1))
    scene.add(wrt.sphere(), material=wrt.Diffuse(0.5))
    scene.add(wrt.quad((-1.0, 3.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)), emission=2.0)
    return wrt.Renderer(scene, width=96, height=72, **options)


def true_noise(image, reference):
    """Return the mean standard error: of normal errors it is √(π/2) times their mean absolute value."""
    return np.sqrt(np.pi / 2.0) * np.abs(image - reference).mean() / reference.mean()


@pytest.mark.slow
def test_the_true_noise_is_the_target(report):
    reference = image_of(box(64, seed=99), 2048, pass_seconds=5.0)  # few pixels decide in a smaller one
    for sampler, target in (("sobol", 0.1), ("sobol", 0.04), ("independent", 0.04)):
        renderer = finish(box(64, sampler=sampler), noise=target)
        true = true_noise(renderer.image(), reference)
        report(f"true noise at {renderer.spp} spp, {sampler}", true, target)
        assert 0.7 * target < true < 1.15 * target
        assert 0.65 * target <= renderer.noise() <= target


@pytest.mark.slow
def test_adaptive_sampling_is_less_work_for_the_same_noise(report):
    uniform, adaptive = finish(ball(), noise=TARGET), finish(ball(), noise=TARGET, adaptive=True)
    counts = adaptive.film.counts
    gain = uniform.film.counts.sum() / counts.sum()
    report("samples without over those with adaptive sampling", gain)
    assert gain > 1.5
    truth = image_of(ball(seed=5), 2048, pass_seconds=5.0)
    true = true_noise(adaptive.image(), truth)
    report("true noise", true, TARGET)
    assert 0.7 * TARGET < true < 1.15 * TARGET
    assert adaptive.image().mean() == pytest.approx(truth.mean(), rel=1e-3)
    assert counts.min() >= 32
    tiles = [counts[y : y + SIDE, x : x + SIDE] for y in range(0, 72, SIDE) for x in range(0, 96, SIDE)]
    assert all(len(np.unique(tile)) == 1 for tile in tiles)


@pytest.mark.slow
@pytest.mark.parametrize("adaptive", [False, True])
def test_the_end_does_not_depend_on_passes_threads_or_interruptions(adaptive, tmp_path):
    limits = {"noise": TARGET, "adaptive": adaptive}
    expected = finish(ball(threads=1), **limits, pass_seconds=5.0)
    assert adaptive or expected.spp & (expected.spp - 1)  # it may end between powers of two
    first = ball(threads=2)
    for progress in first.passes(**limits, pass_seconds=1e-6):
        if progress.spp >= 150:
            break
    assert (len(np.unique(first.film.counts)) > 1) == adaptive
    first.save_checkpoint(tmp_path / "state")
    second = ball()
    second.load_checkpoint(tmp_path / "state")
    for renderer in (first, second, second):  # the last time it has ended
        np.testing.assert_array_equal(image_of(renderer, **limits, pass_seconds=1e-6), expected.image())
        np.testing.assert_array_equal(renderer.film.counts, expected.film.counts)


@pytest.mark.slow
def test_other_limits_come_first():
    assert finish(box(), 3, noise=0.01).spp == 3
    assert finish(box(), time=1e-6, noise=0.01).spp == 1
    scene = wrt.load("cornell-box")
    scene.settings = wrt.RenderSettings(width=32, height=32, noise=0.5)
    by_settings = finish(wrt.Renderer(scene))
    assert 8 <= by_settings.spp < 64
    assert finish(by_settings, 70).spp == 70
    adaptive = finish(ball(), noise=TARGET, adaptive=True)
    assert len(np.unique(adaptive.film.counts)) > 1
    assert np.isfinite(image_of(adaptive, noise=0.9 * TARGET, adaptive=True)).all()
    most = int(adaptive.film.counts.max())
    assert (finish(adaptive, most + 3).film.counts == most + 3).all()  # tiles that had stopped are taken up
    np.testing.assert_array_equal(adaptive.image(), image_of(ball(), most + 3))


def test_progress_tells_the_way_to_the_target():
    passes = list(box().passes(noise=0.12, pass_seconds=1e-6))
    assert all(progress.target_noise == 0.12 for progress in passes)
    assert passes[0].target_spp is passes[0].noise is None
    assert passes[-1].target_spp == passes[-1].spp
    assert passes[-1].noise <= 0.12
    assert all(progress.seconds_left is not None for progress in passes if progress.target_spp is not None)


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_impossible_targets_are_refused():
    for bad in (0.0, 1.5, float("nan"), "1%"):
        for use in (box().passes, wrt.RenderSettings):
            with pytest.raises(wrt.InputError, match="noise"):
                use(noise=bad)
    with pytest.raises(wrt.InputError, match="renders only layers"):
        box(integrator="aov", layers=["normal"]).passes(noise=0.1)
    with pytest.raises(wrt.InputError, match="needs a target of noise"):
        box().passes(adaptive=True)
    with pytest.raises(wrt.InputError, match="adaptive must be true or false"):
        box().passes(noise=0.1, adaptive="yes")


def test_a_black_picture_ends():
    scene = wrt.load("cornell-box")
    scene.shapes = [shape for shape in scene.shapes if not any(np.atleast_1d(shape.emission))]
    with pytest.warns(UserWarning, match="no light"):
        renderer = wrt.Renderer(scene, width=32, height=32)
    assert finish(renderer, noise=0.01).spp == 8


def test_damaged_states_are_refused():
    renderer = finish(box(), noise=0.3)
    good = renderer.noise_estimate.state()
    estimate = NoiseEstimate(renderer.film)
    estimate.restore(good)
    assert estimate.noise(20) == renderer.noise_estimate.noise(20)
    for change in (
        {"noise_mean": good["noise_mean"][1:]},
        {"noise_mean": good["noise_mean"] * np.nan},
        {"noise_counts": good["noise_counts"] + 1},
        {"noise_target": np.array([2.0])},
    ):
        with pytest.raises(wrt.InputError, match="noise"):
            estimate.restore({**good, **change})
