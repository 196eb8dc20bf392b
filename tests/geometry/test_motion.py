"""Keyframed motion agrees with closed forms, on the host and on the device."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from support.kernels import upload
from support.ray_trees import affine, rotation

import wrt
from wrt.kernels.core.motion import MotionKey, MotionRecord, transform_at
from wrt.upload.accel.swept_boxes import swept_boxes
from wrt.upload.camera import motion_records

FloatArray = NDArray[np.float64]


def turned(axis: tuple[float, ...], degrees: float) -> FloatArray:
    return np.asarray(Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix())


def about(axis: tuple[float, ...], degrees: float, center: tuple[float, ...], offset: FloatArray) -> FloatArray:
    r = turned(axis, degrees)
    return affine(r, center - r @ center + offset)


def random_affine(rng: np.random.Generator, *, mirrored: bool = False) -> FloatArray:
    """Return a random map that squeezes no direction by more than 5."""
    sizes = rng.uniform(0.4, 2.0, 3) * (-1.0 if mirrored else 1.0)
    return affine(rotation(rng) @ np.diag(sizes) @ rotation(rng), rng.uniform(-3.0, 3.0, 3))


AXIS, CENTER, RISE = (1.0, 2.0, -0.5), (3.0, 1.0, -2.0), np.array([0.0, 3.0, 1.0])
FIRST = random_affine(np.random.default_rng(5), mirrored=True)
HALF = (0.0, 0.6, 0.8)


def turning(degrees: float, rise: FloatArray = 0.0 * RISE) -> tuple[wrt.Motion, Callable[[float], FloatArray]]:
    motion = wrt.Motion.rotation(AXIS, degrees, center=CENTER, times=(0.0, 2.0), offset=rise)
    return motion, lambda share: about(AXIS, degrees * share, CENTER, rise * share)


CLOSED_FORMS: dict[str, tuple[wrt.Motion, Callable[[float], FloatArray]]] = {
    "straight": (
        wrt.Motion.translation((1.0, -2.0, 4.0), times=(0.0, 2.0)),
        lambda share: affine(np.eye(3), share * np.array([1.0, -2.0, 4.0])),
    ),
    # Evenly, the right way round, over any number of turns; the axis stays where it is, or rises as a screw does.
    **{f"{degrees:g} degrees": turning(degrees) for degrees in (10.0, 180.0, -1000.0)},
    "screw": turning(720.0, RISE),
    "after a transform": (turning(400.0, RISE)[0].after(FIRST), lambda share: turning(400.0, RISE)[1](share) @ FIRST),
    # Between two keys by slerp: the shorter way, or of two as short ones one.
    "half a turn by keys": (
        wrt.Motion((0.0, 2.0), [np.eye(4), affine(turned(HALF, 180.0))]),
        lambda share: affine(turned(HALF, 180.0 * share)),
    ),
    "200 degrees by keys": (
        wrt.Motion((0.0, 2.0), [np.eye(4), affine(turned((0, 0, 1), 200.0))]),
        lambda share: affine(turned((0, 0, 1), -160.0 * share)),
    ),
    # The stretch is linear beside the rotation, not part of it.
    "growing while turning": (
        wrt.Motion(
            (0.0, 2.0), [affine(np.diag([1.0, 2.0, 3.0])), affine(turned((1, 1, 0), 60.0) @ np.diag([2.0, 2.0, 1.0]))]
        ),
        lambda share: affine(turned((1, 1, 0), 60.0 * share) @ np.diag([1.0 + share, 2.0, 3.0 - 2.0 * share])),
    ),
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_motions_are_where_closed_forms_say(name: str) -> None:
    motion, expected = CLOSED_FORMS[name]
    for time in np.linspace(-0.5, 2.5, 31):
        np.testing.assert_allclose(motion.at(time), expected(min(max(time / 2.0, 0.0), 1.0)), atol=1e-12)


@pytest.mark.parametrize("mirrored", [False, True])
def test_keys_are_met_and_stay_invertible(mirrored: bool) -> None:
    rng = np.random.default_rng(1)
    for keys in (1, 2, 5):
        matrices = [random_affine(rng, mirrored=mirrored) for _ in range(keys)]
        times = np.cumsum(rng.uniform(0.1, 1.0, keys))
        motion = wrt.Motion(times, matrices, center=(1.0, 0.5, -2.0))
        at = [times[0] - 1.0, *times, times[-1] + 1.0]
        np.testing.assert_allclose(motion.at(at), [matrices[0], *matrices, matrices[-1]], atol=1e-13)
        between = np.linalg.det(motion.at(np.linspace(times[0], times[-1], 100))[:, :3, :3])
        assert (between * (-1.0 if mirrored else 1.0) > 0.01).all()


@wp.kernel(enable_backward=False, module="test_motion")
def place(
    keys: wp.array(dtype=MotionKey),
    motions: wp.array(dtype=MotionRecord),
    times: wp.array(dtype=float),
    out: wp.array(dtype=float, ndim=3),
):
    i, j = wp.tid()
    found = transform_at(keys, motions[i], times[j])
    for row in range(3):
        for column in range(3):
            out[i * times.shape[0] + j, row, column] = found.linear[row, column]
        out[i * times.shape[0] + j, row, 3] = found.offset[row]


def test_the_device_agrees(device: str, report: Report) -> None:
    rng = np.random.default_rng(2)
    motions = [
        wrt.Motion([1.0], [random_affine(rng)]),
        wrt.Motion((0.0, 1.0), [random_affine(rng), random_affine(rng)]),
        wrt.Motion((0.0, 0.3, 1.0, 2.0), [random_affine(rng, mirrored=True) for _ in range(4)], center=CENTER),
        turning(900.0)[0],
        # Angles around where slerp gives way to a straight line.
        *(wrt.Motion.rotation((1, -2, 0.5), np.rad2deg(2.0 * half)) for half in (4e-4, 5.1e-4, 1e-3)),
        wrt.Motion((0.0, 2.0), [np.eye(4), affine(turned(HALF, 180.0))]),
    ]
    keys, records = motion_records(motions)
    times = np.linspace(-0.5, 2.5, 301).astype(np.float32)
    out = wp.zeros((len(motions) * len(times), 3, 4), dtype=float, device=device)
    inputs = [upload(keys, MotionKey, device), upload(records, MotionRecord, device), upload(times, float, device)]
    wp.launch(place, dim=(len(motions), len(times)), inputs=[*inputs, out], device=device)
    expected = np.stack([motion.at(times)[:, :3] for motion in motions])
    found = out.numpy().reshape(expected.shape)
    error = np.abs(found - expected).max(axis=(1, 2, 3))
    report("largest difference", error.max())
    assert (error < 2e-6 * np.abs(expected).max(axis=(1, 2, 3))).all()
    # A wrong partner: a millisecond late.
    late = np.stack([motion.at(times + 1e-3)[:, :3] for motion in motions[1:]])
    assert np.abs(found[1:] - late).max() > 1e-4


# --- Boxes of what moves -----------------------------------------------------------------------------


def test_boxes_hold_what_moves(report: Report) -> None:
    """Throughout each slice, and they are nearly tight."""
    rng = np.random.default_rng(5)
    slack = []
    for case in range(24):
        keys = 1 + case % 4
        matrices = [random_affine(rng) for _ in range(keys)]
        motion = wrt.Motion(np.sort(rng.uniform(-0.2, 1.2, keys)), matrices, tuple(rng.uniform(-1, 1, 3)))
        times = np.array([0.0]) if case % 3 else np.array([-0.1, 0.4, 0.9])
        centers, halves = rng.uniform(-1, 1, (len(times), 3)), rng.uniform(0.05, 1.0, (len(times), 3))
        boxes = np.stack([centers - halves, centers + halves], axis=1)
        radius = float(np.linalg.norm(halves, axis=1).max())
        at = np.linspace(0.0, 1.0, 1601)
        moving = np.array([[np.interp(at, times, boxes[:, k, axis]) for axis in range(3)] for k in (0, 1)])
        moving = np.moveaxis(moving, 2, 0)
        corners = moving[:, np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)]), np.arange(3)]
        moved = motion.at(at)
        points = np.einsum("kij,knj->kni", moved[:, :3, :3], corners) + moved[:, None, :3, 3]
        for k, (low, high) in enumerate(swept_boxes(motion, times, boxes, radius, (0.0, 1.0), 8).astype(np.float64)):
            of_slice = points[200 * k : 200 * k + 201]
            least, most = of_slice.min(axis=(0, 1)), of_slice.max(axis=(0, 1))
            assert (low <= least).all()
            assert (high >= most).all()
            slack.append(float((high - low).sum() / (most - least).sum()))
    report("sides over those of the tightest boxes: mean, most", np.mean(slack), f"{np.max(slack):.3f}")
    assert np.mean(slack) < 1.06


def test_boxes_of_balls_are_those_of_balls() -> None:
    motion = wrt.Motion.rotation((1, 2, 3), 300.0, center=(1.0, 2.0, 3.0))
    box = np.array([[[0.5, 1.5, 2.5], [1.5, 2.5, 3.5]]])
    found = swept_boxes(motion, np.zeros(1), box, 0.5, (0.0, 1.0), 4)
    np.testing.assert_allclose(found, np.broadcast_to(box, (4, 2, 3)), atol=1e-4)
