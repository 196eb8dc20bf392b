"""Cameras of COLLADA files, which trimesh does not keep.

Format: Khronos Group 2008, "COLLADA: Digital Asset Schema Release 1.4.1". A camera looks along −z of its node.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.mesh.parts import viewpoint
from wrt.linalg import norm, product
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.motion import turn

Matrix = NDArray[np.float64]

_SIDES = {"perspective": ("xfov", "yfov"), "orthographic": ("xmag", "ymag")}
"""The elements of the width and the height of each kind of camera: degrees, or half the size of the view."""

_USUAL_ASPECT = 16.0 / 9.0
"""Width over height of a picture whose file gives its width alone."""


def cameras_of(root: Any) -> list[tuple[str, Camera]]:
    """Return names and cameras of a document's scene, in metres, in the order of their nodes."""
    described = {each.get("id"): each for each in root.iter("{*}camera")}
    if not described:
        return []
    unit = root.find("{*}asset/{*}unit")
    metres = float("1" if unit is None else unit.get("meter", "1"))
    cameras = []
    for node, matrix in _nodes(root, np.diag([metres, metres, metres, 1.0])):
        for instance in node.iterchildren("{*}instance_camera"):
            camera = described.get(instance.get("url", "")[1:])
            if camera is None:
                raise InputError(f"its camera {instance.get('url')!r} is not there")
            name = node.get("name") or node.get("id") or camera.get("name") or ""
            cameras.append((name, _camera(camera, matrix, metres)))
    return cameras


def _nodes(root: Any, world: Matrix) -> Iterator[tuple[Any, Matrix]]:
    """Yield the nodes of the scene with their (4, 4) transforms to the world, parents first."""
    nodes = {each.get("id"): each for each in root.iter("{*}node")}
    scenes = {each.get("id"): each for each in root.iter("{*}visual_scene")}
    instance = root.find("{*}scene/{*}instance_visual_scene")
    scene = None if instance is None else scenes.get(instance.get("url", "")[1:])
    waiting = [] if scene is None else [(each, world, frozenset[str]()) for each in scene.iterchildren("{*}node")][::-1]
    while waiting:
        node, above, within = waiting.pop()
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE)  # instances may multiply
        matrix = product(above, local_matrix(node))
        yield node, matrix
        inner = [(each, matrix, within) for each in node.iterchildren("{*}node")]
        for instance in node.iterchildren("{*}instance_node"):
            name = instance.get("url", "")[1:]
            if name in within:
                raise InputError(f"its node {name!r} is within itself")
            if name in nodes:  # the library names others
                inner.append((nodes[name], matrix, within | {name}))
        waiting += inner[::-1]


def local_matrix(node: Any) -> Matrix:
    """Return (4, 4) the product of a node's transforms, in the order of the file; a skew is left out."""
    matrix = np.eye(4)
    for element in node.iterchildren(tag="{*}*"):
        kind = element.tag.rpartition("}")[2]
        if kind not in ("matrix", "translate", "rotate", "scale", "lookat"):
            continue
        numbers = np.array((element.text or "").split(), np.float64)
        move = np.eye(4)
        if kind == "matrix":
            move = numbers.reshape(4, 4)
        elif kind == "translate":
            move[:3, 3] = numbers
        elif kind == "scale":
            move[range(3), range(3)] = numbers
        elif kind == "rotate":
            move = turn(numbers[:3].tolist(), float(numbers[3]))
        else:
            move = look_at(*numbers.reshape(3, 3))
        matrix = product(matrix, move)
    return matrix


def look_at(eye: Matrix, target: Matrix, up: Matrix) -> Matrix:
    """Return the (4, 4) place of what is at `eye` and whose −z axis points to `target`."""
    back = eye - target
    right = np.cross(up, back)
    columns = [right / norm(right), np.cross(back, right) / norm(np.cross(back, right)), back / norm(back), eye]
    return np.vstack([np.column_stack(columns), [0.0, 0.0, 0.0, 1.0]])


def _camera(described: Any, matrix: Matrix, metres: float) -> Camera:
    optics = described.find("{*}optics/{*}technique_common")
    for kind, sides in _SIDES.items():
        if (lens := optics.find(f"{{*}}{kind}")) is None:
            continue
        width, height, aspect = (_number(lens, name) for name in (*sides, "aspect_ratio"))
        if height is None and width is None:
            raise InputError(f"its camera {described.get('id')!r} has neither {sides[0]} nor {sides[1]}")
        is_flat = kind == "orthographic"
        if height is None and width is not None:
            ratio = aspect or _USUAL_ASPECT
            tangent = math.tan(math.radians(0.5 * width)) / ratio
            height = width / ratio if is_flat else 2.0 * math.degrees(math.atan(tangent))
        assert height is not None
        if is_flat:
            return OrthographicCamera(**viewpoint(matrix), view_height=2.0 * abs(height) * metres)
        return PerspectiveCamera(**viewpoint(matrix), fov_degrees=height)
    raise InputError(f"its camera {described.get('id')!r} is neither perspective nor orthographic")


def _number(lens: Any, name: str) -> float | None:
    text = lens.findtext(f"{{*}}{name}")
    return None if text is None else float(text)
