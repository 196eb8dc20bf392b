"""Automatic exposure makes a scene visible, and the default keeps radiance exact where a display can show it."""

import math

import numpy as np
import pytest

import wrt
from wrt.develop.exposure import stops
from wrt.develop.picture import develop


def picture(*parts, side=100):
    """Return a picture whose columns have shares of radiances; parts are (share, radiance)."""
    shares, values = zip(*parts, strict=True)
    image = np.repeat(values, np.diff(np.round(np.cumsum([0.0, *shares]) * side).astype(int)))
    return np.broadcast_to(image[None, :, None], (side, len(image), 3)).astype(np.float64)


def test_automatic_exposure_has_the_documented_value_whatever_the_noise():
    assert stops(picture((1.0, 1e6)), 3.5) == 3.5
    # A tenth of the picture is brighter than 0.7.
    assert stops(picture((0.8, 10.0), (0.2, 20.0)), "auto") == pytest.approx(math.log2(0.7 / 20.0))
    # The black background does not count, nor does one that is much darker than the subject.
    for dark in (0.0, 1e-3):
        found = stops(picture((0.92, dark), (0.08, 20.0)), "auto")
        assert found == pytest.approx(math.log2(0.7 / 20.0), abs=0.1)
    # A room of radiance 1 with windows of 500: the geometric mean becomes 0.05, which leaves the room visible.
    room = picture((0.8, 1.0), (0.2, 500.0))
    assert stops(room, "auto") == pytest.approx(math.log2(0.05) - 0.2 * math.log2(500.0), abs=0.05)
    rng = np.random.default_rng(4)
    image = picture((0.5, 3.0), (0.5, 30.0), side=128)
    noisy = image * rng.exponential(1.0, image.shape)
    noisy.reshape(-1, 3)[rng.choice(128 * 128, 8, replace=False)] = 1e6
    for odd in (1.0, math.nan, math.inf):
        noisy[0, 0] = odd
        assert stops(noisy, "auto") == pytest.approx(stops(image, "auto"), abs=0.5)


def test_the_default_exposure_is_continuous_and_changes_only_pictures_that_show_badly():
    for parts, sign in (
        (((0.88, 0.3), (0.12, 500.0)), 0),  # lamps change nothing
        (((1.0, 0.0),), 0),
        (((1.0, 1.0),), 0),
        (((0.8, 0.0), (0.12, 20.0), (0.08, 40.0)), -1),  # an object without surroundings, far too bright
        (((0.5, 10.0), (0.5, 30.0)), -1),
        (((1.0, 0.02),), 1),
    ):
        image = picture(*parts)
        assert stops(image) == (stops(image, "auto") if sign else 0.0)
        assert not sign or stops(image) * sign > 5.0
        assert stops(image, brighten=False) == min(stops(image), 0.0)  # as for textures
    image = picture((0.3, 0.05), (0.4, 0.2), (0.3, 0.5))
    gains = np.arange(-8.0, 12.0, 0.01)
    found = np.array([stops(image * 2.0**gain) for gain in gains])
    assert np.abs(np.diff(found)).max() < 0.15
    assert not found[np.abs(gains) < 0.5].any()
    assert np.ptp((gains + found)[gains > 6.0]) < 1e-6
    assert np.ptp((gains + found)[gains < -4.0]) < 1e-6


@pytest.mark.parametrize("exposure", ["automatic", math.nan, 101.0])
def test_an_unusable_exposure_is_refused(exposure):
    with pytest.raises(wrt.InputError, match="exposure must be"):
        wrt.RenderSettings(exposure=exposure)
    with pytest.raises(wrt.InputError, match="exposure must be"):
        wrt.develop_image(np.ones((2, 2, 3)), exposure=exposure)


def test_clipped_pixels_are_counted_and_warned_of():
    image = picture((0.8, 0.4), (0.2, 3.0))
    clipped = develop(image, tone="none", exposure=0.0)
    assert clipped.clipped == pytest.approx(0.2)
    assert "20 %" in clipped.warning
    assert "--exposure" in clipped.warning
    assert develop(image, exposure=0.0).warning is None  # the default keeps detail in them
    lamp = picture((0.97, 0.4), (0.03, 300.0))
    assert develop(lamp, tone="none", exposure=0.0).warning is None
    assert develop(0.0 * image).warning == "the picture is black: no light reaches what its camera sees"
