"""Rectangles, disks and spheres are sampled by the densities that are stated, wherever they are seen from."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.kernels import map_function, uniforms, upload
from support.statistics import chi_square_test

from wrt.backend.warp_backend import initialize_warp
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
WRONG = 1.06
"""By how much the partner of each test is off that must be seen to fail."""

RECTANGLE = wp.constant(0)
DISK = wp.constant(1)
SPHERE = wp.constant(2)
CONE = wp.constant(3)

# Of all kinds: in the plane z = 0 around or from the origin, the normal +z, sizes below.
WIDTH, HEIGHT, RADIUS = 1.2, 0.7, wp.constant(0.8)


@wp.kernel(enable_backward=False)
def draw_ways(
    kind: int,
    p: wp.vec3,
    size: wp.vec2,
    u: wp.array(dtype=wp.vec2),
    wi_out: wp.array(dtype=wp.vec3),
    pdf_out: wp.array(dtype=wp.vec2),
    distance_out: wp.array(dtype=float),
):
    """Write ways, their densities as sampled and as asked for, and their lengths."""
    i = wp.tid()
    x = wp.vec3(1.0, 0.0, 0.0)
    y = wp.vec3(0.0, 1.0, 0.0)
    z = wp.vec3(0.0, 0.0, 1.0)
    if kind == RECTANGLE:
        r = rectangle_from(wp.vec3(0.0), x, y, size, p)
        xy = sample_rectangle(r, u[i])
        way = wp.vec3(xy[0], xy[1], -p[2])
        distance_out[i] = wp.length(way)
        wi_out[i] = way / wp.max(wp.length(way), 1.0e-30)
        pdf_out[i] = wp.vec2(rectangle_pdf(r, wp.length(way)))
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


@wp.func
def disk_density(p: wp.vec3, wi: wp.vec3) -> float:
    return disk_pdf(disk_cone(wp.vec3(0.0), wp.vec3(0.0, 0.0, 1.0), RADIUS, p), wi)


def draw(kind: int, p: Any, size: tuple[float, float], u: NDArray, device: str) -> list[Array]:
    initialize_warp()
    out = [wp.zeros(len(u), dtype=dtype, device=device) for dtype in (wp.vec3, wp.vec2, float)]
    wp.launch(draw_ways, len(u), [kind, wp.vec3(*p), wp.vec2(*size), upload(u, wp.vec2, device)], out, device=device)
    return [array.numpy().astype(np.float64) for array in out]


def drawn(kind: int, p: Any, size: tuple[float, float], seed: int, device: str, rtol: float = 1e-5) -> list[Array]:
    """Return N ways, their densities, which are those that are asked for, and their lengths."""
    wi, (pdf, asked), distance = (array.T for array in draw(kind, p, size, uniforms(N, 2, seed=seed), device))
    np.testing.assert_allclose(pdf, asked, rtol=rtol)
    return [wi.T, pdf, distance]


def check(name: str, counts: Array, expected: Array, report: Report) -> None:
    """Hold counts against a density, and see that one which is a little larger on one side would not do."""
    assert expected.sum() == pytest.approx(N, rel=2e-4)
    result = chi_square_test(counts.ravel(), expected.ravel(), tests=20)
    report(name, result.statistic, result.dof, p=result.p)
    assert result.passed, result.message
    tilted = expected * np.linspace(2.0 - WRONG, WRONG, len(expected))[:, None]
    assert not chi_square_test(counts.ravel(), tilted.ravel() * (N / tilted.sum()), tests=20).passed


def cross_section(names: Iterable[str]) -> list[Any]:
    """Return the names, the first three of which are quick."""
    return [name if k < 3 else pytest.param(name, marks=pytest.mark.slow) for k, name in enumerate(names)]


# --- Rectangle -------------------------------------------------------------------------------------


def solid_angle(x: Array, y: Array, h: float) -> Array:
    """Return the signed solid angle between the foot of the perpendicular and the corner (x, y), in float64."""
    return np.arctan(x * y / (h * np.sqrt(x * x + y * y + h * h)))


RECTANGLES = {
    "above the middle": (0.6, 0.35, 0.8),
    "grazing": (4.0, 0.3, 0.15),
    "behind, below a corner": (-0.1, -0.1, -0.3),
    "very near": (0.5, 0.3, 1e-3),
    "at an edge": (0.6, 1e-4, 0.01),
    "as small as is still sampled by angle": (0.5, 0.3, 20.0),
    "far": (5.0, 2.0, 300.0),
}


@pytest.mark.parametrize("name", cross_section(RECTANGLES))
def test_rectangle(name: str, device: str, report: Report) -> None:
    p = np.array(RECTANGLES[name])
    h = abs(p[2])
    wi, pdf, distance = drawn(RECTANGLE, p, (WIDTH, HEIGHT), 1, device)
    way = wi * (-p[2] / wi[:, 2])[:, None]
    # Bins between quantiles of x and y: wherever the light's solid angle is, there they are.
    edges = []
    for axis, size in ((0, WIDTH), (1, HEIGHT)):
        low = -p[axis]
        inner = np.quantile(way[:, axis], np.linspace(0.0, 1.0, 25)[1:-1])
        edges.append(np.concatenate([[low], inner, [low + size]]))
    counts, *_ = np.histogram2d(np.clip(way[:, 0], edges[0][0], edges[0][-1]), way[:, 1], bins=edges)
    x, y = np.meshgrid(*edges, indexing="ij")
    omega = np.diff(np.diff(solid_angle(x, y, h), axis=0), axis=1)
    total = omega.sum()
    if total > 2e-3:
        assert np.ptp(pdf) == 0.0
        assert pdf[0] * total == pytest.approx(1.0, rel=2e-4)
        report(f"{name}: density times solid angle", float(pdf[0] * total), 1.0)
        expected = N * omega * pdf[0]
    else:
        area = np.diff(edges[0])[:, None] * np.diff(edges[1])
        np.testing.assert_allclose(pdf, distance**3 / (h * WIDTH * HEIGHT), rtol=1e-5)
        expected = N * area / (WIDTH * HEIGHT)
    check(name, counts, expected, report)


# --- Disk ------------------------------------------------------------------------------------------


DISKS = {
    "above the middle": (0.0, 0.0, 0.8),
    "aside": (2.0, 1.0, 1.5),
    "behind and aside": (-2.0, 1.0, -0.7),
    "grazing": (3.0, 0.0, 0.05),
    "near the rim, inside": (0.75, 0.0, 0.02),
    "near the rim, outside": (0.0, 0.85, 0.02),
    "far": (60.0, 20.0, 300.0),
}


def disk_chords(psi: Array, c: float) -> tuple[Array, Array]:
    """Return where a line in the plane, from a foot at distance c from the centre, enters and leaves the disk."""
    middle = c * np.cos(psi)
    half = np.sqrt(np.maximum(RADIUS**2 - (c * np.sin(psi)) ** 2, 0.0))
    return np.maximum(middle - half, 0.0), middle + half


@pytest.mark.parametrize("name", cross_section(DISKS))
def test_disk(name: str, device: str, report: Report) -> None:
    """Bins are in polar coordinates about the foot of the perpendicular, where solid angle is sin t dt dψ."""
    p = np.array(DISKS[name])
    h, c = abs(p[2]), float(np.hypot(p[0], p[1]))
    wi, pdf, _ = drawn(DISK, p, (RADIUS, 0.0), 2, device, rtol=1e-4)
    assert pdf.max() / pdf.min() < 2.0
    report(f"{name}: largest density over smallest", float(pdf.max() / pdf.min()), "< 2")

    inside = c < RADIUS
    reach = np.pi if inside else np.arcsin(RADIUS / c)
    toward = np.array([-p[0], -p[1]]) / c if c > 0.0 else np.array([1.0, 0.0])
    across = np.array([-toward[1], toward[0]])
    plane = wi[:, :2] / np.abs(wi[:, 2:])
    psi = np.arctan2(plane @ across, plane @ toward)
    near, far = (np.arctan2(r, h) for r in disk_chords(psi, c))
    t = np.arctan(np.hypot(plane[:, 0], plane[:, 1]))
    s = psi / reach if inside else 2.0 / np.pi * np.arcsin(np.clip(psi / reach, -1.0, 1.0))
    outside = (t < near - 1e-4) | (t > far + 1e-4)
    assert outside.mean() < 1e-4
    bins = np.linspace(-1.0, 1.0, 33), np.linspace(0.0, 1.0, 17)
    share = np.clip((t - near) / np.maximum(far - near, 1e-12), 0.0, 1.0)
    counts, *_ = np.histogram2d(s, share, bins=bins)

    nodes, weights = np.polynomial.legendre.leggauss(6)
    along = 0.5 * (bins[0][:-1, None] + bins[0][1:, None] + np.diff(bins[0])[:, None] * nodes)
    deep = 0.5 * (bins[1][:-1, None] + bins[1][1:, None] + np.diff(bins[1])[:, None] * nodes)
    s, share = np.meshgrid(along.ravel(), deep.ravel(), indexing="ij")
    psi = reach * (s if inside else np.sin(0.5 * np.pi * s))
    jacobian = reach * (1.0 if inside else 0.5 * np.pi * np.cos(0.5 * np.pi * s))
    near, far = (np.arctan2(r, h) for r in disk_chords(psi, c))
    t = near + share * (far - near)
    d = np.stack([np.sin(t) * np.cos(psi), np.sin(t) * np.sin(psi), np.cos(t)], axis=-1).reshape(-1, 3)
    world = d[:, :1] * [*toward, 0.0] + d[:, 1:2] * [*across, 0.0] + d[:, 2:] * [0.0, 0.0, -np.sign(p[2])]
    asked = map_function(disk_density, np.tile(p, (len(world), 1)), world, device=device).reshape(t.shape)
    mass = (asked * np.sin(t) * (far - near) * jacobian).reshape(len(counts), 6, counts.shape[1], 6)
    cells = np.diff(bins[0])[:, None] * np.diff(bins[1]) * 0.25
    expected = N * np.einsum("aibj,i,j->ab", mass, weights, weights) * cells
    check(name, counts, expected, report)


# --- Sphere and cone -------------------------------------------------------------------------------

SPHERES = {"near": (0.9, 0.3, 0.4), "touching, but for a thousandth": (0.0, 0.0, RADIUS * 1.001), "far": (0, 5e3, 2e3)}
CONES = {"the sun": np.radians(0.265), "a wide cone": np.radians(80.0)}


@pytest.mark.parametrize("name", cross_section([*SPHERES, *CONES]))
def test_sphere_and_cone(name: str, device: str, report: Report) -> None:
    """Uniform over the cone: 1 − cos to the axis and the azimuth are."""
    if name in SPHERES:
        p = np.float32(SPHERES[name]).astype(np.float64)
        sine = float(np.float32(RADIUS)) / np.linalg.norm(p)
        axis, kind, size = -p / np.linalg.norm(p), SPHERE, (RADIUS, 0.0)
        whole = sine**2 / (1.0 + np.sqrt(1.0 - sine**2))
    else:
        whole = 2.0 * np.sin(0.5 * CONES[name]) ** 2
        axis, kind, size = np.array([0.48, 0.6, 0.64]), CONE, (whole, 0.0)
        p = axis
    wi, pdf, distance = drawn(kind, p, size, 3, device)
    np.testing.assert_allclose(pdf * 2.0 * np.pi * whole, 1.0, rtol=1e-3 if "touching" in name else 1e-5)
    if name in SPHERES:
        met = p + wi * distance[:, None]
        error = np.abs(np.linalg.norm(met, axis=1) - RADIUS).max()
        report(f"{name}: error of the point on the sphere over the way", float(error / distance.max()), "< 1e-6")
        assert error < 1e-6 * max(distance.max(), RADIUS)
    side = np.cross(axis, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    x, y = wi @ side, wi @ np.cross(axis, side)
    sine2 = x * x + y * y
    height = np.where(wi @ axis > 0.0, sine2 / (1.0 + np.sqrt(np.maximum(1.0 - sine2, 0.0))), 1.0 - wi @ axis) / whole
    bins = np.linspace(0.0, 1.0, 21), np.linspace(-np.pi, np.pi, 33)
    counts, *_ = np.histogram2d(np.clip(height, 0.0, 1.0), np.arctan2(y, x), bins=bins)
    check(name, counts, np.full(counts.shape, N / counts.size), report)


# --- At the limits ---------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("kind", [int(RECTANGLE), int(DISK), int(SPHERE)])
def test_nothing_is_infinite_or_no_number(kind: int, device: str) -> None:
    """In the light's plane, on it, inside the sphere, nearly so, and at all distances: finite, or no density at all."""
    rng = np.random.default_rng(4)
    corner = 1.0 - 2.0**-24
    u = np.float32([(a, b) for a in (0.0, 0.25, 0.5, corner) for b in (0.0, 0.5, corner)])
    places = [(0, 0, 0), (0.1, 0.1, 0), (5, 1, 0), (RADIUS, 0, 0), (0.1, 0.2, 0.3), (0, 0, 1e-30), (0.3, 0.3, -1e-9)]
    places += [tuple(10.0 ** rng.uniform(-9, 9) * v for v in rng.normal(size=3)) for _ in range(100)]
    places += [(x, y, z) for x in (0.1, 2.0) for y in (0.1, -3.0) for z in 10.0 ** np.arange(-20.0, 0.0, 2.0)]
    ways = rng.normal(size=(9, 3))
    places += [tuple(v / np.linalg.norm(v) * RADIUS * (1.0 + e)) for v in ways for e in (-1e-7, 1e-7)]
    for size in ((WIDTH, HEIGHT), (1e-4, 1e-6), (1e5, 1e-3)):
        for p in places:
            wi, pdf, distance = draw(kind, p, size, u, device)
            assert np.isfinite(wi).all(), p
            assert np.isfinite(distance).all(), p
            assert np.isfinite(pdf).all(), (p, size)
            assert (pdf >= 0.0).all(), p
            some = pdf[:, 0] > 0.0
            np.testing.assert_allclose(np.linalg.norm(wi[some], axis=1), 1.0, atol=1e-5)


def test_there_is_no_way_to_what_has_no_solid_angle(device: str) -> None:
    u = uniforms(64, 2, seed=5)
    for p in ((0.3, 0.2, 0.0), (7.0, 0.0, 0.0)):
        assert not draw(RECTANGLE, p, (WIDTH, HEIGHT), u, device)[1].any()
        assert not draw(DISK, p, (RADIUS, 0.0), u, device)[1].any()
    for p in ((0.0, 0.0, 0.0), (0.5, 0.5, 0.1)):
        assert not draw(SPHERE, p, (RADIUS, 0.0), u, device)[1].any()
    assert draw(SPHERE, (0.5, 0.5, 0.5), (RADIUS, 0.0), u, device)[1].all()
