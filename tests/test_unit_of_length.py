"""A picture does not depend on the unit of length, nor on how far from the origin a thing is: nothing shades itself."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.statistics import image_z_test, t_test_mean

import wrt

FloatArray = NDArray[np.float64]

SIZE = {"width": 48, "height": 36}


def turned(mesh: wrt.Mesh, scale: float, center: FloatArray, rng: np.random.Generator) -> wrt.Mesh:
    """Return a mesh turned at random, flat, `center` from the origin."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    q = q * np.sign(np.linalg.det(q))
    return wrt.Mesh(scale * (mesh.vertices @ q.T + center), mesh.faces)


def room(scale: float, *, bodies: bool = False) -> wrt.Scene:
    """A box with an open front: walls that reflect one another, a turned cube and a ball, and a lamp."""
    rng = np.random.default_rng(3)
    camera = wrt.PerspectiveCamera((0.2 * scale, 1.0 * scale, 3.2 * scale), (0.0, 0.8 * scale, 0.0), fov_degrees=42)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.1))

    def quad(*vectors: tuple[float, float, float]) -> wrt.Mesh:
        return wrt.quad(*(tuple(scale * x for x in vector) for vector in vectors))  # type: ignore[arg-type]

    scene.add(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), material=wrt.Diffuse((0.7, 0.6, 0.5)))
    scene.add(quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)), material=wrt.Diffuse(0.7))
    scene.add(quad((-1, 0, 1), (0, 0, -2), (0, 2, 0)), material=wrt.Diffuse((0.6, 0.1, 0.1)))
    scene.add(quad((-0.4, 1.9, -0.4), (0.8, 0, 0), (0, 0, 0.8)), emission=8.0)
    cube = turned(wrt.box((-0.3,) * 3, (0.3,) * 3), scale, np.array([-0.4, 0.55, -0.3]), rng)
    scene.add(cube, material=wrt.Diffuse(0.8))
    ball = wrt.sphere(tuple(scale * x for x in (0.45, 0.35, 0.2)), 0.3 * scale, subdivisions=3)
    scene.add(ball, material=wrt.Dielectric() if bodies else wrt.Conductor())
    return scene


def rendered(scene: wrt.Scene, device: str, spp: int, **options: object) -> wrt.Renderer:
    settings = {**SIZE, "max_depth": 6, "sampler": "independent", **options}
    renderer = wrt.Renderer(scene, device=device, **settings)  # type: ignore[arg-type]
    for _ in renderer.passes(spp=spp):
        pass
    assert renderer.film.rejected == 0
    return renderer


@pytest.mark.parametrize("bodies", [False, True])
def test_a_unit_that_is_a_power_of_two_gives_the_same_bits(bodies: bool, device: str) -> None:
    """All roundings are the same then: there is no length of its own in any kernel."""
    expected = rendered(room(1.0, bodies=bodies), device, 16).image()
    for scale in (2.0**-10, 2.0**10):
        np.testing.assert_array_equal(rendered(room(scale, bodies=bodies), device, 16).image(), expected)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_same_scene_in_other_units_looks_the_same(scale: float, device: str, report: Report) -> None:
    one, other = rendered(room(1.0), device, 256, seed=1), rendered(room(scale), device, 256, seed=2)
    test = image_z_test(one.image(), one.variance(), other.image(), other.variance(), n_a=256, n_b=256)
    report(f"scale {scale:g}", test.message)
    assert test.agrees()
    # No speckles: with the same random numbers, hardly a path is another.
    same = rendered(room(scale), device, 16, seed=1).image()
    close = np.isclose(same, rendered(room(1.0), device, 16, seed=1).image(), rtol=1e-3)
    report(f"scale {scale:g}: channels that differ by less than 0.1 %", close.mean())
    assert close.mean() > 0.97


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("away", [0.0, 30.0])
@pytest.mark.parametrize("kind", ["cube", "ball", "needles"])
def test_convex_bodies_do_not_shade_themselves(
    kind: str, scale: float, away: float, device: str, report: Report
) -> None:
    """Under a sky of radiance 1 a convex body shows its albedo, exactly but for what it wrongly blocks."""
    ball = wrt.sphere(subdivisions=3)
    stretch = np.array([1.0, 1.0, 0.02]) if kind == "needles" else np.ones(3)
    mesh = wrt.box((-0.7,) * 3, (0.7,) * 3) if kind == "cube" else wrt.Mesh(ball.vertices * stretch, ball.faces)
    center = away * np.array([1.0, 0.6, -0.8])
    eye, target = scale * (center + [0.0, 0.0, 8.0]), scale * center
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(tuple(eye), tuple(target), fov_degrees=5.0))
    scene.environment = wrt.ConstantEnvironment(1.0)
    scene.add(turned(mesh, scale, center, np.random.default_rng(6)), material=wrt.Diffuse(0.5))
    renderer = rendered(scene, device, 64, width=24, height=24, max_depth=8, filter="box")
    seen = renderer.image()[..., 0].astype(np.float64)
    inside = seen[8:16, 8:16]
    report(f"{kind}, scale {scale:g}, {away:g} away: radiance", inside.mean(), 0.5)
    assert np.abs(inside - 0.5).max() < 1e-3
    assert abs(inside.mean() - 0.5) < 1e-4


@pytest.mark.parametrize("strategy", ["light", "mis"])
@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_furnace_of_any_size(scale: float, strategy: str, device: str, report: Report) -> None:
    """Between walls that shine 1 and have an albedo of one half the radiance is 2."""
    rng = np.random.default_rng(8)
    box = wrt.box((-1.0,) * 3, (1.0,) * 3)
    walls = turned(wrt.Mesh(box.vertices, box.faces[:, ::-1]), scale, np.zeros(3), rng)
    camera = wrt.PerspectiveCamera((0.3 * scale, -0.2 * scale, 0.5 * scale), (0.0, 0.0, 0.0), fov_degrees=90)
    scene = wrt.Scene(camera=camera)
    scene.add(walls, material=wrt.Diffuse(0.5), emission=1.0)
    renderer = rendered(scene, device, 512, width=32, height=32, max_depth=1000, strategy=strategy)
    mean = float(renderer.image()[..., 0].astype(np.float64).mean())
    error = float(np.sqrt(renderer.variance()[..., 0].sum())) / 32**2
    report(f"scale {scale:g}, {strategy}", mean, 2.0, p=t_test_mean(mean, error**2, 32 * 32 * 512, 2.0))
    assert abs(mean - 2.0) < 4.0 * error


@pytest.mark.parametrize("far", [10.0, 1e3, 1e5])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_lamp_is_seen_from_afar(far: float, axis: int, device: str, report: Report) -> None:
    """A square of 2 cm at the origin that shines L gives the irradiance L A / r² at a distance of r, all of it.

    The error of a hit's distance is there larger than the lamp.
    """
    u, v, n = np.roll(np.eye(3), axis, axis=0)
    lamp = wrt.quad(tuple(-0.01 * u - 0.01 * v), tuple(0.02 * u), tuple(0.02 * v))
    facing = wrt.quad(tuple(far * n - u - v), tuple(2.0 * v), tuple(2.0 * u))
    place = far * n - 3.0 * n
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(tuple(place), tuple(far * n), tuple(u), fov_degrees=8.0))
    scene.add(lamp, emission=1e4 * far**2)
    scene.add(facing, material=wrt.Diffuse(0.5))
    renderer = rendered(scene, device, 64, width=8, height=8, max_depth=2, strategy="light")
    seen = renderer.image()[..., 0].astype(np.float64)
    expected = 0.5 / np.pi * 1e4 * 0.02**2
    report(f"{far:g} m away: radiance", seen.mean(), expected)
    np.testing.assert_allclose(seen, expected, rtol=2e-3)


@pytest.mark.parametrize("unit", [0.001, 1.0, 1000.0])
def test_a_mesh_of_any_unit_can_be_set_on_the_floor(unit: float) -> None:
    mesh = wrt.box((3.0, -2.0, 5.0), (4.0, 2.0, 7.0)).scaled(unit).standing(1.5)
    np.testing.assert_allclose(mesh.bounds, [[-0.1875, 0.0, -0.375], [0.1875, 1.5, 0.375]], atol=1e-6)
    with pytest.raises(wrt.InputError, match=r"^quad: the mesh is flat along y, so it cannot be scaled to a height$"):
        wrt.quad((0, 1, 0), (0, 0, unit), (unit, 0, 0)).standing(1.0)
    for height in (0.0, -1.0, float("nan"), "tall"):
        with pytest.raises(wrt.InputError, match="box: height must be"):
            wrt.box((0, 0, 0), (1, 1, 1)).standing(height)  # type: ignore[arg-type]
