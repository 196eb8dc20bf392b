"""Shutters and cameras that move: times of the trapezoid, rays where the camera is then, streaks as long as they go."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial.transform import Rotation
from support.cameras import camera_rays
from support.exact_pictures import rendered
from support.kernels import uniforms

import wrt

FloatArray = NDArray[np.float64]
N = 2**18
OPEN, CLOSE = 0.5, 2.5


def trapezoid_cdf(x: FloatArray, ramp: float) -> FloatArray:
    """Return the integral of a density that rises over the first ramp / 2 of [0, 1], and falls over the last."""
    fine = np.linspace(0.0, 1.0, 200_001)
    with np.errstate(divide="ignore", invalid="ignore"):
        density = np.ones_like(fine) if ramp == 0.0 else np.minimum(1.0, np.minimum(fine, 1.0 - fine) / (ramp / 2.0))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    return np.interp(x, fine, total / total[-1])


def trapezoid_quantile(u: FloatArray, ramp: float) -> FloatArray:
    fine = np.linspace(0.0, 1.0, 200_001)
    return np.interp(u, trapezoid_cdf(fine, ramp), fine)


@pytest.mark.parametrize("ramp", [0.0, 0.3, 1.0])
def test_times_have_the_shutters_distribution(ramp: float, device: str, report: Report) -> None:
    """Number by number, and so as a whole."""
    camera = wrt.PerspectiveCamera(shutter_open=OPEN, shutter_close=CLOSE, shutter_ramp=ramp)
    u = uniforms(N, 1, seed=3)[:, 0]
    times = camera_rays(camera, 4, 4, np.full((N, 2), 2.0), shutters=u, device=device).times
    assert OPEN <= times.min() <= times.max() <= CLOSE
    x = (times - OPEN) / (CLOSE - OPEN)
    np.testing.assert_allclose(x, trapezoid_quantile(u.astype(np.float64), ramp), atol=2e-5)
    result = stats.kstest(x, lambda v: trapezoid_cdf(v, ramp))
    report(f"ramp {ramp:g}: Kolmogorov-Smirnov distance", float(result.statistic), p=float(result.pvalue))
    assert result.pvalue > 0.01


AXIS, CENTER, OFFSET = np.array((0.2, 1.0, 0.3)), np.array((0.5, 0.2, -0.3)), np.array([1.0, -2.0, 3.0])
MOTION = wrt.Motion.rotation(AXIS, 300.0, center=CENTER, times=(OPEN, CLOSE), offset=OFFSET)


@pytest.mark.parametrize("make", [wrt.PerspectiveCamera, wrt.OrthographicCamera, wrt.PanoramaCamera, wrt.FisheyeCamera])
def test_rays_start_where_the_camera_is(make: type[wrt.Camera], device: str) -> None:
    rng = np.random.default_rng(4)
    where = {"films": rng.random((400, 2)) * 8.0, "lenses": rng.random((400, 2)), "shutters": rng.random(400)}
    lens = {"aperture_radius": 0.3} if make is wrt.PerspectiveCamera else {}
    camera = make((1, 2, 3), (0, 0, 0), shutter_open=OPEN - 0.5, shutter_close=CLOSE + 0.5, **lens)
    rest = camera_rays(camera, 8, 8, **where, device=device)
    rays = camera_rays(dataclasses.replace(camera, motion=MOTION), 8, 8, **where, device=device)
    np.testing.assert_array_equal(rays.times, rest.times)
    np.testing.assert_array_equal(rays.footprints, rest.footprints)
    share = np.clip((rays.times - OPEN) / (CLOSE - OPEN), 0.0, 1.0)[:, None]
    turns = Rotation.from_rotvec(np.radians(300.0) * share * AXIS / np.linalg.norm(AXIS))
    np.testing.assert_allclose(rays.origins, CENTER + turns.apply(rest.origins - CENTER) + share * OFFSET, atol=1e-5)
    np.testing.assert_allclose(rays.directions, turns.apply(rest.directions), atol=3e-6)


# --- Streaks -----------------------------------------------------------------------------------------

SIZE, FOV, DEPTH = 128, 40.0, 5.0
HEIGHT = 2.0 * math.tan(math.radians(FOV / 2.0))
"""Of the picture at distance 1."""
COLUMNS = (np.arange(SIZE) + 0.5) / SIZE - 0.5


def profile_of_a_strip(side: float, device: str, **camera: object) -> FloatArray:
    """Return the light in each column of a picture of a shining strip, 2 m high, before a camera at (0, 0, 0)."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 0, 0), (0, 0, -1), fov_degrees=FOV, **camera))
    strip = wrt.quad((-side / 2, -1.0, -DEPTH), (side, 0, 0), (0, 2.0, 0))
    scene.add(strip, material=wrt.Diffuse(0.0), emission=1.0)
    size = {"width": SIZE, "height": SIZE, "max_depth": 1, "filter": "box", "seed": 2}
    return np.asarray(rendered(scene, 256, device=device, **size).image()[..., 0].sum(axis=0), np.float64)


@pytest.mark.slow
def test_streak_of_a_camera_that_is_shifted(device: str, report: Report) -> None:
    """A point at depth d moves by v T / d on the plane at distance 1, against the camera, and evenly."""
    way, side = 1.6, 0.1
    motion = wrt.Motion.translation((way, 0, 0), (OPEN, CLOSE))
    profile = profile_of_a_strip(side, device, shutter_open=OPEN, shutter_close=CLOSE, motion=motion)
    share = profile / profile.sum()
    middle = float((share * COLUMNS).sum())
    variance = float((share * (COLUMNS - middle) ** 2).sum()) - ((side / (DEPTH * HEIGHT)) ** 2 + 1.0 / SIZE**2) / 12.0
    length, expected = math.sqrt(12.0 * variance), way / (DEPTH * HEIGHT)
    report("length, picture heights; middle", length, expected)
    assert length == pytest.approx(expected, rel=0.01)
    assert middle == pytest.approx(-expected / 2.0, abs=0.01 * expected)


@pytest.mark.slow
def test_streak_of_a_camera_that_pans(device: str, report: Report) -> None:
    """Turned to the left by ω t, it sees a point before it at tan(ω t): from the middle, and slower there."""
    side, degrees = 0.06, 18.0
    motion = wrt.Motion.rotation((0, 1, 0), degrees, times=(0.0, 0.01))
    profile = profile_of_a_strip(side, device, shutter_close=0.01, motion=motion)
    lit = np.flatnonzero(profile > 0.5 * profile.max())
    width = side / (DEPTH * HEIGHT) * SIZE  # of the strip, columns
    length, expected = lit[-1] + 1 - lit[0], math.tan(math.radians(degrees)) / HEIGHT * SIZE
    report("length, columns", float(length), expected)
    assert lit[0] == pytest.approx(SIZE / 2, abs=1.0)
    assert length == pytest.approx(expected, abs=1.0 + 0.5 * width)
    # Its solid angle stays, but that of a pixel shrinks by cos³ outwards.
    angles = np.radians(degrees) * (np.arange(4000) + 0.5) / 4000.0
    weights = 1.0 / np.cos(angles) ** 3
    mean = float((weights * np.tan(angles)).sum() / weights.sum() / HEIGHT)
    middle = float((profile * COLUMNS).sum() / profile.sum())
    report("middle, picture heights", middle, mean)
    assert middle == pytest.approx(mean, rel=0.01)
