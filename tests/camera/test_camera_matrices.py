"""Cameras of computer vision: rays through pixels meet the points that OpenCV's formulas project onto these pixels."""

import re

import numpy as np
import pytest
from support.cameras import camera_rays

import wrt
from wrt.linalg import polar

CAMERAS = 100


def random_cameras(seed):
    """Yield a generator, K, R, t and the size of a picture, of random cameras."""
    rng = np.random.default_rng(seed)
    for _ in range(CAMERAS):
        width, height = (int(n) for n in rng.integers(64, 1920, 2))
        fx, fy = rng.uniform(0.4, 2.0, 2) * max(width, height)
        k = np.array([[fx, 0, width * rng.uniform(0.2, 0.8)], [0, fy, height * rng.uniform(0.2, 0.8)], [0, 0, 1]])
        r = polar(rng.normal(size=(3, 3)))[0]
        yield rng, k, r * np.linalg.det(r), rng.normal(size=3) * 3.0, width, height


def pixels_of(points, k, r, t):
    """Return the pixels of points of the world in OpenCV's convention: whole numbers are the middles of pixels."""
    x, y, z = (points @ r.T + t).T
    return np.stack([k[0, 0] * x / z + k[0, 2], k[1, 1] * y / z + k[1, 2]], axis=1)


def test_rays_of_camera_matrices_meet_what_opencv_projects(device):
    for rng, k, r, t, width, height in random_cameras(1):
        pixels = rng.uniform(-0.5, np.array([width, height]) - 0.5, (16, 2))
        camera = wrt.PerspectiveCamera.from_opencv(k, r, t, width, height)
        rays = camera_rays(camera, width, height, pixels + 0.5, device=device)
        points = rays.origins + rays.directions * rng.uniform(1.0, 50.0, (16, 1))
        np.testing.assert_allclose(pixels_of(points, k, r, t), pixels, atol=0.01)
        np.testing.assert_allclose(camera.project(points, width, height) - 0.5, pixels, atol=0.01)
        double = camera_rays(camera, 2 * width, 2 * height, 2.0 * (pixels + 0.5), device=device)
        np.testing.assert_allclose(double.directions, rays.directions, atol=1e-6)
        of_colmap = k + [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
        same = wrt.PerspectiveCamera.from_opencv(of_colmap, r, t, width, height, pixel_center=0.5)
        assert (same.shift_x, same.shift_y) == pytest.approx((camera.shift_x, camera.shift_y))


def brown(x, y, coefficients):
    """Return distorted points as in OpenCV's documentation of calib3d."""
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients
    s = x**2 + y**2
    factor = (1 + k1 * s + k2 * s**2 + k3 * s**3) / (1 + k4 * s + k5 * s**2 + k6 * s**3)
    return (
        x * factor + 2 * p1 * x * y + p2 * (s + 2 * x**2),
        y * factor + p1 * (s + 2 * y**2) + 2 * p2 * x * y,
    )


def fisheye(angle, coefficients):
    """Return the radius of an angle as in OpenCV's documentation of fisheyes."""
    return angle * (1 + sum(k * angle ** (2 * i) for i, k in enumerate(coefficients, 1)))


def distorted_pixels(points, k, r, t, coefficients):
    x, y, z = (points @ r.T + t).T
    if len(coefficients) == 8:
        x, y = brown(x / z, y / z, coefficients)
    else:
        across = np.hypot(x, y)
        scale = fisheye(np.arctan2(across, z), coefficients) / across
        x, y = x * scale, y * scale
    return np.stack([k[0, 0] * x + k[0, 2], k[1, 1] * y + k[1, 2]], axis=1)


def random_coefficients(rng, kind):
    """Return k1, k2, p1, p2, k3, k4, k5, k6 of barrels and pincushions, or k1 to k4 of a fisheye."""
    if kind is wrt.FisheyeCamera:
        return rng.uniform(-1, 1, 4) * [0.1, 0.05, 0.02, 0.01]
    return rng.uniform(-1, 1, 8) * [0.4, 0.2, 0.01, 0.01, 0.1, 0.2, 0.1, 0.05]


@pytest.mark.parametrize("kind", [wrt.PerspectiveCamera, wrt.FisheyeCamera])
def test_rays_of_lenses_that_distort_meet_what_opencv_projects(kind, device):
    shares = []
    for rng, k, r, t, width, height in random_cameras(4):
        coefficients = random_coefficients(rng, kind)
        pixels = rng.uniform(-0.5, np.array([width, height]) - 0.5, (64, 2))
        camera = kind.from_opencv(k, r, t, width, height, distortion=coefficients)
        rays = camera_rays(camera, width, height, pixels + 0.5, device=device)
        points = rays.origins + rays.directions * rng.uniform(1.0, 50.0, (64, 1))
        seen = rays.visible
        np.testing.assert_allclose(distorted_pixels(points, k, r, t, coefficients)[seen], pixels[seen], atol=0.01)
        np.testing.assert_allclose(camera.project(points, width, height)[seen] - 0.5, pixels[seen], atol=0.01)
        shares.append(seen.mean())
    assert np.mean(shares) > 0.8
    assert min(shares) > 0.1


@pytest.mark.parametrize("kind", [wrt.PerspectiveCamera, wrt.FisheyeCamera])
def test_only_pixels_without_an_inverse_are_black(kind, device):
    """They lie beyond the largest radius that the model reaches before it folds over."""
    black = 0
    for rng, k, r, t, width, height in random_cameras(5):
        coefficients = random_coefficients(rng, kind) * (
            [1, 1, 0, 0, 1, 1, 1, 1] if kind is wrt.PerspectiveCamera else 1
        )
        angles = np.linspace(0.0, np.radians(89.9) if kind is wrt.PerspectiveCamera else np.pi, 100_000)
        with np.errstate(all="ignore"):
            radii = (
                fisheye(angles, coefficients)
                if kind is wrt.FisheyeCamera
                else brown(np.tan(angles), 0.0 * angles, coefficients)[0]
            )
        folds = np.flatnonzero(~(np.diff(radii) > 0.0))
        reach = radii[folds[0] if len(folds) else -1]
        pixels = rng.uniform(-0.5, np.array([width, height]) - 0.5, (64, 2))
        camera = kind.from_opencv(k, r, t, width, height, distortion=coefficients)
        visible = camera_rays(camera, width, height, pixels + 0.5, device=device).visible
        film = np.hypot(*((pixels - k[:2, 2]) / [k[0, 0], k[1, 1]]).T)
        clear = np.abs(film - reach) > 1e-3
        np.testing.assert_array_equal(visible[clear], film[clear] < reach)
        black += (~visible).sum()
    assert black > 20


@pytest.mark.parametrize("kind", [wrt.PerspectiveCamera, wrt.FisheyeCamera])
def test_the_motion_of_a_distorted_picture(kind, device):
    """Points of a wall, seen by a camera that moves, go from where it projects them to where it does so later."""
    motion = wrt.Motion.translation((0.2, 0.1, 0.3))
    lens = {"distortion": (-0.1, 0.02, 0.01, 0.02), "shutter_close": 1.0, "motion": motion}
    camera = kind((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_degrees=70.0, **lens)
    scene = wrt.Scene(camera=camera)
    scene.add(wrt.quad((-9, -9, 0), (18, 0, 0), (0, 18, 0)))
    names = ("position", "motion", "object")
    renderer = wrt.Renderer(scene, width=40, height=30, integrator="aov", layers=names, device=device)
    for _ in renderer.passes(spp=2):
        pass
    layers = {name: layer.reshape(1200, -1) for name, layer in renderer.layers().items()}
    before, after = (camera.project(layers["position"], 40, 30, time=time) for time in (0.0, 1.0))
    seen = np.isfinite(before + after).all(axis=1) & (layers["object"][:, 0] == 1)
    assert seen.mean() > 0.5
    np.testing.assert_allclose(layers["motion"][seen], (after - before)[seen], atol=1e-3)


def test_z_is_the_distance_along_the_axis_of_a_camera_that_moves(device):
    motion = wrt.Motion.rotation((0.2, 1.0, 0.0), 30.0, center=(1.0, 0.0, 0.0))
    camera = wrt.PerspectiveCamera((0.5, 0.2, 3.0), (0.0, 0.0, 0.0), shutter_open=0.6, shutter_close=0.6, motion=motion)
    scene = wrt.Scene(camera=camera)
    scene.add(wrt.quad((-1, -9, 0), (9, 0, -3), (0, 18, 0)))
    renderer = wrt.Renderer(scene, width=40, height=30, integrator="aov", layers=("z", "position"), device=device)
    for _ in renderer.passes(spp=1):
        pass
    layers, place = renderer.layers(), motion.at(0.6)
    origin, forward = place[:3, :3] @ camera.origin + place[:3, 3], place[:3, :3] @ camera.frame()[2]
    seen = np.isfinite(layers["z"])
    assert 0.2 < seen.mean() < 0.9
    np.testing.assert_allclose(layers["z"][seen], (layers["position"][seen] - origin) @ forward, rtol=1e-5)


def test_lenses_of_scene_files(tmp_path):
    for camera in (
        wrt.PerspectiveCamera(distortion=(-0.1, 0.02, 0.0, 0.0, 0.3), pixel_aspect=1.01),
        wrt.FisheyeCamera(distortion=(-0.1, 0.02), circular=False, shift_x=0.1),
    ):
        scene = wrt.Scene(camera=camera)
        scene.add(wrt.sphere())
        wrt.save_scene(tmp_path / f"{camera.type_name}.toml", scene)
        assert wrt.load(tmp_path / f"{camera.type_name}.toml").camera == camera


def test_distortion_is_checked_and_kept():
    camera = wrt.PerspectiveCamera(distortion=np.array([[0.1, 0.0, 0.0, 0.0, 0.0, *[0.0] * 9]]))
    assert camera.distortion == (0.1,)
    assert wrt.PerspectiveCamera(distortion=[0.0] * 5) == wrt.PerspectiveCamera()
    for kind, value, message in (
        (wrt.PerspectiveCamera, [0.0] * 8 + [0.1], "camera distortion has coefficients beyond k1, k2, p1, p2, k3, k4,"),
        (wrt.FisheyeCamera, [0.1] * 5, "camera distortion has coefficients beyond k1, k2, k3, k4, which wrt does not"),
        (wrt.PerspectiveCamera, ["a"], "camera distortion must be an array of numbers"),
        (wrt.PerspectiveCamera, [np.inf], "camera distortion[0] must be finite"),
    ):
        with pytest.raises(wrt.InputError, match=re.escape(message)):
            kind(distortion=value)
    with pytest.raises(wrt.InputError, match="PanoramaCamera has no focal lengths; take a PerspectiveCamera or a Fish"):
        wrt.PanoramaCamera.from_opencv(K, width=100, height=80)


def test_poses_of_both_conventions_and_rotation_vectors():
    _, k, r, t, width, height = next(random_cameras(2))
    camera = wrt.PerspectiveCamera.from_opencv(k, r, t, width, height)
    to_world = np.eye(4)
    to_world[:3] = np.column_stack([r.T, -r.T @ t])
    for matrix, convention in ((to_world, "opencv"), (to_world @ np.diag([1, -1, -1, 1]), "opengl")):
        for made in (wrt.Camera.from_matrix(m, convention=convention) for m in (matrix, matrix[:3])):
            np.testing.assert_allclose(made.frame(), camera.frame(), atol=1e-12)
            np.testing.assert_allclose(made.origin, camera.origin)
    panorama = wrt.PanoramaCamera.from_matrix(np.eye(4), vertical_degrees=90.0)
    assert (panorama.target, panorama.vertical_degrees) == ((0.0, 0.0, -1.0), 90.0)
    turned = wrt.PerspectiveCamera.from_opencv(k, (0.0, 0.0, np.pi / 2), t, width, height)  # x becomes y
    np.testing.assert_allclose(turned.frame(), [[0, -1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize(
    ("up", "target", "right"),
    [((0, 1, 0), (0, -1, 0), (1, 0, 0)), ((0, 1, 0), (0, 1, 0), (1, 0, 0)), ((1, 0, 0), (-2, 0, 0), (0, 1, 0))],
)
def test_a_camera_may_look_along_its_up_direction(up, target, right):
    frame = wrt.PerspectiveCamera((0.0, 0.0, 0.0), target, up).frame()
    np.testing.assert_allclose(frame[0], right)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(frame) == pytest.approx(-1.0)  # right, up and forward


def test_every_camera_projects_points_to_where_its_rays_go(device):
    motion = wrt.Motion.translation((1.0, 2.0, 3.0))
    pose = {"origin": (1.0, -2.0, 0.5), "target": (-1.5, 0.5, 2.0), "shutter_close": 1.0, "motion": motion}
    kinds = (wrt.PerspectiveCamera, wrt.OrthographicCamera, wrt.PanoramaCamera, wrt.FisheyeCamera)
    films = np.random.default_rng(3).random((200, 2)) * [40, 30]
    for camera in (kind(**pose) for kind in kinds):
        rays = camera_rays(camera, 40, 30, films, shutters=0.25, device=device)
        found = camera.project(rays.origins + 3.0 * rays.directions, 40, 30, time=0.25)
        np.testing.assert_allclose(found[rays.visible], films[rays.visible], atol=1e-3)
        assert np.isnan(found[~rays.visible]).all()
    behind = wrt.PerspectiveCamera().project([(0.0, 0.0, 4.0), (0.0, 0.0, 3.0)], 40, 30)
    assert np.isnan(behind).all()


K = np.array([[100.0, 0, 50], [0, 90, 40], [0, 0, 1]])
SHEARED = np.array([[1, 0.1, 0], [0, 1, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"K": np.eye(4)}, "K must be (3, 3), not (4, 4)"),
        ({"K": K * [[0], [1], [1]]}, "K[0, 0], the focal length fx, must be greater than 0, not 0"),
        ({"K": K + [[0, 2, 0], [0, 0, 0], [0, 0, 0]]}, "K has a skew of 2 pixels"),
        ({"K": K.T}, "K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], not "),
        ({"R": SHEARED}, "R must have orthonormal columns; their products are off by 0.1"),
        ({"R": np.diag([1, 1, -1])}, "R must be a rotation, not a reflection"),
        ({"R": np.full((3, 3), np.nan)}, "R must be finite"),
        ({"t": (1, 2)}, "t must be (3,) or (3, 1) or (1, 3), not (2,)"),
        ({"width": None}, "from_opencv needs the width and the height"),
        ({"height": 0}, "height must be between 1 and"),
    ],
)
def test_what_is_no_camera_matrix_is_named(changes, message):
    with pytest.raises(wrt.InputError, match=re.escape(message)):
        wrt.PerspectiveCamera.from_opencv(**{"K": K, "width": 100, "height": 80, **changes})


def test_what_is_no_pose_is_named():
    for matrix, convention, message in (
        (np.eye(3), "opengl", "the camera's matrix must be (4, 4) or (3, 4), not (3, 3)"),
        (np.diag([2, 2, 2, 1]), "opengl", "the camera's matrix must have orthonormal columns"),
        (np.eye(4).T + np.eye(4)[[3, 0, 1, 2]], "opengl", "the last row of the camera's matrix must be 0, 0, 0, 1"),
        (np.eye(4), "blender", "convention must be one of opengl, opencv, not 'blender'"),
    ):
        with pytest.raises(wrt.InputError, match=re.escape(message)):
            wrt.PerspectiveCamera.from_matrix(matrix, convention=convention)
    with pytest.raises(wrt.InputError, match="camera up must not be zero"):
        wrt.PerspectiveCamera(up=(0.0, 0.0, 0.0))
    with pytest.raises(wrt.InputError, match=r"points must be \(N, 3\), not \(3,\)"):
        wrt.PerspectiveCamera().project((1.0, 2.0, 3.0), 4, 4)
