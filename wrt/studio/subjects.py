"""What a picture of a scene is about, and how large a camera shows it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import norm, product
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.scene import Shape

_SURROUNDS = 3.0  # a shape this many times as large as all others together is a floor or a backdrop


def subjects(shapes: list[Shape], camera: Camera | None = None) -> list[Shape]:
    """Return the shapes that a picture of a scene is about: no lamps, floors and backdrops.

    A floor or backdrop is a shape several times as large as all smaller ones together.

    Args:
        shapes: all shapes of the scene.
        camera: a camera of the scene; what is outside its picture, such as a reflector, does not count either.
    """
    kept = [shape for shape in shapes if not shape.emits] or list(shapes)
    if camera is not None:
        kept = [shape for shape in kept if share_of_picture(camera, shape.outline, 1.5) > 0.0] or kept
    boxes = np.stack([shape.bounds for shape in kept])
    order = np.argsort([-norm(high - low) for low, high in boxes], kind="stable")
    for number, largest in enumerate(order[:-1]):
        rest = boxes[order[number + 1 :]]
        extent = norm(rest[:, 1].max(axis=0) - rest[:, 0].min(axis=0))
        if norm(boxes[largest][1] - boxes[largest][0]) <= _SURROUNDS * extent or extent == 0.0:
            return [kept[i] for i in sorted(order[number:])]
    return [kept[order[-1]]]


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
    elif isinstance(camera, PerspectiveCamera) and not (camera.shift_x or camera.shift_y):
        if depth.max() <= 0.0:
            return 0.0
        if depth.min() <= 0.0:
            return 1.0
        film, half = film / depth[:, None], float(np.tan(np.radians(camera.fov_degrees) / 2.0))
    else:
        return 1.0
    film = film / np.array([half * aspect, half])
    low, high = film.min(axis=0), film.max(axis=0)
    if (low >= 1.0).any() or (high <= -1.0).any():
        return 0.0
    low, high = np.clip(low, -1.0, 1.0), np.clip(high, -1.0, 1.0)
    return float((0.5 * (high - low)).max())
