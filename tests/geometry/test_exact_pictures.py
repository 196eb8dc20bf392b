"""Pictures of exact shapes: light from them in closed form, a furnace, motion, media, and both kernels."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from support.covering_kernels import rendering_with
from support.irradiance import check, disk_irradiance, floor_scene, irradiance, pixel_mean
from support.ray_trees import unit
from support.small_scenes import rendered
from support.statistics import image_z_test, t_test_mean
from support.wide_scenes import differences, needs_lanes

import wrt
from wrt.kernels.core.features import Features
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.exact.spheres import Spheres
from wrt.upload.accel import instancing

two_kernels = rendering_with(*(Features(("diffuse",), True, "none", exact=kind) for kind in ("spheres", "quadrics")))

SPP = {"mis": 1024, "light": 512, "bsdf": 4096}
HEIGHT = 1.2
ABOVE = (0.4, -0.3)
"""The place of lamps above the floor."""
TEXELS = np.float32([[1.0, 9.0, 0.5, 3.0], [6.0, 0.2, 4.0, 12.0], [0.3, 5.0, 15.0, 1.0]])


def of_sphere(x: NDArray, z: NDArray) -> NDArray:
    """E = π L (r / d)² cosθ where the whole sphere is above the horizon (Howell, C-137), for L = 2 / r²."""
    d2 = (x - ABOVE[0]) ** 2 + HEIGHT**2 + (z - ABOVE[1]) ** 2
    return np.asarray(math.pi * 2.0 / d2 * (HEIGHT / np.sqrt(d2)))


def of_disk(radius: float, x: NDArray, z: NDArray) -> NDArray:
    """A disk parallel to the floor, for L = 2 / r²."""
    return 2.0 / radius**2 * disk_irradiance(x - ABOVE[0], z - ABOVE[1], HEIGHT, radius)


def of_points(points: NDArray, normals: NDArray, flux: NDArray, x: NDArray, z: NDArray) -> NDArray:
    """Return the sum over points of a lamp's surface with their radiance times area."""
    segments = points - np.stack([x, np.zeros_like(x), z], axis=-1)[..., None, :]
    cosines = segments[..., 1] * np.maximum(-np.einsum("...sk,sk->...s", segments, normals), 0.0)
    return np.asarray(cosines / (segments**2).sum(axis=-1) ** 2 @ flux)


def squares(u_count: int, v_count: int) -> tuple[NDArray, NDArray]:
    """Return the middles of cells of the unit square."""
    u, v = np.meshgrid((np.arange(u_count) + 0.5) / u_count, (np.arange(v_count) + 0.5) / v_count)
    return u.ravel(), v.ravel()


def textured_sphere() -> tuple[wrt.Mesh, Any, Any, Any]:
    """Its light is read from the texel, whichever strategy finds the lamp."""
    center, radius = np.array([ABOVE[0], HEIGHT, ABOVE[1]]), 0.6
    u, v = squares(72, 72)
    sine = np.sin(np.pi * v)
    out = np.stack([sine * np.cos(2.0 * np.pi * u), sine * np.sin(2.0 * np.pi * u), np.cos(np.pi * v)], axis=1)
    # Rows of an image are from the top, where v is 1.
    radiance = TEXELS[((1.0 - v) * 3).astype(int), (u * 4).astype(int)]
    flux = radiance * radius**2 * 2.0 * np.pi**2 * sine / len(sine)
    image = wrt.ImageTexture(TEXELS[..., None].repeat(3, axis=2), filter="nearest")
    expected = functools.partial(of_points, center + radius * out, out, flux)
    return wrt.sphere(tuple(center), radius, exact=True), image, expected, (ABOVE, HEIGHT, radius)


def tube() -> tuple[wrt.Mesh, Any, Any, Any]:
    radius, (start, end) = 0.25, np.array([(-0.5, 0.9, 0.1), (0.6, 1.3, 0.4)])
    u, v = squares(192, 48)
    axis = unit(end - start)
    first = unit(np.cross(axis, (0.0, 1.0, 0.0)))
    out = np.cos(2.0 * np.pi * u)[:, None] * first + np.sin(2.0 * np.pi * u)[:, None] * np.cross(axis, first)
    points = start + v[:, None] * (end - start) + radius * out
    flux = np.full(len(u), 8.0 * 2.0 * np.pi * radius * np.linalg.norm(end - start) / len(u))
    lamp = wrt.cylinder(tuple(start), tuple(end), radius)
    return lamp, 8.0, functools.partial(of_points, points, out, flux), ((0.05, 0.25), 1.2, 0.85)


def lamp_of(kind: str, radius: float) -> tuple[wrt.Mesh, Any, Any, Any]:
    """Return a lamp, its radiance, its irradiance on the floor, and the place, height and radius of what it hides."""
    place, shadow = (ABOVE[0], HEIGHT, ABOVE[1]), (ABOVE, HEIGHT, radius)
    if kind == "sphere":
        return wrt.sphere(place, radius, exact=True), 2.0 / radius**2, of_sphere, shadow
    if kind == "of_a_disk":
        return wrt.disk(place, (0, -1, 0), radius), 2.0 / radius**2, functools.partial(of_disk, radius), shadow
    return tube() if kind == "cylinder" else textured_sphere()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "strategy", "radius"),
    [
        *(("sphere", strategy, radius) for strategy, radius in (("mis", 0.9), ("light", 1e-3), ("bsdf", 0.9))),
        *(("of_a_disk", *how) for how in (("mis", 0.3), ("light", 0.01), ("light", 0.7), ("bsdf", 0.9))),
        *((kind, strategy, 0.0) for kind in ("cylinder", "textured") for strategy in SPP),
    ],
)
def test_irradiance(kind: str, strategy: str, radius: float, device: str, report: Report) -> None:
    """In closed form, or summed over the lamp by the midpoint rule."""
    lamp, radiance, expected, (center, height, shadow) = lamp_of(kind, radius)
    scene = floor_scene()
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=radiance)
    where, measured, variance = irradiance(scene, device, SPP[strategy], strategy=strategy)
    hidden = np.hypot(*(where - 50.0 * np.array(center)[:, None, None] / (50.0 - height))) <= shadow * 1.1 + 0.15
    assert hidden.mean() < 0.7
    exact = pixel_mean(expected, where)
    check(kind, measured[~hidden], variance[~hidden], exact[~hidden], SPP[strategy], report)


@pytest.mark.slow
@pytest.mark.parametrize("center", [(0.0, 0.0, 0.0), (300.0, -200.0, 100.0)])
@pytest.mark.parametrize("kind", ["sphere", "can"])
def test_no_light_leaks_out_of_closed_shapes(
    kind: str, center: tuple[float, float, float], device: str, report: Report
) -> None:
    middle, axis = np.array(center), np.array([0.2, 0.9, -0.3])
    if kind == "sphere":
        shapes = [wrt.sphere(center, 1.0, exact=True).turned_inside_out()]
    else:
        low, high = tuple(middle - axis), tuple(middle + axis)
        lids = [wrt.disk(low, tuple(axis), 0.8001), wrt.disk(high, tuple(-axis), 0.8001)]
        shapes = [wrt.cylinder(low, high, 0.8).turned_inside_out(), *lids]
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(middle + (0.3, -0.2, 0.5), middle + (-0.4, 0.3, -1), fov_degrees=90))
    for mesh in shapes:
        scene.add(mesh, material=wrt.Diffuse(0.8), emission=1.0)
    renderer = rendered(scene, 256, width=32, height=32, seed=1, max_depth=1000, device=device)
    mean = float(renderer.image().astype(np.float64).mean())
    error = float(np.sqrt(renderer.variance()[..., 0].sum())) / (32 * 32)
    report("radiance within", mean, 5.0, p=t_test_mean(mean, error**2, 32 * 32 * 256, 5.0))
    assert abs(mean - 5.0) < 3.0 * error


# --- Against triangles -------------------------------------------------------------------------------


def cut(mesh: wrt.Mesh, exact: bool, segments: int = 256) -> wrt.Mesh:
    assert isinstance(mesh, Quadrics | Spheres)
    return mesh if exact else mesh.tessellated(segments if len(mesh.faces) == 1 else 48)


def motion(start: ArrayLike, end: ArrayLike, last: ArrayLike) -> wrt.Motion:
    """Return a motion in a second from one place to another, where the linear map has become `last`."""
    keys = np.stack([np.eye(4)] * 2)
    keys[0, :3, 3], keys[1, :3, 3], keys[1, :3, :3] = start, end, last
    return wrt.Motion(np.array([0.0, 1.0]), keys)


ROLL = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter of a turn."""


def varied(exact: bool) -> wrt.Scene:
    """Shapes that roll, grow and become ellipses, shared meshes, one place mirrored, lamps, glass with absorption.

    Tubes emit outwards, inwards and on both sides.
    """
    rng = np.random.default_rng(4)
    image = wrt.ImageTexture(rng.random((4, 8, 3)).astype(np.float32), filter="nearest")
    camera = wrt.PerspectiveCamera((0.0, 1.2, 4.0), (0.0, 0.5, 0.0), shutter_open=0.0, shutter_close=1.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.5))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse(0.5))
    roll = motion((-0.8, 0.4, 0.0), (0.2, 0.5, 0.5), 1.3 * ROLL)
    grow = motion((0.9, 0.5, 0.6), (0.7, 0.6, 0.5), np.diag([1.0, 0.4, 1.5]))
    rise = motion((0.1, 0.9, -0.8), (-0.4, 1.2, -0.6), 0.8 * ROLL)
    tube, plate = wrt.cylinder((-0.1, -0.1, -0.3), (0.1, 0.1, 0.3), 0.35), wrt.disk((0, 0, 0), (1, 1, 2), 0.3)
    ball = wrt.spheres([(0, 0, 0)], 0.4)
    for mesh, transform, emission in ((tube, roll, 0.0), (plate, grow, image), (ball, rise, 0.0)):
        scene.add(cut(mesh, exact), material=wrt.Diffuse(image), transform=transform, emission=emission)
    places, axes = rng.uniform(-0.4, 0.4, (18, 3)), rng.standard_normal((18, 3))
    group: list[wrt.Mesh] = [
        wrt.cylinder(tuple(a), tuple(a + 0.3 * b), 0.03) for a, b in zip(places[:9], axes[:9], strict=True)
    ]
    group += [wrt.disk(tuple(a), tuple(b), 0.1) for a, b in zip(places[9:], axes[9:], strict=True)]
    group.append(wrt.spheres(rng.uniform(-0.4, 0.4, (20, 3)), rng.uniform(0.02, 0.08, 20)))
    for x, mirror in ((1.2, 1.0), (-1.4, -1.0)):
        place = np.diag([mirror, 1.0, 1.0, 1.0])
        place[:3, 3] = x, 0.5, -0.3
        for k, mesh in enumerate(cut(each, exact) for each in group):
            scene.add(mesh, material=wrt.Diffuse((0.7, 0.3, 0.2)), transform=place, emission=4.0 if k % 7 == 0 else 0.0)
    scene.add(cut(wrt.disk((0.0, 2.0, 0.3), (0.2, -1, 0), 0.3), exact), emission=6.0)
    inward = wrt.cylinder((0.0, 0.3, 0.0), (0.1, 0.9, 0.6), 0.3).turned_inside_out()
    for mesh, two_sided in ((inward, False), (wrt.cylinder((1.2, 0.2, 1.0), (1.0, 0.9, 1.2), 0.1), True)):
        looks = {"material": wrt.Diffuse(0.4), "two_sided_emission": two_sided}
        scene.add(cut(mesh, exact), emission=(3.0, 2.5, 2.0), **looks)
    wine = wrt.Dielectric(interior=wrt.Medium(absorption=(0.5, 2.0, 3.0)))
    scene.add(cut(wrt.spheres([(-0.6, 0.3, 1.0)], 0.25), exact), material=wine)
    return scene


@pytest.mark.slow
def test_shapes_look_as_fine_triangles_do(device: str, report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)
    a, b = (rendered(varied(exact), 512, seed=1 + exact, device=device, filter="box") for exact in (True, False))
    result = image_z_test(a.image(), a.variance(), b.image(), b.variance(), n_a=512, n_b=512)
    report("against triangles, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p)
    assert result.agrees(), result.message


# --- Both kernels ------------------------------------------------------------------------------------


def from_afar(distance: float) -> wrt.Scene:
    """Small shapes, several to a leaf, seen so that float32 hardly resolves them: along an axis or beside it."""
    rng = np.random.default_rng(12)
    turned = (0.3, 0.2, 1.0) if distance == 1e5 else (0.0, 0.0, 1.0)
    eye = distance * np.array(turned) / np.linalg.norm(turned)
    camera = wrt.PerspectiveCamera(tuple(eye), (0.0, 0.0, 0.0), fov_degrees=math.degrees(2.4 / distance))
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(1.0))
    for a, b in zip(rng.uniform(-1.0, 1.0, (150, 3)), rng.standard_normal((150, 3)), strict=True):
        look = {"material": wrt.Diffuse(tuple(rng.random(3)))}
        scene.add(wrt.disk(tuple(a), tuple(b), 0.12), **look)
        scene.add(wrt.cylinder(tuple(a[::-1]), tuple(a[::-1] + 0.2 * b), 0.04), **look)
    return scene


@needs_lanes
@pytest.mark.slow
@pytest.mark.parametrize("distance", [1e4, 1e5, 1e6])
def test_both_kernels_see_the_same_from_afar(distance: float) -> None:
    """Neither counts a hit that is rounded out of the box around its shape."""
    assert differences(from_afar(distance)) == []
