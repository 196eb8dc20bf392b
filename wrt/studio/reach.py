"""What an animation shows at all its times: a studio and a camera made for it can stay."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import product
from wrt.scene.camera import Camera
from wrt.scene.scene import Scene
from wrt.studio.framing import CHUNK
from wrt.studio.subjects import subjects

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
        points: (N, 3) points whose convex hull contains each shape at each time, but for 1 % of its size at most;
            the hull's box is exact.
        subjects: (M, 3) those of what the pictures are about, without lamps, floors and backdrops.
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
    """Return the reach of what is shown by a scene or more, of several times; all have shapes."""
    points, about, cameras = [], [], []
    for scene in scenes:
        points += [_outermost(shape.outline) for shape in scene.shapes]
        about += [_outermost(shape.outline) for shape in subjects(scene.shapes, scene.camera)]
        cameras.append(scene.camera)
    return Reach(np.concatenate(points), np.concatenate(about), cameras[0])


def _outermost(points: NDArray[np.floating[Any]]) -> Points:
    """Return those of many points that lie farthest in each of _DIRECTIONS."""
    if len(points) <= len(_DIRECTIONS):
        return points.astype(np.float64)
    kept = np.empty((0, 3))
    for start in range(0, len(points), CHUNK):
        both = np.concatenate([kept, points[start : start + CHUNK]])
        kept = both[product(both, _DIRECTIONS.T).argmax(axis=0)]
    return np.unique(kept, axis=0)
