"""The wide kernels of gradients give the sums of the scalar kernel, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.wide_scenes import CAMERAS, LANES, SCENES, needs_lanes

import wrt
from wrt.gradients import backward, kernels
from wrt.gradients.backward import KEYS, Backward
from wrt.gradients.kernels import MULTIPLE, portions
from wrt.kernels.gradients.gradient_pass import make_gradient_kernel
from wrt.spmd.ir import Unsupported
from wrt.spmd.translate import wide_code

NOT_FOR_GRADIENTS = ("clamp_indirect", "layers", "crop")
ONLY_SCALAR = "spectral"
"""A scene whose adjoints have a loop."""

SLOW = "plain", "sides"
"""The scenes that are tested beside the machinery: without lights that rays can hit, and with some."""

SPP = 37


def sums(renderer: wrt.Renderer) -> dict[str, NDArray[np.float64]]:
    """Return derivatives by all values of a scene, of a loss that differs from pixel to pixel."""
    shape = renderer.film.height, renderer.film.width, 3
    d_image = np.random.default_rng(5).uniform(-1.0, 1.0, shape)
    return Backward(renderer).run(d_image, SPP, seed=2)


def renderer_of(name: str, **changes: Any) -> wrt.Renderer:
    make, options, cameras = SCENES[name]
    scene = make()
    scene.camera = CAMERAS[cameras[0]]
    options = {key: value for key, value in options.items() if key not in NOT_FOR_GRADIENTS}
    return wrt.Renderer(scene, **{"width": 45, "height": 31, **options, **changes})


def with_wide_kernels(name: str, monkeypatch: pytest.MonkeyPatch, **changes: Any) -> wrt.Renderer:
    monkeypatch.setenv("WRT_WIDE", str(LANES))
    renderer = renderer_of(name, **changes)
    Backward(renderer).compile()
    assert renderer._kernel.gradients["values"].lanes == LANES
    return renderer


@needs_lanes
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in SLOW else pytest.mark.machinery)
        for name in SCENES
        if name != ONLY_SCALAR
    ],
)
def test_the_same_bits(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also with other threads, and if a launch takes fewer samples."""
    renderer = renderer_of(name)
    scalar = sums(renderer)
    assert renderer._kernel.gradients["values"].lanes == 1
    renderer = with_wide_kernels(name, monkeypatch)
    wide = sums(renderer)
    monkeypatch.setattr(kernels, "PER_LAUNCH", 7 * renderer.film.pixels)
    again = sums(with_wide_kernels(name, monkeypatch, threads=1))
    assert sum(scalar[key].any() for key in KEYS) >= 2
    for key in KEYS:
        np.testing.assert_array_equal(wide[key], scalar[key], err_msg=key)
        np.testing.assert_array_equal(again[key], scalar[key], err_msg=key)


@needs_lanes
@pytest.mark.slow
def test_sums_beyond_the_limit_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    renderer = with_wide_kernels(SLOW[0], monkeypatch)
    monkeypatch.setattr(backward, "LARGEST", 2.0**63)
    with pytest.raises(wrt.errors.InputError, match="too large"):
        sums(renderer)


@pytest.mark.slow
def test_a_scene_whose_adjoints_have_a_loop_stays_scalar() -> None:
    renderer = renderer_of(ONLY_SCALAR)
    with pytest.raises(Unsupported, match="iter_reverse"):
        wide_code(make_gradient_kernel(renderer._kernel.features, "replay"), 16)


def test_portions_are_what_a_wide_kernel_takes_at_once() -> None:
    for spp in (1, 3, 16, 37, 100):
        for most in (1, 5, 16, 40, 1000):
            parts = list(portions(spp, most))
            assert [first for first, _ in parts] == [0, *(last for _, last in parts[:-1])]
            assert parts[-1][1] == spp
            counts = [last - first for first, last in parts]
            assert all(0 < n <= most and (n % MULTIPLE == 0 or n & (n - 1) == 0) for n in counts)
