"""A render ends at its target of noise, at the same sample however it is cut into passes, killed or resumed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray

import wrt
from wrt.rendering.noise.noise_target import NoiseEstimate
from wrt.scene.scene import RenderSettings

SIZE = {"width": 32, "height": 32}
LARGER = {"width": 64, "height": 64}
"""In a small picture a few pixels at the edges of the lamp decide."""


def box(**options: Any) -> wrt.Renderer:
    return wrt.Renderer(wrt.load("cornell-box"), **{**SIZE, **options})


def run(renderer: wrt.Renderer, **limits: Any) -> NDArray[np.float32]:
    for _ in renderer.passes(**limits):
        pass
    return renderer.image()


@pytest.fixture(scope="module")
def reference() -> NDArray[np.float32]:
    return run(box(seed=99, **LARGER), spp=4096, pass_seconds=5.0)


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["sobol", "independent"])
@pytest.mark.parametrize("target", [0.1, 0.04])
def test_the_true_noise_is_the_target(
    target: float, sampler: str, reference: NDArray[np.float32], report: Report
) -> None:
    """The standard error of normal errors is √(π/2) times their mean absolute value."""
    renderer = box(sampler=sampler, **LARGER)
    image = run(renderer, noise=target)
    true = np.sqrt(np.pi / 2.0) * np.abs(image - reference).mean() / reference.mean()
    report(f"true noise at {renderer.spp} spp, {sampler}", true, target)
    assert 0.7 * target < true < 1.15 * target
    assert renderer.noise() == pytest.approx(target, rel=0.35)
    assert renderer.noise() <= target


def test_independent_samples_agree_with_their_variance() -> None:
    """Both estimates hold for them. What the mean absolute value leaves out are the tails of the distribution."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0)))
    scene.add(wrt.sphere(), material=wrt.Diffuse(0.5))
    scene.environment = wrt.ConstantEnvironment(1.0)
    renderer = wrt.Renderer(scene, sampler="independent", **LARGER)
    run(renderer, noise=0.01)
    assert renderer.noise() == pytest.approx(renderer.film.noise(), rel=0.1)


def test_the_end_does_not_depend_on_passes_threads_or_interruptions(tmp_path: Path) -> None:
    whole = box(threads=1)
    expected = run(whole, noise=0.12, pass_seconds=5.0)
    assert whole.spp not in (8, 16, 32, 64, 128)  # it may end between powers of two
    assert np.array_equal(run(box(threads=2), noise=0.12, pass_seconds=1e-6), expected)

    path = tmp_path / "state"
    first = box()
    for progress in first.passes(noise=0.12, pass_seconds=1e-6):
        if progress.spp >= 19:
            break
    first.save_checkpoint(path)
    second = box()
    second.load_checkpoint(path)
    assert second.spp == first.spp < whole.spp
    assert np.array_equal(run(second, noise=0.12), expected)
    assert np.array_equal(run(second, noise=0.12), expected)  # it has ended


def test_other_limits_come_first() -> None:
    few = box()
    run(few, spp=3, noise=0.01)
    assert few.spp == 3
    short = box()
    run(short, time=1e-6, noise=0.01)
    assert short.spp == 1
    settings = RenderSettings(**SIZE, noise=0.5)
    scene = wrt.load("cornell-box")
    scene.settings = settings
    assert run(wrt.Renderer(scene)).shape == (32, 32, 3)
    own = wrt.Renderer(scene)
    run(own)
    assert 8 <= own.spp < 64
    run(own, spp=70)
    assert own.spp == 70


def test_progress_tells_the_way_to_the_target() -> None:
    seen = list(box().passes(noise=0.12, pass_seconds=1e-6))
    assert all(progress.target_noise == 0.12 for progress in seen)
    assert seen[0].target_spp is None
    assert seen[0].noise is None
    assert seen[-1].target_spp == seen[-1].spp
    assert seen[-1].noise is not None
    assert seen[-1].noise <= 0.12
    assert all(progress.seconds_left is not None for progress in seen if progress.target_spp is not None)


@pytest.mark.parametrize("bad", [0.0, -0.1, 1.5, float("nan"), "1%"])
def test_impossible_targets_are_refused(bad: Any) -> None:
    renderer = box()
    with pytest.raises(wrt.InputError, match="noise"):
        renderer.passes(noise=bad)
    with pytest.raises(wrt.InputError, match="noise"):
        RenderSettings(noise=bad)


def test_layers_have_no_target() -> None:
    with pytest.raises(wrt.InputError, match="renders only layers"):
        box(integrator="aov", layers=["normal"]).passes(noise=0.1)


def test_a_black_picture_ends() -> None:
    scene = wrt.load("cornell-box")
    scene.shapes = [shape for shape in scene.shapes if not any(np.atleast_1d(shape.emission))]
    with pytest.warns(UserWarning, match="no light"):
        renderer = wrt.Renderer(scene, **SIZE)
    run(renderer, noise=0.01)
    assert renderer.spp == 8


def test_damaged_states_are_refused() -> None:
    renderer = box()
    run(renderer, noise=0.3)
    estimate = renderer._noise_estimate
    good = estimate.state()
    again = NoiseEstimate(renderer.film)
    again.restore(good)
    assert again.noise(20) == estimate.noise(20)
    bad: list[dict[str, NDArray[Any]]] = [
        {"noise_mean": good["noise_mean"]},
        {**good, "noise_mean": good["noise_mean"][1:]},
        {**good, "noise_mean": good["noise_mean"] * np.nan},
        {**good, "noise_tiles": good["noise_tiles"] - 1.0},
        {**good, "noise_tiles": good["noise_tiles"] + np.inf},
        {**good, "noise_counts": good["noise_counts"] + 1},
        {**good, "noise_counts": good["noise_counts"] * 1.0},
        {**good, "noise_counts": np.array([2**40, 3]), "count": np.array([64], np.int32)},
        {**good, "noise_target": np.array([2.0])},
    ]
    for state in bad:
        with pytest.raises(wrt.InputError, match=r"noise"):
            again.restore(state)
