"""Nodes, cameras and lights of glTF files.

Format: Khronos Group 2021, "glTF 2.0 Specification", sections 3.5 and 3.10; KHR_lights_punctual. Candela are taken as
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
from wrt.io.mesh.parts import viewpoint
from wrt.linalg import product
from wrt.scene.camera import Camera, OrthographicCamera, PerspectiveCamera
from wrt.scene.lights import DirectionalLight, Light, PointLight, SpotLight
from wrt.values import vec3

Matrix = NDArray[np.float64]


def nodes_of(tree: Tree, *, last_child_first: bool = False) -> Iterator[tuple[int, Tree, Matrix]]:
    """Yield the number of every node of the file's scene, the node, and its (4, 4) transform to the world.

    Parents come before their children.

    Raises:
        InputError: where nodes form a circle or share a child.
    """
    nodes, scenes = tree.get("nodes", []), tree.get("scenes", [])
    roots = list(dict.fromkeys(scenes[tree.get("scene", 0)].get("nodes", []))) if scenes else []
    order = 1 if last_child_first else -1
    waiting = [(number, np.eye(4)) for number in roots[::order]]
    visited: set[int] = set()
    while waiting:
        number, parent = waiting.pop()
        if number in visited:
            raise InputError("the nodes form a circle, or share a child")
        visited.add(number)
        node = nodes[number]
        with np.errstate(all="ignore"):  # infinite places are reported by their meshes, cameras and lights
            world = product(parent, local_matrix(node))
        yield number, node, world
        waiting += [(child, world) for child in node.get("children", [])[::order]]


def visible_nodes_of(tree: Tree, *, last_child_first: bool = False) -> Iterator[tuple[int, Tree, Matrix]]:
    """Yield what `nodes_of` does, without nodes that are hidden and all below them (KHR_node_visibility)."""
    hidden: set[int] = set()
    for number, node, world in nodes_of(tree, last_child_first=last_child_first):
        is_visible = node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True)
        if number in hidden or not is_visible:
            hidden.update(node.get("children", []))
        else:
            yield number, node, world


def local_matrix(node: Tree) -> Matrix:
    """Return a node's local transform: a column-major matrix, or translation times rotation times scale."""
    if "matrix" in node:
        return np.asarray(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.asarray(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), np.float64)
    squared_length = x * x + y * y + z * z + w * w
    x, y, z, w = np.array((x, y, z, w)) * (math.sqrt(2.0 / squared_length) if squared_length > 0.0 else 0.0)
    result = np.eye(4)
    result[:3, :3] = [
        [1.0 - y * y - z * z, x * y - w * z, x * z + w * y],
        [x * y + w * z, 1.0 - x * x - z * z, y * z - w * x],
        [x * z - w * y, y * z + w * x, 1.0 - x * x - y * y],
    ]
    result[:3, :3] *= np.asarray(node.get("scale", (1.0, 1.0, 1.0)), np.float64)
    result[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return result


def cameras_of(tree: Tree) -> list[tuple[str, Camera]]:
    """Return names and cameras of the scene's nodes, without their aspect ratios: the picture has its own."""
    cameras: list[tuple[str, Camera]] = []
    for _, node, world in nodes_of(tree):
        if "camera" in node:
            described = tree["cameras"][node["camera"]]
            name = str(node.get("name") or described.get("name", ""))
            if described["type"] == "orthographic":
                height = 2.0 * abs(described["orthographic"]["ymag"])
                cameras.append((name, OrthographicCamera(**viewpoint(world), view_height=height)))
            elif described["type"] == "perspective":  # the reader warns of others
                fov = math.degrees(described["perspective"]["yfov"])
                cameras.append((name, PerspectiveCamera(**viewpoint(world), fov_degrees=fov)))
    return cameras


def lights_of(tree: Tree) -> list[Light]:
    """Return the scene's visible punctual lights in node order."""
    lights = tree.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])
    found = (
        (node.get("extensions", {}).get("KHR_lights_punctual"), world) for _, node, world in visible_nodes_of(tree)
    )
    return [light_of(lights[reference["light"]], world) for reference, world in found if reference is not None]


def light_of(light: Tree, world: Matrix) -> Light:
    """Return a light as KHR_lights_punctual describes it, placed by a (4, 4) transform."""
    strength = vec3(np.asarray(light.get("color", (1.0, 1.0, 1.0)), np.float64) * light.get("intensity", 1.0))
    position, direction = vec3(world[:3, 3]), vec3(-world[:3, 2])
    name = str(light.get("name", ""))
    if light["type"] == "directional":
        return DirectionalLight(direction, irradiance=strength, name=name)
    if light["type"] == "spot":
        cone = light.get("spot", {})
        inner = math.degrees(cone.get("innerConeAngle", 0.0))
        outer = math.degrees(cone.get("outerConeAngle", math.pi / 4.0))
        spot: dict[str, Any] = {"inner_degrees": inner, "outer_degrees": outer, "falloff": "gltf"}
        return SpotLight(position, direction, intensity=strength, name=name, **spot)
    if light["type"] != "point":
        raise InputError(f"a light is of type {light['type']!r}, which glTF does not have")
    return PointLight(position, intensity=strength, name=name)
