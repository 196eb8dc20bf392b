"""Automatic exposure shows what is there, and the default keeps radiance exact where it can be shown."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import wrt
from wrt.develop.exposure import stops
from wrt.develop.picture import develop

GREY = [0.25, 0.5, 0.8, 1.0]


def picture(*parts: tuple[float, float], side: int = 100) -> np.ndarray:
    """A picture whose areas have (share, radiance), in columns."""
    edges = np.round(np.cumsum([0.0, *(share for share, _ in parts)]) * side).astype(int)
    image = np.zeros((side, side, 3))
    for (begin, end), (_, value) in zip(itertools.pairwise(edges), parts, strict=True):
        image[:, begin:end] = value
    return image


def test_a_number_of_stops_is_taken_as_it_is():
    assert stops(picture((1.0, 1e6)), 3.5) == 3.5
    assert stops(picture((1.0, 1e6)), 0.0) == 0.0


def test_automatic_exposure_has_the_documented_value():
    # A tenth of the picture is brighter than 0.7.
    assert stops(picture((0.8, 10.0), (0.2, 20.0)), "auto") == pytest.approx(math.log2(0.7 / 20.0))
    # The black background does not count, nor does one that is much darker than the subject.
    for dark in (0.0, 1e-3):
        found = stops(picture((0.92, dark), (0.08, 20.0)), "auto")
        assert found == pytest.approx(math.log2(0.7 / 20.0), abs=0.1)
    # A room of radiance 1 with windows of 500: the geometric mean becomes 0.05, which leaves the room visible.
    room = picture((0.8, 1.0), (0.2, 500.0))
    assert stops(room, "auto") == pytest.approx(math.log2(0.05) - 0.2 * math.log2(500.0), abs=0.05)


def test_noise_and_fireflies_hardly_matter():
    rng = np.random.default_rng(4)
    image = picture((0.5, 3.0), (0.5, 30.0), side=128)
    noisy = image * rng.exponential(1.0, image.shape)
    noisy.reshape(-1, 3)[rng.choice(128 * 128, 8, replace=False)] = 1e6
    assert stops(noisy, "auto") == pytest.approx(stops(image, "auto"), abs=0.5)
    noisy[0, 0] = math.nan
    noisy[0, 5] = math.inf
    assert stops(noisy, "auto") == pytest.approx(stops(image, "auto"), abs=0.5)


@pytest.mark.parametrize("radiance", GREY)
def test_by_default_a_uniform_picture_is_exact(radiance):
    image = np.full((40, 40, 3), radiance)
    assert stops(image) == 0.0
    assert math.copysign(1.0, stops(image)) == 1.0
    expected = wrt.develop_image(image, tone="none", exposure=0.0)
    np.testing.assert_array_equal(wrt.develop_image(image), expected)


def test_by_default_lamps_change_nothing_and_an_overexposed_picture_is_darkened():
    assert stops(picture((0.88, 0.3), (0.12, 500.0))) == 0.0
    alone = picture((0.8, 0.0), (0.12, 20.0), (0.08, 40.0))  # an object without surroundings, far too bright
    assert stops(alone) == stops(alone, "auto") < -5.0
    assert stops(picture((0.48, 0.0), (0.48, 0.3), (0.04, 500.0))) == 0.0  # and one well lit, with a lamp
    assert stops(picture((0.5, 10.0), (0.5, 30.0))) == stops(picture((0.5, 10.0), (0.5, 30.0)), "auto") < -5.0
    assert stops(picture((1.0, 0.02))) == stops(picture((1.0, 0.02)), "auto") > 5.0
    assert stops(picture((1.0, 0.02)), brighten=False) == 0.0
    dark = np.full((8, 8, 3), 0.01)  # a texture
    np.testing.assert_array_equal(wrt.develop_image(dark), wrt.develop_image(dark, exposure=0.0))
    assert stops(np.zeros((40, 40, 3))) == 0.0
    assert stops(np.full((1, 1, 3), math.nan)) == 0.0


def test_the_default_goes_over_continuously():
    image = picture((0.3, 0.05), (0.4, 0.2), (0.3, 0.5))
    gains = np.arange(-8.0, 12.0, 0.01)
    found = np.array([stops(image * 2.0**gain) for gain in gains])
    assert np.abs(np.diff(found)).max() < 0.15
    shown = gains + found
    assert found[np.abs(gains) < 0.5].tolist() == [0.0] * int((np.abs(gains) < 0.5).sum())
    assert np.ptp(shown[gains > 6.0]) < 1e-6
    assert np.ptp(shown[gains < -4.0]) < 1e-6


@pytest.mark.slow
def test_a_day_is_shown_well_without_options():
    """A white surface under the sun is neither clipped nor grey, at the exposure that the documentation names."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin=(0, 2, 5), target=(0, 0, 0), fov_degrees=40))
    scene.add(wrt.quad((-50, 0, 50), (100, 0, 0), (0, 0, -100)), material=wrt.Diffuse(0.8))
    scene.environment = wrt.SunSkyEnvironment()
    developed = develop(wrt.render(scene, width=32, height=32, spp=4))
    assert -6.2 < developed.stops < -4.8
    assert developed.clipped < 0.03
    assert 180 < np.median(developed.codes) < 245


@pytest.mark.parametrize("exposure", ["automatic", math.nan, math.inf, 101.0, [1.0]])
def test_an_unusable_exposure_is_refused(exposure):
    with pytest.raises(wrt.InputError, match="exposure must be"):
        wrt.develop_image(np.ones((2, 2, 3)), exposure=exposure)
    with pytest.raises(wrt.InputError, match="exposure must be"):
        wrt.RenderSettings(exposure=exposure)


def test_clipped_pixels_are_counted_and_a_warning_says_what_to_do():
    image = picture((0.8, 0.4), (0.2, 3.0))
    clipped = develop(image, tone="none", exposure=0.0)
    assert clipped.clipped == pytest.approx(0.2)
    assert clipped.warning is not None
    assert "20 %" in clipped.warning
    assert "--exposure" in clipped.warning
    assert develop(image, exposure=0.0).warning is None  # the default keeps detail in them
    assert develop(picture((0.97, 0.4), (0.03, 300.0)), tone="none", exposure=0.0).warning is None  # a lamp
    assert develop(np.ones((8, 8, 3)), tone="none", exposure=0.0).warning is None  # white is not clipped


def test_a_black_picture_is_told():
    image = np.zeros((64, 64, 3))
    image[:2, :2] = 0.5  # one pixel in a thousand
    for black in (0.0 * image, image):
        assert develop(black).warning == "the picture is black: no light reaches what its camera sees"
    image[:3, :2] = 0.001
    assert develop(image).warning is None
