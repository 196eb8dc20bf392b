"""Media that scatter: furnaces, single scattering, the colour of a deep medium, and channels of different density."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import Report
from scipy.integrate import quad
from support.media import mean_and_error, render, stage

import wrt
from wrt.scene.medium import albedo_of_color, color_of_albedo


def ball(material: wrt.Material) -> wrt.Shape:
    sphere = wrt.sphere((0.0, 0.0, 0.0), 0.5, subdivisions=2)
    return wrt.Shape(wrt.Mesh(sphere.vertices, sphere.faces), material, name="ball")


@pytest.mark.parametrize("boundary", [wrt.Null, wrt.Dielectric])
@pytest.mark.parametrize("thickness", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("g", [-0.5, 0.0, 0.8])
def test_white_in_a_furnace(g: float, thickness: float, boundary: type, device: str, report: Report) -> None:
    """A medium that absorbs nothing cannot be seen under an even sky, however often it scatters.

    Its density differs in the channels, by 2 either way. A block, from which light always gets out.
    """
    medium = wrt.Medium.from_albedo(1.0, (0.5 * thickness, thickness, 2.0 * thickness), g)
    scene = stage(sky=1.0, origin=(1.8, 1.3, 3.0), fov_degrees=20.0)
    scene.add(wrt.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), material=boundary(interior=medium))
    mean, error = mean_and_error(render(scene, device, size=(24, 24), spp=64, max_depth=1000))
    report(f"{boundary.__name__}, g {g:g}, thickness {thickness:g}: worst", f"{((mean - 1) / error).round(2)} sigma", 0)
    assert (np.abs(mean - 1.0) < 3.5 * np.maximum(error, 1e-6)).all()
    assert error.max() < 0.01


def test_a_furnace_with_absorption_is_not_white(device: str) -> None:
    """Of an albedo of 0.99 it would be seen."""
    scene = stage(sky=1.0, origin=(1.8, 1.3, 3.0), fov_degrees=20.0)
    medium = wrt.Medium.from_albedo(0.99, 10.0)
    scene.add(wrt.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), material=wrt.Null(interior=medium))
    mean, error = mean_and_error(render(scene, device, size=(24, 24), spp=64))
    assert (mean < 1.0 - 5.0 * error).all()


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["mis", "light", "bsdf"])
@pytest.mark.parametrize("g", [0.0, 0.7])
def test_single_scattering_in_a_thin_slab(g: float, strategy: str, device: str, report: Report) -> None:
    """One event and no more: ∫ s exp(−t z) p(θ) L(z) dz along the way of the camera, in closed form per channel.

    A lamp far to the side, small enough to be a point, lights it at 90 degrees through the air above, so that on the
    way to the event light goes z / cosθ through the slab.
    """
    s, a, d = np.array([0.05, 0.2, 0.8]), np.array([0.3, 0.1, 0.0]), 0.4
    t = s + a
    scene = stage()
    medium = wrt.Medium(tuple(a), tuple(s), g)
    scene.add(wrt.box((-50, -50, -d), (50, 50, 0.0)), material=wrt.Null(interior=medium))
    lamp = wrt.quad((40.0, -4.0, 26.0), (0, 8.0, 0), (-6.0, 0, 8.0))  # about 50 m away, its front inwards
    lamp = wrt.Mesh(lamp.vertices, lamp.faces[:, ::-1])
    scene.add(lamp, material=wrt.Diffuse(0.0), emission=100.0)
    options = {"size": (32, 32), "spp": 512, "max_scatterings": 1}
    mean, error = mean_and_error(render(scene, device, strategy=strategy, **options))  # type: ignore[arg-type]

    x, y = ((np.polynomial.legendre.leggauss(16)[0] + 1.0) / 2.0,) * 2
    w = np.polynomial.legendre.leggauss(16)[1] / 2.0
    points = np.array([40.0, -4.0, 26.0]) + x[:, None, None] * [0, 8.0, 0] + y[None, :, None] * np.array([-6.0, 0, 8.0])
    normal = -np.cross([0, 8.0, 0], [-6.0, 0, 8.0])

    def arriving(z: float, channel: int) -> float:
        way = points - [0.0, 0.0, -z]
        r2 = (way**2).sum(axis=2)
        r = np.sqrt(r2)
        cosine = -way[..., 2] / r  # between the camera's way, −z, and the way to the light
        p = (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)
        through = np.exp(-t[channel] * z * r / way[..., 2])
        light = 100.0 * np.maximum(-(way @ normal), 0.0) / (r2 * r)
        return float(np.einsum("i,j,ij", w, w, p * through * light)) * s[channel] * math.exp(-t[channel] * z)

    expected = np.array([quad(arriving, 0.0, d, args=(c,))[0] for c in range(3)])
    report(f"{strategy}, g {g:g}", str(mean), str(expected))
    assert (np.abs(mean - expected) < 3.5 * error + 1e-4 * expected).all()
    if strategy != "bsdf":
        assert (np.abs(mean - 1.05 * expected) > 3.5 * error).all()


def test_emission_while_it_scatters(device: str, report: Report) -> None:
    """In a medium without end that emits, scatters and absorbs, radiance is e / a everywhere."""
    medium = wrt.Medium(absorption=(0.5, 1.0, 2.0), scattering=(3.0, 1.0, 0.5), g=0.3, emission=(1.0, 2.0, 3.0))
    scene = stage(sky=0.0, medium=medium)
    mean, error = mean_and_error(render(scene, device, size=(16, 16), spp=256))
    expected = np.array([2.0, 2.0, 1.5])
    report("e / a", str(mean.round(4)), str(expected))
    assert (np.abs(mean - expected) < 3.5 * error).all()
    assert (np.abs(mean - expected) < 0.02 * expected).all()


@pytest.mark.slow
def test_a_wall_in_fog_under_roulette(device: str) -> None:
    """Roulette changes no mean: a medium in a furnace of walls that emit 1 and reflect 0.5, where radiance is 2."""
    outside = wrt.box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    fog = wrt.Medium.from_albedo(1.0, (0.3, 1.0, 3.0), g=0.5)
    scene = stage(medium=fog, origin=(0.3, -0.2, 0.5), target=(-0.4, 0.3, -1.0), fov_degrees=90.0)
    scene.add(wrt.Mesh(outside.vertices, outside.faces[:, ::-1]), material=wrt.Diffuse(0.5), emission=1.0)
    mean, error = mean_and_error(render(scene, device, size=(24, 24), spp=128, max_depth=1000))
    assert (np.abs(mean - 2.0) < 3.5 * error).all()
    assert error.max() < 0.01


@pytest.mark.parametrize("g", [0.0, 0.6])
def test_color_of_a_deep_medium(g: float, device: str, report: Report) -> None:
    """Under even light, seen from all sides alike, `from_subsurface` shows the colour that it was given.

    A large slab, 400 mean free paths deep; the camera sees it at angles of which cosθ is spread as light from a matt
    surface is: that mean is the albedo under light from all sides, for the way can be reversed.
    """
    color = np.array([0.2, 0.5, 0.8])
    scene = stage(sky=1.0)
    medium = wrt.Medium.from_subsurface(tuple(color), 0.01, g)
    scene.add(wrt.box((-50, -50, -4.0), (50, 50, 0.0)), material=wrt.Null(interior=medium))
    nodes, weights = np.polynomial.legendre.leggauss(6)
    total, variance = np.zeros(3), np.zeros(3)
    for node, weight in zip(nodes, weights, strict=True):
        mu2 = 0.5 * (node + 1.0)  # 2 μ dμ = d(μ²)
        angle = math.acos(math.sqrt(mu2))
        scene.camera = wrt.PerspectiveCamera((3 * math.sin(angle), 0, 3 * math.cos(angle)), (0, 0, 0), fov_degrees=1e-3)
        mean, error = mean_and_error(render(scene, device, size=(16, 16), spp=32))
        total += 0.5 * weight * mean
        variance += (0.5 * weight * error) ** 2
    report(f"g {g:g}: colour", str(total.round(4)), str(color))
    # Where g is not 0 similarity holds deep inside only: near the surface light that goes on forwards is lost.
    assert (np.abs(total - color) < 3.5 * np.sqrt(variance) + (0.03 if g else 0.001)).all()
    assert np.sqrt(variance).max() < 0.005


def test_color_and_albedo_are_inverse() -> None:
    for color in (0.0, 0.05, 0.4, 0.9, 0.999, 1.0):
        assert abs(color_of_albedo(albedo_of_color(color)) - color) < 1e-7
    # Van de Hulst's fit ("Multiple Light Scattering", 1980), s² = 1 − a: (1 − s) (1 − 0.139 s) / (1 + 1.17 s).
    for albedo in (0.1, 0.5, 0.8, 0.9, 0.99, 0.9999):
        s = math.sqrt(1.0 - albedo)
        assert abs(color_of_albedo(albedo) - (1.0 - s) * (1.0 - 0.139 * s) / (1.0 + 1.17 * s)) < 2.5e-3


@pytest.mark.slow
def test_path_lets_media_absorb_alone(device: str) -> None:
    scene = stage(sky=1.0)
    medium = wrt.Medium(absorption=1.0, scattering=5.0)
    scene.add(wrt.box((-5, -5, -0.5), (5, 5, 0.0)), material=wrt.Null(interior=medium))
    with pytest.warns(UserWarning, match="ignores scattering in media"):
        image = render(scene, device, integrator="path").image()
    np.testing.assert_allclose(image, math.exp(-0.5), rtol=1e-4)
