"""Each camera's rays are those of its formula; what they stand for on the film; what a camera cannot be."""

import dataclasses
import math

import numpy as np
import pytest
from support.cameras import camera_rays
from support.small_scenes import image_of

import wrt

WIDTH, HEIGHT = 48, 30
POSE = {"origin": (1.0, -2.0, 0.5), "target": (-1.5, 0.5, 2.0), "up": (0.2, 1.0, -0.4)}
CORNERS = [(0, 0), (WIDTH, 0), (0, HEIGHT), (WIDTH, HEIGHT), (WIDTH / 2, HEIGHT / 2)]
FILM = np.concatenate([CORNERS, np.random.default_rng(1).random((500, 2)) * [WIDTH, HEIGHT]])
"""Corners and middle of the picture, and random points."""
ORIGIN = np.array(POSE["origin"])
FORWARD = (np.array(POSE["target"]) - ORIGIN) / np.linalg.norm(np.array(POSE["target"]) - ORIGIN)
RIGHT = np.cross(FORWARD, POSE["up"]) / np.linalg.norm(np.cross(FORWARD, POSE["up"]))
UP = np.cross(RIGHT, FORWARD)
X, Y = FILM[:, :1] - WIDTH / 2, HEIGHT / 2 - FILM[:, 1:]
"""Pixels to the right of the middle, and above it."""
S = 2.0 * math.tan(math.radians(25.0))
PLANE = FORWARD + S * (X / HEIGHT + 0.25) * RIGHT + S * (Y / HEIGHT - 0.5) * UP
LONGITUDE, LATITUDE = np.radians(280.0) * X / WIDTH, np.radians(150.0) * Y / HEIGHT
LEVEL = np.cos(LONGITUDE) * FORWARD + np.sin(LONGITUDE) * RIGHT
RHO = np.hypot(X, Y)
THETA = np.radians(220.0) * RHO / HEIGHT
# The camera, a change that must be noticed, and the origins and directions of its formula.
CAMERAS = {
    # Shifted by a quarter of a picture height to the right and half of one down.
    "perspective": (
        wrt.PerspectiveCamera(**POSE, fov_degrees=50.0, shift_x=0.25, shift_y=-0.5),
        {"shift_x": 0.251},
        (ORIGIN, PLANE / np.linalg.norm(PLANE, axis=1, keepdims=True)),
    ),
    "wide pixels": (
        wrt.PerspectiveCamera(**POSE, fov_degrees=50.0, pixel_aspect=1.5),
        {"pixel_aspect": 1.505},
        (
            ORIGIN,
            (OF_WIDE := FORWARD + S / HEIGHT * (1.5 * X * RIGHT + Y * UP)) / np.linalg.norm(OF_WIDE, axis=1)[:, None],
        ),
    ),
    "orthographic": (
        wrt.OrthographicCamera(**POSE, view_height=3.0),
        {"view_height": 3.01},
        (ORIGIN + 3.0 / HEIGHT * (X * RIGHT + Y * UP), FORWARD),
    ),
    "panorama": (
        wrt.PanoramaCamera(**POSE, horizontal_degrees=280.0, vertical_degrees=150.0),
        {"vertical_degrees": 150.5},
        (ORIGIN, np.cos(LATITUDE) * LEVEL + np.sin(LATITUDE) * UP),
    ),
    # 220 degrees across the circle, which is as high as the picture.
    "fisheye": (
        wrt.FisheyeCamera(**POSE, fov_degrees=220.0),
        {"fov_degrees": 220.5},
        (ORIGIN, np.cos(THETA) * FORWARD + np.sin(THETA) * (X * RIGHT + Y * UP) / np.maximum(RHO, 1e-30)),
    ),
}
LENSES = {
    "barrel": wrt.PerspectiveCamera(**POSE, fov_degrees=50.0, distortion=(-0.3, 0.1)),
    "pincushion": wrt.PerspectiveCamera(**POSE, fov_degrees=50.0, distortion=(0.3, 0.1, 0.001, 0.002)),
    "bent fisheye": wrt.FisheyeCamera(**POSE, fov_degrees=160.0, distortion=(-0.05, 0.01), circular=False, shift_x=0.1),
}
"""Cameras whose rays tests/camera/test_camera_matrices.py checks."""


@pytest.mark.parametrize("name", CAMERAS)
def test_rays_are_those_of_the_formula(name, device):
    camera, change, (origins, directions) = CAMERAS[name]

    def error(camera):
        rays = camera_rays(camera, WIDTH, HEIGHT, FILM, device=device)
        np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1.0, atol=2e-7)
        return max(np.abs(rays.origins - origins).max(), np.abs(rays.directions - directions).max())

    assert error(camera) < 2e-6
    assert error(dataclasses.replace(camera, **change)) > 5e-4


@pytest.mark.parametrize("name", [*CAMERAS, *LENSES])
def test_a_pixel_is_as_wide_as_its_rays_are_apart(name, device):
    """Its narrower side is the smaller singular value of how points at a distance move with the film."""
    camera, distance, step = LENSES[name] if name in LENSES else CAMERAS[name][0], 7.0, 0.25
    rays = camera_rays(camera, WIDTH, HEIGHT, FILM, device=device)

    def point(*offset):
        moved = camera_rays(camera, WIDTH, HEIGHT, FILM + offset, device=device)
        return moved.origins + distance * moved.directions

    jacobian = np.stack([point(step, 0) - point(-step, 0), point(0, step) - point(0, -step)], axis=2) / (2.0 * step)
    expected = np.linalg.svd(jacobian, compute_uv=False)[:, 1]
    found = rays.footprints[:, 0] + distance * rays.footprints[:, 1]
    far = np.hypot(X, Y)[:, 0] > 1.0  # differences are coarse in the middle of a fisheye
    if name == "wide pixels":  # the width off the axis is that of square pixels, which are smaller
        expected = np.clip(found, expected / 1.5, expected)
    np.testing.assert_allclose(found[far], expected[far], rtol=0.02, atol=1e-4)
    assert (rays.footprints >= 0.0).all()


def test_a_fisheye_sees_its_circle_which_touches_the_shorter_sides(device):
    for width, height in ((WIDTH, HEIGHT), (HEIGHT, WIDTH)):
        points = FILM * [width / WIDTH, height / HEIGHT]
        rays = camera_rays(CAMERAS["fisheye"][0], width, height, points, device=device)
        inside = np.hypot(points[:, 0] - width / 2, points[:, 1] - height / 2) / (min(width, height) / 2)
        np.testing.assert_array_equal(rays.visible[inside < 0.9999], True)
        np.testing.assert_array_equal(rays.visible[inside > 1.0001], False)
    scene = sky_scene(np.ones((1, 1, 3)), wrt.FisheyeCamera(fov_degrees=180.0))
    image = wrt.render(scene, width=200, height=100, spp=16, device=device)[..., 0]
    assert image[50, 100] == 1.0
    assert image[:, :48].max() == 0.0  # the picture is black outside
    assert float(image.sum()) == pytest.approx(math.pi * 50.0**2, rel=2e-3)


def sky_scene(pixels, camera):
    scene = wrt.Scene(camera=camera, environment=wrt.ImageEnvironment(pixels))
    scene.add(wrt.box((90, 90, 90), (91, 91, 91)))
    return scene


def test_a_panorama_is_laid_out_as_an_environment_image(device):
    pixels = np.random.default_rng(3).random((8, 16, 3)).astype(np.float32)
    scene = sky_scene(pixels, wrt.PanoramaCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0)))
    image = image_of(wrt.Renderer(scene, width=16 * 17, height=8 * 17, device=device, filter="box"), 16)
    middles = image[8::17, 8::17]  # texels are interpolated, and so themselves only in their middles
    np.testing.assert_allclose(middles, pixels, atol=0.03)
