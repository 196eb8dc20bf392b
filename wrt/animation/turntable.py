"""Turntables: the scene turns once in front of the camera."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.linalg import norm, product
from wrt.scene.camera import Camera, PerspectiveCamera
from wrt.scene.mesh import box_around
from wrt.scene.motion import turn
from wrt.scene.scene import Scene, Shape, require_scene
from wrt.studio.framing import frame_camera
from wrt.studio.views import VIEWS, view_direction
from wrt.values import Vec3, integer, vec3

Matrix = NDArray[np.float64]

MARGIN = 1.15
"""Size of the picture over the size of the space that the subject sweeps as it turns."""

MOST_FRAMES = 100_000

_SLICES = 64
_ANGLES = 64
_VERTICAL = 0.999
"""A camera with this cosine to the vertical looks straight up or down, and is not moved."""


def turntable(scene: Scene, frames: int) -> Iterator[Scene]:
    """Yield the scenes of a turntable, one per frame; the last is one step before the first.

    In wrt's studio, where `wrt.load` puts a mesh, camera, light and backdrop stay: the shapes turn about the vertical
    axis through their middle, and the camera moves back along its direction until no frame cuts anything off. In other
    scenes the camera travels once around the vertical axis through its target, at constant height and distance; if
    camera and target are 1 m apart, as in files that give only a direction, the axis is at the depth of the scene's
    middle. A scene without a camera is framed for the whole turn. Such scenes share all their shapes, so a Renderer can
    go from one to the next by `set_camera`.

    The camera moves to the right; shapes turn clockwise seen from above, which looks the same.

    Args:
        scene: the scene. Vertical is the axis (x, y or z) nearest to the camera's up.
        frames: number of frames, at least 2.

    Raises:
        InputError: when the scene has no shapes, or its camera moves on its own.
    """
    require_scene(scene, "a turntable")
    count = integer(frames, "frames of a turntable", minimum=2, maximum=MOST_FRAMES)
    if not scene.shapes:
        raise InputError("the scene has no shapes to render")
    if scene.camera is not None and scene.camera.motion is not None:
        raise InputError("a turntable moves the camera, but the scene's camera has a motion of its own")
    make = _turned_shapes if scene.studio_shapes else _turned_camera
    return make(scene, count)


def _turned_shapes(scene: Scene, count: int) -> Iterator[Scene]:
    subjects, stage = scene.shapes[: scene.studio_shapes], scene.shapes[scene.studio_shapes :]
    points, middle = _points(subjects)
    camera = scene.camera
    if isinstance(camera, PerspectiveCamera):
        camera = _with_all_in_view(scene, camera, _swept(points, middle))
    for number in range(count):
        matrix = turn((0.0, 1.0, 0.0), -360.0 * number / count, middle)
        turned = [shape.moved(matrix) for shape in subjects] if number else subjects
        yield dataclasses.replace(scene, shapes=[*turned, *stage], camera=camera)


def _turned_camera(scene: Scene, count: int) -> Iterator[Scene]:
    points, middle = _points(scene.shapes)
    camera, axis = scene.camera, (0.0, 1.0, 0.0)
    if camera is None:
        aspect = scene.settings.width / scene.settings.height
        camera, pivot = frame_camera(_swept(points, middle), aspect), middle
    else:
        axis = _nearest_axis(camera.up)
        pivot = _pivot(camera, scene)
    for number in range(count):
        matrix = turn(axis, 360.0 * number / count, pivot)
        yield dataclasses.replace(scene, camera=_moved(camera, matrix) if number else camera)


def _points(shapes: list[Shape]) -> tuple[NDArray[Any], Matrix]:
    """Return points whose convex hull contains the shapes, and the middle of their bounding box."""
    points = np.concatenate([shape.outline for shape in shapes])
    low, high = box_around(points)
    return points, 0.5 * (np.asarray(low, np.float64) + np.asarray(high, np.float64))


def _swept(points: NDArray[Any], middle: Matrix) -> Matrix:
    """Return points whose convex hull contains the space that points sweep about the y axis through `middle`."""
    x, y, z = (np.asarray(points, np.float64) - middle).T
    radius = np.hypot(x, z)
    low, high = float(y.min()), float(y.max())
    slices = np.minimum(((y - low) / max(high - low, 1e-300) * _SLICES).astype(int), _SLICES - 1)
    largest, bottom, top = np.full(_SLICES, -1.0), np.full(_SLICES, np.inf), np.full(_SLICES, -np.inf)
    np.maximum.at(largest, slices, radius)
    np.minimum.at(bottom, slices, y)
    np.maximum.at(top, slices, y)
    used = largest >= 0.0
    rings = np.concatenate([np.stack([largest, ends], axis=1)[used] for ends in (bottom, top)])
    angles = np.arange(_ANGLES) * (2.0 * math.pi / _ANGLES)
    reach = rings[:, :1] / math.cos(math.pi / _ANGLES)  # the polygon's sides touch the circle
    heights = np.broadcast_to(rings[:, 1:], (len(rings), _ANGLES))
    rim = np.stack([reach * np.cos(angles), heights, reach * np.sin(angles)], axis=-1)
    return np.asarray(middle + rim.reshape(-1, 3))


def _with_all_in_view(scene: Scene, camera: PerspectiveCamera, points: Matrix) -> Camera:
    """Move a camera, keeping its direction, so that all points are in the picture."""
    forward = camera.frame()[2]
    if abs(float(forward[1])) > _VERTICAL:
        return camera
    aspect = scene.settings.width / scene.settings.height
    view = vec3(-forward) if forward.any() else view_direction(VIEWS["three-quarter"])[0]
    framed = frame_camera(points, aspect, view=view, fov_degrees=camera.fov_degrees, margin=MARGIN)
    return dataclasses.replace(camera, origin=framed.origin, target=framed.target, up=framed.up)


def _nearest_axis(up: Vec3) -> Vec3:
    axis = np.zeros(3)
    largest = int(np.argmax(np.abs(up)))
    axis[largest] = math.copysign(1.0, up[largest])
    return vec3(axis)


def _pivot(camera: Camera, scene: Scene) -> Matrix:
    """Return a point on the vertical axis around which a scene's own camera travels."""
    origin, target = np.array(camera.origin), np.array(camera.target)
    if abs(norm(target - origin) - 1.0) > 1e-6:
        return target
    _, middle = _points([shape for shape in scene.shapes if not shape.emits] or scene.shapes)
    depth = float(product(middle - origin, target - origin))
    return np.asarray(origin + depth * (target - origin)) if depth > 0.0 else middle


def _moved(camera: Camera, matrix: Matrix) -> Camera:
    homogeneous = (*camera.origin, 1.0), (*camera.target, 1.0), (*camera.up, 0.0)
    origin, target, up = (vec3(product(matrix, np.array(point))[:3]) for point in homogeneous)
    return dataclasses.replace(camera, origin=origin, target=target, up=up)
