"""Pictures of exact disks and cylinders: light from them in closed form, a furnace, motion, and both kernels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.exact_pictures import (
    ROLL,
    check_furnace,
    check_like_triangles,
    clear_of,
    exposed_floor,
    motion,
    placed,
)
from test_irradiance import check, floor_scene, irradiance, pixel_mean
from test_wide import differences, needs_lanes

import wrt
from wrt.scene.exact.quadrics import Quadrics


@pytest.mark.parametrize(
    ("strategy", "radius", "spp"), [("mis", 0.3, 1024), ("light", 0.01, 256), ("light", 0.9, 1024), ("bsdf", 0.9, 4096)]
)
def test_irradiance_of_a_disk(strategy: str, radius: float, spp: int, device: str, report: Report) -> None:
    """A disk parallel to the floor: E = π L ½ (1 − (h² + s² − r²) / √((h² + s² + r²)² − 4 r² s²)) (Howell, B-13)."""
    scene = floor_scene()
    radiance, height = 2.0 / radius**2, 1.2
    scene.add(wrt.disk((0.4, height, -0.3), (0, -1, 0), radius), material=wrt.Diffuse(0.0), emission=radiance)
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)

    def expected(x: NDArray, z: NDArray) -> NDArray:
        s2, h2, r2 = (x - 0.4) ** 2 + (z + 0.3) ** 2, height**2, radius**2
        root = np.sqrt((h2 + s2 + r2) ** 2 - 4.0 * r2 * s2)
        # 1 − a / root without the difference of nearly equal numbers
        share = 4.0 * h2 * r2 / (root * (root + h2 + s2 - r2))
        return 0.5 * math.pi * radiance * share

    clear = clear_of(where, (0.4, -0.3), height, radius)
    name = f"disk of {radius} m, {strategy}"
    check(name, measured[clear], variance[clear], pixel_mean(expected, where)[clear], spp, report)


def from_cylinder(ends: NDArray, radius: float, radiance: float, x: NDArray, z: NDArray) -> NDArray:
    """Return the irradiance of the floor by Gauss's rule over the part of a cylinder that faces a point.

    With the whole cylinder above the floor, the integrand is smooth there.
    """
    middle, length = ends.mean(axis=0), float(np.linalg.norm(ends[1] - ends[0]))
    axis = (ends[1] - ends[0]) / length
    points = np.stack([x, np.zeros_like(x), z], axis=-1)
    away = points - middle
    away = away - (away @ axis)[..., None] * axis
    far = np.linalg.norm(away, axis=-1)
    first = away / far[..., None]
    second = np.cross(axis, first)
    reach = np.arccos(radius / far)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    total = np.zeros_like(x)
    for turn, share in zip(nodes, weights, strict=True):
        out = np.cos(turn * reach)[..., None] * first + np.sin(turn * reach)[..., None] * second
        for along, part in zip(nodes, weights, strict=True):
            way = middle + 0.5 * length * along * axis + radius * out - points
            d2 = (way**2).sum(axis=-1)
            cosines = way[..., 1] * -(way * out).sum(axis=-1) / d2
            total += share * part * np.maximum(cosines, 0.0) / d2 * reach
    return np.asarray(0.5 * length * radius * radiance * total)


@pytest.mark.parametrize(("strategy", "spp"), [("mis", 1024), ("light", 512), ("bsdf", 4096)])
def test_irradiance_of_a_cylinder(strategy: str, spp: int, device: str, report: Report) -> None:
    scene, radius, radiance = floor_scene(), 0.25, 8.0
    ends = np.array([(-0.5, 0.9, 0.1), (0.6, 1.3, 0.4)])
    scene.add(wrt.cylinder(*map(tuple, ends), radius), material=wrt.Diffuse(0.0), emission=radiance)
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)
    clear = clear_of(where, (0.05, 0.25), 1.2, 0.85)
    expected = pixel_mean(lambda x, z: from_cylinder(ends, radius, radiance, x, z), where)
    check(f"cylinder, {strategy}", measured[clear], variance[clear], expected[clear], spp, report)


@pytest.mark.parametrize("center", [(0.0, 0.0, 0.0), (300.0, -200.0, 100.0)])
def test_no_light_leaks_out_of_a_can(center: tuple[float, float, float], device: str, report: Report) -> None:
    middle, axis = np.array(center), np.array([0.2, 0.9, -0.3])
    side = wrt.cylinder(tuple(middle - axis), tuple(middle + axis), 0.8).turned_inside_out()
    low = wrt.disk(tuple(middle - axis), tuple(axis), 0.8001)
    high = wrt.disk(tuple(middle + axis), tuple(-axis), 0.8001)
    check_furnace([side, low, high], middle, device, report)


def cut(mesh: Quadrics, exact: bool, segments: int = 256) -> wrt.Mesh:
    return mesh if exact else mesh.tessellated(segments)


def moving(exact: bool) -> wrt.Scene:
    """A disk that turns and becomes an ellipse, a tube that rolls, shared meshes, one place mirrored, and lights."""
    rng = np.random.default_rng(4)
    image = wrt.ImageTexture(rng.random((4, 8, 3)).astype(np.float32), filter="nearest")
    scene = exposed_floor(0.5)
    roll = motion((-0.8, 0.4, 0.0), (0.2, 0.5, 0.5), 1.3 * ROLL)
    tube = wrt.cylinder((-0.1, -0.1, -0.3), (0.1, 0.1, 0.3), 0.35)
    scene.add(cut(tube, exact), material=wrt.Diffuse(image), transform=roll)
    grow = motion((0.9, 0.5, 0.6), (0.7, 0.6, 0.5), np.diag([1.0, 0.4, 1.5]))
    plate = wrt.disk((0, 0, 0), (1, 1, 2), 0.3)
    scene.add(cut(plate, exact), material=wrt.Diffuse(image), transform=grow, emission=image)
    tubes = [
        wrt.cylinder(tuple(a), tuple(a + b), 0.03)
        for a, b in zip(rng.uniform(-0.4, 0.4, (9, 3)), 0.3 * rng.standard_normal((9, 3)), strict=True)
    ]
    plates = [
        wrt.disk(tuple(a), tuple(b), 0.1)
        for a, b in zip(rng.uniform(-0.4, 0.4, (9, 3)), rng.standard_normal((9, 3)), strict=True)
    ]
    for x, mirror in ((1.2, 1.0), (-1.4, -1.0)):
        place = placed(x, mirror, -0.3)
        for k, mesh in enumerate(cut(each, exact) for each in (*tubes, *plates)):
            shine = 4.0 if k % 6 == 0 else 0.0
            scene.add(mesh, material=wrt.Diffuse((0.7, 0.3, 0.2)), transform=place, emission=shine)
    scene.add(cut(wrt.disk((0.0, 2.0, 0.3), (0.2, -1, 0), 0.3), exact), emission=6.0)
    return scene


@pytest.mark.slow
def test_moving_shapes_look_as_fine_triangles_do(device: str, report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    from wrt.upload.accel import instancing

    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)
    check_like_triangles(moving, "disks and cylinders", device, report)


def lamps(exact: bool) -> wrt.Scene:
    """Tubes that shine outwards, inwards and to both sides, an ellipse with an image, and glass with absorption."""
    rng = np.random.default_rng(9)
    image = wrt.ImageTexture(rng.random((4, 4, 3)).astype(np.float32))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.2, 1.5, 5.0), (0.0, 0.6, 0.0)))
    scene.add(wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse(0.6))
    out = wrt.cylinder((-1.5, 0.4, 0.0), (-0.9, 1.2, 0.3), 0.15)
    inward = wrt.cylinder((0.0, 0.3, 0.0), (0.1, 0.9, 0.6), 0.3).turned_inside_out()
    both = wrt.cylinder((1.2, 0.2, 0.0), (1.0, 0.9, 0.5), 0.2)
    for mesh, two_sided in ((out, False), (inward, False), (both, True)):
        looks = {"material": wrt.Diffuse(0.4), "two_sided_emission": two_sided}
        scene.add(cut(mesh, exact), emission=(3.0, 2.5, 2.0), **looks)
    plate = wrt.disk((0, 0, 0), (0, -1, 0.3), 0.5).transformed(
        [[1.2, 0.3, 0, 0.3], [0, 0.6, 0.2, 2.2], [0.2, 0, 0.8, -0.5], [0, 0, 0, 1]]
    )
    assert isinstance(plate, Quadrics)
    scene.add(cut(plate, exact), material=wrt.Diffuse(0.2), emission=image)
    wine = wrt.Dielectric(interior=wrt.Medium(absorption=(0.5, 2.0, 3.0)))
    ends = (0.4, 0.35, 1.4), (-0.4, 0.35, 1.5)
    along = np.subtract(*ends)
    for mesh in (wrt.cylinder(*ends, 0.3), wrt.disk(ends[0], tuple(along), 0.3), wrt.disk(ends[1], tuple(-along), 0.3)):
        scene.add(cut(mesh, exact), material=wine)
    return scene


@pytest.mark.slow
def test_lamps_shine_as_fine_triangles_do(device: str, report: Report) -> None:
    check_like_triangles(lamps, "lamps", device, report, 1024)


def still() -> wrt.Scene:
    """Lamps, a sphere and a pane among many small shapes in one tree."""
    rng = np.random.default_rng(1)
    scene = lamps(True)
    scene.add(wrt.sphere((1.2, 0.5, 1.0), 0.3, exact=True), material=wrt.Dielectric())
    for a, b in zip(rng.uniform(-1.5, 1.5, (60, 3)), rng.standard_normal((60, 3)), strict=True):
        at = a * (1.0, 0.3, 1.0) + (0.0, 0.6, 0.0)
        scene.add(wrt.disk(tuple(at), tuple(b), 0.05), material=wrt.Diffuse((0.8, 0.3, 0.3)))
        scene.add(wrt.cylinder(tuple(at), tuple(at + 0.2 * b), 0.02), material=wrt.Diffuse((0.3, 0.3, 0.8)))
    return scene


def from_afar(distance: float) -> wrt.Scene:
    """Small shapes, several to a leaf, seen so that float32 hardly resolves them: along an axis or beside it."""
    rng = np.random.default_rng(12)
    turned = (0.3, 0.2, 1.0) if distance == 1e5 else (0.0, 0.0, 1.0)
    eye = distance * np.array(turned) / np.linalg.norm(turned)
    fov = math.degrees(2.4 / distance)
    scene = wrt.Scene(
        camera=wrt.PerspectiveCamera(tuple(eye), (0.0, 0.0, 0.0), fov_degrees=fov),
        environment=wrt.ConstantEnvironment(1.0),
    )
    for a, b in zip(rng.uniform(-1.0, 1.0, (150, 3)), rng.standard_normal((150, 3)), strict=True):
        look = {"material": wrt.Diffuse(tuple(rng.random(3)))}
        scene.add(wrt.disk(tuple(a), tuple(b), 0.12), **look)
        scene.add(wrt.cylinder(tuple(a[::-1]), tuple(a[::-1] + 0.2 * b), 0.04), **look)
    return scene


@needs_lanes
@pytest.mark.slow
@pytest.mark.parametrize("distance", [1e4, 1e5, 1e6])
def test_both_kernels_see_the_same_from_afar(distance: float) -> None:
    """A hit that is rounded out of the box around its shape counts in neither."""
    assert differences(from_afar(distance)) == []


@needs_lanes
@pytest.mark.slow
@pytest.mark.parametrize("make", [still, lambda: moving(True)], ids=["one tree", "instances"])
def test_both_kernels_leave_the_same_bits(make: object) -> None:
    assert callable(make)
    assert differences(make()) == []
