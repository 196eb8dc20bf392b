"""Keyframed motion is where closed forms say, on the host and on the device."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import wrt
from wrt.kernels.geometry.motion import MotionKey, MotionRecord, transform_at
from wrt.upload.motion import motion_records

FloatArray = NDArray[np.float64]


def affine(linear: FloatArray, offset: tuple[float, ...] | FloatArray = (0.0, 0.0, 0.0)) -> FloatArray:
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = linear, offset
    return m


def turned(axis: tuple[float, ...], degrees: float) -> FloatArray:
    return np.asarray(Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix())


def random_affine(rng: np.random.Generator, *, mirrored: bool = False) -> FloatArray:
    """Return a random map of which no direction is squeezed by more than 5."""
    q, p = (Rotation.random(random_state=rng.integers(2**31)).as_matrix() for _ in range(2))
    sizes = rng.uniform(0.4, 2.0, 3) * (-1.0 if mirrored else 1.0)
    return affine(q @ np.diag(sizes) @ p, rng.uniform(-3.0, 3.0, 3))


TIMES = np.linspace(-0.5, 2.5, 61)


def test_straight_lines() -> None:
    motion = wrt.Motion.translation((1.0, -2.0, 4.0), times=(0.0, 2.0))
    for time in TIMES:
        share = min(max(time / 2.0, 0.0), 1.0)
        np.testing.assert_allclose(motion.at(time), affine(np.eye(3), (share, -2.0 * share, 4.0 * share)), atol=1e-15)


@pytest.mark.parametrize("degrees", [10.0, 90.0, 179.0, 180.0, -180.0, 725.0, -1000.0])
def test_turns_about_a_point(degrees: float) -> None:
    """Evenly, the right way round, over any number of turns; the axis stays where it is."""
    axis, center = (1.0, 2.0, -0.5), np.array([3.0, 1.0, -2.0])
    motion = wrt.Motion.rotation(axis, degrees, center=center, times=(0.0, 2.0))
    for time in TIMES:
        r = turned(axis, degrees * min(max(time / 2.0, 0.0), 1.0))
        np.testing.assert_allclose(motion.at(time), affine(r, center - r @ center), atol=1e-13)


def test_half_a_turn_between_two_keys() -> None:
    """Through slerp; both ways are as short, but it is one of them, about the right axis and even."""
    axis = (0.0, 0.6, 0.8)
    motion = wrt.Motion((0.0, 2.0), [np.eye(4), affine(turned(axis, 180.0))])
    sign = 1.0 if np.allclose(motion.at(0.5)[:3, :3], turned(axis, 45.0)) else -1.0
    for time in TIMES:
        r = turned(axis, sign * 90.0 * min(max(time, 0.0), 2.0))
        np.testing.assert_allclose(motion.at(time), affine(r), atol=1e-13)


def test_the_shorter_way() -> None:
    motion = wrt.Motion((0.0, 1.0), [np.eye(4), affine(turned((0, 0, 1), 200.0))])
    np.testing.assert_allclose(motion.at(0.5)[:3, :3], turned((0, 0, 1), -80.0), atol=1e-14)


def test_a_screw() -> None:
    axis, center, rise = np.array([0.0, 1.0, 0.0]), np.array([0.5, 0.0, -1.0]), 3.0
    motion = wrt.Motion.rotation(axis, 720.0, center=center, times=(0.0, 1.0), offset=rise * axis)
    point = np.array([2.0, 0.3, -1.0, 1.0])
    for time in np.linspace(0.0, 1.0, 33):
        angle = 4.0 * np.pi * time
        expected = [0.5 + 1.5 * np.cos(angle), 0.3 + rise * time, -1.0 - 1.5 * np.sin(angle)]
        np.testing.assert_allclose((motion.at(time) @ point)[:3], expected, atol=1e-13)


def test_growing_while_turning() -> None:
    """The stretch is linear beside the rotation, not part of it."""
    first, last = affine(np.diag([1.0, 2.0, 3.0])), affine(turned((1, 1, 0), 60.0) @ np.diag([2.0, 2.0, 1.0]))
    motion = wrt.Motion((0.0, 1.0), [first, last])
    for time in np.linspace(0.0, 1.0, 9):
        expected = turned((1, 1, 0), 60.0 * time) @ np.diag([1.0 + time, 2.0, 3.0 - 2.0 * time])
        np.testing.assert_allclose(motion.at(time)[:3, :3], expected, atol=1e-14)


def test_after_a_transform() -> None:
    first = random_affine(np.random.default_rng(5), mirrored=True)
    motion = wrt.Motion.rotation((1, 2, 0), 400.0, center=(1.0, -2.0, 3.0), offset=(0.0, 1.0, 0.0))
    for time in TIMES:
        np.testing.assert_allclose(motion.after(first).at(time), motion.at(time) @ first, atol=1e-12)


@pytest.mark.parametrize("mirrored", [False, True])
def test_keys_are_met_and_stay_invertible(mirrored: bool) -> None:
    rng = np.random.default_rng(1)
    for keys in (1, 2, 5):
        matrices = [random_affine(rng, mirrored=mirrored) for _ in range(keys)]
        times = np.cumsum(rng.uniform(0.1, 1.0, keys))
        motion = wrt.Motion(times, matrices, center=(1.0, 0.5, -2.0))
        np.testing.assert_allclose(motion.at(times), matrices, atol=1e-13)
        np.testing.assert_allclose(
            motion.at([times[0] - 1.0, times[-1] + 1.0]), [matrices[0], matrices[-1]], atol=1e-13
        )
        between = np.linalg.det(motion.at(np.linspace(times[0], times[-1], 100))[:, :3, :3])
        assert ((between < 0.0) == mirrored).all()
        assert np.abs(between).min() > 0.01


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
        wrt.Motion(
            (0.0, 0.3, 1.0, 2.0), [random_affine(rng, mirrored=True) for _ in range(4)], center=(0.5, -1.0, 2.0)
        ),
        wrt.Motion.rotation((1, 2, 3), 900.0, center=(1.0, 2.0, 0.0), times=(0.0, 2.0)),
        # Angles around where slerp gives way to a straight line.
        *(wrt.Motion.rotation((1, -2, 0.5), np.rad2deg(2.0 * half)) for half in (4e-4, 5.1e-4, 1e-3)),
        wrt.Motion((0.0, 2.0), [np.eye(4), affine(turned((0.0, 0.6, 0.8), 180.0))]),
    ]
    keys, records = motion_records(motions)
    times = np.linspace(-0.5, 2.5, 301).astype(np.float32)
    out = wp.zeros((len(motions) * len(times), 3, 4), dtype=float, device=device)
    inputs = [
        wp.array(keys, dtype=MotionKey, device=device),
        wp.array(records, dtype=MotionRecord, device=device),
        wp.array(times, dtype=float, device=device),
    ]
    wp.launch(place, dim=(len(motions), len(times)), inputs=[*inputs, out], device=device)
    expected = np.stack([motion.at(times)[:, :3] for motion in motions])
    error = np.abs(out.numpy().reshape(expected.shape) - expected).max(axis=(1, 2, 3))
    report("largest difference", error.max())
    assert (error < 2e-6 * np.abs(expected).max(axis=(1, 2, 3))).all()
    # A wrong partner: a few milliseconds late.
    late = np.stack([motion.at(times + 1e-3)[:, :3] for motion in motions[1:]])
    assert np.abs(out.numpy().reshape(expected.shape)[1:] - late).max() > 1e-4


@pytest.mark.parametrize(
    ("times", "transforms", "message"),
    [
        ([], np.zeros((0, 4, 4)), "one or more"),
        ([0.0, 0.0], [np.eye(4), np.eye(4)], "ascend"),
        ([0.0, np.nan], [np.eye(4), np.eye(4)], "finite"),
        ([0.0], [np.eye(3)], r"\(1, 4, 4\)"),
        ([0.0], [np.diag([1.0, 1.0, 0.0, 1.0])], "not invertible"),
        ([0.0], [np.diag([1.0, 1.0, 1.0, 2.0])], "affine"),
        ([0.0], [np.diag([np.inf, 1.0, 1.0, 1.0])], "finite"),
        ([0.0, 1.0], [np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])], "mirrors"),
    ],
)
def test_what_is_no_motion(times: list[float], transforms: object, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.Motion(times, transforms)  # type: ignore[arg-type]
