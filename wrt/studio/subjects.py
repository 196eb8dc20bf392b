"""What pictures show: the subjects of a scene, how large a camera shows them, and where an animation moves them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import norm, product
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.scene import Scene, Shape
from wrt.studio.framing import CHUNK

_SURROUNDS = 3.0  # a shape this many times as large as all others together is a floor or a backdrop


def subjects(shapes: list[Shape], camera: Camera | None = None) -> list[Shape]:
    """Return the shapes that a picture of a scene is about: no lamps, floors and backdrops.

    A floor or backdrop is a shape several times as large as all smaller ones together, or catches shadows.

    Args:
        shapes: all shapes of the scene.
        camera: a camera of the scene; what is outside its picture, such as a reflector, does not count either.
    """
    candidates = [shape for shape in shapes if not (shape.emits or shape.shadow_catcher)] or list(shapes)
    if camera is not None:
        candidates = [s for s in candidates if share_of_picture(camera, s.outline, 1.5) > 0.0] or candidates
    boxes = np.stack([shape.bounds for shape in candidates])
    order = np.argsort([-norm(high - low) for low, high in boxes], kind="stable")
    for number, largest in enumerate(order[:-1]):
        smaller = boxes[order[number + 1 :]]
        extent = norm(smaller[:, 1].max(axis=0) - smaller[:, 0].min(axis=0))
        if norm(boxes[largest][1] - boxes[largest][0]) <= _SURROUNDS * extent or extent == 0.0:
            return [candidates[i] for i in sorted(order[number:])]
    return [candidates[order[-1]]]


def share_of_picture(camera: Camera, points: NDArray[Any], aspect: float) -> float:
    """Return the part of the picture's width or height that points extend over, the larger of the two; 0 to 1.

    It is 1 for cameras that are neither perspective nor orthographic, and for those with points beside or behind them:
    a camera inside a room shows it well.
    """
    right, up, forward = camera.frame()
    offset = np.asarray(points, np.float64) - np.asarray(camera.origin)
    depth, film = product(offset, forward), np.stack([product(offset, right), product(offset, up)], axis=1)
    if isinstance(camera, OrthographicCamera):
        half = 0.5 * camera.view_height
    elif isinstance(camera, PerspectiveCamera) and not (camera.shift_x or camera.shift_y or camera.distortion):
        if depth.max() <= 0.0:
            return 0.0
        if depth.min() <= 0.0:
            return 1.0
        film, half = film / depth[:, None], float(np.tan(np.radians(camera.fov_degrees) / 2.0))
        aspect *= camera.pixel_aspect
    else:
        return 1.0
    film = film / np.array([half * aspect, half])
    low, high = film.min(axis=0), film.max(axis=0)
    if (low >= 1.0).any() or (high <= -1.0).any():
        return 0.0
    low, high = np.clip(low, -1.0, 1.0), np.clip(high, -1.0, 1.0)
    return float((0.5 * (high - low)).max())


# --- Animations ------------------------------------------------------------------------------------

Points = NDArray[np.float64]


def _directions(count: int) -> Points:
    """Return the six directions of the axes, and `count` more on a spiral over the sphere (Fibonacci's)."""
    turns = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    radius = np.sqrt(1.0 - z * z)
    spiral = np.stack([radius * np.cos(turns), radius * np.sin(turns), z], axis=1)
    return np.concatenate([np.eye(3), -np.eye(3), spiral])


_DIRECTIONS = _directions(250)
"""(256, 3) every direction is within 9.3 degrees of one of them."""


@dataclasses.dataclass(frozen=True)
class Reach:
    """Where the shapes of an animation are at some of its times.

    Attributes:
        points: (N, 3) points whose convex hull contains each shape at each time, to 1 % of its size; the hull's box is
            exact.
        subjects: (M, 3) the same for the subjects alone, without lamps, floors and backdrops.
        camera: the source's camera at the first of the times, if it has one.
    """

    points: Points
    subjects: Points
    camera: Camera | None

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) the lowest and highest corner."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    def moved(self, matrix: NDArray[np.float64]) -> Reach:
        """Return it with its points transformed by a (4, 4) affine matrix; the camera stays."""
        linear, offset = matrix[:3, :3].T, matrix[:3, 3]
        return dataclasses.replace(
            self, points=product(self.points, linear) + offset, subjects=product(self.subjects, linear) + offset
        )


def reach_of(scenes: Iterable[Scene]) -> Reach:
    """Return the reach of an animation, given its scene at one or more times; all have shapes."""
    points, about, cameras = [], [], []
    for scene in scenes:
        points += [_outermost(shape.outline) for shape in scene.shapes]
        about += [_outermost(shape.outline) for shape in subjects(scene.shapes, scene.camera)]
        cameras.append(scene.camera)
    return Reach(np.concatenate(points), np.concatenate(about), cameras[0])


def _outermost(points: NDArray[np.floating[Any]]) -> Points:
    """Return the farthest of many points in each of _DIRECTIONS."""
    if len(points) <= len(_DIRECTIONS):
        return points.astype(np.float64)
    farthest = np.empty((0, 3))
    for start in range(0, len(points), CHUNK):
        candidates = np.concatenate([farthest, points[start : start + CHUNK]])
        farthest = candidates[product(candidates, _DIRECTIONS.T).argmax(axis=0)]
    return np.unique(farthest, axis=0)
