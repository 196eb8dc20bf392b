"""Pictures of exact shapes: light within and below them, and the same shapes as triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from conftest import Report
from numpy.typing import ArrayLike, NDArray

import wrt
from support.statistics import image_z_test, t_test_mean

ROLL = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter of a turn."""


def picture(scene: wrt.Scene, seed: int, device: str, spp: int = 256) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the image and its variance."""
    renderer = wrt.Renderer(
        scene, sampler="independent", width=48, height=36, seed=seed, max_depth=5, device=device, filter="box"
    )
    for _ in renderer.passes(spp=spp):
        pass
    return renderer.image(), renderer.variance()


def check_like_triangles(
    make: Callable[[bool], wrt.Scene], claim: str, device: str, report: Report, spp: int = 256
) -> None:
    """Compare the scenes that `make` returns of exact shapes and of triangles in their place."""
    exact, triangles = picture(make(True), 1, device, spp), picture(make(False), 2, device, spp)
    result = image_z_test(*exact, *triangles, n_a=spp, n_b=spp)
    difference = f"{100.0 * result.relative_difference[1]:+.3f}"
    report(f"{claim} against triangles, per cent", difference, 0, p=result.mean_p)
    assert result.agrees(), result.message


def check_furnace(meshes: Sequence[wrt.Mesh], middle: NDArray[Any], device: str, report: Report) -> None:
    """Within meshes that enclose the middle and emit 1 inwards, the radiance is 1 / (1 − a): nothing leaks out."""
    albedo = 0.8
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(middle + (0.3, -0.2, 0.5), middle + (-0.4, 0.3, -1), fov_degrees=90))
    for mesh in meshes:
        scene.add(mesh, material=wrt.Diffuse(albedo), emission=1.0)
    renderer = wrt.Renderer(scene, sampler="independent", width=32, height=32, seed=1, max_depth=1000, device=device)
    for _ in renderer.passes(spp=256):
        pass
    mean = float(renderer.image().astype(np.float64).mean())
    error = float(np.sqrt(renderer.variance()[..., 0].sum())) / (32 * 32)
    expected = 1.0 / (1.0 - albedo)
    report("radiance within", mean, expected, p=t_test_mean(mean, error**2, 32 * 32 * 256, expected))
    assert abs(mean - expected) < 3.0 * error
    assert not renderer.film.rejected


def clear_of(where: NDArray[Any], center: tuple[float, float], height: float, radius: float) -> NDArray[np.bool_]:
    """Return the pixels of the floor that nothing at that height hides from the camera, 50 m above."""
    at = 50.0 * np.array(center)[:, None, None] / (50.0 - height)
    return np.asarray(np.hypot(*(where - at)) > radius * 1.1 + 0.15)


def exposed_floor(environment: float) -> wrt.Scene:
    """Return a floor under an even sky, and a camera whose shutter is open from 0 to 1 s."""
    camera = wrt.PerspectiveCamera((0.0, 1.2, 4.0), (0.0, 0.5, 0.0), shutter_open=0.0, shutter_close=1.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(environment))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse(0.5))
    return scene


def motion(start: ArrayLike, end: ArrayLike, last: ArrayLike) -> wrt.Motion:
    """Return a motion in a second from one place to another, where the linear map has become `last`."""
    keys = np.stack([np.eye(4)] * 2)
    keys[0, :3, 3], keys[1, :3, 3], keys[1, :3, :3] = start, end, last
    return wrt.Motion(np.array([0.0, 1.0]), keys)


def placed(x: float, mirror: float, z: float) -> NDArray[Any]:
    """Return the transform to a place half a metre above the floor, mirrored along x if `mirror` is −1."""
    matrix = np.diag([mirror, 1.0, 1.0, 1.0])
    matrix[:3, 3] = x, 0.5, z
    return matrix
