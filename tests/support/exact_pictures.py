"""Pictures of exact shapes: their light on a floor, within and below them, and the same shapes as triangles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from conftest import Report
from numpy.typing import ArrayLike, NDArray

import wrt
from support.statistics import image_z_test, sidak, t_test_mean
from support.wide_scenes import wide_kernel

ROLL = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter of a turn."""

SIZE = 16
POINTS = np.linspace(-1.5, 1.5, SIZE)
"""Where pixel centres meet the floor, along x and along z."""


def rendered(scene: wrt.Scene, spp: int, **options: Any) -> wrt.Renderer:
    renderer = wrt.Renderer(scene, **{"sampler": "independent", "width": 48, "height": 36, "max_depth": 5, **options})
    for _ in renderer.passes(spp=spp):
        pass
    assert not renderer.film.rejected
    return renderer


def check_irradiance(
    lamp: wrt.Mesh,
    emission: Any,
    expected: Callable[[NDArray, NDArray], NDArray],
    shadow: tuple[tuple[float, float], float, float],
    spp: int,
    report: Report,
    **options: Any,
) -> None:
    """Compare what a lamp sheds on a floor, seen from 50 m above, with a function of x and z.

    `shadow` is what the lamp hides from the camera: a disk's place, height and radius.
    """
    scene = wrt.Scene()
    scene.add(wrt.quad((-8.0, 0.0, 8.0), (16.0, 0.0, 0.0), (0.0, 0.0, -16.0)), material=wrt.Diffuse(0.5))
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=emission)
    fov = 2.0 * math.degrees(math.atan(0.5 * 3.0 * SIZE / (SIZE - 1) / 50.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 50.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov_degrees=fov)
    renderer = rendered(scene, spp, width=SIZE, height=SIZE, max_depth=2, filter="box", seed=3, **options)
    where = np.stack(np.meshgrid(POINTS, POINTS))
    center, height, radius = shadow
    clear = np.hypot(*(where - 50.0 * np.array(center)[:, None, None] / (50.0 - height))) > radius * 1.1 + 0.15
    assert clear.mean() > 0.3
    # The mean over each pixel, by a 4x4 Gauss-Legendre rule.
    half = 0.5 * (POINTS[1] - POINTS[0])
    nodes = [(half * a, 0.5 * share) for a, share in zip(*np.polynomial.legendre.leggauss(4), strict=True)]
    pairs = itertools.product(nodes, repeat=2)
    exact = sum(wa * wb * expected(where[0] + a, where[1] + b) for (a, wa), (b, wb) in pairs)[clear]
    measured = (renderer.image()[..., 0] * math.pi / 0.5)[clear]
    variance = (renderer.variance()[..., 0] * (math.pi / 0.5) ** 2)[clear]
    p = t_test_mean(measured, variance, spp, exact)
    report("mean irradiance", float(measured.mean()), float(exact.mean()), p=float(p.min()))
    assert p.min() > sidak(0.01, p.size)
    # All pixels together see a bias that none shows alone.
    total_p = float(t_test_mean(measured.mean(), variance.sum() / variance.size**2, spp * p.size, exact.mean()))
    report("all pixels", float(measured.mean() / exact.mean()), 1.0, p=total_p)
    assert total_p > 0.01


def check_like_triangles(
    make: Callable[[bool], wrt.Scene], claim: str, device: str, report: Report, spp: int = 256
) -> None:
    """Compare the scenes that `make` returns of exact shapes and of triangles in their place."""
    a, b = (rendered(make(exact), spp, seed=1 + exact, device=device, filter="box") for exact in (True, False))
    result = image_z_test(a.image(), a.variance(), b.image(), b.variance(), n_a=spp, n_b=spp)
    difference = f"{100.0 * result.relative_difference[1]:+.3f}"
    report(f"{claim} against triangles, per cent", difference, 0, p=result.mean_p)
    assert result.agrees(), result.message


def check_furnace(meshes: Sequence[wrt.Mesh], middle: NDArray[Any], device: str, report: Report) -> None:
    """Within meshes that enclose the middle and emit 1 inwards, the radiance is 1 / (1 − a): nothing leaks out."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(middle + (0.3, -0.2, 0.5), middle + (-0.4, 0.3, -1), fov_degrees=90))
    for mesh in meshes:
        scene.add(mesh, material=wrt.Diffuse(0.8), emission=1.0)
    renderer = rendered(scene, 256, width=32, height=32, seed=1, max_depth=1000, device=device)
    mean = float(renderer.image().astype(np.float64).mean())
    error = float(np.sqrt(renderer.variance()[..., 0].sum())) / (32 * 32)
    report("radiance within", mean, 5.0, p=t_test_mean(mean, error**2, 32 * 32 * 256, 5.0))
    assert abs(mean - 5.0) < 3.0 * error


def differences(scene: wrt.Scene, lanes: int) -> list[str]:
    """Return which arrays of the film the kernel of one thread and the wide one leave with different bits."""
    renderer = wrt.Renderer(scene, width=45, height=31, threads=1)
    start, films = renderer.film.state(), []
    for kernel, threads in ((renderer._kernel.scalar, renderer.film.pixels), wide_kernel(renderer, lanes)):
        renderer.film.restore(start)
        renderer.film.data.rays.zero_()
        for target in (3, 22):
            renderer.device.launch(kernel, threads, [target, *renderer._inputs])
        films.append({**renderer.film.state(), "rays": renderer.film.data.rays.numpy().copy()})
    assert films[0]["total"].any()
    assert films[0]["count"].min() >= 22
    return [name for name in films[0] if films[0][name].tobytes() != films[1][name].tobytes()]


def motion(start: ArrayLike, end: ArrayLike, last: ArrayLike) -> wrt.Motion:
    """Return a motion in a second from one place to another, where the linear map has become `last`."""
    keys = np.stack([np.eye(4)] * 2)
    keys[0, :3, 3], keys[1, :3, 3], keys[1, :3, :3] = start, end, last
    return wrt.Motion(np.array([0.0, 1.0]), keys)
