"""Exact cylinders that emit are sampled on their visible part, by the stated density, with little noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from support.kernels import uniforms, upload
from support.statistics import sidak

from wrt.kernels.geometry.quadrics import CYLINDER, Quadric
from wrt.kernels.geometry.rays import Receiver
from wrt.kernels.lights.lights import quadric_pdf, sample_mesh_quadric
from wrt.kernels.scene.scene_data import LightRecord

N = 2**18
RADIUS, LENGTH = 0.4, 1.5
AXES = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0] * [[RADIUS], [RADIUS], [LENGTH]]
CENTER = np.array([0.5, -1.0, 2.0])

PLACES = {
    "beside": (1.9, 0.7, 0.1),
    "far away": (400.0, -300.0, 0.2),
    "nearly on it": (1.02, 0.0, 0.4),
    "beyond an end": (1.5, -0.6, 1.2),
    "inside": (0.3, 0.5, -0.2),
    "before its opening": (0.2, -0.3, 0.9),
}
"""Places in the space of the unit cylinder, whose radius is 1 and whose height is 1."""

SIDES = {"outwards": (1.0, 0), "inwards": (-1.0, 0), "both": (1.0, 1)}
"""The side that emits, and whether both do."""


@wp.kernel(enable_backward=False)
def draw(
    quadric: Quadric,
    light: LightRecord,
    receiver: Receiver,
    u: wp.array(dtype=wp.vec2),
    place_out: wp.array(dtype=wp.vec2),
    wi_out: wp.array(dtype=wp.vec3),
    numbers_out: wp.array(dtype=wp.vec3),
):
    """Write texture coordinates, directions, distances and densities of samples, and the density of the same hit."""
    i = wp.tid()
    sample = sample_mesh_quadric(light, quadric, receiver, u[i])
    place_out[i] = wp.vec2(sample.point.u, sample.point.v)
    wi_out[i] = sample.wi
    pdf = quadric_pdf(quadric, light.two_sided, receiver, sample.wi, sample.point.t, 1.0)
    numbers_out[i] = wp.vec3(sample.point.t, sample.pdf, pdf)


def drawn(at: NDArray, side: float, two_sided: int, u: NDArray, device: str) -> list[NDArray]:
    quadric, light, receiver = Quadric(), LightRecord(), Receiver()
    quadric.kind, quadric.side, quadric.center = int(CYLINDER), side, wp.vec3(*CENTER)
    quadric.x, quadric.y, quadric.z = (wp.vec3(*axis) for axis in AXES)
    light.two_sided = two_sided
    receiver.position = wp.vec3(*at)
    out = [wp.zeros(len(u), dtype=dtype, device=device) for dtype in (wp.vec2, wp.vec3, wp.vec3)]
    wp.launch(draw, len(u), [quadric, light, receiver, upload(u, wp.vec2, device)], out, device=device)
    return [array.numpy().astype(np.float64) for array in out]


@pytest.mark.parametrize("emits", SIDES)
@pytest.mark.parametrize(
    "name", [name if name == "beside" else pytest.param(name, marks=pytest.mark.slow) for name in PLACES]
)
def test_samples_have_their_density(name: str, emits: str, device: str, report: Report) -> None:
    """In each cell of the wall 1 / density by area sums to its area; invisible cells get no samples."""
    (side, two_sided), place = SIDES[emits], np.array(PLACES[name])
    found, wi, numbers = drawn(CENTER + place @ AXES, side, two_sided, uniforms(N, 2, seed=5), device)
    distance, pdf, pdf_of_hit = numbers.T
    d = float(np.hypot(*place[:2]))
    near = d > 1.0 and emits != "inwards"
    far = emits != "outwards" and (d < 1.0 or abs(place[2]) > 0.5)
    if not near and not far:
        assert (pdf == 0.0).all()
        return
    sampled = pdf > 0.0
    assert sampled.mean() > 0.999
    # A path that hits the light there is weighted by the same density.
    np.testing.assert_allclose(pdf_of_hit[sampled], pdf[sampled], rtol=1e-6)
    turn = 2.0 * np.pi * found[:, 0]
    normal = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ AXES[:2] / RADIUS
    area = np.zeros(N)
    area[sampled] = (distance**2 / np.abs((wi * normal).sum(axis=1)))[sampled] / pdf[sampled]
    turn = (turn - math.atan2(place[1], place[0]) + np.pi) % (2.0 * np.pi) - np.pi
    # Directions are uniform in the angle about the axis that the cylinder subtends.
    x, y = (wi @ np.linalg.inv(AXES))[:, :2].T
    angle = (np.arctan2(y, x) - math.atan2(-place[1], -place[0]) + np.pi) % (2.0 * np.pi) - np.pi
    half = math.asin(1.0 / d) if d > 1.0 else np.pi
    assert stats.kstest(angle[sampled] / half, "uniform", args=(-1.0, 2.0)).pvalue > sidak(0.01, 18)
    edges = np.linspace(-np.pi, np.pi, 61), np.linspace(0.0, 1.0, 12)
    sums, squares, counts = (np.histogram2d(turn, found[:, 1], edges, weights=area**k)[0] for k in (1, 2, 0))
    # Of cells across the limb only a part is seen, and from near it hardly any.
    facing = d * np.cos(edges[0]) - 1.0
    least, most = np.minimum(facing[1:], facing[:-1]), np.maximum(facing[1:], facing[:-1])
    clear = 0.1 * max(d - 1.0, 0.1)
    some = ((near & (least > clear)) | (far & (most < -clear)))[:, None] & (counts > 0.0)
    unseen = (not near) & (least > 0.0) | (not far) & (most < 0.0)
    assert not counts[unseen].any()
    expected = N * 2.0 * np.pi * RADIUS * LENGTH / sums.size

    def chance(expected: NDArray) -> float:
        return float(stats.chi2.sf(((sums - expected)[some] ** 2 / squares[some]).sum(), some.sum()))

    report(f"{name}, {emits}: cells", int(some.sum()), "", p=chance(expected))
    assert chance(expected) > sidak(0.01, 18)
    # A density that is 6 % larger at one end would not do.
    assert chance(expected * np.linspace(0.94, 1.06, 11)) < 1e-4
