"""Cameras and lights of glTF files.

Format: Khronos Group 2021, "glTF 2.0 Specification", sections 3.5.3 and 3.10; KHR_lights_punctual. Candela are taken as
watts per steradian and lux as watts per square metre, as in most viewers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.io.gltf.buffers import Tree
from wrt.linalg import norm, product
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.lights import DirectionalLight, Light, PointLight, SpotLight

Matrix = NDArray[np.float64]

_DEEPEST = 256
"""Depth of the node tree above which it is taken for a cycle."""


def cameras_of(tree: Tree) -> list[Camera]:
    """Return the scene's cameras in node order, without their aspect ratios: the picture has its own."""
    found: list[Camera] = []
    for node, world in nodes_of(tree):
        if "camera" in node:
            described = tree["cameras"][node["camera"]]
            place = _view(world)
            if described["type"] == "orthographic":
                height = 2.0 * abs(described["orthographic"]["ymag"])
                found.append(OrthographicCamera(**place, view_height=height))
            else:
                fov = math.degrees(described["perspective"]["yfov"])
                found.append(PerspectiveCamera(**place, fov_degrees=fov))
    return found


def lights_of(tree: Tree) -> list[Light]:
    """Return the scene's punctual lights in node order."""
    found: list[Light] = []
    described = tree.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])
    for node, world in nodes_of(tree):
        reference = node.get("extensions", {}).get("KHR_lights_punctual")
        if reference is None:
            continue
        light = described[reference["light"]]
        amount = np.asarray(light.get("color", (1.0, 1.0, 1.0)), np.float64) * light.get("intensity", 1.0)
        strength = tuple(amount.tolist())
        position, direction = tuple(world[:3, 3].tolist()), tuple((-world[:3, 2]).tolist())
        if light["type"] == "directional":
            found.append(DirectionalLight(direction, irradiance=strength))
        elif light["type"] == "spot":
            cone = light.get("spot", {})
            inner, outer = cone.get("innerConeAngle", 0.0), cone.get("outerConeAngle", math.pi / 4.0)
            found.append(
                SpotLight(
                    position,
                    direction,
                    intensity=strength,
                    inner_degrees=math.degrees(inner),
                    outer_degrees=math.degrees(outer),
                    falloff="gltf",
                )
            )
        else:
            found.append(PointLight(position, intensity=strength))
    return found


def nodes_of(tree: Tree) -> Iterator[tuple[Tree, Matrix]]:
    """Yield every node of the file's scene, parents first, with its (4, 4) transform to the world.

    Raises:
        InputError: where nodes form a circle.
    """
    nodes = tree.get("nodes", [])
    scenes = tree.get("scenes", [])
    roots = scenes[tree.get("scene", 0)].get("nodes", []) if scenes else []
    waiting = [(nodes[number], np.eye(4), 0) for number in reversed(roots)]
    while waiting:
        node, parent, level = waiting.pop()
        if level > _DEEPEST:
            raise InputError("the nodes form a circle, or lie more than 256 deep")
        with np.errstate(all="ignore"):  # not-a-number is reported where it is used
            world = product(parent, _local(node))
        yield node, world
        waiting += [(nodes[child], world, level + 1) for child in reversed(node.get("children", []))]


def _local(node: Tree) -> Matrix:
    """Return a node's local transform: a column-major matrix, or translation times rotation times scale."""
    if "matrix" in node:
        return np.asarray(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.asarray(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), np.float64)
    result = np.eye(4)
    result[:3, :3] = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    result[:3, :3] *= np.asarray(node.get("scale", (1.0, 1.0, 1.0)), np.float64)
    result[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return result


def _view(world: Matrix) -> dict[str, Any]:
    """Return `origin`, `target` and `up` of a camera that looks along the −z axis of its node."""
    origin = world[:3, 3]
    length = norm(world[:3, 2])
    if length == 0.0:
        raise InputError("a camera hangs on a node that is scaled to nothing")
    forward = -world[:3, 2] / length
    return {
        "origin": tuple(origin.tolist()),
        "target": tuple((origin + forward).tolist()),
        "up": tuple(world[:3, 1].tolist()),
    }
