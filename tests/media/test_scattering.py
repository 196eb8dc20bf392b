"""Media that scatter: their phase function, furnaces, single scattering, the colour of a deep medium, and motion."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from conftest import Report
from scipy.integrate import quad
from support.covering_kernels import render_with, rendering_with
from support.kernels import map_function, uniforms
from support.media import KERNELS, mean_and_error, render, stage
from support.statistics import chi_square_test, integrate_pdf_over_bins, sphere_histogram

import wrt
from wrt.kernels.media.medium import phase, sample_phase
from wrt.scene.medium import albedo_of_color, color_of_albedo

N = 2**19


def henyey_greenstein(cosine: np.ndarray, g: float) -> np.ndarray:
    return (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)


@pytest.mark.parametrize("g", [0.8, 1e-4, pytest.param(-0.95, marks=pytest.mark.slow)])
def test_directions_follow_the_phase_function(g: float, device: str, report: Report) -> None:
    forward = np.broadcast_to([0.0, 0.0, 1.0], (N, 3))
    drawn = map_function(sample_phase, forward, np.full(N, g), uniforms(N, 2, seed=4), device=device)
    counts = sphere_histogram(drawn)

    def expected(mean: float) -> np.ndarray:
        return N * integrate_pdf_over_bins(lambda d: henyey_greenstein(d[..., 2], mean), counts.shape)

    result = chi_square_test(counts, expected(float(np.float32(g))), tests=5)
    report(f"g = {g:g}", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    # With another mean cosine they do not.
    of_another_mean = expected(g + 0.05 * (1.0 if g < 0.0 else -1.0))
    assert not chi_square_test(counts, of_another_mean, tests=5, total_tolerance=1.0).passed
    cosine = np.linspace(-1.0, 1.0, 1001)
    value = map_function(phase, cosine, np.full(1001, g), device=device)
    formula = henyey_greenstein(np.float32(cosine).astype(np.float64), float(np.float32(g)))
    # 1 + g² − 2 g cosθ is a difference of near numbers for g near 1 and θ near 0.
    np.testing.assert_allclose(value, formula, rtol=2e-6 / (1.0 - abs(g)) ** 2)


def test_directions_turn_with_the_way(device: str) -> None:
    forward = np.array([0.48, -0.6, 0.64])
    inputs = (np.broadcast_to(forward, (N, 3)), np.full(N, 0.8), uniforms(N, 2, seed=4))
    directions = map_function(sample_phase, *inputs, device=device).astype(np.float64)
    assert abs((directions @ forward).mean() - 0.8) < 4.0 * 0.4 / np.sqrt(N)
    assert abs((directions @ np.cross(forward, [0.0, 0.0, 1.0])).mean()) < 4.0 * 0.4 / np.sqrt(N)


few_kernels = rendering_with(*KERNELS)
BLOCK = wrt.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
ASIDE = {"sky": 1.0, "origin": (1.8, 1.3, 3.0), "fov_degrees": 20.0}


@pytest.mark.parametrize(
    ("boundary", "thickness", "g"),
    [
        (wrt.Null, 1.0, 0.8),
        (wrt.Dielectric, 10.0, -0.5),
        pytest.param(wrt.Null, 10.0, 0.0, marks=pytest.mark.slow),
    ],
)
def test_white_in_a_furnace(boundary: type, thickness: float, g: float, device: str, report: Report) -> None:
    """A medium that absorbs nothing cannot be seen under an even sky, however often it scatters.

    Its density differs in the channels, by 2 either way. A block, from which light always gets out.
    """
    medium = wrt.Medium.from_albedo(1.0, (0.5 * thickness, thickness, 2.0 * thickness), g)
    scene = stage(**ASIDE)
    scene.add(BLOCK, material=boundary(interior=medium))
    mean, error = mean_and_error(render(scene, device, size=(24, 24), spp=64, max_depth=1000))
    report(f"{boundary.__name__}, g {g:g}, thickness {thickness:g}: worst", f"{((mean - 1) / error).round(2)} sigma", 0)
    assert (np.abs(mean - 1.0) < 3.5 * np.maximum(error, 1e-6)).all()
    assert error.max() < 0.01


@pytest.mark.parametrize(
    ("g", "strategy"),
    [(0.7, "mis"), *(pytest.param(0.7, s, marks=pytest.mark.slow) for s in ("light", "bsdf"))],
)
def test_single_scattering_in_a_thin_slab(g: float, strategy: str, device: str, report: Report) -> None:
    """One event and no more: ∫ s exp(−t z) p(θ) L(z) dz along the way of the camera, in closed form per channel.

    A lamp far to the side, small enough to be a point, lights it at 90 degrees through the air above, so that on the
    way to the event light goes z / cosθ through the slab.
    """
    s, a, d = np.array([0.05, 0.2, 0.8]), np.array([0.3, 0.1, 0.0]), 0.4
    t = s + a
    scene = stage()
    scene.add(wrt.box((-50, -50, -d), (50, 50, 0.0)), material=wrt.Null(interior=wrt.Medium(tuple(a), tuple(s), g)))
    corner, along, up = np.array([40.0, -4.0, 26.0]), np.array([0.0, 8.0, 0.0]), np.array([-6.0, 0.0, 8.0])
    normal = np.cross(up, along)
    scene.add(wrt.quad(tuple(corner), tuple(up), tuple(along)), material=wrt.Diffuse(0.0), emission=100.0)
    mean, error = mean_and_error(render(scene, device, strategy=strategy, size=(32, 32), spp=512, max_scatterings=1))

    x = (np.polynomial.legendre.leggauss(16)[0] + 1.0) / 2.0
    w = np.polynomial.legendre.leggauss(16)[1] / 2.0
    points = corner + x[:, None, None] * along + x[None, :, None] * up

    def arriving(z: float, channel: int) -> float:
        offset = points - [0.0, 0.0, -z]
        r2 = (offset**2).sum(axis=2)
        r = np.sqrt(r2)
        p = henyey_greenstein(-offset[..., 2] / r, g)  # between the camera's way, −z, and the way to the light
        through = np.exp(-t[channel] * z * r / offset[..., 2])
        light = 100.0 * np.maximum(-(offset @ normal), 0.0) / (r2 * r)
        return float(np.einsum("i,j,ij", w, w, p * through * light)) * s[channel] * math.exp(-t[channel] * z)

    expected = np.array([quad(arriving, 0.0, d, args=(c,))[0] for c in range(3)])
    report(f"{strategy}, g {g:g}", str(mean), str(expected))
    assert (np.abs(mean - expected) < 3.5 * error + 1e-4 * expected).all()
    if strategy != "bsdf":
        assert (np.abs(mean - 1.05 * expected) > 3.5 * error).all()


def test_emission_while_it_scatters(device: str, report: Report) -> None:
    """In a medium without end that emits, scatters and absorbs, radiance is e / a everywhere."""
    medium = wrt.Medium(absorption=(0.5, 1.0, 2.0), scattering=(3.0, 1.0, 0.5), g=0.3, emission=(1.0, 2.0, 3.0))
    mean, error = mean_and_error(render(stage(medium=medium), device, size=(16, 16), spp=256))
    expected = np.array([2.0, 2.0, 1.5])
    report("e / a", str(mean.round(4)), str(expected))
    assert (np.abs(mean - expected) < 3.5 * error).all()
    assert (np.abs(mean - expected) < 0.02 * expected).all()


@pytest.mark.parametrize("g", [0.0, pytest.param(0.6, marks=pytest.mark.slow)])
def test_color_of_a_deep_medium(g: float, device: str, report: Report) -> None:
    """Under even light, seen from all sides alike, `from_subsurface` shows the colour that it was given.

    A large slab, 400 mean free paths deep. The camera sees it at cosine-distributed angles; by reversibility the mean
    over them is the albedo under light from all sides.
    """
    color = np.array([0.2, 0.5, 0.8])
    scene = stage(sky=1.0)
    medium = wrt.Medium.from_subsurface(tuple(color), 0.01, g)
    scene.add(wrt.box((-50, -50, -4.0), (50, 50, 0.0)), material=wrt.Null(interior=medium))
    total, variance = np.zeros(3), np.zeros(3)
    for node, weight in zip(*np.polynomial.legendre.leggauss(6), strict=True):
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


def test_path_lets_media_absorb_alone(device: str) -> None:
    scene = stage(sky=1.0)
    medium = wrt.Medium(absorption=1.0, scattering=5.0)
    scene.add(wrt.box((-5, -5, -0.5), (5, 5, 0.0)), material=wrt.Null(interior=medium))
    with pytest.warns(UserWarning, match="ignores scattering in media"):
        image = render(scene, device, integrator="path").image()
    np.testing.assert_allclose(image, math.exp(-0.5), rtol=1e-4)


@pytest.mark.slow
def test_shadows_in_fog_are_those_of_the_time(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plate between a lamp and all fog that is seen moves away when half of the shutter's time is over."""
    render_with([dataclasses.replace(kernel, instances="moving") for kernel in KERNELS], monkeypatch)
    plate = wrt.quad((-500.0, 2.0, 500.0), (1000.0, 0.0, 0.0), (0.0, 0.0, -1000.0))
    away = np.eye(4)
    away[0, 3] = 1000.0

    def seen(move: wrt.Motion) -> tuple[np.ndarray, np.ndarray]:
        fog = wrt.Medium(absorption=0.05, scattering=(0.5, 0.3, 0.1), g=0.4)
        scene = stage(medium=fog, shutter_open=0.0, shutter_close=1.0)
        scene.add(plate, material=wrt.Diffuse(0.0), transform=move)
        scene.add_light(wrt.PointLight((0.0, 4.0, 0.0), intensity=50.0))
        return mean_and_error(render(scene, device, size=(32, 32), spp=256, max_scatterings=1))

    moving, error = seen(wrt.Motion((0.0, 1.0), (np.eye(4), away)))
    free, free_error = seen(wrt.Motion((0.0, 1.0), (away, away)))
    assert (np.abs(moving - 0.5 * free) < 3.5 * np.hypot(error, 0.5 * free_error)).all()
    assert (np.hypot(error, 0.5 * free_error) < 0.01 * free).all()
