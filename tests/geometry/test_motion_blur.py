"""Motion blur: shutter times, moving cameras, and streaks, against closed forms and the mean of still pictures."""

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
from support.small_scenes import rendered
from support.statistics import image_z_test
from support.wide_scenes import deforming

import wrt

FloatArray = NDArray[np.float64]

# --- Shutters and cameras ----------------------------------------------------------------------------

OPEN, CLOSE = 0.5, 2.5


def trapezoid_quantile(u: FloatArray, ramp: float) -> FloatArray:
    """Return the quantile u of a density on [0, 1] that rises over the first ramp / 2 and falls over the last."""
    area = 1.0 - ramp / 2.0
    rise, fall = np.sqrt(u * area * ramp), 1.0 - np.sqrt((1.0 - u) * area * ramp)
    return np.where(u * area < ramp / 4.0, rise, np.where((1.0 - u) * area < ramp / 4.0, fall, u * area + ramp / 4.0))


@pytest.mark.parametrize("ramp", [0.0, 0.3, 1.0])
def test_times_have_the_shutters_distribution(ramp: float, device: str) -> None:
    camera = wrt.PerspectiveCamera(shutter_open=OPEN, shutter_close=CLOSE, shutter_ramp=ramp)
    u = uniforms(2**18, 1, seed=3)[:, 0]
    times = camera_rays(camera, 4, 4, np.full((len(u), 2), 2.0), shutters=u, device=device).times
    assert OPEN <= times.min() <= times.max() <= CLOSE
    x = (times - OPEN) / (CLOSE - OPEN)
    np.testing.assert_allclose(x, trapezoid_quantile(u.astype(np.float64), ramp), atol=2e-5)


AXIS, CENTER, OFFSET = np.array((0.2, 1.0, 0.3)), np.array((0.5, 0.2, -0.3)), np.array([1.0, -2.0, 3.0])
MOTION = wrt.Motion.rotation(AXIS, 300.0, center=CENTER, times=(OPEN, CLOSE), offset=OFFSET)


@pytest.mark.parametrize("make", [wrt.PerspectiveCamera, wrt.OrthographicCamera, wrt.PanoramaCamera, wrt.FisheyeCamera])
def test_rays_start_where_the_camera_is(make: type[wrt.Camera], device: str) -> None:
    rng = np.random.default_rng(4)
    where = {"films": rng.random((400, 2)) * 8.0, "lenses": rng.random((400, 2)), "shutters": rng.random(400)}
    lens = {"aperture_radius": 0.3} if make is wrt.PerspectiveCamera else {}
    camera = make((1, 2, 3), (0, 0, 0), shutter_open=OPEN - 0.5, shutter_close=CLOSE + 0.5, **lens)
    resting = camera_rays(camera, 8, 8, **where, device=device)
    rays = camera_rays(dataclasses.replace(camera, motion=MOTION), 8, 8, **where, device=device)
    np.testing.assert_array_equal(rays.times, resting.times)
    np.testing.assert_array_equal(rays.footprints, resting.footprints)
    share = np.clip((rays.times - OPEN) / (CLOSE - OPEN), 0.0, 1.0)[:, None]
    turns = Rotation.from_rotvec(np.radians(300.0) * share * AXIS / np.linalg.norm(AXIS))
    np.testing.assert_allclose(rays.origins, CENTER + turns.apply(resting.origins - CENTER) + share * OFFSET, atol=1e-5)
    np.testing.assert_allclose(rays.directions, turns.apply(resting.directions), atol=3e-6)


# --- Streaks -----------------------------------------------------------------------------------------

WIDTH, HEIGHT, SPP = 64, 8, 4096
"""Pixels of the streaks; the picture shows 8 x 1 metres, as high as the square that moves."""

QUAD = wrt.quad((-0.25, -0.5, 0.0), (0.5, 0.0, 0.0), (0.0, 1.0, 0.0))


def streak(shape: dict[str, object], device: str, **camera: object) -> FloatArray:
    """Return one channel of a picture of an emitting shape before black."""
    made = wrt.OrthographicCamera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), view_height=1.0, **camera)
    scene = wrt.Scene(camera=made)
    scene.add(emission=1.0, two_sided_emission=True, **shape)  # type: ignore[arg-type]
    renderer = rendered(scene, SPP, width=WIDTH, height=HEIGHT, max_depth=1, filter="box", device=device, seed=3)
    return renderer.image()[..., 0].astype(np.float64)


def chance(found: FloatArray, expected: FloatArray) -> float:
    """Return the p-value of Pearson's χ² if `expected` is right: a sample sees the shape or not."""
    expected = np.broadcast_to(expected, found.shape)
    certain = (expected < 1e-9) | (expected > 1.0 - 1e-9)
    if not np.allclose(found[certain], expected[certain], atol=3.0 / SPP):
        return 0.0
    expected, found = expected[~certain], found[~certain]
    variance = expected * (1.0 - expected) / SPP
    return float(stats.chi2.sf(np.sum((found - expected) ** 2 / variance), len(found)))


def crossing(offset: float, start: float = -2.0) -> FloatArray:
    """Return the share of the time that the square, moving along x by `offset`, covers each column.

    At x it is covered while |x − start − offset t| < 1/4; the mean over a pixel is by the antiderivative of that
    trapezoid.
    """

    def integral(x: FloatArray) -> FloatArray:
        """Return ∫ (x − s)₊ from s = 0 to offset, over offset: the antiderivative of a step that moves."""
        a, b = np.maximum(x, 0.0), np.maximum(x - offset, 0.0)
        return (a * a - b * b) / (2.0 * offset)

    edges = np.linspace(-4.0, 4.0, WIDTH + 1) - start
    return np.asarray(np.diff(integral(edges + 0.25) - integral(edges - 0.25)) * WIDTH / 8.0)


@pytest.mark.parametrize("what", ["shape", pytest.param("camera", marks=pytest.mark.slow)])
def test_a_streak(what: str, device: str, report: Report) -> None:
    """Its length, and the light along it: the shape, or the camera, moves for one of four seconds."""
    offset = 2.0 if what == "shape" else -2.0
    moving = wrt.Motion.translation((offset, 0.0, 0.0), times=(1.0, 2.0))
    shape, camera = ({"transform": moving}, {}) if what == "shape" else ({}, {"motion": moving})
    found = streak({"mesh": QUAD, **shape}, device, shutter_open=0.0, shutter_close=4.0, **camera)

    def expected(length: float, first: float = 0.25, start: float = 0.0) -> FloatArray:
        middle = np.linspace(-4, 4, 2 * WIDTH + 1)[1::2]
        at_start, at_end = (np.abs(middle - x) < 0.25 for x in (0.0, 2.0))
        return np.asarray(0.25 * crossing(length, start) + first * at_start + (0.75 - first) * at_end)

    p = chance(found, expected(2.0))
    report("the light along it", "", "", p=p)
    assert p > 1e-3
    # Wrong partners: a streak 5 % longer, one that begins 5 % too late, one that is a step aside.
    for wrong in (expected(2.1), expected(2.0, first=0.2625), expected(2.0, start=0.05)):
        assert chance(found, wrong) < 1e-6


@pytest.mark.slow
def test_stretching(device: str, report: Report) -> None:
    """The left edge stays, the right one moves: beyond x = 0 the light falls linearly."""
    stretch = np.stack([QUAD.vertices, QUAD.vertices + np.where(QUAD.vertices[:, :1] > 0.0, [2.0, 0.0, 0.0], 0.0)])
    deformation = wrt.Deformation((0.0, 1.0), stretch)
    found = streak({"mesh": QUAD, "deformation": deformation}, device, shutter_open=0.0, shutter_close=1.0)
    x = (np.arange(8 * WIDTH) + 0.5) / WIDTH - 4.0

    def expected(by: float) -> FloatArray:
        share = np.where(x < 0.25, 1.0, np.clip(1.0 - (x - 0.25) / by, 0.0, 1.0)) * (x > -0.25)
        return np.asarray(share.reshape(WIDTH, 8).mean(axis=1))

    p = chance(found, expected(2.0))
    report("the light along it", "", "", p=p)
    assert p > 1e-3
    assert chance(found, expected(2.1)) < 1e-9


@pytest.mark.slow
def test_a_deformation_may_bring_normals_to_a_flat_mesh(device: str) -> None:
    quad = wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    tilted = np.tile(np.float32([0.6, 0.0, 0.8]), (len(quad.vertices), 1))
    moving = wrt.Deformation((0.0, 1.0), np.stack([quad.vertices, 0.5 * quad.vertices]), np.stack([tilted] * 2))

    def picture(mesh: wrt.Mesh, deformation: wrt.Deformation) -> NDArray:
        scene = wrt.Scene(camera=wrt.OrthographicCamera((0, 0, 3), view_height=2.5, shutter_close=1.0))
        scene.add(mesh, material=wrt.Diffuse(0.8), deformation=deformation)
        scene.add_light(wrt.DirectionalLight((-0.7, 0.0, -0.7), irradiance=2.0))
        return rendered(scene, 4, width=24, height=24, device=device).image()

    found = picture(quad, moving)
    np.testing.assert_array_equal(found, picture(dataclasses.replace(quad, normals=tilted), moving))
    assert np.abs(found - picture(quad, wrt.Deformation(moving.times, moving.vertices))).max() > 0.02


# --- Pictures ----------------------------------------------------------------------------------------

RAMP = 0.8


def moving_scene(shutter: tuple[float, float], ramp: float = RAMP) -> wrt.Scene:
    """Return a tumbling box, a deforming ball, moving lamps, shapes at rest, and a turning camera."""
    scene = deforming()
    scene.environment = wrt.ConstantEnvironment(0.1)
    times = dict(zip(("shutter_open", "shutter_close"), shutter, strict=True))
    turn = wrt.Motion.rotation((0, 1, 0.5), 12.0, center=(0.5, 0.0, 3.0), offset=(0.2, 0.1, -0.3))
    view = {"fov_degrees": 40.0, "shutter_ramp": ramp, "motion": turn}
    scene.camera = wrt.PerspectiveCamera((0.0, 2.0, 5.0), (0.0, 0.6, 0.0), **view, **times)
    return scene


@pytest.mark.slow
def test_motion_is_the_mean_of_still_pictures(device: str, report: Report) -> None:
    """At times drawn by the shutter's trapezoid. Still pictures have all triangles in one tree."""
    options = {"width": 40, "height": 30, "max_depth": 4, "device": device}
    blurred = rendered(moving_scene((0.0, 1.0)), 1024, seed=1, **options)
    assert blurred._built.features.instances == "deforming"
    # One time in each of 128 equal parts of the whole: with so few pixels more would change nothing.
    count, rng = 128, np.random.default_rng(4)
    mean, variance = np.zeros((30, 40, 3)), np.zeros((30, 40, 3))
    for i, time in enumerate(trapezoid_quantile((np.arange(count) + rng.random(count)) / count, RAMP)):
        picture = rendered(moving_scene((time, time)), 8, seed=100 + i, **options)
        assert picture._built.features.instances == "none"
        mean += picture.image() / count
        variance += picture.variance() / count**2
    test = image_z_test(blurred.image(), blurred.variance(), mean, variance, n_a=1024, n_b=7 * count)
    report("against still pictures", test.message)
    assert test.pass_fraction >= 0.995
    assert min(test.p_min, test.block_p, test.spread_p, test.mean_p) > 1e-3
    # Wrong partners: another ramp of the shutter, and a single picture in the middle of the time.
    for shutter, ramp in (((0.0, 1.0), 0.2), ((0.5, 0.5), RAMP)):
        wrong = rendered(moving_scene(shutter, ramp), 1024, seed=7, **options)
        test = image_z_test(wrong.image(), wrong.variance(), mean, variance, n_a=1024, n_b=7 * count)
        report("wrong partner: p of blocks", test.block_p)
        assert test.block_p < 1e-6


def test_shapes_know_where_they_are() -> None:
    for shape in moving_scene((0.0, 1.0)).shapes:
        boxes = np.stack([shape.mesh_at(time).bounds for time in (0.0, 0.3, 0.7, 1.0)])
        assert (boxes[:, 0] >= shape.bounds[0] - 0.01).all()
        assert (boxes[:, 1] <= shape.bounds[1] + 0.01).all()
