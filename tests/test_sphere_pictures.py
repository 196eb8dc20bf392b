"""Pictures of exact spheres: light from them in closed form, a furnace, motion, and both kernels."""

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
from wrt.scene.exact.spheres import Spheres


@pytest.mark.parametrize(("strategy", "radius", "spp"), [("mis", 0.3, 1024), ("light", 1e-3, 256), ("bsdf", 0.9, 4096)])
def test_irradiance_of_an_emissive_sphere(strategy: str, radius: float, spp: int, device: str, report: Report) -> None:
    """E = π L (r / d)² cosθ where the whole sphere is above the horizon (Howell, C-137)."""
    scene = floor_scene()
    radiance = 2.0 / radius**2
    scene.add(wrt.sphere((0.4, 1.2, -0.3), radius, exact=True), material=wrt.Diffuse(0.0), emission=radiance)
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)

    def expected(x: NDArray, z: NDArray) -> NDArray:
        d2 = (x - 0.4) ** 2 + 1.2**2 + (z + 0.3) ** 2
        return math.pi * 2.0 / d2 * (1.2 / np.sqrt(d2))

    clear = clear_of(where, (0.4, -0.3), 1.2, radius)
    check(
        f"sphere of {radius} m, {strategy}",
        measured[clear],
        variance[clear],
        pixel_mean(expected, where)[clear],
        spp,
        report,
    )


@pytest.mark.parametrize("center", [(0.0, 0.0, 0.0), (300.0, -200.0, 100.0)])
def test_no_light_leaks_out_of_a_sphere(center: tuple[float, float, float], device: str, report: Report) -> None:
    ball = wrt.sphere(center, 1.0, exact=True)
    assert isinstance(ball, Spheres)
    check_furnace([ball.turned_inside_out()], np.array(center), device, report)


def moving(exact: bool) -> wrt.Scene:
    """A ball that rolls and grows, two instances of many balls, one of them mirrored, and a moving box."""
    rng = np.random.default_rng(4)
    image = wrt.ImageTexture(rng.random((4, 8, 3)).astype(np.float32), filter="nearest")
    scene = exposed_floor(1.0)

    def ball(mesh: Spheres) -> wrt.Mesh:
        return mesh if exact else mesh.tessellated(256 if len(mesh.faces) == 1 else 48)

    one = wrt.spheres([(0.0, 0.0, 0.0)], 0.4)
    roll = motion((-0.8, 0.4, 0.0), (0.2, 0.5, 0.5), 1.3 * ROLL)
    scene.add(ball(one), material=wrt.Diffuse(image), transform=roll)
    many = ball(wrt.spheres(rng.uniform(-0.4, 0.4, (40, 3)), rng.uniform(0.02, 0.1, 40)))
    for x, mirror in ((1.2, 1.0), (-1.4, -1.0)):
        scene.add(many, material=wrt.Diffuse((0.7, 0.3, 0.2)), transform=placed(x, mirror, 0.3))
    scene.add(wrt.spheres([(0.9, 1.4, 0.0)], 0.2) if exact else wrt.sphere((0.9, 1.4, 0.0), 0.2), emission=8.0)
    return scene


@pytest.mark.slow
def test_moving_spheres_look_as_fine_triangles_do(device: str, report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    from wrt.upload.accel import instancing

    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)
    check_like_triangles(moving, "exact spheres", device, report)


def misty(exact: bool) -> wrt.Scene:
    """A camera in a sphere of mist, with balls of coloured glass and of milk, one in the other's shadow."""
    camera = wrt.PerspectiveCamera((0.2, 1.0, 3.0), (0.0, 0.5, 0.0), fov_degrees=35.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment((0.5, 0.6, 0.8)))
    scene.add(wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse(0.5))
    scene.add(wrt.quad((-1, 3, -1), (2, 0, 0), (0, 0, 2)), emission=(7.0, 6.0, 4.0))
    mist = wrt.Medium(scattering=0.3, absorption=(0.05, 0.1, 0.2))
    milk = wrt.Medium(scattering=(4.0, 3.0, 2.0), absorption=0.1)
    wine = wrt.Medium(absorption=(0.5, 2.0, 3.0))
    for center, radius, material in (
        ((0.0, 0.5, 0.0), 6.0, wrt.Null(interior=mist)),
        ((-0.35, 0.4, 0.0), 0.3, wrt.Null(interior=milk)),
        ((0.35, 0.4, 0.3), 0.3, wrt.Dielectric(interior=wine)),
    ):
        ball = wrt.spheres([center], radius)
        scene.add(ball if exact else ball.tessellated(128), material=material)
    return scene


@pytest.mark.slow
def test_spheres_bound_media_as_triangles_do(device: str, report: Report) -> None:
    check_like_triangles(misty, "spheres of media", device, report, 128)


def still() -> wrt.Scene:
    """Spheres of several materials among triangles, one of which shines."""
    rng = np.random.default_rng(1)
    image = wrt.ImageTexture(rng.random((8, 16, 3)).astype(np.float32))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.2, 1.5, 5.0), (0.0, 0.6, 0.0)))
    scene.add(wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse(0.6))
    scene.add(wrt.quad((-1, 3, -1), (2, 0, 0), (0, 0, 2)), emission=(7.0, 6.0, 4.0), two_sided_emission=True)
    scene.add(wrt.sphere((0.0, 0.5, 0.0), 0.5, exact=True), material=wrt.Diffuse(image))
    scene.add(wrt.sphere((1.2, 0.5, 0.5), 0.5, exact=True), material=wrt.Dielectric())
    scene.add(wrt.sphere((-0.5, 1.5, 0.2), 0.2, exact=True), material=wrt.Diffuse(0.2), emission=image)
    many = rng.uniform(-1.5, 1.5, (300, 3)) * (1.0, 0.3, 1.0) + (0.0, 0.6, 0.0)
    colors = rng.random((300, 3))
    small = wrt.spheres(many, rng.uniform(0.01, 0.05, 300), colors=colors)
    scene.add(small, material=wrt.Diffuse(wrt.VertexColor()))
    return scene


@needs_lanes
@pytest.mark.slow
def test_both_kernels_leave_the_same_bits() -> None:
    assert differences(still()) == []
