"""A picture depends neither on the unit of length nor on the distance from the origin: no surface shades itself."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from support.covering_kernels import MATT_AND_METAL, rendering_with
from support.ray_trees import affine, rotation
from support.small_scenes import rendered

import wrt
from wrt.upload.accel import instancing

one_kernel = rendering_with(MATT_AND_METAL)


@pytest.fixture
def shared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meshes of few triangles too have trees of their own."""
    monkeypatch.setattr(instancing, "WORTH_SHARING", 0)


def room(scale: float, ball: wrt.Material) -> wrt.Scene:
    """A box with an open front: walls that reflect one another, a turned cube and a ball, and a lamp."""
    camera = wrt.PerspectiveCamera((0.2 * scale, 1.0 * scale, 3.2 * scale), (0.0, 0.8 * scale, 0.0), fov_degrees=42)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.1))

    def quad(*vectors: tuple[float, float, float]) -> wrt.Mesh:
        return wrt.quad(*(tuple(scale * x for x in vector) for vector in vectors))  # type: ignore[arg-type]

    scene.add(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), material=wrt.Diffuse((0.7, 0.6, 0.5)))
    scene.add(quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)), material=wrt.Diffuse(0.7))
    scene.add(quad((-1, 0, 1), (0, 0, -2), (0, 2, 0)), material=wrt.Diffuse((0.6, 0.1, 0.1)))
    scene.add(quad((-0.4, 1.9, -0.4), (0.8, 0, 0), (0, 0, 0.8)), emission=8.0)
    box = wrt.box((-0.3,) * 3, (0.3,) * 3)
    place = rotation(np.random.default_rng(3))
    scene.add(wrt.Mesh(scale * (box.vertices @ place.T + [-0.4, 0.55, -0.3]), box.faces), material=wrt.Diffuse(0.8))
    scene.add(wrt.sphere(tuple(scale * x for x in (0.45, 0.35, 0.2)), 0.3 * scale, subdivisions=3), material=ball)
    return scene


@pytest.mark.parametrize("ball", [wrt.Conductor(), pytest.param(wrt.Dielectric(), marks=pytest.mark.slow)])
def test_the_same_scene_in_other_units_looks_the_same(ball: wrt.Material, device: str, report: Report) -> None:
    """To the bit for powers of two, which round alike; by other factors few paths differ."""
    expected = rendered(room(1.0, ball), 16, device=device).image()
    for scale in (2.0**-10, 2.0**10):
        np.testing.assert_array_equal(rendered(room(scale, ball), 16, device=device).image(), expected)
    close = np.isclose(rendered(room(1e-3, ball), 16, device=device).image(), expected, rtol=1e-3)
    report("scale 0.001: channels that differ by less than 0.1 %", close.mean())
    assert close.mean() > (0.97 if isinstance(ball, wrt.Conductor) else 0.9)


@pytest.mark.parametrize(("scale", "away"), [(1e-3, 30.0), (1e3, 30.0)])
@pytest.mark.parametrize("kind", ["cube", "ball", "needles", pytest.param("instance", marks=pytest.mark.slow)])
def test_convex_bodies_do_not_shade_themselves(
    shared: None, kind: str, scale: float, away: float, device: str, report: Report
) -> None:
    """Under a sky of radiance 1 a convex body of flat facets shows its albedo, less what it wrongly blocks.

    The instance is stretched, and modelled away from its own origin, by which rounding is worse.
    """
    ball, rng = wrt.sphere(subdivisions=3), np.random.default_rng(6)
    center = scale * away * np.array([1.0, 0.6, -0.8])
    eye = center + scale * np.array([0.0, 0.0, 8.0])
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(tuple(eye), tuple(center), fov_degrees=5.0))
    scene.environment = wrt.ConstantEnvironment(1.0)
    if kind == "instance":
        model = np.array([3.0, -2.0, 1.0])
        linear = scale * rotation(rng) @ np.diag([1.0, 0.4, 1.0]) @ rotation(rng)
        places = [affine(linear, center + scale * np.array([0.0, 0.0, z]) - linear @ model) for z in (0.0, 4000.0)]
        scene.add_instances(wrt.Mesh(ball.vertices + model, ball.faces), places, material=wrt.Diffuse(0.5))
    else:
        mesh = wrt.box((-0.7,) * 3, (0.7,) * 3) if kind == "cube" else ball
        stretched = mesh.vertices * np.array([1.0, 1.0, 0.02 if kind == "needles" else 1.0])
        scene.add(wrt.Mesh(scale * (stretched @ rotation(rng).T) + center, mesh.faces), material=wrt.Diffuse(0.5))
    renderer = rendered(scene, 64, width=24, height=24, max_depth=8, filter="box", device=device)
    assert renderer._built.features.instances == ("still" if kind == "instance" else "none")
    inside = renderer.image()[8:16, 8:16, 0].astype(np.float64)
    report(f"{kind}, scale {scale:g}, {away:g} away: radiance", inside.mean(), 0.5)
    assert np.abs(inside - 0.5).max() < (2e-3 if kind == "instance" else 1e-3)
    assert abs(inside.mean() - 0.5) < 1e-4


@pytest.mark.parametrize(("far", "axis"), [(10.0, 0), (1e5, 0), (1e5, 1)])
def test_a_lamp_is_seen_from_afar(far: float, axis: int, device: str, report: Report) -> None:
    """A square of 2 cm that emits L gives the irradiance L A / r² at a distance r, where hits are rounded by more."""
    u, v, n = np.roll(np.eye(3), axis, axis=0)
    lamp = wrt.quad(tuple(-0.01 * u - 0.01 * v), tuple(0.02 * u), tuple(0.02 * v))
    facing = wrt.quad(tuple(far * n - u - v), tuple(2.0 * v), tuple(2.0 * u))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(tuple((far - 3.0) * n), tuple(far * n), tuple(u), fov_degrees=8.0))
    scene.add(lamp, emission=1e4 * far**2)
    scene.add(facing, material=wrt.Diffuse(0.5))
    renderer = rendered(scene, 64, width=8, height=8, max_depth=2, strategy="light", device=device)
    radiance, expected = renderer.image()[..., 0].astype(np.float64), 0.5 / np.pi * 1e4 * 0.02**2
    report(f"{far:g} m away: radiance", radiance.mean(), expected)
    np.testing.assert_allclose(radiance, expected, rtol=2e-3)


def test_a_mesh_of_any_unit_can_be_set_on_the_floor() -> None:
    for unit in (0.001, 1000.0):
        mesh = wrt.box((3.0, -2.0, 5.0), (4.0, 2.0, 7.0)).scaled(unit).standing(1.5)
        np.testing.assert_allclose(mesh.bounds, [[-0.1875, 0.0, -0.375], [0.1875, 1.5, 0.375]], atol=1e-6)
    with pytest.raises(wrt.InputError, match=r"^quad: the mesh is flat along y, so it cannot be scaled to a height$"):
        wrt.quad((0, 1, 0), (0, 0, 1), (1, 0, 0)).standing(1.0)
    with pytest.raises(wrt.InputError, match="box: height must be"):
        wrt.box((0, 0, 0), (1, 1, 1)).standing(float("nan"))
