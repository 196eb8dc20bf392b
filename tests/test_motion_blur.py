"""What moves while the shutter is open is smeared as closed forms say, and as many still pictures together."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from scipy import stats
from support.statistics import image_z_test

import wrt
from wrt.scene.motion import Motion
from wrt.upload.accel import instancing
from wrt.upload.accel.swept_boxes import swept_boxes

FloatArray = NDArray[np.float64]

WIDTH, HEIGHT = 64, 16
"""Pixels of the streaks; the picture shows 8 x 2 metres."""


def streak(
    shape: dict[str, object], device: str, shutter: tuple[float, float] = (0.0, 1.0), spp: int = 4096
) -> tuple[FloatArray, FloatArray]:
    """Return one channel of a picture of a shining shape before black, and its variance."""
    camera = wrt.OrthographicCamera(
        origin=(0.0, 0.0, 5.0),
        target=(0.0, 0.0, 0.0),
        view_height=2.0,
        shutter_open=shutter[0],
        shutter_close=shutter[1],
    )
    scene = wrt.Scene(camera=camera)
    scene.add(emission=1.0, two_sided_emission=True, **shape)  # type: ignore[arg-type]
    renderer = wrt.Renderer(
        scene, width=WIDTH, height=HEIGHT, max_depth=1, filter="box", sampler="independent", device=device, seed=3
    )
    for _ in renderer.passes(spp=spp):
        pass
    return renderer.image()[..., 0].astype(np.float64)


def centers() -> tuple[FloatArray, FloatArray]:
    """Return x and y in metres at 8 x 8 points of each pixel: (H, W, 64) each."""
    fine = (np.arange(8) + 0.5) / 8.0
    x = (np.arange(WIDTH)[:, None] + fine) * 8.0 / WIDTH - 4.0
    y = 1.0 - (np.arange(HEIGHT)[:, None] + fine) * 2.0 / HEIGHT
    full = (HEIGHT, WIDTH, 8, 8)
    xs = np.broadcast_to(x[None, :, None, :], full).reshape(HEIGHT, WIDTH, 64)
    ys = np.broadcast_to(y[:, None, :, None], full).reshape(HEIGHT, WIDTH, 64)
    return xs, ys


def chance(found: FloatArray, expected: FloatArray, spp: int = 4096) -> float:
    """Return the probability of such a difference, were `expected` right (Pearson's χ²): a sample shines or not."""
    certain = (expected < 1e-9) | (expected > 1.0 - 1e-9)
    if not np.allclose(found[certain], expected[certain], atol=3.0 / spp):
        return 0.0
    expected, found = expected[~certain], found[~certain]
    variance = expected * (1.0 - expected) / spp
    return float(stats.chi2.sf(np.sum((found - expected) ** 2 / variance), len(found)))


QUAD = wrt.quad((-0.25, -0.5, 0.0), (0.5, 0.0, 0.0), (0.0, 1.0, 0.0))


def crossing(offset: float, width: float = 0.5, start: float = -2.0) -> FloatArray:
    """Return the share of the time that a square moving along x by `offset` covers, per pixel.

    At x it is covered while |x − start − offset t| < width / 2; the mean over a pixel is by the antiderivative of
    that trapezoid.
    """

    def integral(x: FloatArray) -> FloatArray:
        """Return ∫ (x − s)₊ from s = 0 to offset, over offset: the antiderivative of a step that moves."""
        a, b = np.maximum(x, 0.0), np.maximum(x - offset, 0.0)
        return (a * a - b * b) / (2.0 * offset)

    edges = np.linspace(-4.0, 4.0, WIDTH + 1)
    total = integral(edges - start + 0.5 * width) - integral(edges - start - 0.5 * width)
    rows = np.zeros(HEIGHT)
    rows[4:12] = 1.0
    return np.asarray(rows[:, None] * (np.diff(total) * WIDTH / 8.0))


def test_a_streak(device: str, report: Report) -> None:
    """Its length, and the light along it."""
    start = np.eye(4)
    start[0, 3] = -2.0
    moving = wrt.Motion((0.0, 1.0), [start, wrt.Motion.translation((3.0, 0.0, 0.0)).at(1.0) @ start])
    found = streak({"mesh": QUAD, "transform": moving}, device)
    p = chance(found, crossing(3.0))
    report("the light along it", "", "", p=p)
    assert p > 1e-3
    # Wrong partners: a streak 5 % longer, one of 5 % too much time, one that is a step late.
    for wrong in (crossing(3.15), 1.05 * crossing(3.0), crossing(3.0, start=-1.95)):
        assert chance(found, wrong) < 1e-6
    # Half the time, half the way; the times of keys are in seconds.
    later = wrt.Motion((0.5, 2.5), moving.transforms)
    found = streak({"mesh": QUAD, "transform": later}, device, shutter=(0.5, 1.5))
    assert chance(found, crossing(1.5)) > 1e-3


def test_a_shutter_before_and_after_the_motion(device: str) -> None:
    """Outside of its keys a thing stands still: of four seconds it moves in one."""
    moving = wrt.Motion.translation((2.0, 0.0, 0.0), times=(1.0, 2.0))
    found = streak({"mesh": QUAD, "transform": moving}, device, shutter=(0.0, 4.0))
    at = {x: np.where(np.abs(np.linspace(-4, 4, 2 * WIDTH + 1)[1::2] - x) < 0.25, 1.0, 0.0) for x in (0.0, 2.0)}
    rows = (np.abs(np.arange(HEIGHT) - 7.5) < 4.0)[:, None]
    expected = 0.25 * crossing(2.0, start=0.0) + rows * (0.25 * at[0.0] + 0.5 * at[2.0])
    assert chance(found, expected) > 1e-3


@pytest.mark.parametrize("degrees", [90.0, 300.0])
def test_an_arc(degrees: float, device: str, report: Report) -> None:
    """A square that turns about the middle of the picture, a metre and a half beside which it is."""
    mesh = wrt.quad((0.55, -0.2, 0.0), (0.3, 0.0, 0.0), (0.0, 0.4, 0.0))
    found = streak({"mesh": mesh, "transform": wrt.Motion.rotation((0, 0, 1), degrees)}, device)

    def expected(turn: float) -> FloatArray:
        x, y = centers()
        share = np.zeros(x.shape)
        for angle in np.deg2rad((np.arange(2000) + 0.5) / 2000 * turn):
            back_x, back_y = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
            share += (np.abs(back_x - 0.7) < 0.15) & (np.abs(back_y) < 0.2)
        return np.asarray(share.mean(axis=2) / 2000)

    p = chance(found, expected(degrees))
    report(f"{degrees:g} degrees: the light along it", "", "", p=p)
    assert p > 1e-3
    assert chance(found, expected(1.1 * degrees)) < 1e-9


def test_stretching(device: str, report: Report) -> None:
    """The left edge stays, the right one moves: beyond x = 0 the light falls linearly."""
    vertices = np.stack([QUAD.vertices, QUAD.vertices])
    vertices[1, QUAD.vertices[:, 0] > 0.0, 0] += 2.0
    found = streak({"mesh": QUAD, "deformation": wrt.Deformation((0.0, 1.0), vertices)}, device)

    def expected(by: float) -> FloatArray:
        x, y = centers()
        share = np.where(x < 0.25, 1.0, 1.0 - (x - 0.25) / by)
        return np.asarray((np.clip(share, 0.0, 1.0) * (x > -0.25) * (np.abs(y) < 0.5)).mean(axis=2))

    p = chance(found, expected(2.0))
    report("the light along it", "", "", p=p)
    assert p > 1e-3
    assert chance(found, expected(2.1)) < 1e-9


# --- Pictures --------------------------------------------------------------------------------------


def moving_scene(shutter: tuple[float, float]) -> wrt.Scene:
    """A ball that tumbles, a smooth one that changes its shape, a light that moves, and things that stand."""
    camera = wrt.PerspectiveCamera(
        (0.0, 2.0, 5.0), (0.0, 0.6, 0.0), fov_degrees=40.0, shutter_open=shutter[0], shutter_close=shutter[1]
    )
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.1))
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse(0.6))
    red = wrt.Diffuse((0.8, 0.3, 0.2))
    keys = [np.eye(4), np.eye(4)]
    keys[0][:3, 3] = -1.5, 0.5, 0.0
    keys[1][:3, :3] = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) @ np.diag([1.2, 0.7, 1.0])
    keys[1][:3, 3] = -0.5, 1.0, 0.0
    box = wrt.box((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4))
    scene.add(box, material=red, transform=wrt.Motion((0.0, 1.0), keys, center=(0.2, 0.0, 0.0)))
    mirrored = np.diag([-0.5, 0.5, 0.5, 1.0])
    mirrored[:3, 3] = 0.2, 0.3, 1.0
    scene.add(box, material=wrt.Mirror(0.9), transform=mirrored)
    ball = wrt.sphere(subdivisions=2)
    shapes = np.stack([ball.vertices * [0.4, 0.4, 0.4], ball.vertices * [0.7, 0.2, 0.4]]) + [1.2, 0.5, 0.0]
    scene.add(ball, material=wrt.Diffuse(0.7), deformation=wrt.Deformation((-0.5, 1.0), shapes))
    lamp = wrt.quad((-0.5, 2.5, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    scene.add(lamp, emission=(8.0, 7.0, 5.0), transform=wrt.Motion.translation((1.5, 0.0, 0.3)))
    return scene


def test_a_deformation_may_bring_normals_to_a_flat_mesh(device: str) -> None:
    quad = wrt.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    tilted = np.tile(np.float32([0.6, 0.0, 0.8]), (len(quad.vertices), 1))
    deformation = wrt.Deformation((0.0, 1.0), np.stack([quad.vertices, 0.5 * quad.vertices]), np.stack([tilted] * 2))

    def picture(mesh: wrt.Mesh, deformation: wrt.Deformation, shutter_close: float) -> NDArray:
        camera = wrt.OrthographicCamera(
            (0, 0, 3), (0, 0, 0), view_height=2.5, shutter_open=0.0, shutter_close=shutter_close
        )
        scene = wrt.Scene(camera=camera)
        scene.add(mesh, material=wrt.Diffuse(0.8), deformation=deformation)
        scene.add_light(wrt.DirectionalLight((-0.7, 0.0, -0.7), irradiance=2.0))
        return wrt.render(scene, width=24, height=24, spp=4, device=device)

    for shutter_close in (0.0, 1.0):
        found = picture(quad, deformation, shutter_close)
        smooth = dataclasses.replace(quad, normals=tilted)
        np.testing.assert_array_equal(found, picture(smooth, deformation, shutter_close))
        flat = wrt.Deformation(deformation.times, deformation.vertices)
        assert np.abs(found - picture(quad, flat, shutter_close)).max() > 0.02


@pytest.mark.slow
def test_motion_is_the_mean_of_still_pictures(device: str, report: Report) -> None:
    """Still ones have all triangles where they are in one tree, and know nothing of motion."""
    options = {"width": 40, "height": 30, "max_depth": 4, "sampler": "independent", "device": device}
    blurred = wrt.Renderer(moving_scene((0.0, 1.0)), seed=1, **options)  # type: ignore[arg-type]
    assert blurred._built.features.instances == "deforming"
    for _ in blurred.passes(spp=2048):
        pass
    # One time in each of 256 equal parts of the whole: so few pixels tell that there are not more of them.
    count, rng = 256, np.random.default_rng(4)
    mean, variance = np.zeros((30, 40, 3)), np.zeros((30, 40, 3))
    for i, time in enumerate((np.arange(count) + rng.random(count)) / count):
        still = wrt.Renderer(moving_scene((time, time)), seed=100 + i, **options)  # type: ignore[arg-type]
        assert still._built.features.instances == "none"
        for _ in still.passes(spp=8):
            pass
        mean += still.image() / count
        variance += still.variance() / count**2
    test = image_z_test(blurred.image(), blurred.variance(), mean, variance, n_a=2048, n_b=7 * count)
    report("against still pictures", test.message)
    assert test.pass_fraction >= 0.995
    assert min(test.p_min, test.block_p, test.spread_p, test.mean_p) > 1e-3
    # A wrong partner: a single picture in the middle of the time.
    middle = wrt.Renderer(moving_scene((0.5, 0.5)), seed=7, **options)  # type: ignore[arg-type]
    for _ in middle.passes(spp=256):
        pass
    test = image_z_test(blurred.image(), blurred.variance(), middle.image(), middle.variance(), n_a=2048, n_b=256)
    assert test.block_p < 1e-9


# --- Boxes ------------------------------------------------------------------------------------------


def test_boxes_hold_what_moves(report: Report) -> None:
    """Throughout each slice, and they are not much larger than they must be."""
    rng = np.random.default_rng(5)
    slack = []
    for case in range(40):
        keys = 1 + case % 4
        matrices = np.tile(np.eye(4), (keys, 1, 1))
        for m in matrices:
            q, r = np.linalg.qr(rng.normal(size=(3, 3)))
            q = q * np.sign(np.diag(r))
            q *= np.sign(np.linalg.det(q))
            m[:3, :3] = q @ np.diag(rng.uniform(0.3, 2.0, 3))
            m[:3, 3] = rng.uniform(-5, 5, 3)
        motion = Motion(np.sort(rng.uniform(-0.2, 1.2, keys)), matrices, tuple(rng.uniform(-1, 1, 3)))
        times = np.array([0.0]) if case % 3 else np.array([-0.1, 0.4, 0.9])
        centers = rng.uniform(-1, 1, (len(times), 3))
        halves = rng.uniform(0.05, 1.0, (len(times), 3))
        boxes = np.stack([centers - halves, centers + halves], axis=1)
        radius = float(np.linalg.norm(halves, axis=1).max())
        found = swept_boxes(motion, times, boxes, radius, (0.0, 1.0), 8)
        for k, (low, high) in enumerate(found.astype(np.float64)):
            at = np.linspace(k / 8, (k + 1) / 8, 201)
            moved = motion.at(at)
            share = np.interp(at, times, np.arange(len(times))) if len(times) > 1 else np.zeros(len(at))
            first = np.minimum(share.astype(int), max(len(times) - 2, 0))
            f = (share - first)[:, None, None]
            own = (1 - f) * boxes[first] + f * boxes[np.minimum(first + 1, len(times) - 1)]
            picks = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
            corners = own[:, picks, np.arange(3)]
            points = np.einsum("kij,knj->kni", moved[:, :3, :3], corners) + moved[:, None, :3, 3]
            least, most = points.min(axis=(0, 1)), points.max(axis=(0, 1))
            assert (low <= least).all()
            assert (high >= most).all()
            slack.append(float((high - low).sum() / (most - least).sum()))
    report("sides over those of the tightest boxes: mean, most", np.mean(slack), f"{np.max(slack):.3f}")
    assert np.mean(slack) < 1.05


def test_boxes_of_balls_are_those_of_balls() -> None:
    """However they turn; stretched ones are held by the ball around them."""
    motion = Motion.rotation((1, 2, 3), 300.0, center=(1.0, 2.0, 3.0))
    box = np.array([[[0.5, 1.5, 2.5], [1.5, 2.5, 3.5]]])
    found = swept_boxes(motion, np.zeros(1), box, 0.5, (0.0, 1.0), 4)
    np.testing.assert_allclose(found, np.broadcast_to(box, (4, 2, 3)), atol=1e-4)


def test_shapes_know_where_they_are() -> None:
    scene = moving_scene((0.0, 1.0))
    for shape in scene.shapes:
        low, high = shape.bounds
        for time in (0.0, 0.3, 0.7, 1.0):
            box = shape.mesh_at(time).bounds
            assert (box[0] >= low - 0.01).all()
            assert (box[1] <= high + 0.01).all()


def test_what_stands_still_while_the_shutter_is_open_is_in_one_tree() -> None:
    for shutter, kind in (((0.0, 1.0), "deforming"), ((0.3, 0.3), "none"), ((2.0, 3.0), "none")):
        assert instancing.lay_out(moving_scene(shutter)).kind == kind
    scene = moving_scene((0.0, 1.0))
    scene.shapes = [shape for shape in scene.shapes if shape.deformation is None]
    assert instancing.lay_out(scene).kind == "moving"


@pytest.mark.slow
def test_resuming(tmp_path: object) -> None:
    scene = moving_scene((0.0, 1.0))
    whole, half = (wrt.Renderer(scene, width=12, height=9, seed=5) for _ in range(2))
    for _ in whole.passes(spp=8):
        pass
    for _ in half.passes(spp=3):
        pass
    path = f"{tmp_path}/half.ckpt"
    half.save_checkpoint(path)
    resumed = wrt.Renderer.resume(path, moving_scene((0.0, 1.0)), threads=1)
    for _ in resumed.passes(spp=8):
        pass
    np.testing.assert_array_equal(resumed.image(), whole.image())
    # Another motion is another scene.
    for i, change in ((1, "transform"), (3, "deformation")):
        other = moving_scene((0.0, 1.0))
        shape = other.shapes[i]
        new: object = wrt.Motion.translation((0.1, 0.0, 0.0))
        if change == "deformation":
            assert shape.deformation is not None
            new = wrt.Deformation(shape.deformation.times + 0.1, shape.deformation.vertices)
        other.shapes[i] = dataclasses.replace(shape, **{change: new})
        with pytest.raises(wrt.InputError, match="geometry"):
            wrt.Renderer.resume(path, other)
