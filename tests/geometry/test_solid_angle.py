"""Rectangles, disks and spheres are sampled with the stated densities, from any viewpoint."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from support.kernels import uniforms, upload
from support.statistics import chi_square_test, sidak

from wrt.backend.warp_start import initialize_warp
from wrt.kernels.sampling.solid_angle import (
    cone_pdf,
    disk_cone,
    disk_pdf,
    rectangle_from,
    rectangle_pdf,
    sample_cone,
    sample_disk,
    sample_rectangle,
    sample_sphere,
    sphere_one_minus_cos,
)

Array = NDArray[np.float64]

N = 2**19
TESTS = 20
"""Tests of this file that share a significance of 1 %."""

RECTANGLE = wp.constant(0)
DISK = wp.constant(1)
SPHERE = wp.constant(2)
CONE = wp.constant(3)

# Of all kinds: in the plane z = 0 around or from the origin, the normal +z, sizes below.
WIDTH, HEIGHT, RADIUS = 1.2, 0.7, wp.constant(0.8)


@wp.kernel(enable_backward=False)
def draw_directions(
    kind: int,
    p: wp.vec3,
    size: wp.vec2,
    u: wp.array(dtype=wp.vec2),
    wi_out: wp.array(dtype=wp.vec3),
    pdf_out: wp.array(dtype=wp.vec2),
    distance_out: wp.array(dtype=float),
):
    """Write directions, their densities from `sample` and from `pdf`, and distances."""
    i = wp.tid()
    x = wp.vec3(1.0, 0.0, 0.0)
    y = wp.vec3(0.0, 1.0, 0.0)
    z = wp.vec3(0.0, 0.0, 1.0)
    if kind == RECTANGLE:
        r = rectangle_from(wp.vec3(0.0), x, y, size, p)
        xy = sample_rectangle(r, u[i])
        segment = wp.vec3(xy[0], xy[1], -p[2])
        distance_out[i] = wp.length(segment)
        wi_out[i] = segment / wp.max(wp.length(segment), 1.0e-30)
        pdf_out[i] = wp.vec2(rectangle_pdf(r, wp.length(segment)))
    elif kind == DISK:
        cone = disk_cone(wp.vec3(0.0), z, size[0], p)
        s = sample_disk(cone, u[i])
        wi_out[i] = s.wi
        pdf_out[i] = wp.vec2(s.pdf, disk_pdf(cone, s.wi))
    elif kind == SPHERE:
        s = sample_sphere(wp.vec3(0.0), size[0], p, u[i])
        wi_out[i] = s.wi
        pdf_out[i] = wp.vec2(s.pdf, cone_pdf(sphere_one_minus_cos(wp.vec3(0.0), size[0], p)))
        distance_out[i] = s.distance
    else:
        wi_out[i] = sample_cone(wp.normalize(p), size[0], u[i])
        pdf_out[i] = wp.vec2(cone_pdf(size[0]))


def draw(kind: int, p: Any, size: tuple[float, float], u: NDArray, device: str) -> list[Array]:
    initialize_warp()
    out = [wp.zeros(len(u), dtype=dtype, device=device) for dtype in (wp.vec3, wp.vec2, float)]
    wp.launch(
        draw_directions, len(u), [kind, wp.vec3(*p), wp.vec2(*size), upload(u, wp.vec2, device)], out, device=device
    )
    return [array.numpy().astype(np.float64) for array in out]


def drawn(kind: int, p: Any, size: tuple[float, float], device: str, rtol: float = 1e-5) -> list[Array]:
    """Return N directions, their densities, which `sample` and `pdf` agree on, and distances."""
    wi, pdf, distance = draw(kind, p, size, uniforms(N, 2, seed=1), device)
    np.testing.assert_allclose(pdf[:, 0], pdf[:, 1], rtol=rtol)
    return [wi, pdf[:, 0], distance]


# --- Flat lights -----------------------------------------------------------------------------------


def solid_angle(x: Array, y: Array, h: float) -> Array:
    """Return the signed solid angle between the foot of the perpendicular and the corner (x, y), in float64."""
    return np.arctan(x * y / (h * np.sqrt(x * x + y * y + h * h)))


def solid_angle_of_disk(c: float, h: float) -> float:
    """Return the solid angle from height h, at a distance c from the axis, by the chords through the foot there."""
    inside = c < RADIUS
    nodes = (np.arange(100_000) + 0.5) / 50_000.0 - 1.0
    psi = np.pi * nodes if inside else np.arcsin(RADIUS / c) * np.sin(0.5 * np.pi * nodes)
    by_node = np.pi if inside else np.arcsin(RADIUS / c) * 0.5 * np.pi * np.cos(0.5 * np.pi * nodes)
    half = np.sqrt(np.maximum(RADIUS**2 - (c * np.sin(psi)) ** 2, 0.0))
    near, far = (h / np.hypot(h, np.maximum(c * np.cos(psi) + side * half, 0.0)) for side in (-1.0, 1.0))
    return float(2.0 * (by_node * (near - far)).mean())


FLAT = {
    "rectangle above the middle": (0.6, 0.35, 0.8),
    "rectangle, grazing": (4.0, 0.3, 0.15),
    "rectangle behind, below a corner": (-0.1, -0.1, -0.3),
    "rectangle, very near": (0.5, 0.3, 1e-3),
    "rectangle at an edge": (0.6, 1e-4, 0.01),
    "rectangle as small as is still sampled by angle": (0.5, 0.3, 20.0),
    "rectangle far away": (5.0, 2.0, 300.0),
    "disk above the middle": (0.0, 0.0, 0.8),
    "disk behind and aside": (-2.0, 1.0, -0.7),
    "disk, grazing": (3.0, 0.0, 0.05),
    "disk near the rim, inside": (0.75, 0.0, 0.02),
    "disk near the rim, outside": (0.0, 0.85, 0.02),
    "disk far away": (60.0, 20.0, 300.0),
}
QUICK = {"rectangle above the middle", "rectangle, grazing", "disk behind and aside", "disk near the rim, inside"}


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in FLAT]
)
def test_flat_lights(name: str, device: str, report: Report) -> None:
    """In each cell, between quantiles of x and of y, 1 / density sums to its solid angle."""
    p = np.array(FLAT[name])
    h, is_disk = abs(p[2]), "disk" in name
    size = (RADIUS, 0.0) if is_disk else (WIDTH, HEIGHT)
    wi, pdf, _ = drawn(int(DISK if is_disk else RECTANGLE), p, size, device, rtol=1e-4 if is_disk else 1e-5)
    assert pdf.max() < 2.0 * pdf.min()
    place = (p - wi * (p[2] / wi[:, 2])[:, None])[:, :2]
    low, high = ((-RADIUS, -RADIUS), (RADIUS, RADIUS)) if is_disk else ((0.0, 0.0), (WIDTH, HEIGHT))
    slack = 1e-5 * np.linalg.norm(p)
    assert ((place >= np.array(low) - slack) & (place <= np.array(high) + slack)).all()
    place = np.clip(place, low, high)
    edges = [
        np.concatenate([[low[k]], np.quantile(place[:, k], np.linspace(0.0, 1.0, 25)[1:-1]), [high[k]]]) for k in (0, 1)
    ]
    found, squares = (np.histogram2d(*place.T, bins=edges, weights=pdf**-power)[0] for power in (1, 2))
    x, y = np.meshgrid(*edges, indexing="ij")
    omega = np.diff(np.diff(solid_angle(x - p[0], y - p[1], h), axis=0), axis=1)
    total = float(omega.sum())
    some = N * omega * pdf.mean() > 20.0
    if is_disk:
        assert np.hypot(*place.T).max() < RADIUS + slack
        total = solid_angle_of_disk(float(np.hypot(*p[:2])), h)
        on_disk = np.hypot(x, y) < RADIUS
        some &= on_disk[1:, 1:] & on_disk[1:, :-1] & on_disk[:-1, 1:] & on_disk[:-1, :-1]
    else:
        assert some.mean() > 0.9
    error = max(float((1.0 / pdf).std()) / np.sqrt(N), 1e-4 * total)
    report(f"{name}: solid angle", float((1.0 / pdf).mean()), total)
    assert float((1.0 / pdf).mean()) == pytest.approx(total, abs=4.0 * error)

    def chance(omega: Array) -> float:
        return float(stats.chi2.sf(((found - N * omega)[some] ** 2 / squares[some]).sum(), some.sum()))

    report(f"{name}: cells", int(some.sum()), "", p=chance(omega))
    assert chance(omega) > sidak(0.01, TESTS)
    # A density that is 6 % larger on one side would not do.
    assert chance(omega * np.linspace(0.94, 1.06, 24)[:, None]) < 1e-6


# --- Sphere and cone -------------------------------------------------------------------------------

ROUND = {
    "sphere near by": (0.9, 0.3, 0.4),
    "sphere, touching but for a thousandth": (0.0, 0.0, RADIUS * 1.001),
    "sphere far away": (0, 5e3, 2e3),
    "the sun": np.radians(0.265),
    "a wide cone": np.radians(80.0),
}


@pytest.mark.parametrize("name", ROUND)
def test_spheres_and_cones(name: str, device: str, report: Report) -> None:
    """Uniform over the cone: 1 − cos to the axis and the azimuth are."""
    if "sphere" in name:
        p = np.float32(ROUND[name]).astype(np.float64)
        sine = float(np.float32(RADIUS)) / np.linalg.norm(p)
        axis, kind, size = -p / np.linalg.norm(p), SPHERE, (RADIUS, 0.0)
        extent = sine**2 / (1.0 + np.sqrt(1.0 - sine**2))
    else:
        extent = 2.0 * np.sin(0.5 * ROUND[name]) ** 2
        p = axis = np.array([0.48, 0.6, 0.64])
        kind, size = CONE, (extent, 0.0)
    wi, pdf, distance = drawn(int(kind), p, size, device)
    np.testing.assert_allclose(pdf * 2.0 * np.pi * extent, 1.0, rtol=1e-3 if "touching" in name else 1e-5)
    if "sphere" in name:
        error = np.abs(np.linalg.norm(p + wi * distance[:, None], axis=1) - RADIUS).max()
        report(f"{name}: error of the point on the sphere over the distance", float(error / distance.max()), "< 1e-6")
        assert error < 1e-6 * max(distance.max(), RADIUS)
    side = np.cross(axis, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    x, y = wi @ side, wi @ np.cross(axis, side)
    sine2 = x * x + y * y
    height = np.where(wi @ axis > 0.0, sine2 / (1.0 + np.sqrt(np.maximum(1.0 - sine2, 0.0))), 1.0 - wi @ axis) / extent
    bins = np.linspace(0.0, 1.0, 21), np.linspace(-np.pi, np.pi, 33)
    counts, *_ = np.histogram2d(np.clip(height, 0.0, 1.0), np.arctan2(y, x), bins=bins)
    result = chi_square_test(counts, np.full(counts.shape, N / counts.size), tests=TESTS)
    report(name, result.statistic, result.dof, p=result.p)
    assert result.passed, result.message


# --- At the limits ---------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("kind", [int(RECTANGLE), int(DISK), int(SPHERE)])
def test_nothing_is_infinite_or_no_number(kind: int, device: str) -> None:
    """In or near the light's plane, on it, inside the sphere, at all distances: finite, or without a density."""
    rng = np.random.default_rng(4)
    corner = 1.0 - 2.0**-24
    u = np.float32([(a, b) for a in (0.0, 0.25, 0.5, corner) for b in (0.0, 0.5, corner)])
    signs = rng.choice([-1.0, 0.0, 1.0], (200, 3))
    near_the_sphere = rng.normal(size=(18, 3))
    near_the_sphere *= (
        RADIUS * rng.uniform(1.0 - 1e-7, 1.0 + 1e-7, (18, 1)) / np.linalg.norm(near_the_sphere, axis=1)[:, None]
    )
    for size in ((WIDTH, HEIGHT), (1e-4, 1e-6), (1e5, 1e-3)):
        for p in np.concatenate([signs * 10.0 ** rng.uniform(-20.0, 9.0, (200, 3)), signs[:50], near_the_sphere]):
            wi, pdf, distance = draw(kind, p, size, u, device)
            assert all(np.isfinite(array).all() for array in (wi, pdf, distance)), (p, size)
            assert (pdf >= 0.0).all(), p
            some = pdf[:, 0] > 0.0
            np.testing.assert_allclose(np.linalg.norm(wi[some], axis=1), 1.0, atol=1e-5)


def test_nothing_is_sampled_without_a_solid_angle(device: str) -> None:
    u = uniforms(64, 2, seed=5)
    for p in ((0.3, 0.2, 0.0), (7.0, 0.0, 0.0)):
        assert not draw(int(RECTANGLE), p, (WIDTH, HEIGHT), u, device)[1].any()
        assert not draw(int(DISK), p, (RADIUS, 0.0), u, device)[1].any()
    for p, is_outside in (((0.0, 0.0, 0.0), False), ((0.5, 0.5, 0.1), False), ((0.5, 0.5, 0.5), True)):
        assert (draw(int(SPHERE), p, (RADIUS, 0.0), u, device)[1] > 0.0).all() == is_outside
