"""Openings of every shape are uniform over their area, and blurs have the size of the thin-lens formula."""

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from support.cameras import camera_rays
from support.kernels import uniforms
from support.statistics import chi_square_test

import wrt

N = 2**19
RADIUS, FOV, FOCUS = 0.3, 35.0, 4.0
# Options, corners (0 for a disk), and where a corner lies in degrees from the right, counter-clockwise.
SHAPES = {
    "disk": ({}, 0, 0.0),
    "square": ({"aperture": "square", "aperture_rotation_degrees": 20.0}, 4, 65.0),
    "triangle": ({"aperture": "polygon", "aperture_blades": 3}, 3, 90.0),
    "pentagon": ({"aperture": "polygon", "aperture_blades": 5, "aperture_rotation_degrees": 31.0}, 5, 121.0),
    "nonagon": ({"aperture": "polygon", "aperture_blades": 9}, 9, 90.0),
}


def camera(shape, **changes):
    options = {"fov_degrees": FOV, "aperture_radius": RADIUS, "focus_distance": FOCUS, **SHAPES[shape][0], **changes}
    return wrt.PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), **options)


def unfolded(points, corners, first):
    """Return (N, 2) coordinates in [0, 1] that are uniform where points are so over a shape, side by side.

    In the triangle between the middle and a side, the square of the distance towards the side is uniform, and so is the
    place along the parallel to it.
    """
    angle, r = np.arctan2(points[:, 1], points[:, 0]), np.hypot(*points.T)
    if corners == 0:
        return np.stack([(r / RADIUS) ** 2, (angle / (2.0 * np.pi)) % 1.0], axis=1)
    step = 2.0 * np.pi / corners
    side = np.floor(((angle - math.radians(first)) % (2.0 * np.pi)) / step)
    off = angle - math.radians(first) - (side + 0.5) * step
    t = r * np.cos(off) / (RADIUS * math.cos(step / 2.0))
    along = 0.5 + 0.5 * np.tan(off) / math.tan(step / 2.0)
    return np.stack([t**2, (side % corners + np.clip(along % 1e9, 0.0, 1.0)) / corners], axis=1)


def uniformity(points, corners, first, tests):
    bins = 31, 7 * max(corners, 5)
    counts, _, _ = np.histogram2d(*unfolded(points, corners, first).T, bins=bins, range=[[0, 1 + 1e-6], [0, 1]])
    return chi_square_test(counts, np.full(bins, N / (bins[0] * bins[1])), tests=tests, samples=N)


@pytest.mark.parametrize("shape", SHAPES)
def test_openings_are_uniform_over_their_area(shape, device, report):
    _, corners, first = SHAPES[shape]
    rays = camera_rays(camera(shape), 8, 8, np.full((N, 2), 4.0), uniforms(N, 2, seed=5), device=device)
    assert np.abs(rays.origins[:, 2]).max() < 1e-6
    points = rays.origins[:, :2]
    result = uniformity(points, corners, first, len(SHAPES))
    area = 0.5 * corners * math.sin(2.0 * math.pi / corners) if corners else math.pi
    found = ConvexHull(points).volume / RADIUS**2
    report("area over R²", found, area, p=result.p)
    assert result.passed, result.message
    assert found == pytest.approx(area, rel=2e-3)
    assert np.hypot(*points.T).max() <= RADIUS * (1.0 + 1e-6)
    if corners:
        assert not uniformity(points, corners, first + 2.0, 1).passed


def diameter(depth):
    """Return the blur at a depth by the thin-lens formula, in picture heights, and a picture's height there."""
    height = 2.0 * math.tan(math.radians(FOV / 2.0)) * depth
    return 2.0 * RADIUS * abs(depth - FOCUS) / (height * FOCUS), height


def crossings(rays, depth):
    """Return where rays cross the plane at a depth."""
    return (rays.origins + (-depth - rays.origins[:, 2:]) / rays.directions[:, 2:] * rays.directions)[:, :2]


@pytest.mark.parametrize("depth", [1.5, 40.0])
@pytest.mark.parametrize("shape", ["disk", "pentagon", "square"])
def test_blurs_have_the_diameter_of_the_formula(shape, depth, device, report):
    """Where rays of one film point cross the point's plane, as seen from the middle of the lens."""
    shift = {"shift_x": 0.3, "shift_y": -0.1}
    film = np.tile([5.0, 2.5], (2**16, 1))
    expected, height = diameter(depth)
    rays = camera_rays(camera(shape, **shift), 8, 8, film, uniforms(2**16, 2, seed=6), device=device)
    pinhole = camera_rays(camera(shape, aperture_radius=0.0, **shift), 8, 8, film[:1], device=device)
    blur = (crossings(rays, depth) - crossings(pinhole, depth)) / height
    found = 2.0 * np.hypot(*blur.T).max()
    report(f"{shape} at {depth:g} m: diameter, picture heights", found, expected)
    assert found == pytest.approx(expected, rel=0.01)
    # The mean square of the radius over a regular polygon, or a disk, of radius 1.
    corners = SHAPES[shape][1]
    mean_square = (2.0 + math.cos(2.0 * math.pi / corners)) / 6.0 if corners else 0.5
    assert np.mean(blur**2) * 2.0 == pytest.approx(mean_square * (0.5 * expected) ** 2, rel=0.01)


@pytest.mark.parametrize("depth", [3.0, 10.0])
def test_blurs_of_an_orthographic_camera(depth, device):
    lens = {"aperture_radius": RADIUS, "focus_distance": FOCUS}
    chosen = wrt.OrthographicCamera((0, 0, 0), (0, 0, -1), view_height=2.0, **lens)
    rays = camera_rays(chosen, 8, 8, np.tile([5.0, 2.0], (2**14, 1)), uniforms(2**14, 2, seed=7), device=device)
    blur = crossings(rays, depth) - [0.25, 0.5]
    assert np.hypot(*blur.T).max() == pytest.approx(RADIUS * abs(depth - FOCUS) / FOCUS, rel=0.01)
