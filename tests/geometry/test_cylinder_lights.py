"""Exact cylinders that shine are sampled where they are seen, by the density that is stated, with little noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.kernels import uniforms, upload
from support.statistics import chi_square_test

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
"""By what a cylinder shines: its side, and whether it has two."""


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
    """Write texture coordinates and directions of samples; their distances, densities, and those of the same hits."""
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


def angle_of(turn: NDArray, distance: float) -> NDArray:
    """Return the angle at the point, from the way to the axis, of places on the circle; `turn` from the way to it."""
    return np.arctan2(np.sin(turn), distance - np.cos(turn))


def shares_of_turn(edges: NDArray, distance: float, near: int, far: int) -> NDArray:
    """Return the share of samples between turns from the direction to the point, by uniform angles there."""
    if distance < 1.0:
        steps = np.diff(np.unwrap(angle_of(edges, distance)))
        return np.abs(steps) / (2.0 * math.pi) * far
    limb, width = math.acos(1.0 / distance), 2.0 * math.asin(1.0 / distance)

    def of_arc(low: float, high: float) -> NDArray:
        within = np.clip(edges, low, high)
        return np.abs(np.diff(angle_of(within, distance))) / width

    walls = near * of_arc(-limb, limb) + far * (of_arc(-math.pi, -limb) + of_arc(limb, math.pi))
    return walls / (near + far)


@pytest.mark.parametrize("shines", SIDES)
@pytest.mark.parametrize(
    "name", [name if name == "beside" else pytest.param(name, marks=pytest.mark.slow) for name in PLACES]
)
def test_samples_have_their_density(name: str, shines: str, device: str, report: Report) -> None:
    """Angles about the point and heights are uniform; from beside it nothing of the inside is sampled."""
    (side, two_sided), place = SIDES[shines], np.array(PLACES[name])
    at = CENTER + place @ AXES
    found, wi, (distance, pdf, pdf_of_hit) = (
        array.T for array in drawn(at, side, two_sided, uniforms(N, 2, seed=5), device)
    )
    outside = np.hypot(*place[:2]) > 1.0
    near = int(outside and shines != "inwards")
    far = int(shines != "outwards" and (not outside or abs(place[2]) > 0.5))
    if not near and not far:
        assert (pdf == 0.0).all()
        return
    sampled = pdf > 0.0
    assert sampled.mean() > 0.999
    d = float(np.hypot(*place[:2]))
    turn = 2.0 * math.pi * found[0] - math.atan2(place[1], place[0])
    turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
    turns, heights = np.linspace(-math.pi, math.pi, 61), np.linspace(0.0, 1.0, 12)
    counts = np.histogram2d(turn, found[1], [turns, heights])[0]
    expected = N * np.outer(shares_of_turn(turns, d, near, far), np.diff(heights))
    result = chi_square_test(counts, expected, tests=18, min_expected=20.0)
    report(f"{name}, {shines}: samples", result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    # The density per solid angle: that by area, of the angle's derivative, times r² / cosθ. Near the limb the points
    # are rounded more than the density.
    facing = np.abs(d * np.cos(turn) - 1.0)
    clear = sampled & (facing > 0.05 * max(d - 1.0, 0.05))
    by_turn = facing / (1.0 + d * d - 2.0 * d * np.cos(turn))
    width = 2.0 * math.asin(1.0 / d) if outside else 2.0 * math.pi
    by_area = by_turn / (width * (near + far)) / (RADIUS * LENGTH)
    normal = np.cos(2.0 * math.pi * found[0])[:, None] * AXES[0] + np.sin(2.0 * math.pi * found[0])[:, None] * AXES[1]
    cosine = np.abs((wi.T * normal).sum(axis=1)) / RADIUS
    own = by_area * distance**2 / cosine
    rounded = name in ("far away", "nearly on it")
    np.testing.assert_allclose(pdf[clear], own[clear], rtol=2e-2 if rounded else 2e-3)
    # A path that meets the light there is weighed by the same density.
    np.testing.assert_allclose(pdf_of_hit[sampled], pdf[sampled], rtol=1e-6)
