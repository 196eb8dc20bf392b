"""A studio for bare meshes: ground, backdrop, key light, fill light and camera."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.linalg import norm, product
from wrt.scene.camera import Camera
from wrt.scene.environment import ConstantEnvironment, Environment
from wrt.scene.materials import Diffuse
from wrt.scene.mesh import Mesh, single
from wrt.scene.motion import rotation_matrix
from wrt.scene.scene import RenderSettings, Scene, Shape
from wrt.scene.shapes import quad
from wrt.studio.framing import frame_camera
from wrt.studio.ground import ground_height
from wrt.studio.subjects import Reach
from wrt.studio.views import VIEWS, azimuth_of, view_angles, view_direction
from wrt.values import vec3

SETTINGS = RenderSettings(width=960, height=720, spp=128)
KEY_RADIANCE = 12.5
FILL_RADIANCE = 0.36
NEUTRAL_KEY, NEUTRAL_FILL = 6.0, 0.7
"""The same for glTF, whose viewers light by a bright neutral environment: metals reflect it, and shadows are faint."""

GROUND_REFLECTANCE = 0.55
FOV_DEGREES = 24.0
MARGIN = 1.3
"""Size of the picture over the size of the object."""

UP_ROTATIONS = {
    "x": ((0.0, 0.0, 1.0), 90.0),
    "-x": ((0.0, 0.0, 1.0), -90.0),
    "y": ((1.0, 0.0, 0.0), 0.0),
    "-y": ((1.0, 0.0, 0.0), 180.0),
    "z": ((1.0, 0.0, 0.0), -90.0),
    "-z": ((1.0, 0.0, 0.0), 90.0),
}
"""Axis and degrees of the rotation that turns each up axis into +y."""


_SIZES = 2.0**-4, 2.0**16
"""Range of scene sizes, metres; beyond, ray offsets and squared distances lose precision."""


def present(
    shapes: list[Shape],
    *,
    up: str = "y",
    rescale: bool = True,
    view: object = "three-quarter",
    aspect: float | None = None,
    camera: Camera | None = None,
    environment: Environment | None = None,
    backdrop: bool = True,
    reach: Reach | None = None,
    neutral: bool = False,
    shadow_catcher: bool = False,
) -> Scene:
    """Return a studio scene around `shapes`, which stand on a sweep and are lit softly from the upper left.

    Sweep and light turn about the vertical axis with the camera, so that every view is lit from the camera's side. A
    camera below the horizon has no sweep before it, and its light comes from below.

    Args:
        shapes: the shapes to show; they are only rotated, to bring `up` to +y.
        up: the axis of the shapes' own coordinates that points up: x, y, z, -x, -y or -z.
        rescale: whether to scale shapes of less than 6 cm or more than 65 km across to about a metre, by a power of
            two.
        view: where the camera is, see `wrt.studio.views`.
        aspect: width of the picture over its height; by default that of SETTINGS.
        camera: a camera to use as it is, instead of `view`.
        environment: lights the shapes instead of the studio's lamp and backdrop; the floor is then flat.
        backdrop: whether there is a sweep or floor.
        reach: what an animation of the shapes shows; the studio and the camera are as for all of that.
        neutral: whether more of the light comes from all sides, as in viewers of glTF.
        shadow_catcher: whether there is a flat floor instead that catches shadows, whatever `backdrop`.

    Raises:
        InputError: if the axis or the view is unknown, or there are no shapes.
    """
    to_y = _turn_to_y(up)
    if not shapes:
        raise InputError("there is nothing to show: no shapes")
    azimuth, elevation = view_angles(view)
    if up != "y":
        shapes = [shape.moved(to_y) for shape in shapes]
        reach = reach and reach.moved(to_y)
    scene = Scene(shapes=list(shapes), settings=dataclasses.replace(SETTINGS), studio_shapes=len(shapes))
    low, high = scene.bounds if reach is None else reach.bounds
    size = norm(high - low)
    if size == 0.0:
        raise InputError("there is nothing to show: all vertices are in one place")
    if rescale and not _SIZES[0] <= size <= _SIZES[1]:
        factor = 2.0 ** -round(math.log2(size))
        scaling = np.diag([factor, factor, factor, 1.0])
        scene.shapes = [shape.moved(scaling) for shape in scene.shapes]
        reach = reach and reach.moved(scaling)
        low, high = scene.bounds if reach is None else reach.bounds
        size = norm(high - low)
    center = 0.5 * (low + high)

    if camera is None:
        points = np.concatenate([shape.outline for shape in scene.shapes]) if reach is None else reach.points
        toward, upwards = view_direction(view)
        shown = SETTINGS.width / SETTINGS.height if aspect is None else aspect
        camera = frame_camera(points, shown, view=toward, up=upwards, fov_degrees=FOV_DEGREES, margin=MARGIN)
    else:
        at_first = camera if reach is None or reach.camera is None else reach.camera
        azimuth, elevation = azimuth_of(at_first, center), 0.0
    scene.camera = camera
    floor = np.array([center[0], ground_height(scene.shapes, float(low[1]), float(size)), center[2]])
    turn = _turn((0.0, 1.0, 0.0), azimuth - VIEWS["three-quarter"][0])
    if shadow_catcher:
        scene.settings.transparent = True
    if elevation >= 0.0 and (shadow_catcher or backdrop):
        is_flat = shadow_catcher or environment is not None
        ground = _floor(floor, size) if is_flat else _sweep(floor, size, turn)
        looks = {"material": Diffuse(GROUND_REFLECTANCE), "name": "ground", "edges": False}
        scene.add(ground, **looks, shadow_catcher=shadow_catcher)
    if environment is not None:
        scene.environment = environment
        return scene
    scene.environment = ConstantEnvironment(NEUTRAL_FILL if neutral else FILL_RADIANCE)
    key = NEUTRAL_KEY if neutral else KEY_RADIANCE
    scene.shapes.append(_key_light(center, size, turn, key, below=elevation < 0.0))
    return scene


def upright(scene: Scene, up: str) -> Scene:
    """Return a scene of a file without lights, its shapes and cameras turned to bring the axis `up` to +y."""
    matrix = _turn_to_y(up)

    def turned(camera: Camera) -> Camera:
        directions = {name: np.array(getattr(camera, name)) for name in ("origin", "target", "up")}
        fields: dict[str, Any] = {name: vec3(product(matrix[:3, :3], row)) for name, row in directions.items()}
        return dataclasses.replace(camera, **fields)

    cameras = {name: turned(camera) for name, camera in scene.cameras.items()}
    camera = next((cameras[name] for name, each in scene.cameras.items() if each is scene.camera), None)
    return dataclasses.replace(
        scene, shapes=[shape.moved(matrix) for shape in scene.shapes], camera=camera, cameras=cameras
    )


def _turn_to_y(up: str) -> NDArray[np.float64]:
    """Return the (4, 4) rotation that brings an axis to +y."""
    return _turn(*UP_ROTATIONS[up])


def _turn(axis: tuple[float, float, float], degrees: float) -> NDArray[np.float64]:
    """Return the (4, 4) rotation by an angle about an axis through the origin."""
    turn = np.eye(4)
    if degrees:
        turn[:3, :3] = rotation_matrix(axis, degrees)
    return turn


def _key_light(center: np.ndarray, size: float, turn: NDArray[np.float64], radiance: float, *, below: bool) -> Shape:
    """Return a lamp as wide as the object, in front at the upper left, or the lower left; it makes soft shadows."""
    toward = product(turn[:3, :3], np.array([-0.75, -1.15 if below else 1.15, 0.8]))
    toward /= norm(toward)
    side = np.cross([0.0, 1.0, 0.0], toward)
    side /= norm(side)
    lift = np.cross(toward, side)
    place = center + 1.9 * size * toward
    corner = place - 0.5 * size * side - 0.5 * size * lift
    lamp = quad(tuple(corner), tuple(size * lift), tuple(size * side))
    return Shape(lamp, Diffuse(0.0), radiance, name="key light", edges=False)


def _floor(floor: np.ndarray, size: float) -> Mesh:
    """Return a flat floor that ends far behind what a camera sees of it."""
    half = 60.0 * size
    corner = floor + np.array([-half, 0.0, half])
    return quad(tuple(corner), (2.0 * half, 0.0, 0.0), (0.0, 0.0, -2.0 * half))


def _sweep(floor: np.ndarray, size: float, turn: NDArray[np.float64]) -> Mesh:
    """Return a studio backdrop: a floor that curves up into a wall behind, smooth along the curve."""
    width, front, back, radius, height = 30.0 * size, 12.0 * size, 3.2 * size, 2.2 * size, 14.0 * size
    angles = np.linspace(0.0, math.pi / 2.0, 65)
    z = np.concatenate([[front], -back - radius * np.sin(angles), [-back - radius]])
    y = np.concatenate([[0.0], radius * (1.0 - np.cos(angles)), [height]])
    normal_y = np.concatenate([[1.0], np.cos(angles), [0.0]])
    normal_z = np.concatenate([[0.0], np.sin(angles), [1.0]])
    n = len(z)
    vertices = np.zeros((2 * n, 3))
    vertices[:n, 0], vertices[n:, 0] = -width / 2.0, width / 2.0
    vertices[:, 1], vertices[:, 2] = np.tile(y, 2), np.tile(z, 2)
    normals = np.stack([np.zeros(2 * n), np.tile(normal_y, 2), np.tile(normal_z, 2)], axis=1)
    i = np.arange(n - 1)
    faces = np.concatenate([np.stack([i, i + n, i + n + 1], 1), np.stack([i, i + n + 1, i + 1], 1)])
    rotation = turn[:3, :3].T
    vertices, normals = product(vertices, rotation) + floor, product(normals, rotation)
    return Mesh(single(vertices), faces, normals.astype(np.float32), name="sweep")
