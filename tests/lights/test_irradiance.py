"""Light from each kind of light on a plane, against closed forms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.covering_kernels import rendering_with
from support.irradiance import (
    EVERY_LIGHT,
    POINTS,
    SIZE,
    check,
    disk_irradiance,
    floor_scene,
    irradiance,
    mean_p,
    pixel_mean,
    rectangle_irradiance,
)

import wrt

one_kernel = rendering_with(EVERY_LIGHT)


class Case(NamedTuple):
    light: wrt.Light | wrt.Shape | wrt.ImageEnvironment
    exact: Callable[[NDArray, NDArray], NDArray]
    strategies: tuple[str, ...] = ("mis", "light", "bsdf")


PLACE = (0.4, 1.2, -0.3)


def point_irradiance(x: NDArray, z: NDArray) -> NDArray:
    """E = I cosθ / r² of the intensity 3 at PLACE."""
    return 3.0 * PLACE[1] / ((x - PLACE[0]) ** 2 + PLACE[1] ** 2 + (z - PLACE[2]) ** 2) ** 1.5


def sphere_irradiance(x: NDArray, z: NDArray) -> NDArray:
    """Irradiance of a ball of radiance 1, all of it above the horizon: π (R/d)² cosθ."""
    d2 = x * x + z * z + 1.55**2
    return math.pi * 0.6**2 / d2 * 1.55 / np.sqrt(d2)


def even(value: float) -> Callable[[NDArray, NDArray], NDArray]:
    return lambda x, z: np.full_like(x, value)


def zenith_irradiance(rows: int) -> float:
    """Irradiance of the first row of an image, 1 there: level to its middle, then falling to the middle of the next."""
    polar = np.linspace(0.0, 1.5 * math.pi / rows, 30_001)
    radiance = np.clip(1.5 - polar * rows / math.pi, 0.0, 1.0)
    return float(np.trapezoid(radiance * 2.0 * math.pi * np.sin(polar) * np.cos(polar), polar))


def texel_at_the_zenith() -> wrt.ImageEnvironment:
    """A sun in one texel of the first row, at the seam. Interpolated, it is spread over azimuths, also across that."""
    pixels = np.zeros((16, 32, 3), np.float32)
    pixels[0, 0] = 32.0 * 20.0
    return wrt.ImageEnvironment(pixels, rotation_degrees=50.0)


RECTANGLE = ((-0.6, 1.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8))  # its front faces down
SLANTED = (1.0, -2.0, 0.5)
CASES = {
    "point by intensity": Case(wrt.PointLight(PLACE, intensity=3.0), point_irradiance, ("mis",)),
    "point by power": Case(wrt.PointLight(PLACE, power=12.0 * math.pi), point_irradiance, ("mis",)),
    "point by color": Case(wrt.PointLight(PLACE, color=3.0 / math.pi), point_irradiance, ("mis",)),
    "directional by color": Case(
        wrt.DirectionalLight(SLANTED, color=2.0 / math.pi), even(4.0 / math.sqrt(5.25)), ("mis",)
    ),
    "triangles": Case(
        wrt.Shape(wrt.quad(*RECTANGLE), wrt.Diffuse(0.0), emission=1.0),
        lambda x, z: rectangle_irradiance(x, z, 1.0, (0.6, 0.4)),
    ),
    "rectangle": Case(
        wrt.RectangleLight(*RECTANGLE, radiance=1.0), lambda x, z: rectangle_irradiance(x, z, 1.0, (0.6, 0.4))
    ),
    "disk": Case(
        wrt.DiskLight((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), 0.5, power=0.25 * math.pi**2),
        lambda x, z: disk_irradiance(x, z, 1.0, 0.5),
    ),
    "sphere": Case(wrt.SphereLight((0.0, 1.55, 0.0), 0.6, power=1.44 * math.pi**2), sphere_irradiance),
    "sun": Case(wrt.DirectionalLight(SLANTED, irradiance=2.0, angle_degrees=40.0), even(4.0 / math.sqrt(5.25))),
    "image": Case(
        wrt.ImageEnvironment(np.full((7, 13, 3), 0.8, np.float32), rotation_degrees=33.0), even(0.8 * math.pi)
    ),
    "sun at the zenith of an image": Case(
        texel_at_the_zenith(), even(20.0 * zenith_irradiance(16)), strategies=("mis", "light")
    ),
}


def under(light: wrt.Light | wrt.Shape | wrt.ImageEnvironment, eye: float = 0.9) -> wrt.Scene:
    scene = floor_scene(eye)
    if isinstance(light, wrt.Shape):
        scene.shapes.append(light)
    elif isinstance(light, wrt.ImageEnvironment):
        scene.environment = light
    else:
        scene.add_light(light)
    return scene


@pytest.mark.parametrize(
    ("name", "strategy"),
    [
        pytest.param(n, s, marks=[] if s == "mis" or (n, s) == ("triangles", "light") else [pytest.mark.slow])
        for n, case in CASES.items()
        for s in case.strategies
    ],
)
def test_irradiance_has_its_closed_form(name: str, strategy: str, device: str, report: Report) -> None:
    case = CASES[name]
    spp = 4096 if strategy == "bsdf" else 1024
    where, measured, variance = irradiance(under(case.light), device, spp, strategy=strategy)
    expected = pixel_mean(case.exact, where)
    if variance.max() < 1e-10:
        np.testing.assert_allclose(measured, expected, rtol=1e-5)
        return
    check(f"{name}, {strategy}", measured, variance, expected, spp, report)
    wrong = (1.05 if strategy == "bsdf" else 1.01) * expected
    assert mean_p(measured, variance, spp, wrong) < 1e-3


def test_the_environment_is_chosen_as_often_as_paths_are_told(device: str, report: Report) -> None:
    """Beside another light: samples state their density with the choice, as rays that end in the environment do."""
    scene = under(CASES["image"].light)
    scene.add_light(CASES["sun"].light)
    where, measured, variance = irradiance(scene, device, 1024)
    expected = CASES["image"].exact(*where) + CASES["sun"].exact(*where)
    check("an image beside a sun", measured, variance, expected, 1024, report)


@pytest.mark.parametrize("strategy", ["mis", pytest.param("bsdf", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["sphere", "sun"])
def test_panes_that_are_not_opaque_dim_light(name: str, strategy: str, device: str, report: Report) -> None:
    """Black panes of opacity 0.25 pass three quarters of the light, with each estimator."""
    scene = under(CASES[name].light, eye=0.4)
    pane = wrt.quad((-50.0, 0.5, 50.0), (100.0, 0.0, 0.0), (0.0, 0.0, -100.0))
    scene.add(pane, material=wrt.Diffuse(0.0, opacity=0.25))
    where, measured, variance = irradiance(scene, device, 1024, strategy=strategy)
    expected = 0.75 * pixel_mean(CASES[name].exact, where)
    check(f"{name} behind a pane, {strategy}", measured, variance, expected, 1024, report)


def test_projector(device: str, report: Report) -> None:
    """E = E₁ c cosθ r / z³ with the image's colour c, where z is along the axis; nothing beside the frame."""
    place, direction, up = np.array(PLACE), np.array([-0.3, -1.0, 0.2]), (0.2, 0.1, -1.0)
    image = wrt.ImageTexture(np.array([[0.1, 0.9], [0.4, 0.2]])[..., None].repeat(3, axis=2), filter="nearest")
    scene = floor_scene()
    scene.add_light(wrt.ProjectorLight(place, direction, up, texture=image, irradiance=3.0, fov_degrees=70.0))
    where, measured, variance = irradiance(scene, device, 1024)
    axis = direction / np.linalg.norm(direction)
    right = np.cross(axis, up) / np.linalg.norm(np.cross(axis, up))

    def frame(x: NDArray, z: NDArray) -> tuple[NDArray, NDArray]:
        """Return the irradiance that white would give, and the number of the quarter of the frame; 4 outside."""
        offset = np.stack([x, np.zeros_like(x), z], axis=-1) - place
        depth = offset @ axis
        s, t = (offset @ across / depth / math.tan(math.radians(35.0)) for across in (right, np.cross(right, axis)))
        quarter = np.where(t > 0.0, 0, 2) + np.where(s < 0.0, 0, 1)
        return 3.0 * place[1] / depth**3, np.where(np.maximum(np.abs(s), np.abs(t)) < 1.0, quarter, 4)

    half = 0.5 * (POINTS[1] - POINTS[0])
    corners = [frame(where[0] + a * half, where[1] + b * half)[1] for a in (-1, 1) for b in (-1, 1)]
    is_inside_a_quarter = np.ptp(corners, axis=0) == 0
    shares = np.array([0.1, 0.9, 0.4, 0.2, 0.0])[corners[0]]
    assert all((corners[0][is_inside_a_quarter] == quarter).sum() > 5 for quarter in range(5))
    lit = is_inside_a_quarter & (corners[0] < 4)
    expected = pixel_mean(lambda x, z: frame(x, z)[0], where) * shares
    check("projector", measured[lit], variance[lit], expected[lit], 1024, report)
    assert not measured[np.min(corners, axis=0) == 4].any()


FALLOFFS = ("smooth", "linear", "gltf")


def fading(cosine: NDArray, inner: float, outer: float, falloff: str) -> NDArray:
    """The share of a spot's intensity, by the formulas of docs/lights.md."""
    if falloff == "linear":
        return np.clip((outer - np.arccos(cosine)) / (outer - inner), 0.0, 1.0)
    x = np.clip((cosine - math.cos(outer)) / (math.cos(inner) - math.cos(outer)), 0.0, 1.0)
    return x * x if falloff == "gltf" else x * x * (3.0 - 2.0 * x)


@pytest.mark.parametrize("falloff", FALLOFFS)
def test_spot_light(falloff: str, device: str, report: Report) -> None:
    """E = I f(θ) cosθ' / r²: within the inner cone, between the two and outside, which are all on the floor."""
    scene = floor_scene()
    inner, outer = math.radians(20.0), math.radians(40.0)
    axis = np.array([0.3, -1.0, 0.1])
    cone = {"inner_degrees": 20.0, "outer_degrees": 40.0, "falloff": falloff}
    scene.add_light(wrt.SpotLight(PLACE, tuple(axis), intensity=3.0, **cone))
    where, measured, variance = irradiance(scene, device, 4096)

    def cosine(x: NDArray, z: NDArray) -> NDArray:
        offset = np.stack([x - PLACE[0], np.full_like(x, -PLACE[1]), z - PLACE[2]])
        return np.einsum("k,k...->...", axis, offset) / np.linalg.norm(offset, axis=0) / np.linalg.norm(axis)

    def factor(x: NDArray, z: NDArray) -> NDArray:
        return fading(cosine(x, z), inner, outer, falloff)

    assert {0.0, 1.0} <= set(factor(*where).ravel())
    lit = factor(*where) > 0.05  # where the edge crosses a pixel, quadrature does not know
    exact = pixel_mean(lambda x, z: point_irradiance(x, z) * factor(x, z), where)
    check(f"spot light, {falloff}", measured[lit], variance[lit], exact[lit], 4096, report)
    dark = cosine(*where) < math.cos(math.radians(46.0))
    assert dark.sum() > 20
    assert not measured[dark].any()


@pytest.mark.parametrize("falloff", FALLOFFS)
@pytest.mark.parametrize(("inner", "outer"), [(40.0, 40.0), (10.0, 170.0), (0.05, 0.1)])
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
    # By colour: white that faces the spot at one metre shows that colour, L = π f c (n·l).
    assert wrt.SpotLight((0, 0, 0), (0, -1, 0), color=2.0).intensity[0] == pytest.approx(2.0 * math.pi)


def test_lights_are_seen_and_hide_what_is_behind_them(device: str) -> None:
    """Seen from above: fronts show their radiance and backs nothing; a black one takes the light of another away."""
    options = {"width": 8, "height": 8, "spp": 2, "device": device, "sampler": "independent"}
    # The first faces down, the second up.
    down, up = [((-9.0, 1.0, -9.0), *edges) for edges in itertools.permutations([(18.0, 0.0, 0.0), (0.0, 0.0, 18.0)])]
    color = (1.0, 2.0, 3.0)

    def lamp(mesh: wrt.Mesh, *, two_sided: bool = False) -> wrt.Shape:
        return wrt.Shape(mesh, wrt.Diffuse(0.0), emission=color, two_sided_emission=two_sided)

    for light, shown in (
        (wrt.RectangleLight(*up, radiance=color), color),
        (wrt.RectangleLight(*down, radiance=color), 0.0),
        (lamp(wrt.quad(*down), two_sided=True), color),
        (lamp(wrt.quad(*down)), 0.0),
    ):
        image = wrt.render(under(light, eye=50.0), **options)
        np.testing.assert_array_equal(image, np.broadcast_to(np.float32(shown), image.shape))
    scene = under(wrt.PointLight((0.0, 2.0, 0.0), intensity=1.0))
    assert wrt.render(scene, **options).all()
    scene.add_light(wrt.DiskLight((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), 5.0, radiance=0.0))
    assert not wrt.render(scene, **options).any()


def many_lights(count: int) -> tuple[list[wrt.Light], NDArray]:
    """Return lights of each kind that rays can hit, from one to two metres above the floor, and their radiances."""
    rng = np.random.default_rng(5)
    lights: list[wrt.Light] = []
    radiances = 1.0 + np.arange(count)
    for k, radiance in enumerate(radiances.tolist()):
        place, size = rng.uniform((-1.6, 1.0, -1.6), (1.6, 2.0, 1.6)), rng.uniform(0.1, 0.3)
        x, y, z = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        if k % 3 == 0:
            lights.append(wrt.SphereLight(tuple(place), size, radiance))
        elif k % 3 == 1:
            lights.append(wrt.DiskLight(tuple(place), tuple(z), size, radiance, two_sided=True))
        else:
            lights.append(wrt.RectangleLight(tuple(place), tuple(x * size), tuple(y * size), radiance, two_sided=True))
    return lights, radiances


def first_light(lights: list[wrt.Light], origin: NDArray, to: NDArray) -> NDArray:
    """Return the number of the first light between one point and others, (..., 3), or −1: each is tested."""
    d = to - origin
    best, number = np.full(d.shape[:-1], 1.0), np.full(d.shape[:-1], -1)
    for k, light in enumerate(lights):
        if isinstance(light, wrt.SphereLight):
            from_center = origin - np.array(light.center)
            a, b, c = (d * d).sum(axis=-1), d @ from_center, from_center @ from_center - light.radius**2
            root = b * b - a * c
            t = np.where(root >= 0.0, (-b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf)
        elif isinstance(light, wrt.DiskLight):
            normal, center = np.array(light.normal), np.array(light.center)
            t = (center - origin) @ normal / (d @ normal)
            t = np.where(np.linalg.norm(origin + d * t[..., None] - center, axis=-1) <= light.radius, t, np.inf)
        else:
            u, v, corner = np.array(light.edge_u), np.array(light.edge_v), np.array(light.origin)
            normal = np.cross(u, v)
            t = (corner - origin) @ normal / (d @ normal)
            place = origin + d * t[..., None] - corner
            shares = np.stack([place @ u / (u @ u), place @ v / (v @ v)])
            t = np.where(((shares >= 0.0) & (shares <= 1.0)).all(axis=0), t, np.inf)
        number = np.where((t > 0.0) & (t < best), k, number)
        best = np.where((t > 0.0) & (t < best), t, best)
    return number


def test_each_of_many_lights_is_seen_and_throws_a_shadow(device: str) -> None:
    """Pixels whose corners and middle agree, against a test of every light, from above and as seen by a point light."""
    lights, radiances = many_lights(60)
    size = 64
    half = 0.5 * SIZE * (POINTS[1] - POINTS[0]) / size
    x, z = np.meshgrid(*2 * [half * np.arange(1 - size, size, 2)])
    probes = [np.stack([x + a, 0.0 * x, z + b], axis=-1) for a, b in itertools.product((-half, 0.0, half), repeat=2)]
    options = {"width": size, "height": size, "spp": 4, "device": device, "sampler": "independent", "filter": "box"}

    scene = floor_scene(eye=5.0)
    for light in lights:
        scene.add_light(light)
    seen = [first_light(lights, np.array((0.0, 5.0, 0.0)), probe) for probe in probes]
    sure = np.ptp(seen, axis=0) == 0
    assert len(np.unique(seen[0][sure])) > 20
    image = wrt.render(scene, max_depth=1, **options)[..., 0]
    np.testing.assert_array_equal(image[sure], np.append(radiances, 0.0).astype(np.float32)[seen[0][sure]])

    scene = floor_scene(eye=0.9)  # below the lights
    scene.add_light(wrt.PointLight((0.0, 5.0, 0.0), intensity=1.0))
    for light in lights:
        scene.add_light(replace(light, radiance=0.0))
    image = wrt.render(scene, max_depth=2, **options)[..., 0]
    np.testing.assert_array_equal(image[sure] > 0.0, seen[0][sure] < 0)
