"""Camera matrices of computer vision: poses and intrinsics as fields of wrt's cameras.

OpenCV's axes of a camera are x right, y down, z forward, and OpenGL's x right, y up, z backward. Intrinsics follow
OpenCV's documentation ("Camera Calibration and 3D Reconstruction"): a point (x, y, 1) along the camera's axes is at the
pixel (fx x + cx, fy y + cy).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.linalg import determinant, norm, polar, product
from wrt.scene.motion import rotation_matrix
from wrt.values import array, number, one_of, vec3

CONVENTIONS = ("opengl", "opencv")
"""Axes of a camera: x right, y up and z backward, or x right, y down and z forward."""

_ORTHONORMAL = 1e-3
"""Tolerance for the products of a rotation's columns, as files may round its entries to four digits."""

_Matrix = NDArray[np.float64]


def pose_of_matrix(matrix: ArrayLike, convention: str) -> dict[str, Any]:
    """Return `origin`, `target` and `up` of a camera, given its (4, 4) or (3, 4) rigid transform to the world."""
    one_of(convention, CONVENTIONS, "convention")
    values = _finite(matrix, "the camera's matrix", (4, 4), (3, 4))
    if values.shape == (4, 4) and not np.array_equal(values[3], (0.0, 0.0, 0.0, 1.0)):
        raise InputError(f"the last row of the camera's matrix must be 0, 0, 0, 1, not {_listed(values[3])}")
    axes = _rotation(values[:, :3][:3], "the camera's matrix")
    return _pose(values[:3, 3], axes if convention == "opencv" else axes * (1.0, -1.0, -1.0))


def pose_of_extrinsics(rotation: ArrayLike, translation: ArrayLike) -> dict[str, Any]:
    """Return `origin`, `target` and `up` of a camera, given R and t from the world to OpenCV's axes of the camera.

    R is a (3, 3) matrix, or a rotation vector of three numbers, whose length is the angle in radians.
    """
    turn = _finite(rotation, "R", (3, 3), (3,), (3, 1), (1, 3))
    if turn.size == 3:
        angle = norm(turn.ravel())
        turn = rotation_matrix(turn.ravel(), math.degrees(angle)) if angle > 0.0 else np.eye(3)
    axes = _rotation(turn, "R").T
    return _pose(-product(axes, _finite(translation, "t", (3,), (3, 1), (1, 3)).ravel()), axes)


@dataclass(frozen=True)
class Intrinsics:
    """Focal lengths and the principal point of pictures of a size, pixels; (0, 0) is the corner of the picture."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @classmethod
    def of_matrix(cls, matrix: ArrayLike, width: int, height: int, pixel_center: float) -> Intrinsics:
        """Take a (3, 3) matrix; `pixel_center` is the middle of the first pixel on either axis. A skew is refused."""
        k = _finite(matrix, "K", (3, 3))
        fx = number(k[0, 0], "K[0, 0], the focal length fx,", above=0.0)
        fy = number(k[1, 1], "K[1, 1], the focal length fy,", above=0.0)
        if abs(k[0, 1]) > 1e-6 * fx:
            raise InputError(f"K has a skew of {k[0, 1]:g} pixels, which wrt's cameras do not have: K[0, 1] must be 0")
        if k[1, 0] != 0.0 or not np.array_equal(k[2], (0.0, 0.0, 1.0)):
            raise InputError(f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], not {_listed(k)}")
        corner = 0.5 - number(pixel_center, "pixel_center")
        return cls(fx, fy, float(k[0, 2]) + corner, float(k[1, 2]) + corner, width, height)

    def film(self) -> dict[str, Any]:
        """Return fields of a camera: the aspect of its pixels and its shift in picture heights."""
        aspect = self.fy / self.fx
        return {
            "pixel_aspect": aspect,
            "shift_x": aspect * (0.5 * self.width - self.cx) / self.height,
            "shift_y": (self.cy - 0.5 * self.height) / self.height,
        }


def _pose(origin: _Matrix, axes: _Matrix) -> dict[str, Any]:
    """Return the fields of a camera, given its place and OpenCV's axes as columns."""
    return {"origin": vec3(origin), "target": vec3(origin + axes[:, 2]), "up": vec3(-axes[:, 1])}


def _finite(value: ArrayLike, name: str, *shapes: tuple[int, ...]) -> _Matrix:
    """Return float64 values of one of several shapes, or raise InputError."""
    values = array(value, name, np.float64)
    if values.shape not in shapes:
        raise InputError(f"{name} must be {' or '.join(map(str, shapes))}, not {values.shape}")
    if not np.isfinite(values).all():
        raise InputError(f"{name} must be finite")
    return values


def _rotation(matrix: _Matrix, name: str) -> _Matrix:
    """Return the rotation nearest to one that was rounded; raise InputError if it is none."""
    error = np.abs(product(matrix.T, matrix) - np.eye(3)).max()
    if error > _ORTHONORMAL:
        raise InputError(f"{name} must have orthonormal columns; their products are off by {error:.2g}")
    if determinant(matrix) < 0.0:
        raise InputError(f"{name} must be a rotation, not a reflection: its determinant is negative")
    return polar(matrix)[0]


def _listed(values: _Matrix) -> str:
    return str(values.tolist())
