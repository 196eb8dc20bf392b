"""Environments that few numbers describe: spherical harmonics, and a sky with its sun."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.bsdfs import sphere
from support.covering_kernels import render_with
from support.irradiance import EVERY_LIGHT, REFLECTANCE, floor_scene
from support.media import mean_and_error, render

import wrt
from wrt.scene.environment import harmonics, image_directions
from wrt.scene.skies.hosek_wilkie import (
    LUMINOUS_EFFICACY,
    WAVELENGTHS,
    color_matching,
    rgb_from_xyz,
    sun_rgb,
    sun_spectrum,
)

Array = NDArray[np.float64]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def test_harmonics_are_orthonormal() -> None:
    """By Gauss's rule in z and even steps of the azimuth, exact for all products."""
    degree = 16
    z, weights = np.polynomial.legendre.leggauss(degree + 1)
    phi = 2.0 * np.pi * np.arange(2 * degree + 1) / (2 * degree + 1)
    sine = np.sqrt(1.0 - z * z)
    d = np.stack([np.outer(sine, np.cos(phi)), np.outer(sine, np.sin(phi)), np.outer(z, np.ones_like(phi))], axis=-1)
    values = harmonics(degree, d.reshape(-1, 3))
    products = values.T @ (values * np.repeat(weights * 2.0 * np.pi / len(phi), len(phi))[:, None])
    np.testing.assert_allclose(products, np.eye(len(products)), atol=1e-10)


def test_harmonics_are_those_of_the_page() -> None:
    """Ramamoorthi and Hanrahan 2001, equation 3."""
    d = sphere(50, 1)
    x, y, z = d.T
    c0, c1, c2, c3, c4 = 0.282095, 0.488603, 1.092548, 0.315392, 0.546274
    expected = [c0 + 0.0 * x, c1 * y, c1 * z, c1 * x]
    expected += [c2 * x * y, c2 * y * z, c3 * (3 * z * z - 1), c2 * x * z, c4 * (x * x - y * y)]
    np.testing.assert_allclose(harmonics(2, d), np.stack(expected, axis=1), atol=2e-6)


def test_harmonics_that_are_negative_are_black() -> None:
    image = wrt.SphericalHarmonicsEnvironment([0.0, 1.0, 0.0, 0.0]).image()  # y
    up = image_directions(*image.pixels.shape[:2])[..., 1] > 0.0
    assert (image.pixels[up] > 0.0).all()
    assert not image.pixels[~up].any()


@pytest.mark.parametrize("strategy", ["mis", pytest.param("light", marks=pytest.mark.slow)])
def test_irradiance_of_harmonics(
    strategy: str, device: str, report: Report, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of degree 2 by the clamped cosine's own harmonics, A0 = π, A1 = 2π/3, A2 = π/4 (ibid., equation 8), times the
    scale."""
    render_with([EVERY_LIGHT], monkeypatch)
    coefficients = 0.2 * np.random.default_rng(2).normal(size=(9, 3))
    coefficients[0] = 4.0
    scene = floor_scene()
    scene.environment = wrt.SphericalHarmonicsEnvironment(coefficients, scale=2.5)
    wrt.save_scene(tmp_path / "scene.toml", scene)
    scene = wrt.load(tmp_path / "scene.toml")
    renderer = render(scene, device, size=(16, 16), spp=512, max_depth=2, strategy=strategy)
    bands = np.repeat([math.pi, 2.0 * math.pi / 3.0, math.pi / 4.0], [1, 3, 5])[:, None]
    expected = 2.5 * (harmonics(2, np.array([[0.0, 1.0, 0.0]])) @ (bands * coefficients))[0] * REFLECTANCE / math.pi
    measured, error = mean_and_error(renderer)
    report(f"{strategy}: red green blue", str(measured), str(expected))
    assert (np.abs(measured - expected) < 3.5 * error).all()
    assert (3.5 * error < 0.02 * expected).all()


@pytest.mark.parametrize(("elevation", "turbidity"), [(1.0, 10.0), (50.0, 2.0)])
def test_skies_are_skies(elevation: float, turbidity: float) -> None:
    """No negative radiance, a continuous sky, the sun where it should be, ground of what comes down."""
    albedo = (0.1, 0.2, 0.4)
    environment = wrt.SunSkyEnvironment(elevation, 40.0, turbidity=turbidity, ground_albedo=albedo)
    image, sun = environment.image_and_sun()
    assert sun is not None
    height = len(image.pixels)
    sky, ground = image.pixels[: height // 2].astype(np.float64), image.pixels[height // 2 :]
    luminance = sky @ LUMINANCE
    assert (image.pixels >= 0.0).all()
    assert (luminance > 0.0).all()
    # From texel to texel it changes by less than a tenth: no seam at −z, at the zenith or above the horizon. It is
    # steeper in haze under a low sun, and falls off in the last degree above the horizon.
    steps = np.abs(np.diff(np.log(luminance), axis=0))
    assert steps[:-4].max() < (0.1 if turbidity < 10.0 else 0.15)
    assert np.abs(np.diff(np.log(np.concatenate([luminance, luminance[:, :1]], axis=1)), axis=1)).max() < 0.1
    to_sun = np.array(environment.to_sun)
    np.testing.assert_allclose(-np.array(sun.direction), to_sun)
    d = image_directions(*image.pixels.shape[:2])[: height // 2]
    # At a low sun the brightest place may be the haze below it.
    assert np.linalg.norm((d.reshape(-1, 3)[luminance.argmax()] - to_sun)[[0, 2]]) < 0.6
    solid_angle = np.sin(np.arccos(d[..., 1])) * (np.pi / height) ** 2
    down = np.einsum("ijc,ij->c", sky, d[..., 1] * solid_angle) + np.asarray(sun.irradiance) * to_sun[1]
    np.testing.assert_allclose(ground, np.broadcast_to(down * albedo / np.pi, ground.shape), rtol=1e-3)


def test_color_matching_functions_are_those_of_the_cie() -> None:
    """CIE 1931 at four wavelengths (CIE 15), and the equal integrals 106.86 of all three."""
    table = {450.0: (0.3362, 0.0380, 1.7721), 500.0: (0.0049, 0.3230, 0.2720), 550.0: (0.4334, 0.9950, 0.0087)}
    for wavelength, values in (table | {600.0: (1.0622, 0.6310, 0.0008)}).items():
        np.testing.assert_allclose(color_matching([wavelength])[0], values, atol=0.035)
    np.testing.assert_allclose(color_matching(np.arange(360.0, 831.0)).sum(axis=0), 106.86, rtol=0.01)
    np.testing.assert_allclose(rgb_from_xyz([0.95047, 1.0, 1.08883]), 1.0, atol=1e-4)


def test_the_sun_s_illuminance_is_that_of_its_spectrum() -> None:
    """∫ L ȳ dλ, with the table of the CIE's standard observer of 1931."""
    wavelengths = np.arange(380.0, 721.0, 20.0)
    y_bar = [0.0, 0.0004, 0.004, 0.023, 0.06, 0.139, 0.323, 0.71, 0.954]
    y_bar += [0.995, 0.87, 0.631, 0.381, 0.175, 0.061, 0.017, 0.0041, 0.001]
    for elevation, turbidity in ((math.radians(10.0), 2.0), (math.radians(60.0), 6.0)):
        expected = 20.0 * float(np.interp(wavelengths, WAVELENGTHS, sun_spectrum(elevation, turbidity)) @ y_bar)
        assert float(sun_rgb(elevation, turbidity) @ LUMINANCE) == pytest.approx(expected, rel=0.01)


DEPARTURES = {15.0: (1.22, 1.05), 60.0: (1.08, 0.87)}
"""By the sun's height, sky and sun of turbidity 2.5 over what was measured. The atmosphere that Hošek and Wilkie
simulated is hazier than the clear skies of RP-21: it scatters more light into the sky."""


@pytest.mark.parametrize("degrees", DEPARTURES)
def test_daylight_is_as_bright_as_measured(degrees: float, report: Report) -> None:
    """IES RP-21, "Calculation of Daylight Availability" (1984), has for clear skies, with the sun at the height h,
    0.8 + 15.5 √sin h klx from the sky onto the ground and 127.5 exp(−0.21 / sin h) klx from the sun across its rays.
    """
    sine = math.sin(math.radians(degrees))
    expected = np.array([0.8 + 15.5 * math.sqrt(sine), 127.5 * math.exp(-0.21 / sine)])

    image, sun = wrt.SunSkyEnvironment(degrees, turbidity=2.5).image_and_sun()
    assert sun is not None
    d = image_directions(*image.pixels.shape[:2])[: len(image.pixels) // 2, :, 1]
    solid_angle = np.sqrt(1.0 - d**2) * (np.pi / len(image.pixels)) ** 2
    sky = np.einsum("ijc,ij->c", image.pixels[: len(d)].astype(np.float64), d * solid_angle)
    illuminances = LUMINOUS_EFFICACY / 1000.0 * np.array([sky, sun.irradiance]) @ LUMINANCE
    report(f"sun at {degrees}: sky and sun, klx", illuminances.tolist(), expected.tolist())
    np.testing.assert_allclose(illuminances / expected, DEPARTURES[degrees], rtol=0.01)


def test_the_sun_may_be_given_by_its_direction_or_left_out() -> None:
    assert wrt.SunSkyEnvironment(30.0, sun_scale=0.0).image_and_sun()[1] is None
    angles = wrt.SunSkyEnvironment(30.0, -100.0)
    direction = wrt.SunSkyEnvironment(sun_direction=tuple(3.0 * x for x in angles.to_sun))  # type: ignore[arg-type]
    assert (direction.elevation_degrees, direction.azimuth_degrees) == pytest.approx((30.0, -100.0))
    np.testing.assert_allclose(wrt.SunSkyEnvironment(0.001, 90.0).to_sun, (1.0, 0.0, 0.0), atol=1e-4)
