"""Pictures of exact disks and cylinders: light from them in closed form, a furnace, motion, and both kernels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.statistics import image_z_test, t_test_mean
from test_irradiance import check, floor_scene, irradiance, pixel_mean
from test_sphere_pictures import picture
from test_wide import differences, needs_lanes

import wrt
from wrt.scene.exact.quadrics import Quadrics


def clear_of(where: NDArray, center: tuple[float, float], height: float, radius: float) -> NDArray:
    """Return the pixels of the floor that nothing at that height hides from the camera, 50 m above."""
    at = 50.0 * np.array(center)[:, None, None] / (50.0 - height)
    return np.hypot(*(where - at)) > radius * 1.1 + 0.15


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
    """Within a cylinder with caps that emits 1 inwards, the radiance is 1 / (1 − a), as in `test_furnace.py`."""
    albedo, middle = 0.8, np.array(center)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(middle + (0.3, -0.2, 0.5), middle + (-0.4, 0.3, -1), fov_degrees=90))
    axis = np.array([0.2, 0.9, -0.3])
    side = wrt.cylinder(tuple(middle - axis), tuple(middle + axis), 0.8).turned_inside_out()
    for mesh in (
        side,
        wrt.disk(tuple(middle - axis), tuple(axis), 0.8001),
        wrt.disk(tuple(middle + axis), tuple(-axis), 0.8001),
    ):
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


def cut(mesh: Quadrics, exact: bool, segments: int = 256) -> wrt.Mesh:
    return mesh if exact else mesh.tessellated(segments)


def moving(exact: bool) -> wrt.Scene:
    """A disk that turns and becomes an ellipse, a tube that rolls, shared meshes, one place mirrored, and lights."""
    rng = np.random.default_rng(4)
    image = wrt.ImageTexture(rng.random((4, 8, 3)).astype(np.float32), filter="nearest")
    camera = wrt.PerspectiveCamera((0.0, 1.2, 4.0), (0.0, 0.5, 0.0), shutter_open=0.0, shutter_close=1.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.5))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse(0.5))
    first, last = np.eye(4), np.diag([1.3, 1.3, 1.3, 1.0])
    first[:3, 3], last[:3, 3] = (-0.8, 0.4, 0.0), (0.2, 0.5, 0.5)
    last[:3, :3] = last[:3, :3] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    roll = wrt.Motion(np.array([0.0, 1.0]), np.stack([first, last]))
    tube = wrt.cylinder((-0.1, -0.1, -0.3), (0.1, 0.1, 0.3), 0.35)
    scene.add(cut(tube, exact), material=wrt.Diffuse(image), transform=roll)
    first, last = np.eye(4), np.diag([1.0, 0.4, 1.5, 1.0])
    first[:3, 3], last[:3, 3] = (0.9, 0.5, 0.6), (0.7, 0.6, 0.5)
    grow = wrt.Motion(np.array([0.0, 1.0]), np.stack([first, last]))
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
        place = np.diag([mirror, 1.0, 1.0, 1.0])
        place[:3, 3] = x, 0.5, -0.3
        for k, mesh in enumerate(cut(each, exact) for each in (*tubes, *plates)):
            shine = 4.0 if k % 6 == 0 else 0.0
            scene.add(mesh, material=wrt.Diffuse((0.7, 0.3, 0.2)), transform=place, emission=shine)
    scene.add(cut(wrt.disk((0.0, 2.0, 0.3), (0.2, -1, 0), 0.3), exact), emission=6.0)
    return scene


@pytest.mark.slow
def test_moving_shapes_look_as_fine_triangles_do(device: str, report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    from wrt.upload.accel import instancing

    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)
    exact, triangles = picture(moving(True), 1, device), picture(moving(False), 2, device)
    result = image_z_test(*exact, *triangles, n_a=256, n_b=256)
    difference = f"{100.0 * result.relative_difference[1]:+.3f}"
    report("disks and cylinders against triangles, per cent", difference, 0, p=result.mean_p)
    assert result.agrees(), result.message


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
    exact, triangles = picture(lamps(True), 1, device, 1024), picture(lamps(False), 2, device, 1024)
    result = image_z_test(*exact, *triangles, n_a=1024, n_b=1024)
    difference = f"{100.0 * result.relative_difference[1]:+.3f}"
    report("lamps against triangles, per cent", difference, 0, p=result.mean_p)
    assert result.agrees(), result.message


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


@needs_lanes
@pytest.mark.slow
@pytest.mark.parametrize("make", [still, lambda: moving(True)], ids=["one tree", "instances"])
def test_both_kernels_leave_the_same_bits(make: object) -> None:
    assert callable(make)
    assert differences(make()) == []
