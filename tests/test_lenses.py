"""Depth of field: openings of every shape, uniform over their area, and blurs of the size of the thin-lens formula."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from support.cameras import camera_rays
from support.kernels import uniforms
from support.statistics import ChiSquareResult, chi_square_test

import wrt

FloatArray = NDArray[np.float64]
N = 2**19
RADIUS = 0.3
FOV = 35.0
FOCUS = 4.0

SHAPES: dict[str, dict[str, object]] = {
    "disk": {},
    "square": {"aperture": "square"},
    "square turned": {"aperture": "square", "aperture_rotation_degrees": 20.0},
    "triangle": {"aperture": "polygon", "aperture_blades": 3},
    "four blades": {"aperture": "polygon", "aperture_blades": 4, "aperture_rotation_degrees": -10.0},
    "pentagon turned": {"aperture": "polygon", "aperture_blades": 5, "aperture_rotation_degrees": 31.0},
    "nonagon": {"aperture": "polygon", "aperture_blades": 9},
}
CORNERS = {
    "disk": 0,
    "square": 4,
    "square turned": 4,
    "triangle": 3,
    "four blades": 4,
    "pentagon turned": 5,
    "nonagon": 9,
}
"""Of each shape; 0 for a disk."""
FIRST_CORNER = {"square": 45.0, "square turned": 65.0, "triangle": 90.0, "four blades": 80.0, "pentagon turned": 121.0,
                "nonagon": 90.0}  # fmt: skip
"""Where a corner lies, degrees from the right, counter-clockwise."""


def camera(shape: str, **changes: object) -> wrt.PerspectiveCamera:
    given = {"fov_degrees": FOV, "aperture_radius": RADIUS, "focus_distance": FOCUS, **SHAPES[shape], **changes}
    return wrt.PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), **given)  # type: ignore[arg-type]


@functools.cache
def lens_points(shape: str, device: str) -> FloatArray:
    """Return points on a lens that looks along -z, so that x is to the right and y up."""
    rays = camera_rays(camera(shape), 8, 8, np.full((N, 2), 4.0), uniforms(N, 2, seed=5), device=device)
    assert np.abs(rays.origins[:, 2]).max() < 1e-6
    return rays.origins[:, :2]


def unfolded(points: FloatArray, corners: int, first: float) -> FloatArray:
    """Return (N, 2) coordinates in [0, 1] that are uniform where points are so over a shape; and its sides in turn.

    In the triangle between the middle and a side, the square of the distance towards the side is uniform, and so is the
    place along the parallel to it.
    """
    angle = np.arctan2(points[:, 1], points[:, 0])
    r = np.hypot(points[:, 0], points[:, 1])
    if corners == 0:
        return np.stack([(r / RADIUS) ** 2, (angle / (2.0 * np.pi)) % 1.0], axis=1)
    step = 2.0 * np.pi / corners
    side = np.floor(((angle - math.radians(first)) % (2.0 * np.pi)) / step)
    off = angle - math.radians(first) - (side + 0.5) * step
    t = r * np.cos(off) / (RADIUS * math.cos(step / 2.0))
    along = 0.5 + 0.5 * np.tan(off) / math.tan(step / 2.0)
    return np.stack([t**2, (side % corners + np.clip(along % 1e9, 0.0, 1.0)) / corners], axis=1)


def uniformity(points: FloatArray, corners: int, first: float, tests: int) -> ChiSquareResult:
    cells = unfolded(points, corners, first)
    bins = 31, 7 * max(corners, 5)
    counts, _, _ = np.histogram2d(cells[:, 0], cells[:, 1], bins=bins, range=[[0, 1 + 1e-6], [0, 1]])
    expected = np.full(bins, N / (bins[0] * bins[1]))
    return chi_square_test(counts.ravel(), expected.ravel(), tests=tests, samples=N)


@pytest.mark.parametrize("shape", SHAPES)
def test_openings_are_uniform_over_their_area(shape: str, device: str, report: Report) -> None:
    points = lens_points(shape, device)
    corners, first = CORNERS[shape], FIRST_CORNER.get(shape, 0.0)
    result = uniformity(points, corners, first, len(SHAPES))
    area = 0.5 * corners * math.sin(2.0 * math.pi / corners) if corners else math.pi
    found = ConvexHull(points).volume / RADIUS**2
    report("area over R²", found, area, p=result.p)
    assert result.passed, result.message
    assert found == pytest.approx(area, rel=2e-3)
    assert np.hypot(*points.T).max() <= RADIUS * (1.0 + 1e-6)
    if corners:
        assert not uniformity(points, corners, first + 2.0, 1).passed
    squeezed = points * np.hypot(*points.T)[:, None] ** 0.05
    assert not uniformity(squeezed / np.hypot(*squeezed.T).max() * RADIUS, corners, first, 1).passed


DEPTHS = (1.5, 6.0, 40.0)
"""Metres along the view: before the plane in focus, a little beyond it, and far."""


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("shape", ["disk", "pentagon turned", "square"])
def test_blurs_have_the_diameter_of_the_formula(shape: str, depth: float, device: str, report: Report) -> None:
    """Where rays of one film point cross the point's plane, as seen from the middle of the lens."""
    chosen = camera(shape, shift_x=0.3, shift_y=-0.1)
    film = np.tile([5.0, 2.5], (2**16, 1))
    rays = camera_rays(chosen, 8, 8, film, uniforms(2**16, 2, seed=6), device=device)
    pinhole = camera_rays(camera(shape, aperture_radius=0.0, shift_x=0.3, shift_y=-0.1), 8, 8, film[:1], device=device)

    def crossings(origins: FloatArray, directions: FloatArray) -> FloatArray:
        t = (-depth - origins[:, 2]) / directions[:, 2]
        return (origins + t[:, None] * directions)[:, :2]

    height = 2.0 * math.tan(math.radians(FOV / 2.0))  # of the picture at distance 1
    blur = (crossings(rays.origins, rays.directions) - crossings(pinhole.origins, pinhole.directions)) / (
        depth * height
    )
    expected = 2.0 * RADIUS * abs(depth - FOCUS) / (depth * height * FOCUS)
    found = 2.0 * np.hypot(*blur.T).max()
    report(f"{shape} at {depth:g} m: diameter, picture heights", found, expected)
    assert found == pytest.approx(expected, rel=0.01)
    # Mean square of the radius over a regular polygon of n corners: R² (2 + cos 2π/n) / 6.
    n = CORNERS[shape]
    mean_square = (2.0 + math.cos(2.0 * math.pi / n)) / 6.0 if n else 0.5
    assert np.mean(blur**2) * 2.0 == pytest.approx(mean_square * (0.5 * expected) ** 2, rel=0.01)


@pytest.mark.parametrize("depth", [3.0, 10.0])
def test_blurs_of_an_orthographic_camera(depth: float, device: str) -> None:
    lens = {"aperture_radius": RADIUS, "focus_distance": FOCUS}
    chosen = wrt.OrthographicCamera((0, 0, 0), (0, 0, -1), view_height=2.0, **lens)
    rays = camera_rays(chosen, 8, 8, np.tile([5.0, 2.0], (2**14, 1)), uniforms(2**14, 2, seed=7), device=device)
    t = (-depth - rays.origins[:, 2]) / rays.directions[:, 2]
    points = (rays.origins + t[:, None] * rays.directions)[:, :2] - [0.25, 0.5]
    expected = RADIUS * abs(depth - FOCUS) / FOCUS
    assert np.hypot(*points.T).max() == pytest.approx(expected, rel=0.01)


def picture_of_a_speck(shape: str, depth: float, device: str, side: float, size: int) -> tuple[FloatArray, int]:
    """Return (H, W) a picture of a small shining square in the middle, and its samples a pixel."""
    scene = wrt.Scene(camera=camera(shape, fov_degrees=14.0))
    speck = wrt.quad((-side / 2, -side / 2, -depth), (side, 0, 0), (0, side, 0))
    scene.add(speck, material=wrt.Diffuse(0.0), emission=1.0)
    renderer = wrt.Renderer(scene, width=size, height=size, device=device, max_depth=1, filter="box", seed=11)
    for _ in renderer.passes(spp=1024):
        pass
    return renderer.image()[..., 0].astype(np.float64), renderer.spp


@pytest.mark.parametrize("depth", [3.0, 4.6, 6.0])
@pytest.mark.parametrize("shape", ["disk", "pentagon turned"])
def test_rendered_blurs_have_that_size(shape: str, depth: float, device: str, report: Report) -> None:
    """By the mean square of the distance from its middle; what the speck and the pixels add is taken off."""
    side, size = 0.08, 64
    image, _ = picture_of_a_speck(shape, depth, device, side, size)
    place = (np.arange(size) + 0.5 - size / 2) / size
    x, y = np.meshgrid(place, -place)
    total = image.sum()
    height = 2.0 * math.tan(math.radians(7.0))
    mean_square = float((image * (x**2 + y**2)).sum() / total)
    mean_square -= (side / (depth * height)) ** 2 / 6.0 + 1.0 / (6.0 * size**2)
    n = CORNERS[shape]
    factor = (2.0 + math.cos(2.0 * math.pi / n)) / 6.0 if n else 0.5
    found = 2.0 * math.sqrt(mean_square / factor)
    expected = 2.0 * RADIUS * abs(depth - FOCUS) / (depth * height * FOCUS)
    report(f"{shape} at {depth:g} m: diameter, picture heights", found, expected)
    assert found == pytest.approx(expected, rel=0.01)
    assert image[[0, -1]].max() == image[:, [0, -1]].max() == 0.0


def test_lights_beyond_the_focus_show_the_opening_upright(device: str) -> None:
    """A triangle with its corner up is wider below its middle; before the plane in focus it is upside down."""
    for depth, sign in ((3.0, -1.0), (6.0, 1.0)):
        image, _ = picture_of_a_speck("triangle", depth, device, 0.08, 32)
        rows = image.sum(axis=1)
        height = 15.5 - np.arange(32)
        assert sign * float((rows * height**3).sum()) > 0.0
