"""Media that absorb and emit: Beer's law per channel, on the way to the camera and on the way to a light.

Where nothing scatters and nothing reflects a path has one way to go, and pictures have no noise at all.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Report
from numpy.testing import assert_allclose
from support.media import mean_and_error, render, stage

import wrt

B = np.array([0.5, 1.0, 2.0])
MEDIUM = wrt.Medium(absorption=tuple(B))
BLACK_SKY = 0.0


def slab(material: wrt.Material, thickness: float, *, degrees: float = 0.0, sky: float = 1.0) -> wrt.Scene:
    """Return a large slab of a material before a bright sky, looked through at an angle to its normal."""
    a = math.radians(degrees)
    scene = stage(sky=sky, origin=(3.0 * math.sin(a), 0.0, 3.0 * math.cos(a)))
    scene.add(wrt.box((-20, -20, -thickness), (20, 20, 0.0)), material=material)
    return scene


@pytest.mark.parametrize("degrees", [0.0, 60.0])
@pytest.mark.parametrize("boundary", [wrt.Null(interior=MEDIUM), wrt.Dielectric(1.0, interior=MEDIUM)])
def test_transmittance_of_a_slab(boundary: wrt.Material, degrees: float, device: str) -> None:
    image = render(slab(boundary, 0.7, degrees=degrees), device).image()
    expected = np.exp(-B * 0.7 / math.cos(math.radians(degrees)))
    assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=2e-5)


def test_color_after_a_distance(device: str) -> None:
    """b = −ln I(1): what `from_color` is given comes out after just that distance."""
    color = (0.9, 0.4, 0.05)
    medium = wrt.Medium.from_color(color, distance=2.5)
    assert_allclose(medium.absorption, -np.log(color) / 2.5, rtol=1e-12)
    for thickness, power in ((2.5, 1.0), (1.25, 0.5), (5.0, 2.0)):
        image = render(slab(wrt.Null(interior=medium), thickness), device).image()
        assert_allclose(image[0, 0], np.power(color, power), rtol=2e-5)


def fresnel(cos_i: float, eta: float) -> float:
    """Return F by the g, c form (Cook and Torrance 1982), for eta = n_t / n_i ≥ 1."""
    g = math.sqrt(eta * eta - 1.0 + cos_i * cos_i)
    a, b = (g - cos_i) / (g + cos_i), (cos_i * (g + cos_i) - 1.0) / (cos_i * (g - cos_i) + 1.0)
    return 0.5 * a * a * (1.0 + b * b)


@pytest.mark.parametrize("degrees", [0.0, 50.0])
def test_a_slab_of_coloured_glass(degrees: float, device: str, report: Report) -> None:
    """All reflections between its faces summed: of each face F, on each way T, the sky is 1 on both sides.

    What is seen is F + (1 − F)² T (1 + F T) / (1 − F² T²), a series in F T.
    """
    renderer = render(slab(wrt.Dielectric(1.5, interior=MEDIUM), 0.7, degrees=degrees), device, size=(16, 16), spp=1024)
    mean, error = mean_and_error(renderer)
    sin_t = math.sin(math.radians(degrees)) / 1.5

    def seen(thickness: float) -> np.ndarray:
        f = fresnel(math.cos(math.radians(degrees)), 1.5)
        t = np.exp(-B * thickness / math.sqrt(1.0 - sin_t**2))
        return f + (1.0 - f) ** 2 * t * (1.0 + f * t) / (1.0 - (f * t) ** 2)

    report(f"glass of 0.7 m at {degrees:g}°, red green blue", str(mean.round(5)), str(seen(0.7).round(5)))
    assert (np.abs(mean - seen(0.7)) < 3.5 * error).all()
    # Of a slab 1 % thicker it would not be so.
    assert (np.abs(mean - seen(0.7 * 1.01)) > 3.5 * error).all()


def test_emission_of_a_slab(device: str) -> None:
    """L = e / a (1 − exp(−a d)), and e d where nothing absorbs."""
    e, a, d = np.array([3.0, 2.0, 1.0]), np.array([0.0, 0.5, 4.0]), 0.7
    medium = wrt.Medium(absorption=tuple(a), emission=tuple(e))
    image = render(slab(wrt.Null(interior=medium), d, sky=0.0), device).image()
    expected = [e[0] * d, *(e[1:] / a[1:] * (1.0 - np.exp(-a[1:] * d)))]
    assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=2e-5)


def test_emission_of_the_slightest_absorption(device: str) -> None:
    """1 − exp(−a d) would have no digits left."""
    medium = wrt.Medium(absorption=(1e-9, 1e-6, 1e-4), emission=1.0)
    image = render(slab(wrt.Null(interior=medium), 0.7, sky=0.0), device).image()
    assert_allclose(image[0, 0], 0.7 * (1.0 - np.array([1e-9, 1e-6, 1e-4]) * 0.35), rtol=2e-6)


def test_fog_fills_the_scene(device: str) -> None:
    """A glowing wall 5 m away, and light that the fog itself gives off."""
    fog = wrt.Medium(absorption=tuple(B), emission=(0.3, 0.2, 0.1))
    scene = stage(medium=fog)
    wall = wrt.quad((-9, -9, -2), (18, 0, 0), (0, 18, 0))
    scene.add(wall, material=wrt.Diffuse(0.0), emission=(10.0, 20.0, 30.0))
    t = np.exp(-B * 5.0)
    expected = np.array([10.0, 20.0, 30.0]) * t + np.array([0.3, 0.2, 0.1]) / B * (1.0 - t)
    assert_allclose(render(scene, device).image()[0, 0], expected, rtol=2e-5)


def test_fog_without_end(device: str) -> None:
    """Nothing of the sky comes through, and the fog's own light is e / a."""
    with pytest.warns(UserWarning, match="reaches to infinity"):
        image = render(stage(sky=7.0, medium=wrt.Medium(tuple(B), emission=1.0)), device).image()
    assert_allclose(image[0, 0], 1.0 / B, rtol=2e-5)
    with pytest.raises(wrt.InputError, match="reaches to infinity"):
        render(stage(medium=wrt.Medium((1.0, 0.0, 1.0), emission=1.0)), device)


def test_a_clear_body_in_fog(device: str) -> None:
    """Where a body is there is no fog."""
    scene = stage(sky=0.0, medium=MEDIUM)
    scene.add(wrt.quad((-9, -9, -2), (18, 0, 0), (0, 18, 0)), material=wrt.Diffuse(0.0), emission=1.0)
    scene.add(wrt.box((-3, -3, -0.5), (3, 3, 1.5)), material=wrt.Null())
    assert_allclose(render(scene, device).image()[0, 0], np.exp(-B * 3.0), rtol=2e-5)


@pytest.mark.parametrize("turned", [False, True])
def test_the_camera_in_a_body(turned: bool, device: str) -> None:
    """The path begins in the bodies that the camera stands in: the inner of two, which lies in the other."""
    scene = stage(sky=1.0)
    outer, inner = wrt.Null(interior=wrt.Medium(tuple(2.0 * B))), wrt.Null(interior=MEDIUM)
    shapes = [(wrt.box((-9, -9, -1), (9, 9, 9)), outer), (wrt.box((-2, -2, 0), (2, 2, 5)), inner)]
    for mesh, material in reversed(shapes) if turned else shapes:
        scene.add(mesh, material=material)
    assert_allclose(render(scene, device).image()[0, 0], np.exp(-B * 3.0 - 2.0 * B * 1.0), rtol=2e-5)


def with_diagonals(mesh: wrt.Mesh, *, other: bool) -> wrt.Mesh:
    """Return a box, its quads cut along the other diagonal or the same."""
    if not other:
        return mesh
    faces = mesh.faces.reshape(-1, 2, 3)
    corners = np.array([[*pair[0], next(i for i in pair[1] if i not in pair[0])] for pair in faces])
    turned = []
    for (a, b, c, d), pair in zip(corners, faces, strict=True):
        # The new corner lies opposite the one of the first triangle that the second has not.
        lone = next(i for i in pair[0] if i not in pair[1])
        ring = [lone, *(x for x in (a, b, c) if x != lone)]
        ring = [*pair[0][list(pair[0]).index(lone) :], *pair[0][: list(pair[0]).index(lone)]]
        turned += [[ring[0], ring[1], d], [ring[0], d, ring[2]]]
    return wrt.Mesh(mesh.vertices, np.array(turned))


@pytest.mark.parametrize("other", [False, True])
def test_bodies_that_touch(other: bool, device: str) -> None:
    """Two blocks share a face, whose triangles are the same, or others in the same plane: neither is overlooked."""
    scene = stage(sky=1.0, fov_degrees=20.0)
    for low, high, material in (
        (-1.0, 0.0, wrt.Null(interior=MEDIUM)),
        (-2.0, -1.0, wrt.Null(interior=wrt.Medium(tuple(3.0 * B)))),
        (-3.0, -2.0, wrt.Null(interior=wrt.Medium(tuple(B[::-1])))),
    ):
        box = wrt.box((-4.0, -4.0, low), (4.0, 4.0, high))
        scene.add(with_diagonals(box, other=other and low == -2.0), material=material)
    renderer = render(scene, device, size=(64, 64))
    image = renderer.image()
    total = -np.log(image) / (B + 3.0 * B + B[::-1])
    # The way through each block is 1 / cosθ, the same in all channels and somewhat random within a pixel.
    assert_allclose(total, np.broadcast_to(total[..., :1], total.shape), rtol=2e-4)
    assert total.min() > 0.9999
    assert total.max() < 1.0 / math.cos(math.radians(15.0))


def plate(pane: wrt.Shape | None) -> wrt.Scene:
    """Return a matt plate seen from in front, lit by a point light 2 m before it through something."""
    scene = stage(origin=(0.0, 0.0, 3.0))
    scene.add(wrt.quad((-9, -9, -1), (18, 0, 0), (0, 18, 0)), material=wrt.Diffuse(0.5))
    scene.add_light(wrt.PointLight((2.0, 0.0, 1.0), intensity=1.0))
    if pane is not None:
        scene.shapes.append(pane)
    return scene


def test_a_shadow_of_something_absorbing(device: str) -> None:
    """Light from the side goes through 0.5 m / cos 45° of it, and the way to the camera does not."""
    block = wrt.Shape(wrt.box((0.2, -4, -0.6), (9, 4, -0.1)), wrt.Null(interior=MEDIUM))
    plain, dimmed = (render(plate(pane), device).image()[0, 0] for pane in (None, block))
    assert_allclose(plain, 0.5 / np.pi / 8.0 * math.sqrt(0.5), rtol=1e-4)
    assert_allclose(dimmed / plain, np.exp(-B * 0.5 * math.sqrt(2.0)), rtol=1e-4)


def test_light_through_a_coloured_pane(device: str) -> None:
    """A point light behind thin glass: its rays at 45 degrees leave 1 − 2 F / (1 + F) of it, times the colour."""
    color = np.array([0.9, 0.5, 0.1])
    glass = wrt.ThinDielectric(1.5, specular_transmittance=tuple(color))
    pane = wrt.Shape(wrt.quad((0.1, -4, -0.4), (9, 0, 0), (0, 8, 0)), glass)
    plain, lit = (render(plate(pane), device, spp=4, max_depth=2).image()[0, 0] for pane in (None, pane))
    f = fresnel(math.sqrt(0.5), 1.5)
    assert_allclose(lit / plain, color * (1.0 - 2.0 * f / (1.0 + f)), rtol=1e-4)


@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
def test_a_lamp_behind_coloured_panes(strategy: str, device: str, report: Report) -> None:
    """Light found by chance behind a pane is weighed against shadow rays as if the pane were not there."""
    scene = stage()
    scene.add(wrt.quad((-9, -9, -1), (18, 0, 0), (0, 18, 0)), material=wrt.Diffuse(0.5))
    lamp = wrt.quad((0.5, -1.0, -0.5), (0, 2.0, 0), (0, 0, 2.0))
    lamp = wrt.Mesh(lamp.vertices, lamp.faces[:, ::-1])  # its front towards −x
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=3.0)
    block = wrt.box((0.2, -6, -0.9), (0.4, 6, 6))
    scene.add(block, material=wrt.Null(interior=MEDIUM))
    scene.add(wrt.quad((0.15, -6, -0.95), (0, 12, 0), (0, 0, 9)), material=wrt.ThinDielectric(1.5))
    renderer = render(scene, device, size=(32, 32), spp=256, strategy=strategy, max_depth=2)
    mean, error = mean_and_error(renderer)
    report(f"{strategy}: red green blue", str(mean.round(6)), f"± {error.round(6)}")
    known = {"light": (mean, error)}.get(strategy) or _by_light_alone(scene, device)
    assert (np.abs(mean - known[0]) < 3.5 * np.hypot(error, known[1])).all()


def _by_light_alone(scene: wrt.Scene, device: str) -> tuple[np.ndarray, np.ndarray]:
    return mean_and_error(render(scene, device, size=(32, 32), spp=256, strategy="light", max_depth=2, seed=5))


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(wrt.InputError, match="color must be greater than 0"):
        wrt.Medium.from_color((0.5, 0.0, 0.5), 1.0)
    with pytest.raises(wrt.InputError, match=r"interior must be a wrt\.Medium"):
        wrt.Dielectric(interior=1.0)  # type: ignore[arg-type]
    with pytest.raises(wrt.InputError, match="an interior needs a transmission"):
        wrt.Principled(interior=MEDIUM)
    scene = stage()
    scene.environment = wrt.ConstantEnvironment(1.0)
    two = wrt.Mix(wrt.Dielectric(interior=MEDIUM), wrt.Dielectric())
    scene.add(wrt.box((-1, -1, -1), (1, 1, 1)), material=two, name="odd")
    with pytest.raises(wrt.InputError, match="odd: the parts of a material must have the same interior"):
        wrt.Renderer(scene, width=2, height=2)
