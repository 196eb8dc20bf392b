"""Motion of objects and cameras by keyframes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.linalg import determinant, dot, inverse, norm, polar, product
from wrt.values import Vec3, array, key_times, number, pair, sealed, vector

FloatArray = NDArray[np.float64]

_LONGEST_TURN = 120.0
"""Degrees between two keys of `Motion.rotation`; beyond 180, interpolation would turn the other way."""


class MotionParts(NamedTuple):
    """Polar decomposition of affine maps: x goes to position + rotation · stretch · (x − center).

    Attributes:
        rotations: (K, 4) unit quaternions (x, y, z, w), each in the hemisphere of the one before.
        stretches: (K, 3, 3) symmetric matrices, positive definite, or negative definite for mirror images.
        positions: (K, 3) positions of the centre.
    """

    rotations: FloatArray
    stretches: FloatArray
    positions: FloatArray


@dataclass(frozen=True, eq=False)
class Motion:
    """Interpolated affine keyframes.

    Each key is split into a translation, a rotation and a stretch by polar decomposition (Shoemake and Duff, "Matrix
    Animation and Polar Decomposition", 1992). Between two keys the centre moves on a straight line, the stretch changes
    linearly and the rotation takes the shorter way at constant speed (slerp, Shoemake 1985). Before the first key and
    after the last nothing moves.

    Attributes:
        times: (K,) seconds, ascending; at least one.
        transforms: (K, 4, 4) from object space to the world.
        center: centre of rotation in object space; it moves on straight lines.

    Raises:
        InputError: if shapes are wrong, values are not finite, times do not ascend, a matrix is not affine or not
            invertible, or a key mirrors the one before.
    """

    times: FloatArray
    transforms: FloatArray = field(repr=False)
    center: Vec3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        times = key_times(self.times, "motion")
        matrices = array(self.transforms, "motion transforms", np.float64).copy()
        if matrices.shape != (len(times), 4, 4):
            raise InputError(f"motion transforms must be ({len(times)}, 4, 4), one per key, not {matrices.shape}")
        for k, matrix in enumerate(matrices):
            check_affine(matrix, f"motion transform {k}")
        mirrored = determinant(matrices[:, :3, :3]) < 0.0
        turned = np.flatnonzero(mirrored[1:] != mirrored[:-1])
        if len(turned):
            raise InputError(
                f"motion transform {turned[0] + 1} mirrors the one before: between them, shapes would become flat"
            )
        for values, name in ((times, "times"), (matrices, "transforms")):
            object.__setattr__(self, name, sealed(values))
        object.__setattr__(self, "center", vector(self.center, "motion center"))

    @classmethod
    def translation(cls, offset: ArrayLike, times: Sequence[float] = (0.0, 1.0)) -> Motion:
        """Return the translation by `offset`, metres, between two times."""
        end = np.eye(4)
        end[:3, 3] = vector(offset, "offset")
        return cls(np.array(pair(times, "times")), np.stack([np.eye(4), end]))

    @classmethod
    def rotation(
        cls,
        axis: ArrayLike,
        degrees: float,
        center: ArrayLike = (0.0, 0.0, 0.0),
        times: Sequence[float] = (0.0, 1.0),
        offset: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Motion:
        """Return a rotation at constant speed about an axis through `center` between two times.

        Args:
            axis: of any length but zero; counter-clockwise seen from its tip.
            degrees: angle, which may exceed a full turn.
            center: a point on the axis, metres.
            times: begin and end, seconds.
            offset: translation of the centre between the two times, metres.
        """
        begin, end = pair(times, "times")
        keys = 1 + max(1, math.ceil(abs(number(degrees, "degrees")) / _LONGEST_TURN))
        pivot, shift = np.array(vector(center, "center")), np.array(vector(offset, "offset"))
        matrices = np.tile(np.eye(4), (keys, 1, 1))
        for matrix, share in zip(matrices, np.linspace(0.0, 1.0, keys), strict=True):
            matrix[:3, :3] = rotation_matrix(axis, share * degrees)
            matrix[:3, 3] = pivot + share * shift - product(matrix[:3, :3], pivot)
        return cls(np.linspace(begin, end, keys), matrices, tuple(pivot))

    def after(self, matrix: ArrayLike) -> Motion:
        """Return this motion preceded by a (4, 4) affine matrix.

        If the keys are rigid, the result equals the matrix followed by this motion at every time.
        """
        first = affine_matrix(matrix, "a transform")
        center = product(inverse(first), np.append(self.center, 1.0))[:3]
        return Motion(self.times, product(self.transforms, first), tuple(center.tolist()))

    @property
    def is_rigid(self) -> bool:
        """Whether no key stretches or mirrors."""
        return np.allclose(self.parts.stretches, np.eye(3), atol=1e-9)

    @cached_property
    def parts(self) -> MotionParts:
        """The decomposed keys."""
        linear = self.transforms[:, :3, :3]
        sign = np.sign(determinant(linear))[:, None, None]
        orthogonal, stretches = polar(linear)
        rotations = np.stack([_quaternion(r) for r in sign * orthogonal])
        for k in range(1, len(rotations)):
            if dot(rotations[k], rotations[k - 1]) < 0.0:
                rotations[k] = -rotations[k]
        positions = product(linear, np.array(self.center)) + self.transforms[:, :3, 3]
        return MotionParts(rotations, sign * stretches, positions)

    @cached_property
    def half_angles(self) -> FloatArray:
        """(K,) half the angle from each key's rotation to the next, radians, at most π/2; 0 for the last key."""
        q = self.parts.rotations
        # atan2, since the arc cosine of a dot product near 1 is inaccurate.
        chord, across = np.linalg.norm(q[1:] - q[:-1], axis=1), np.linalg.norm(q[1:] + q[:-1], axis=1)
        return np.append(2.0 * np.arctan2(chord, across), 0.0)

    @property
    def moves(self) -> bool:
        """Whether any two keys differ."""
        return bool((self.transforms != self.transforms[0]).any())

    def at(self, time: ArrayLike) -> FloatArray:
        """Return the (4, 4) transform at a time in seconds, or (N, 4, 4) at N times."""
        t = np.asarray(time, dtype=np.float64)
        flat = np.atleast_1d(t)
        first, share = segments(self.times, flat)
        second = np.minimum(first + 1, len(self.times) - 1)
        rotations, stretches, positions = self.parts
        half = self.half_angles[first]
        sine = np.sin(half)
        even = sine > 1e-6
        safe = np.where(even, sine, 1.0)
        w0 = np.where(even, np.sin((1.0 - share) * half) / safe, 1.0 - share)
        w1 = np.where(even, np.sin(share * half) / safe, share)
        q = w0[:, None] * rotations[first] + w1[:, None] * rotations[second]
        f = share[:, None, None]
        linear = product(_matrices(q), (1.0 - f) * stretches[first] + f * stretches[second])
        position = (1.0 - f[:, 0]) * positions[first] + f[:, 0] * positions[second]
        result = np.tile(np.eye(4), (len(flat), 1, 1))
        result[:, :3, :3] = linear
        result[:, :3, 3] = position - product(linear, np.array(self.center))
        return result.reshape(*t.shape, 4, 4)


def segments(times: FloatArray, at: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the index of the key before each time, and the fraction of the way to the next key, 0 to 1."""
    first = np.clip(np.searchsorted(times, at, side="right") - 1, 0, max(len(times) - 2, 0))
    length = np.diff(times, append=times[-1] + 1.0)
    return first, np.clip((at - times[first]) / length[first], 0.0, 1.0)


def check_affine(matrix: FloatArray, name: str) -> None:
    """Raise InputError unless a (4, 4) matrix is affine and invertible and float32 can hold it and its inverse."""
    if not np.isfinite(matrix).all():
        raise InputError(f"{name} must be finite numbers")
    if (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
        raise InputError(f"{name} must be affine: its last row must be 0 0 0 1, not {matrix[3].tolist()}")
    if determinant(matrix[:3, :3]) == 0.0:
        raise InputError(f"{name} is not invertible")
    with np.errstate(over="ignore"):
        rounded = np.concatenate([matrix, inverse(matrix)]).astype(np.float32)
    if not np.isfinite(rounded).all():
        raise InputError(f"{name} scales by over 1e38 or by under 1e-38")


def affine_matrix(value: object, name: str, alternative: str = "") -> FloatArray:
    """Return `value` as a read-only affine (4, 4) matrix, or raise InputError, which may name an alternative to it."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a (4, 4) matrix{alternative}, not {type(value).__name__}") from None
    if matrix.shape != (4, 4):
        raise InputError(f"{name} must be a (4, 4) matrix{alternative}, not an array of {matrix.shape}")
    check_affine(matrix, name)
    return sealed(matrix)


def rotation_matrix(axis: Any, degrees: Any) -> FloatArray:
    """Return the (3, 3) rotation about an axis of any length but zero (Rodrigues' formula)."""
    x, y, z = vector(axis, "axis")
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        raise InputError("axis must not be zero")
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / length
    angle = np.deg2rad(number(degrees, "degrees"))
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * product(k, k))


def turn(axis: Any, degrees: Any, pivot: ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    """Return the (4, 4) rotation about an axis through a pivot."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(axis, degrees)
    matrix[:3, 3] = np.asarray(pivot) - product(matrix[:3, :3], np.asarray(pivot))
    return matrix


def _quaternion(r: FloatArray) -> FloatArray:
    """Return the unit quaternion (x, y, z, w) of a rotation, from its largest component (Shepperd 1978)."""
    squares = np.array(
        [
            1.0 + r[0, 0] - r[1, 1] - r[2, 2],
            1.0 - r[0, 0] + r[1, 1] - r[2, 2],
            1.0 - r[0, 0] - r[1, 1] + r[2, 2],
            1.0 + r[0, 0] + r[1, 1] + r[2, 2],
        ]
    )
    # Row k holds the products 4 q_k (x, y, z, w).
    a, b, c = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    xy, xz, yz = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
    x, y, z, w = squares
    products = np.array([[x, xy, xz, a], [xy, y, yz, b], [xz, yz, z, c], [a, b, c, w]])
    row = products[int(np.argmax(squares))]
    return np.asarray(row / norm(row))


def _matrices(q: FloatArray) -> FloatArray:
    """Return (N, 3, 3) rotations of (N, 4) quaternions of any length."""
    x, y, z, w = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
