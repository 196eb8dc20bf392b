"""Pictures of exact spheres: light from them in closed form, a furnace, motion, and both kernels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.statistics import image_z_test, t_test_mean
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

    # Seen from above, the sphere hides a part of the floor.
    at = 50.0 * np.array([0.4, -0.3])[:, None, None] / (50.0 - 1.2)
    clear = np.hypot(*(where - at)) > radius * 1.1 + 0.15
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
    """Within a sphere that emits 1 inwards, the radiance is 1 / (1 − a), as in `test_furnace.py`."""
    albedo, middle = 0.8, np.array(center)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(middle + (0.3, -0.2, 0.5), middle + (-0.4, 0.3, -1), fov_degrees=90))
    ball = wrt.sphere(center, 1.0, exact=True)
    assert isinstance(ball, Spheres)
    scene.add(ball.turned_inside_out(), material=wrt.Diffuse(albedo), emission=1.0)
    renderer = wrt.Renderer(scene, sampler="independent", width=32, height=32, seed=1, max_depth=1000, device=device)
    for _ in renderer.passes(spp=256):
        pass
    mean = float(renderer.image().astype(np.float64).mean())
    error = float(np.sqrt(renderer.variance()[..., 0].sum())) / (32 * 32)
    expected = 1.0 / (1.0 - albedo)
    report("radiance within", mean, expected, p=t_test_mean(mean, error**2, 32 * 32 * 256, expected))
    assert abs(mean - expected) < 3.0 * error
    assert not renderer.film.rejected


def picture(scene: wrt.Scene, seed: int, device: str, spp: int = 256) -> tuple[NDArray, NDArray]:
    renderer = wrt.Renderer(
        scene, sampler="independent", width=48, height=36, seed=seed, max_depth=5, device=device, filter="box"
    )
    for _ in renderer.passes(spp=spp):
        pass
    return renderer.image(), renderer.variance()


def moving(exact: bool) -> wrt.Scene:
    """A ball that rolls and grows, two instances of many balls, one of them mirrored, and a moving box."""
    rng = np.random.default_rng(4)
    image = wrt.ImageTexture(rng.random((4, 8, 3)).astype(np.float32), filter="nearest")
    camera = wrt.PerspectiveCamera((0.0, 1.2, 4.0), (0.0, 0.5, 0.0), shutter_open=0.0, shutter_close=1.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(1.0))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse(0.5))

    def ball(mesh: Spheres) -> wrt.Mesh:
        return mesh if exact else mesh.tessellated(256 if len(mesh.faces) == 1 else 48)

    one = wrt.spheres([(0.0, 0.0, 0.0)], 0.4)
    first, last = np.eye(4), np.diag([1.3, 1.3, 1.3, 1.0])
    first[:3, 3], last[:3, 3] = (-0.8, 0.4, 0.0), (0.2, 0.5, 0.5)
    last[:3, :3] = last[:3, :3] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    roll = wrt.Motion(np.array([0.0, 1.0]), np.stack([first, last]))
    scene.add(ball(one), material=wrt.Diffuse(image), transform=roll)
    many = ball(wrt.spheres(rng.uniform(-0.4, 0.4, (40, 3)), rng.uniform(0.02, 0.1, 40)))
    for x, mirror in ((1.2, 1.0), (-1.4, -1.0)):
        place = np.diag([mirror, 1.0, 1.0, 1.0])
        place[:3, 3] = x, 0.5, 0.3
        scene.add(many, material=wrt.Diffuse((0.7, 0.3, 0.2)), transform=place)
    scene.add(wrt.spheres([(0.9, 1.4, 0.0)], 0.2) if exact else wrt.sphere((0.9, 1.4, 0.0), 0.2), emission=8.0)
    return scene


@pytest.mark.slow
def test_moving_spheres_look_as_fine_triangles_do(device: str, report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    from wrt.upload.accel import instancing

    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)
    exact, cut = picture(moving(True), 1, device), picture(moving(False), 2, device)
    result = image_z_test(*exact, *cut, n_a=256, n_b=256)
    report(
        "exact spheres against triangles, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0, p=result.mean_p
    )
    assert result.agrees(), result.message


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
    exact, cut = picture(misty(True), 1, device, 128), picture(misty(False), 2, device, 128)
    result = image_z_test(*exact, *cut, n_a=128, n_b=128)
    difference = f"{100.0 * result.relative_difference[1]:+.3f}"
    report("spheres of media against triangles, per cent", difference, 0, p=result.mean_p)
    assert result.agrees(), result.message


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
