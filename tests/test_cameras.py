"""Each camera's rays are those of its formula; what they stand for on the film; crop windows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.cameras import camera_rays

import wrt
from wrt.scene.scene import SAMPLERS

FloatArray = NDArray[np.float64]
WIDTH, HEIGHT = 48, 30
POSE = {"origin": (1.0, -2.0, 0.5), "target": (-1.5, 0.5, 2.0), "up": (0.2, 1.0, -0.4)}


def axes() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return right, up and forward of POSE."""
    origin, target, up = (np.array(POSE[name]) for name in ("origin", "target", "up"))
    forward = (target - origin) / np.linalg.norm(target - origin)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


def films(n: int = 500) -> FloatArray:
    """Return random points of the picture, its corners and its middle."""
    corners = [(0, 0), (WIDTH, 0), (0, HEIGHT), (WIDTH, HEIGHT), (WIDTH / 2, HEIGHT / 2)]
    return np.concatenate([corners, np.random.default_rng(1).random((n, 2)) * [WIDTH, HEIGHT]])


Rays = tuple[FloatArray, FloatArray]


def perspective(film: FloatArray) -> Rays:
    """A field of 50 degrees, shifted by a quarter of a picture height to the right and half of one down."""
    right, up, forward = axes()
    s = 2.0 * math.tan(math.radians(25.0))
    x = s * ((film[:, 0] - WIDTH / 2) / HEIGHT + 0.25)
    y = s * ((HEIGHT / 2 - film[:, 1]) / HEIGHT - 0.5)
    through = forward + x[:, None] * right + y[:, None] * up
    return np.broadcast_to(POSE["origin"], through.shape), through / np.linalg.norm(through, axis=1, keepdims=True)


def orthographic(film: FloatArray) -> Rays:
    """Three metres high."""
    right, up, forward = axes()
    x, y = 3.0 / HEIGHT * (film[:, 0] - WIDTH / 2), 3.0 / HEIGHT * (HEIGHT / 2 - film[:, 1])
    origins = np.array(POSE["origin"]) + x[:, None] * right + y[:, None] * up
    return origins, np.broadcast_to(forward, origins.shape)


def panorama(film: FloatArray) -> Rays:
    """280 degrees wide and 150 high."""
    right, up, forward = axes()
    longitude = np.radians(280.0) * (film[:, 0] / WIDTH - 0.5)[:, None]
    latitude = np.radians(150.0) * (0.5 - film[:, 1] / HEIGHT)[:, None]
    level = np.cos(longitude) * forward + np.sin(longitude) * right
    directions = np.cos(latitude) * level + np.sin(latitude) * up
    return np.broadcast_to(POSE["origin"], directions.shape), directions


def fisheye(film: FloatArray) -> Rays:
    """220 degrees across the circle, which is as high as the picture."""
    right, up, forward = axes()
    a, b = film[:, 0] - WIDTH / 2, HEIGHT / 2 - film[:, 1]
    rho = np.hypot(a, b)
    theta = np.radians(220.0) * rho / HEIGHT
    unit = np.stack([a, b], axis=1) / np.maximum(rho, 1e-30)[:, None]
    across = unit[:, :1] * right + unit[:, 1:] * up
    directions = np.cos(theta)[:, None] * forward + np.sin(theta)[:, None] * across
    return np.broadcast_to(POSE["origin"], directions.shape), directions


CAMERAS: dict[str, tuple[wrt.Camera, Callable[[FloatArray], Rays]]] = {
    "perspective": (wrt.PerspectiveCamera(**POSE, fov_degrees=50.0, shift_x=0.25, shift_y=-0.5), perspective),
    "orthographic": (wrt.OrthographicCamera(**POSE, view_height=3.0), orthographic),
    "panorama": (wrt.PanoramaCamera(**POSE, horizontal_degrees=280.0, vertical_degrees=150.0), panorama),
    "fisheye": (wrt.FisheyeCamera(**POSE, fov_degrees=220.0), fisheye),
}
OFF = {
    "perspective": {"shift_x": 0.251},
    "orthographic": {"view_height": 3.01},
    "panorama": {"vertical_degrees": 150.5},
    "fisheye": {"fov_degrees": 220.5},
}


@pytest.mark.parametrize("name", CAMERAS)
def test_rays_are_those_of_the_formula(name: str, device: str) -> None:
    camera, formula = CAMERAS[name]
    origins, directions = formula(films())

    def error(camera: wrt.Camera) -> float:
        rays = camera_rays(camera, WIDTH, HEIGHT, films(), device=device)
        np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1.0, atol=2e-7)
        return float(max(np.abs(rays.origins - origins).max(), np.abs(rays.directions - directions).max()))

    assert error(camera) < 2e-6
    assert error(dataclasses.replace(camera, **OFF[name])) > 5e-4


def test_a_fisheye_sees_its_circle(device: str) -> None:
    """It touches the shorter sides; the picture is black outside."""
    film = films()
    for width, height in ((WIDTH, HEIGHT), (HEIGHT, WIDTH)):
        points = film * [width / WIDTH, height / HEIGHT]
        rays = camera_rays(CAMERAS["fisheye"][0], width, height, points, device=device)
        inside = np.hypot(points[:, 0] - width / 2, points[:, 1] - height / 2) / (min(width, height) / 2)
        np.testing.assert_array_equal(rays.visible[inside < 0.9999], True)
        np.testing.assert_array_equal(rays.visible[inside > 1.0001], False)
    scene = wrt.Scene(camera=wrt.FisheyeCamera(fov_degrees=180.0), environment=wrt.ImageEnvironment(np.ones((1, 1, 3))))
    scene.add(wrt.box((90, 90, 90), (91, 91, 91)))
    image = wrt.render(scene, width=200, height=100, spp=16, device=device)[..., 0]
    assert image[50, 100] == 1.0
    assert image[:, :48].max() == 0.0
    assert float(image.sum()) == pytest.approx(math.pi * 50.0**2, rel=2e-3)


def test_shifted_lenses_keep_upright_lines_parallel(device: str) -> None:
    """All rays of a column lie in one upright plane; half a height up, the bottom edge lies on the horizon."""
    column = np.stack(np.meshgrid(np.linspace(0, WIDTH, 9), np.linspace(0, HEIGHT, 7), indexing="ij"), axis=-1)

    def azimuth(camera: wrt.Camera) -> tuple[FloatArray, FloatArray]:
        directions = camera_rays(camera, WIDTH, HEIGHT, column, device=device).directions.reshape(9, 7, 3)
        return np.arctan2(directions[..., 0], -directions[..., 2]), directions[..., 1]

    level = wrt.PerspectiveCamera((0, 0, 3), (0, 0, 0), shift_y=0.5, shift_x=0.2)
    angles, heights = azimuth(level)
    np.testing.assert_allclose(angles, angles[:, :1].repeat(7, axis=1), atol=1e-6)
    np.testing.assert_allclose(heights[:, -1], 0.0, atol=1e-7)
    tilted, _ = azimuth(wrt.PerspectiveCamera((0, 0, 3), (0, 1.09, 0)))
    assert np.ptp(tilted[0]) > 0.05


@pytest.mark.parametrize("name", CAMERAS)
def test_a_pixel_is_as_wide_as_its_rays_are_apart(name: str, device: str) -> None:
    """Its narrower side, as the smaller singular value of how points at a distance move with the film."""
    camera = CAMERAS[name][0]
    film = films()
    rays = camera_rays(camera, WIDTH, HEIGHT, film, device=device)
    distance, step = 7.0, 0.25

    def point(offset: tuple[float, float]) -> FloatArray:
        moved = camera_rays(camera, WIDTH, HEIGHT, film + offset, device=device)
        return moved.origins + distance * moved.directions

    jacobian = np.stack([(point(o) - point((-o[0], -o[1]))) / (2.0 * step) for o in ((step, 0.0), (0.0, step))], axis=2)
    expected = np.linalg.svd(jacobian, compute_uv=False)[:, 1]
    found = rays.footprints[:, 0] + distance * rays.footprints[:, 1]
    far = np.linalg.norm(film - [WIDTH / 2, HEIGHT / 2], axis=1) > 1.0  # of a fisheye differences are coarse there
    np.testing.assert_allclose(found[far], expected[far], rtol=0.02, atol=1e-4)
    assert (rays.footprints >= 0.0).all()


def test_a_panorama_is_laid_out_as_an_environment_image(device: str) -> None:
    pixels = np.random.default_rng(3).random((8, 16, 3)).astype(np.float32)
    scene = wrt.Scene(environment=wrt.ImageEnvironment(pixels))
    scene.camera = wrt.PanoramaCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    scene.add(wrt.sphere((50.0, 50.0, 0.0), 1e-3, subdivisions=0))
    renderer = wrt.Renderer(scene, width=16 * 17, height=8 * 17, device=device, filter="box")
    for _ in renderer.passes(spp=16):
        pass
    # Texels are interpolated, and so themselves only in their middles.
    middles = renderer.image()[8::17, 8::17]
    np.testing.assert_allclose(middles, pixels, atol=0.03)
    turned = np.roll(pixels, 1, axis=1)
    assert np.abs(middles - turned).max() > 0.5


# --- Crop windows ------------------------------------------------------------------------------------
# The skies of this file are images, so that one kernel renders all its scenes.


def stage(camera: wrt.Camera) -> wrt.Scene:
    scene = wrt.Scene(camera=camera, environment=wrt.ImageEnvironment(np.float32([[[0.4, 0.5, 0.6]]])))
    scene.add(wrt.box((-4, -4, -4), (4, -1.2, 4)), material=wrt.Diffuse((0.6, 0.3, 0.2)))
    scene.add(wrt.sphere((0, 0, 0), 0.9, subdivisions=3), material=wrt.Diffuse(0.7))
    scene.add(wrt.quad((-1, 3, -1), (2, 0, 0), (0, 0, 2)), emission=6.0)
    return scene


LENS = {"aperture_radius": 0.2, "aperture": "polygon", "aperture_blades": 5, "shutter_close": 0.1}
CROPPED: dict[str, wrt.Camera] = {
    "perspective": wrt.PerspectiveCamera((0, 1, 5), **LENS, motion=wrt.Motion.translation((0.5, 0, 0), (0, 0.1))),
    "orthographic": wrt.OrthographicCamera((0, 1, 5), view_height=4.0),
    "panorama": wrt.PanoramaCamera((0, 1, 2)),
    "fisheye": wrt.FisheyeCamera((0, 1, 2)),
}


@pytest.mark.parametrize(
    "crop", [(0, 0, WIDTH, HEIGHT), (0, 0, 1, 1), (7, 11, 40, 12), (20, 3, WIDTH, HEIGHT)], ids=str
)
@pytest.mark.parametrize("name", CROPPED)
def test_a_part_has_the_bits_of_the_whole(name: str, crop: tuple[int, int, int, int], device: str) -> None:
    assert_part_is_of_the_whole(stage(CROPPED[name]), crop, device)


@pytest.mark.slow
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_part_has_the_bits_of_the_whole_by_every_sampler(sampler: str, device: str) -> None:
    assert_part_is_of_the_whole(stage(CROPPED["perspective"]), (7, 11, 40, 12), device, sampler=sampler)


def assert_part_is_of_the_whole(scene: wrt.Scene, crop: tuple[int, int, int, int], device: str, **options: Any) -> None:
    options = {"width": WIDTH, "height": HEIGHT, "spp": 3, "device": device, **options}
    whole = wrt.render(scene, **options)
    part = wrt.render(scene, **options, crop=crop)
    x0, y0, x1, y1 = crop
    np.testing.assert_array_equal(part, whole[y0:y1, x0:x1])
    assert whole.any()


def test_a_part_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    scene = stage(CROPPED["perspective"])
    scene.settings = wrt.RenderSettings(width=WIDTH, height=HEIGHT, crop=(5, 6, 30, 20))
    renderer = wrt.Renderer(scene)
    assert (renderer.width, renderer.height, renderer.crop) == (WIDTH, HEIGHT, (5, 6, 30, 20))
    for _ in renderer.passes(spp=2):
        pass
    assert renderer.image().shape == renderer.variance().shape == (14, 25, 3)
    assert renderer.paths == 2 * 14 * 25
    renderer.save_checkpoint(tmp_path / "part")
    scene.settings = wrt.RenderSettings()
    resumed = wrt.Renderer.resume(tmp_path / "part", scene)
    for one in (resumed, renderer):
        for _ in one.passes(spp=5):
            pass
    np.testing.assert_array_equal(resumed.image(), renderer.image())


@pytest.mark.parametrize(
    ("crop", "message"),
    [
        ((0, 0, 49, 30), r"crop must lie inside the picture: \(49, 30\) is beyond its 48x30 pixels"),
        ((3, 5, 3, 6), "crop must not be empty"),
        ((5, 5, 3, 6), "crop must not be empty"),
        ((-1, 0, 3, 3), r"crop\[0\] must be between 0 and 65536, not -1"),
        ((0, 0, 0.5, 0.5), r"crop\[2\] must be a whole number, not 0.5"),
        ((0, 0, 4), "crop must be four whole numbers"),
        ("0123", "crop must be four whole numbers"),
    ],
)
def test_parts_that_are_not_there(crop: object, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.Renderer(stage(CROPPED["fisheye"]), width=WIDTH, height=HEIGHT, crop=crop)  # type: ignore[arg-type]


# --- What is refused ---------------------------------------------------------------------------------

STRETCH = wrt.Motion([0.0, 1.0], [np.eye(4), np.diag([1.0, 1.1, 1.0, 1.0])])
MIRROR = wrt.Motion([0.0], [np.diag([-1.0, 1.0, 1.0, 1.0])])
REFUSED: list[tuple[type[wrt.Camera], dict[str, object], str]] = [
    (wrt.PerspectiveCamera, {"shutter_open": 1.0, "shutter_close": 0.5}, "shutter_close must not be before"),
    (wrt.PerspectiveCamera, {"shutter_ramp": 1.1}, "shutter_ramp must be at most 1"),
    (wrt.PerspectiveCamera, {"shutter_open": math.nan}, "shutter_open must be finite"),
    (wrt.PerspectiveCamera, {"motion": 3}, "motion must be a wrt.Motion, not int"),
    (wrt.PerspectiveCamera, {"motion": STRETCH}, "motion must be rigid"),
    (wrt.PerspectiveCamera, {"motion": MIRROR}, "motion must be rigid"),
    (wrt.PerspectiveCamera, {"aperture": "hexagon"}, "aperture must be one of disk, square, polygon, not 'hexagon'"),
    (wrt.PerspectiveCamera, {"aperture_blades": 2}, "aperture_blades must be between 3 and"),
    (wrt.PerspectiveCamera, {"aperture_blades": 5.5}, "aperture_blades must be a whole number"),
    (wrt.PerspectiveCamera, {"aperture_radius": -1.0}, "aperture_radius must be at least 0"),
    (wrt.PerspectiveCamera, {"focus_distance": 0.0}, "focus_distance must be greater than 0"),
    (wrt.PerspectiveCamera, {"shift_y": math.inf}, "shift_y must be finite"),
    (wrt.OrthographicCamera, {"view_height": 0.0}, "view_height must be greater than 0"),
    (wrt.PanoramaCamera, {"horizontal_degrees": 361.0}, "horizontal_degrees must be at most 360"),
    (wrt.PanoramaCamera, {"vertical_degrees": 181.0}, "vertical_degrees must be at most 180"),
    (wrt.FisheyeCamera, {"fov_degrees": 0.0}, "fov_degrees must be greater than 0"),
    (wrt.FisheyeCamera, {"origin": (0, 0, 0)}, "origin and target must differ"),
]


@pytest.mark.parametrize(("cls", "changes", "message"), REFUSED, ids=lambda value: str(value)[:40])
def test_what_cannot_be_is_refused(cls: type[wrt.Camera], changes: dict[str, object], message: str) -> None:
    with pytest.raises(wrt.InputError, match=f"^camera {message}"):
        cls(**changes)  # type: ignore[arg-type]


def test_a_camera_must_be_one() -> None:
    with pytest.raises(wrt.InputError, match="camera must be one of wrt's cameras, not str"):
        wrt.Renderer(stage("fisheye"))  # type: ignore[arg-type]
