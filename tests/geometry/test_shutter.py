"""Shutters and cameras that move: times of the trapezoid, and rays where the camera is then."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial.transform import Rotation
from support.cameras import camera_rays
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
