"""The kernel of sixteen lanes leaves the same bits as the one of a single thread, whatever a scene uses."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from support.wide_scenes import CAMERAS, SCENES

import wrt
from wrt.build import layout
from wrt.build.integrators import integrator_features
from wrt.kernels.features import Features
from wrt.kernels.wide.paths import TILE
from wrt.kernels.wide.render import make_wide_render_kernel

Bits = dict[str, NDArray[Any]]


def features_of(renderer: wrt.Renderer) -> Features:
    features = dataclasses.replace(renderer._built.features, sampler=renderer.settings.sampler)
    return integrator_features(features, renderer.integrator, renderer.settings)


def bits(renderer: wrt.Renderer, kernel: wp.Kernel, threads: int, start: Bits, spp: int) -> Bits:
    """Return what a kernel makes of a film: up to `spp` samples in each pixel, going on from what is there."""
    renderer.film.restore(start)
    renderer.film.data.rays.zero_()
    wp.launch(kernel, dim=threads, inputs=[0, spp, *renderer._inputs], device="cpu")
    return {**renderer.film.state(), "rays": renderer.film.data.rays.numpy().copy()}


def compare(scene: wrt.Scene, counts: NDArray[np.int32] | int = 0, spp: int = 4, **options: Any) -> int:
    """Render a scene by both kernels, hold them to the same bits, and return how many samples there were."""
    renderer = wrt.Renderer(scene, **{"width": 45, "height": 31, "threads": 1, **options})
    start = renderer.film.state()
    start["count"][:] = counts
    x0, y0, x1, y1 = renderer.crop
    tiles = -(-(x1 - x0) // TILE) * -(-(y1 - y0) // TILE)
    one = bits(renderer, renderer._kernel, renderer.film.pixels, start, spp)
    many = bits(renderer, make_wide_render_kernel(features_of(renderer)), tiles, start, spp)
    differ = [name for name in one if one[name].tobytes() != many[name].tobytes()]
    if differ:
        for name in differ:
            x,y=one[name],many[name]
            n=(x!=y); print(name, n.sum(), n.size, np.argwhere(n.reshape(len(n),-1).any(1))[:5].ravel(), x[n][:5], y[n][:5])
    assert not differ
    assert one["total"].max() > 0.0
    assert one["rays"].min() >= 0
    return int((one["count"] - start["count"]).sum())


@pytest.fixture
def shared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meshes of few triangles too have trees of their own."""
    monkeypatch.setattr(layout, "WORTH_SHARING", 0)


QUICK = ("plain", "bodies")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in SCENES]
)
def test_the_same_bits(name: str, shared: None) -> None:
    make, options, cameras = SCENES[name]
    scene = make()
    for camera in cameras:
        scene.camera = CAMERAS[camera]
        print(name, camera, compare(scene, **options))
