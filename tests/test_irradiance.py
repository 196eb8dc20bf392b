"""Light from each kind of light on a plane, against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.statistics import sidak, t_test_mean

import wrt

REFLECTANCE = 0.5
SIZE = 16
POINTS = np.linspace(-1.5, 1.5, SIZE)


def floor_scene(eye: float = 50.0) -> wrt.Scene:
    """A floor of one reflectance, seen from straight above at a height; pixel centres meet it at POINTS."""
    scene = wrt.Scene()
    scene.add(wrt.quad((-8.0, 0.0, 8.0), (16.0, 0.0, 0.0), (0.0, 0.0, -16.0)), material=wrt.Diffuse(REFLECTANCE))
    extent = 3.0 * SIZE / (SIZE - 1)
    fov = 2.0 * math.degrees(math.atan(0.5 * extent / eye))
    scene.camera = wrt.PerspectiveCamera((0.0, eye, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov_degrees=fov)
    return scene


def irradiance(scene: wrt.Scene, device: str, spp: int, **options: object) -> tuple[NDArray, NDArray, NDArray]:
    """Return where the pixel centres meet the floor, the irradiance there and the variance of that."""
    renderer = wrt.Renderer(
        scene,
        sampler="independent",
        width=SIZE,
        height=SIZE,
        max_depth=2,
        device=device,
        filter="box",
        seed=3,
        **options,
    )
    for _ in renderer.passes(spp=spp):
        pass
    x, z = np.meshgrid(POINTS, POINTS)
    scale = math.pi / REFLECTANCE
    return np.stack([x, z]), renderer.image()[..., 0] * scale, renderer.variance()[..., 0] * scale**2


def pixel_mean(function, where: NDArray) -> NDArray:
    """Return the mean of a function over each pixel, by a 4x4 Gauss-Legendre rule."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half = 0.5 * (POINTS[1] - POINTS[0])
    x, z = where
    total = 0.0
    for a, wa in zip(nodes, weights, strict=True):
        for b, wb in zip(nodes, weights, strict=True):
            total = total + 0.25 * wa * wb * function(x + half * a, z + half * b)
    return total


def check(claim: str, measured: NDArray, variance: NDArray, expected: NDArray, n: int, report: Report) -> None:
    p = t_test_mean(measured, variance, n, expected)
    report(f"{claim}: mean irradiance", float(measured.mean()), float(expected.mean()), p=float(p.min()))
    assert p.min() > sidak(0.01, p.size)
    # All pixels together see a bias that none shows alone.
    total_p = float(t_test_mean(measured.mean(), variance.sum() / variance.size**2, n * p.size, expected.mean()))
    report(f"{claim}: all pixels", float(measured.mean() / expected.mean()), 1.0, p=total_p)
    assert total_p > 0.01


@pytest.mark.parametrize("given", ["intensity", "power"])
def test_point_light(given: str, device: str, report: Report) -> None:
    """E = I cosθ / r²; isotropic power P is the intensity P / 4π."""
    scene = floor_scene()
    intensity = 3.0
    amount = {"intensity": intensity} if given == "intensity" else {"power": intensity * 4.0 * math.pi}
    scene.add_light(wrt.PointLight((0.4, 1.2, -0.3), **amount))
    where, measured, variance = irradiance(scene, device, 4096)

    def expected(x: NDArray, z: NDArray) -> NDArray:
        r2 = (x - 0.4) ** 2 + 1.2**2 + (z + 0.3) ** 2
        return intensity * 1.2 / r2**1.5

    check(f"point light by {given}", measured, variance, pixel_mean(expected, where), 4096, report)


def test_directional_light(device: str) -> None:
    """E = irradiance · cosθ everywhere, with no variance."""
    scene = floor_scene()
    scene.add_light(wrt.DirectionalLight((1.0, -2.0, 0.5), irradiance=2.0))
    _, measured, _ = irradiance(scene, device, 4)
    np.testing.assert_allclose(measured, 2.0 * 2.0 / math.sqrt(5.25), rtol=1e-5)


def test_projector(device: str, report: Report) -> None:
    """E = E₁ c cosθ r / z³ with the image's colour c, where z is along the axis; nothing beside the frame."""
    place, direction, up = np.array([0.4, 1.2, -0.3]), np.array([-0.3, -1.0, 0.2]), (0.2, 0.1, -1.0)
    image = wrt.ImageTexture(np.array([[0.1, 0.9], [0.4, 0.2]])[..., None].repeat(3, axis=2), filter="nearest")
    scene = floor_scene()
    scene.add_light(wrt.ProjectorLight(place, direction, up, texture=image, irradiance=3.0, fov_degrees=70.0))
    spp = 1024
    where, measured, variance = irradiance(scene, device, spp)
    axis = direction / np.linalg.norm(direction)
    right = np.cross(axis, up) / np.linalg.norm(np.cross(axis, up))

    def frame(x: NDArray, z: NDArray) -> tuple[NDArray, NDArray]:
        """Return the irradiance that white would give, and the number of the quarter of the frame; 4 outside."""
        way = np.stack([x, np.zeros_like(x), z], axis=-1) - place
        depth = way @ axis
        s, t = (way @ across / depth / math.tan(math.radians(35.0)) for across in (right, np.cross(right, axis)))
        quarter = np.where(t > 0.0, 0, 2) + np.where(s < 0.0, 0, 1)
        return 3.0 * place[1] / depth**3, np.where(np.maximum(np.abs(s), np.abs(t)) < 1.0, quarter, 4)

    half = 0.5 * (POINTS[1] - POINTS[0])
    corners = [frame(where[0] + a * half, where[1] + b * half)[1] for a in (-1, 1) for b in (-1, 1)]
    whole = np.ptp(corners, axis=0) == 0
    shares = np.array([0.1, 0.9, 0.4, 0.2, 0.0])[corners[0]]
    assert all((corners[0][whole] == quarter).sum() > 5 for quarter in range(5))
    lit = whole & (corners[0] < 4)
    expected = pixel_mean(lambda x, z: frame(x, z)[0], where) * shares
    check("projector", measured[lit], variance[lit], expected[lit], spp, report)
    assert not measured[np.min(corners, axis=0) == 4].any()


def rectangle_irradiance(x: NDArray, z: NDArray, height: float, half: tuple[float, float]) -> NDArray:
    """Irradiance of a horizontal rectangle of radiance 1 above (0, 0), facing down.

    The configuration factor of a parallel rectangle over a corner (Howell, B-4) summed over the
    four rectangles that meet above the point.
    """

    def corner(a: NDArray, b: NDArray) -> NDArray:
        a, b = a / height, b / height
        ra, rb = np.sqrt(1.0 + a * a), np.sqrt(1.0 + b * b)
        return (a / ra * np.arctan(b / ra) + b / rb * np.arctan(a / rb)) / (2.0 * math.pi)

    total = 0.0
    for sa, ea in ((1.0, half[0] - x), (-1.0, -half[0] - x)):
        for sb, eb in ((1.0, half[1] - z), (-1.0, -half[1] - z)):
            total = total + sa * sb * corner(ea, eb)
    return math.pi * total


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_rectangular_light(strategy: str, device: str, report: Report) -> None:
    scene = floor_scene(eye=0.9)
    # Edges so ordered that the front faces down.
    scene.add(wrt.quad((-0.6, 1.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8)), material=wrt.Diffuse(0.0), emission=1.0)
    spp = 4096
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)
    expected = pixel_mean(lambda x, z: rectangle_irradiance(x, z, 1.0, (0.6, 0.4)), where)
    check(f"rectangle, {strategy}", measured, variance, expected, spp, report)


def test_one_sided_light_is_dark_behind(device: str) -> None:
    scene = floor_scene(eye=0.9)
    scene.add(wrt.quad((-0.6, 1.0, -0.4), (0.0, 0.0, 0.8), (1.2, 0.0, 0.0)), material=wrt.Diffuse(0.0), emission=1.0)
    _, measured, _ = irradiance(scene, device, 16)
    assert measured.max() == 0.0


# --- Lights that are exact shapes ------------------------------------------------------------------


def fading(cosine: NDArray, inner: float, outer: float, falloff: str) -> NDArray:
    """The share of a spot's intensity, by the formulas of docs/lights.md."""
    if falloff == "linear":
        return np.clip((outer - np.arccos(cosine)) / (outer - inner), 0.0, 1.0)
    x = np.clip((cosine - math.cos(outer)) / (math.cos(inner) - math.cos(outer)), 0.0, 1.0)
    return x * x if falloff == "gltf" else x * x * (3.0 - 2.0 * x)


SPOT = (0.4, 1.2, -0.3)


@pytest.mark.parametrize("falloff", ["smooth", "linear", "gltf"])
def test_spot_light(falloff: str, device: str, report: Report) -> None:
    """E = I f(θ) cosθ' / r²: within the inner cone, between the two and outside, which are all on the floor."""
    scene = floor_scene()
    inner, outer = math.radians(20.0), math.radians(40.0)
    axis = np.array([0.3, -1.0, 0.1])
    scene.add_light(
        wrt.SpotLight(SPOT, tuple(axis), intensity=3.0, inner_degrees=20.0, outer_degrees=40.0, falloff=falloff)
    )
    where, measured, variance = irradiance(scene, device, 4096)

    def cosine(x: NDArray, z: NDArray) -> NDArray:
        way = np.stack([x - SPOT[0], np.full_like(x, -SPOT[1]), z - SPOT[2]])
        return np.einsum("k,k...->...", axis, way) / np.linalg.norm(way, axis=0) / np.linalg.norm(axis)

    def factor(x: NDArray, z: NDArray) -> NDArray:
        return fading(cosine(x, z), inner, outer, falloff)

    def expected(x: NDArray, z: NDArray) -> NDArray:
        r2 = (x - SPOT[0]) ** 2 + SPOT[1] ** 2 + (z - SPOT[2]) ** 2
        return 3.0 * factor(x, z) * SPOT[1] / r2**1.5

    assert {0.0, 1.0} <= set(factor(*where).ravel())
    lit = factor(*where) > 0.05  # where the edge crosses a pixel, quadrature does not know
    exact = pixel_mean(expected, where)
    check(f"spot light, {falloff}", measured[lit], variance[lit], exact[lit], 4096, report)
    dark = cosine(*where) < math.cos(math.radians(46.0))
    assert dark.sum() > 20
    assert not measured[dark].any()
    for other in {"smooth", "linear", "gltf"} - {falloff}:
        mistaken = fading(np.cos(np.linspace(inner, outer, 9)), inner, outer, other)
        assert np.abs(mistaken - fading(np.cos(np.linspace(inner, outer, 9)), inner, outer, falloff)).max() > 0.05


@pytest.mark.parametrize("falloff", ["smooth", "linear", "gltf"])
@pytest.mark.parametrize(("inner", "outer"), [(0.0, 30.0), (20.0, 25.0), (40.0, 40.0), (10.0, 170.0), (0.05, 0.1)])
def test_power_of_a_spot_is_the_integral_of_its_intensity(falloff: str, inner: float, outer: float) -> None:
    light = wrt.SpotLight((0, 0, 0), (0, -1, 0), power=5.0, inner_degrees=inner, outer_degrees=outer, falloff=falloff)
    a, b = math.radians(inner), math.radians(outer)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    total = 2.0 * math.pi * (1.0 - math.cos(a))
    if b > a:
        angles = a + 0.5 * (b - a) * (nodes + 1.0)
        ring = fading(np.cos(angles), a, b, falloff) * np.sin(angles)
        total += 2.0 * math.pi * float((weights * ring).sum()) * 0.5 * (b - a)
    assert light.intensity[0] * total == pytest.approx(5.0, rel=1e-5)
    assert light.intensity[0] * total * 1.01 != pytest.approx(5.0, rel=1e-5)


@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
def test_punctual_color_is_what_a_white_surface_shows(kind: str, device: str) -> None:
    """L = π f c (n·l) with f = ρ/π: the floor, which faces the light, shows ρ c; at one metre."""
    scene = floor_scene()
    color = (0.25, 0.5, 1.0)
    scene.add_light(
        {
            "point": wrt.PointLight((0.0, 1.0, 0.0), color=color),
            "spot": wrt.SpotLight((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), color=color),
            "directional": wrt.DirectionalLight((0.0, -1.0, 0.0), color=color),
        }[kind]
    )
    assert scene.camera is not None
    image = wrt.render(replace(scene, camera=replace(scene.camera, fov_degrees=1e-3)), width=1, height=1, spp=1)
    np.testing.assert_allclose(image[0, 0], REFLECTANCE * np.array(color), rtol=1e-4)


def sphere_irradiance(x: NDArray, z: NDArray, height: float, radius: float) -> NDArray:
    """Irradiance of a ball of radiance 1 above (0, 0), all of it above the horizon: π (R/d)² cosθ."""
    d2 = x * x + z * z + height * height
    return math.pi * radius**2 / d2 * height / np.sqrt(d2)


def disk_irradiance(x: NDArray, z: NDArray, height: float, radius: float) -> NDArray:
    """Irradiance of a horizontal disk of radiance 1 above (0, 0), facing down (Howell, B-13)."""
    r2, h2, a2 = x * x + z * z, height * height, radius * radius
    return 0.5 * math.pi * (1.0 - (h2 + r2 - a2) / np.sqrt((h2 + r2 + a2) ** 2 - 4.0 * a2 * r2))


SHAPES: dict[str, tuple[object, object]] = {
    "rectangle": (
        wrt.RectangleLight((-0.6, 1.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8), radiance=1.0),
        lambda x, z: rectangle_irradiance(x, z, 1.0, (0.6, 0.4)),
    ),
    "disk": (
        wrt.DiskLight((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), 0.5, power=0.25 * math.pi**2),
        lambda x, z: disk_irradiance(x, z, 1.0, 0.5),
    ),
    "sphere": (
        wrt.SphereLight((0.0, 1.55, 0.0), 0.6, power=1.44 * math.pi**2),
        lambda x, z: sphere_irradiance(x, z, 1.55, 0.6),
    ),
    "sun": (
        wrt.DirectionalLight((1.0, -2.0, 0.5), irradiance=2.0, angle_degrees=40.0),
        lambda x, z: np.full_like(x, 2.0 * 2.0 / math.sqrt(5.25)),
    ),
}


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
@pytest.mark.parametrize("name", SHAPES)
def test_light_shapes(name: str, strategy: str, device: str, report: Report) -> None:
    scene = floor_scene(eye=0.9)
    light, function = SHAPES[name]
    scene.add_light(light)  # type: ignore[arg-type]
    spp = 4096 if strategy == "bsdf" else 1024
    where, measured, variance = irradiance(scene, device, spp, strategy=strategy)
    expected = pixel_mean(function, where)
    check(f"{name}, {strategy}", measured, variance, expected, spp, report)
    share = 1.05 if strategy == "bsdf" else 1.01
    wrong = float(t_test_mean(measured.mean(), variance.sum() / variance.size**2, spp, share * expected.mean()))
    assert wrong < 1e-3


def test_light_shapes_are_seen_and_hide_what_is_behind_them(device: str) -> None:
    """Fronts show their radiance and backs nothing; a black one takes the light of another away."""
    scene = floor_scene()
    scene.add_light(wrt.RectangleLight((-9.0, 1.0, -9.0), (0.0, 0.0, 18.0), (18.0, 0.0, 0.0), radiance=(1.0, 2.0, 3.0)))
    image = wrt.render(scene, width=8, height=8, spp=2, device=device)
    np.testing.assert_array_equal(image, np.broadcast_to(np.float32([1.0, 2.0, 3.0]), image.shape))
    behind = replace(
        scene, lights=[wrt.RectangleLight((-9.0, 1.0, -9.0), (18.0, 0.0, 0.0), (0.0, 0.0, 18.0), radiance=1.0)]
    )
    assert not wrt.render(behind, width=8, height=8, spp=2, device=device).any()
    lit = replace(scene, camera=replace(scene.camera, origin=(0.0, 0.9, 0.0)))  # type: ignore[type-var]
    lid = wrt.DiskLight((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), 5.0, radiance=0.0)
    lit.lights = [wrt.PointLight((0.0, 2.0, 0.0), intensity=1.0), lid]
    assert not wrt.render(lit, width=8, height=8, spp=2, device=device).any()
    lit.lights.pop()
    assert wrt.render(lit, width=8, height=8, spp=2, device=device).all()


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_a_room_of_rectangle_lights_is_a_furnace(strategy: str, device: str, report: Report) -> None:
    """Where radiance 1 arrives from everywhere, a matt box shows its albedo, once it is lit by light alone."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 1.9), (0.0, 0.0, 0.0), fov_degrees=12.0))
    scene.add(wrt.box((-0.7, -0.7, -0.7), (0.7, 0.7, 0.7)), material=wrt.Diffuse(REFLECTANCE))
    for axis in range(3):
        u, v = np.roll([0.0, 4.0, 0.0], axis), np.roll([0.0, 0.0, 4.0], axis)
        corner = -0.5 * (u + v) - np.roll([2.0, 0.0, 0.0], axis)
        scene.add_light(wrt.RectangleLight(tuple(corner), tuple(u), tuple(v), radiance=1.0))
        scene.add_light(wrt.RectangleLight(tuple(-corner), tuple(-v), tuple(-u), radiance=1.0))
    spp = 1024
    renderer = wrt.Renderer(scene, width=SIZE, height=SIZE, max_depth=2, device=device, seed=5, strategy=strategy)
    for _ in renderer.passes(spp=spp):
        pass
    image, variance = renderer.image()[..., 0], renderer.variance()[..., 0]
    check(f"furnace, {strategy}", image, variance, np.full_like(image, REFLECTANCE), spp, report)


def test_a_pane_dims_light_shapes_and_the_sun(device: str, report: Report) -> None:
    """Of black panes that are there by a quarter, three quarters of the light come through, whoever finds it."""
    for name in ("sphere", "sun"):
        light, function = SHAPES[name]
        for strategy in ("mis", "bsdf"):
            scene = floor_scene(eye=0.4)
            pane = wrt.quad((-50.0, 0.5, 50.0), (100.0, 0.0, 0.0), (0.0, 0.0, -100.0))
            scene.add(pane, material=wrt.Diffuse(0.0, opacity=0.25))
            scene.add_light(light)  # type: ignore[arg-type]
            where, measured, variance = irradiance(scene, device, 1024, strategy=strategy)
            expected = 0.75 * pixel_mean(function, where)
            check(f"{name} behind a pane, {strategy}", measured, variance, expected, 1024, report)


# --- Environments ----------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", ["mis", "light"])
def test_image_environment_of_one_value_is_a_constant_one(strategy: str, device: str, report: Report) -> None:
    """E = π L on an open floor, whatever the image's resolution."""
    scene = floor_scene()
    scene.environment = wrt.ImageEnvironment(np.full((7, 13, 3), 0.8, np.float32), rotation_degrees=33.0)
    where, measured, variance = irradiance(scene, device, 1024, strategy=strategy)
    check(f"uniform image, {strategy}", measured, variance, np.full_like(where[0], 0.8 * math.pi), 1024, report)


def test_emission_is_seen_as_it_is(device: str) -> None:
    scene = floor_scene()
    light = wrt.quad((-9.0, 1.0, -9.0), (18.0, 0.0, 0.0), (0.0, 0.0, 18.0))
    scene.add(light, material=wrt.Diffuse(0.0), emission=(1.0, 2.0, 3.0), two_sided_emission=True)
    image = wrt.render(scene, width=8, height=8, spp=2, device=device)
    np.testing.assert_array_equal(image, np.broadcast_to(np.float32([1.0, 2.0, 3.0]), image.shape))
