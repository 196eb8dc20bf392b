"""glTF 2.0 and GLB: triangles in world space with their materials, cameras and lights.

Format: Khronos Group 2021, "glTF 2.0 Specification"; section numbers below are its. Skins and morph targets are as at
rest, or as the first animation has them at a time.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.account import TrackedObject, unused_keys, warn_of_unused
from wrt.io.gltf.animation import PATHS, ends_of, pose
from wrt.io.gltf.buffers import MESHOPT, Buffers, Tree
from wrt.io.gltf.images import LINEAR, MIPMAPS, NEAREST, WRAPS, GltfImages
from wrt.io.gltf.materials import EXTENSIONS, GltfMaterials
from wrt.io.gltf.primitives import FAN, POINTS, STRIP, TRIANGLES, Deformation, Primitive, joint_matrices
from wrt.io.gltf.scene import Matrix, cameras_of, lights_of, local_matrix, nodes_of, visible_nodes_of
from wrt.io.gltf.without_effect import WITHOUT_EFFECT
from wrt.io.mesh.parts import NO_ANIMATION, Contents, Part, as_specified, placed
from wrt.linalg import product

_KNOWN_EXTENSIONS = {
    *(f"KHR_materials_{name}" for name in (*EXTENSIONS, "diffuse_transmission", "variants")),
    *("KHR_texture_basisu", "KHR_texture_transform", "EXT_texture_webp", "EXT_texture_avif"),
    *(
        "KHR_lights_punctual",
        "KHR_mesh_quantization",
        "KHR_draco_mesh_compression",
        "EXT_mesh_gpu_instancing",
        *MESHOPT,
    ),
    *("KHR_node_visibility", "KHR_xmp_json_ld", "KHR_animation_pointer"),
}
"""Extensions that a file may require: supported, without effect on what is read, or left out with a warning."""

_WORDS: dict[str, tuple[Any, ...]] = {
    "animations.channels.target.path": (*PATHS, "pointer"),  # whose extension is named
    "cameras.type": ("perspective", "orthographic"),
    "materials.alphaMode": ("OPAQUE", "MASK", "BLEND"),
    "samplers.magFilter": (NEAREST, LINEAR),
    "samplers.minFilter": (NEAREST, LINEAR, *MIPMAPS),
    "samplers.wrapS": tuple(WRAPS),
    "samplers.wrapT": tuple(WRAPS),
}
"""The values of enumerations. Others are warned of; of modes of primitives below, and files with other types of lights
or of numbers are refused."""

_VERSION = re.compile(r"([0-9]+)\.([0-9]+)")
_OTHER_MODES = {1: "lines", 2: "lines", 3: "lines"}


def read_gltf(path: Path, data: bytes, seconds: float | None = None) -> Contents:
    """Return a part for each primitive of each node of the scene, moved into world space, its cameras and its lights.

    Args:
        path: the file.
        data: its content.
        seconds: the time of the first animation at which the scene is; None for the scene at rest.

    Raises:
        InputError: on a damaged file, a file of glTF 1.0, and on extensions that are required and not supported; if a
            time is given, also on a file without animations.
    """
    with as_specified(path, "glTF"):
        tree, buffers = _opened(path, data)
        for name in tree.get("extensionsRequired", []):
            if str(name) not in _KNOWN_EXTENSIONS:
                raise InputError(
                    f"{path}: requires the glTF extension {name}, which is not supported; export without it"
                )
        if seconds is not None:
            if ends_of(tree, buffers) is None:
                raise InputError(f"{path}: {NO_ANIMATION}")
            pose(tree, buffers, seconds)
        _warn_of_variants(path, tree)
        lights, cameras = lights_of(tree), cameras_of(tree)
        contents = Contents(_parts(tree, buffers), lights, cameras)
        warn_of_unused(path, unused_keys(tree, containers=("extensions",), words=_WORDS), WITHOUT_EFFECT)
        return contents


def animation_ends(path: Path, data: bytes) -> tuple[float, float] | None:
    """Return the times of the first and last keyframe of a file's first animation, seconds; None if there is none.

    Raises:
        InputError: on a damaged file.
    """
    with as_specified(path, "glTF"):
        return ends_of(*_opened(path, data))


def _opened(path: Path, data: bytes) -> tuple[Tree, Buffers]:
    """Return the JSON of a file, whose nodes form trees and which has a scene, and its binary data."""
    text, binary = data, b""
    if data[:4] == b"glTF":
        (_, text), *chunks = _chunks(data)
        binary = next((content for kind, content in chunks if kind == b"BIN\0"), b"")
    tree = json.loads(text, object_pairs_hook=TrackedObject)
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise InputError(f"{path}: not a glTF file: it names no asset")
    version = "1.0" if isinstance(tree.get("meshes"), dict) else _unsupported_version(tree["asset"])
    if version is not None:
        raise InputError(f"{path}: a file of glTF {version}, which is not supported; convert it to glTF 2.0")
    # By dict.get, since a node outside of the scene does not count as reached.
    children = Counter(child for node in tree.get("nodes", []) for child in dict.get(node, "children", []))
    if children and max(children.values()) > 1:  # paths to a node may be exponentially many
        raise InputError("nodes share a child; each may have one parent at most")
    if not tree.get("scenes"):
        roots = [number for number in range(len(tree.get("nodes", []))) if number not in children]
        tree |= {"scenes": [{"nodes": roots}], "scene": 0}
    return tree, Buffers(path, tree, binary)


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the type and the content of each chunk of a GLB (section 4.4.3)."""
    start = 12
    while start + 8 <= len(data):
        size = int.from_bytes(data[start : start + 4], "little")
        yield data[start + 4 : start + 8], data[start + 8 : start + 8 + size]
        start += 8 + size


def _unsupported_version(asset: Tree) -> str | None:
    """Return the version that a file requires (section 3.2), or None if it is supported or unspecified."""
    least, version = (str(asset[name]) if name in asset else None for name in ("minVersion", "version"))
    required = least or version or "2.0"
    found = _VERSION.fullmatch(required)
    is_supported = found is None or (found[1] == "2" and (least is None or found[2] == "0"))
    return None if is_supported else required


def _warn_of_variants(path: Path, tree: Tree) -> None:
    variants = tree.get("extensions", {}).get("KHR_materials_variants", {}).get("variants", [])
    if variants:
        names = ", ".join(repr(str(variant.get("name", number))) for number, variant in enumerate(variants))
        warn(f"{path}: material variants are left out ({names}); the default materials are shown")


# --- Meshes ----------------------------------------------------------------------------------------


def _parts(tree: Tree, buffers: Buffers) -> list[Part]:
    """Return a part for each primitive of each mesh that is shown; places of one mesh share its parts."""
    materials = GltfMaterials(buffers.path, tree.get("materials", []), GltfImages(buffers.path, tree, buffers))
    nodes = [each for each in visible_nodes_of(tree, last_child_first=True) if "mesh" in each[1]]
    meshes = _triangle_primitives(buffers.path, tree.get("meshes", []), {node["mesh"] for _, node, _ in nodes})
    world: dict[int, Matrix] = {}
    places: dict[tuple[int, int | None], list[Matrix]] = {}
    deformations: dict[tuple[int, int | None], Deformation | None] = {}
    for number, matrix in _mesh_places(nodes, buffers):
        node = tree["nodes"][number]
        memory_limits.take(memory_limits.SHAPES, len(meshes[node["mesh"]]) * memory_limits.BYTES_PER_SHAPE)
        if "skin" in node and not world:
            world = _world_of_all(tree)
        deformation = _deformation(tree, node, world, buffers)
        key = node["mesh"], None if deformation is None else number
        deformations[key] = deformation
        places.setdefault(key, []).append(matrix)
    parts = []
    for key, matrices in reversed(places.items()):
        for name, primitive in reversed(meshes[key[0]]):
            part = _part(name, primitive, deformations[key], materials, buffers)
            if len(part.faces):
                parts.append(placed(part, matrices[::-1]))
    return parts


def _triangle_primitives(path: Path, meshes: list[Tree], shown: set[int]) -> dict[int, list[tuple[str, Tree]]]:
    """Return the names and the JSON of the primitives of each shown mesh that are triangles; warns of the rest."""
    found: dict[int, list[tuple[str, Tree]]] = {}
    names: Counter[str] = Counter()
    left_out: set[str] = set()
    without_positions = 0
    for number in sorted(shown):
        mesh, found[number] = meshes[number], []
        name = str(mesh.get("name") or "GLTF")
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", TRIANGLES)
            if "POSITION" not in primitive["attributes"]:  # which need not be rendered (section 3.7.2.1)
                without_positions += 1
            elif mode not in (POINTS, TRIANGLES, STRIP, FAN):
                left_out.add(_OTHER_MODES.get(mode, "primitives of unknown modes"))
            else:
                found[number].append((f"{name}_{names[name]}" if names[name] else name, primitive))
                names[name] += 1
    if without_positions:
        warn(f"{path}: primitives without positions are left out ({without_positions})")
    if left_out:
        warn(f"{path}: {' and '.join(sorted(left_out))} are left out: only triangles and points are rendered")
    return found


def _mesh_places(nodes: list[tuple[int, Tree, Matrix]], buffers: Buffers) -> Iterator[tuple[int, Matrix]]:
    """Yield the number of each of some nodes with meshes, last child first, and a transform of the mesh to the world.

    Pictures depend on the order of shapes: `_parts` turns this one round, in which children come last first.
    """
    # A skin moves its mesh into the world, so that the place of the node does not count.
    for number in sorted((number for number, node, _ in nodes if "skin" in node), reverse=True):
        yield number, np.eye(4)
    for number, node, world in nodes:
        if "skin" in node:
            continue
        instances = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
        if instances is None:
            yield number, world
        else:
            for place in reversed(_instances(instances["attributes"], buffers)):
                yield number, product(world, local_matrix(place))


def _instances(attributes: Tree, buffers: Buffers) -> list[Tree]:
    """Return the translation, rotation and scale of each instance of a mesh (EXT_mesh_gpu_instancing)."""
    keys = [name for name in ("TRANSLATION", "ROTATION", "SCALE") if name in attributes]
    columns = [buffers.numbers(attributes[name]).tolist() for name in keys]
    if len({len(column) for column in columns}) > 1:
        raise InputError(f"{buffers.path}: a node's instances have unlike numbers of places")
    return [dict(zip(map(str.lower, keys), place, strict=True)) for place in zip(*columns, strict=True)]


def _world_of_all(tree: Tree) -> dict[int, Matrix]:
    """Return the transforms of all nodes, as joints may lie outside of the scene."""
    children = {child for node in tree["nodes"] for child in node.get("children", [])}
    roots = [number for number in range(len(tree["nodes"])) if number not in children]
    return {number: matrix for number, _, matrix in nodes_of({"nodes": tree["nodes"], "scenes": [{"nodes": roots}]})}


def _deformation(tree: Tree, node: Tree, world: dict[int, Matrix], buffers: Buffers) -> Deformation | None:
    """Return how a node moves the vertices of its mesh, or None if it does not."""
    weights = np.asarray(node.get("weights", tree["meshes"][node["mesh"]].get("weights", ())), np.float64)
    if "skin" in node:
        return Deformation(weights, joint_matrices(tree["skins"][node["skin"]], world, buffers))
    return Deformation(weights, None) if weights.any() else None


def _part(
    name: str, primitive: Tree, deformation: Deformation | None, materials: GltfMaterials, buffers: Buffers
) -> Part:
    """Return a primitive with its material."""
    number = primitive.get("material")
    wanted = [] if number is None else materials.uv_sets(number)
    part, uvs = Primitive(primitive, buffers).part(name, wanted, deformation)
    if number is not None:
        return materials.dressed(part, number, uvs)
    part.colors = None if part.colors is None else part.colors[:, :3]
    part.double_sided = False  # the default material, section 3.9.1
    return part
