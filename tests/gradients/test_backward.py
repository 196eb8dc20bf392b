"""Derivatives of pictures: against difference quotients with the same random numbers, closed forms, and bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray

import wrt
from wrt.errors import InputError
from wrt.gradients.backward import KEYS, Backward

SIZE, SPP = 24, 16


def box(*shapes: Any, lights: bool = True, **options: Any) -> wrt.Scene:
    """Return a scene of three walls and a lamp, with whatever else."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(0, 1, 3.4), target=(0, 1, 0), fov_degrees=40), **options)
    grey = wrt.Diffuse((0.7, 0.65, 0.6))
    scene.add(wrt.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), material=grey)
    scene.add(wrt.quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)), material=wrt.Diffuse((0.3, 0.5, 0.4)))
    scene.add(wrt.quad((-1, 0, 1), (0, 0, -2), (0, 2, 0)), material=wrt.Diffuse((0.6, 0.3, 0.2)))
    if lights:
        scene.add(wrt.quad((-0.4, 1.98, -0.4), (0.8, 0, 0), (0, 0, 0.8)), material=grey, emission=(9.0, 8.0, 7.0))
    for mesh, material in shapes:
        scene.add(mesh, material=material)
    return scene


def renderer_of(scene: wrt.Scene, device: str = "cpu", **settings: Any) -> wrt.Renderer:
    options = {"width": SIZE, "height": SIZE, "max_depth": 4, "threads": 2, "seed": 1, **settings}
    return wrt.Renderer(scene, device=device, **options)


def upstream() -> NDArray[np.float32]:
    """Return a derivative of the loss that differs from pixel to pixel."""
    return np.random.default_rng(3).uniform(-1.0, 1.0, (SIZE, SIZE, 3)).astype(np.float32)


def loss(renderer: wrt.Renderer, spp: int = SPP) -> float:
    """Return the sum over pixels of radiance times `upstream`, in double precision."""
    renderer._clear()
    renderer.render(spp=spp)
    total = np.asarray(renderer.device.backend.fetch(renderer.film.data.total), np.float64)
    return float((total.reshape(SIZE, SIZE, 3) / spp * upstream()).sum())


def quotients(renderer: wrt.Renderer, values: NDArray[Any], row: int, step: float) -> NDArray[np.float64]:
    """Return the difference quotients by the three numbers of a row of an array of the scene, on the CPU."""
    found = np.empty(3)
    for channel in range(3):
        value, ends = values[row, channel].copy(), []
        for sign in (1.0, -1.0):
            values[row, channel] = value + sign * step
            ends.append(loss(renderer))
        values[row, channel] = value
        found[channel] = (ends[0] - ends[1]) / (2.0 * step)
    return found


def gradients(renderer: wrt.Renderer, spp: int = SPP) -> dict[str, NDArray[np.float64]]:
    return Backward(renderer).run(upstream(), spp, renderer.seed)


def error(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Return the largest difference, relative to the largest number."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def test_reflectances_and_emission(report: Report) -> None:
    """All light is the lamp's, so the derivative by its emission is the loss over that, channel by channel."""
    renderer = renderer_of(box())
    found = gradients(renderer)
    slots = renderer._built.data.slots.rows["value"]
    worst = max(error(found["slots"][row], quotients(renderer, slots, row, 2e-3)) for row in range(3))
    report("derivatives by reflectances", worst, "< 1e-3")
    assert worst < 1e-3
    renderer._clear()
    by_channel = (renderer.render(spp=SPP).astype(np.float64) * upstream()).sum((0, 1))
    assert error(found["emission"][3], by_channel / (9.0, 8.0, 7.0)) < 1e-6
    assert not found["emission"][:3].any()


def test_bits_do_not_depend_on_threads_or_launches(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = box()
    found = gradients(renderer_of(scene))
    monkeypatch.setattr("wrt.gradients.backward.PER_LAUNCH", 5 * SIZE * SIZE)
    again = gradients(renderer_of(scene, threads=1))
    assert set(found) == set(KEYS)
    for key in KEYS:
        np.testing.assert_array_equal(found[key], again[key])


def test_what_has_no_gradients_is_refused() -> None:
    with pytest.raises(InputError, match="integrator 'whitted' has no gradients"):
        Backward(renderer_of(box(), integrator="whitted"))
    with pytest.raises(InputError, match="clamp"):
        Backward(renderer_of(box(), clamp_indirect=1.0))
    backward = Backward(renderer_of(box()))
    with pytest.raises(InputError, match="shape of the picture, 24x24x3, not 3x3"):
        backward.run(np.zeros((3, 3)), 1, 0)
    with pytest.raises(InputError, match="not finite"):
        backward.run(np.full((SIZE, SIZE, 3), np.nan), 1, 0)
