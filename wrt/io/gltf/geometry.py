"""What of a glTF file's geometry trimesh does not read, turned into what it does.

Skins and morph targets as they are at rest, instances, hidden nodes, triangle fans, and accessors that are compressed,
sparse or quantised.

Format: Khronos Group 2021, "glTF 2.0 Specification", sections 3.6 and 3.7; EXT_mesh_gpu_instancing and
KHR_node_visibility.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.gltf.buffers import Buffers, Tree
from wrt.io.gltf.draco import decompress
from wrt.io.gltf.scene import nodes_of
from wrt.linalg import product

_FLOAT = 5126
_FAN = 6
_INSTANCES = "EXT_mesh_gpu_instancing"
_MOST_SETS = 8
"""Sets of four joints that are looked for; files have one or two."""
_BYTES_PER_ROW = 12
"""Memory of one element of an accessor: an index, or a vertex's position, normal or texture coordinates."""


def prepare_nodes(tree: Tree, buffers: Buffers) -> None:
    """Hide what is not visible, decompress meshes, and place instances and moved meshes as nodes of their own."""
    nodes, meshes = tree.get("nodes", []), tree.get("meshes", [])
    _hide(nodes)
    _leave_out_without_positions(nodes, meshes, buffers)
    decompress(tree, buffers)
    if any("skin" in node or "weights" in node for node in nodes) or any("weights" in mesh for mesh in meshes):
        _deform(tree, buffers)
    for node in list(nodes):
        placed = node.get("extensions", {}).get(_INSTANCES)
        if placed is not None and "mesh" in node:
            _add_instances(nodes, node, placed["attributes"], buffers)


def prepare_primitive(tree: Tree, primitive: Tree, names: tuple[str, ...], buffers: Buffers) -> None:
    """Replace what trimesh misreads of a primitive's accessors, the named attributes and the indices.

    Raises:
        InputError: on data that are compressed in a way that cannot be read.
    """
    attributes = primitive["attributes"]
    for name in names:
        if name in attributes and _needs_decoding(tree, attributes[name], name):
            attributes[name] = buffers.add(buffers.numbers(attributes[name]).astype(np.float32))
    if "indices" in primitive and _needs_decoding(tree, primitive["indices"], None):
        primitive["indices"] = buffers.add(buffers.numbers(primitive["indices"]))
    if primitive.get("mode") == _FAN:
        count = tree["accessors"][attributes["POSITION"]]["count"]
        corners = buffers.numbers(primitive["indices"]) if "indices" in primitive else np.arange(count)
        first = np.full(max(len(corners) - 2, 0), corners[0])
        primitive["indices"] = buffers.add(
            np.column_stack([first, corners[1:-1], corners[2:]]).astype(np.uint32).ravel()
        )
        primitive["mode"] = 4


def _needs_decoding(tree: Tree, number: int, name: str | None) -> bool:
    """Return whether trimesh would take an accessor for something else; integers of normals are only scaled."""
    accessor = tree["accessors"][number]
    if "sparse" in accessor or "bufferView" not in accessor:
        return True
    if name is None or name in ("NORMAL", "COLOR_0") or accessor["componentType"] == _FLOAT:
        return False
    return name != "POSITION" or bool(accessor.get("normalized"))


def _hide(nodes: list[Tree]) -> None:
    """Take the meshes of nodes that are not visible, and of those below them."""
    waiting = [
        node for node in nodes if not node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True)
    ]
    while waiting:
        node = waiting.pop()
        node.pop("mesh", None)
        waiting += [nodes[child] for child in node.get("children", [])]


def _leave_out_without_positions(nodes: list[Tree], meshes: list[Tree], buffers: Buffers) -> None:
    """Take primitives without positions, which need not be rendered (section 3.7.2.1), and meshes of them alone."""
    left_out = 0
    for mesh in meshes:
        kept = [primitive for primitive in mesh["primitives"] if "POSITION" in primitive["attributes"]]
        left_out += len(mesh["primitives"]) - len(kept)
        mesh["primitives"] = kept
    if left_out:
        warn(f"{buffers.path}: primitives without positions are left out ({left_out})")
        for node in nodes:
            if "mesh" in node and not meshes[node["mesh"]]["primitives"]:
                del node["mesh"]


# --- Skins and morph targets -----------------------------------------------------------------------


def _deform(tree: Tree, buffers: Buffers) -> None:
    """Give each node whose mesh is moved by a skin or by morph targets a mesh of its own, at rest."""
    nodes, meshes = tree["nodes"], tree["meshes"]
    children = {child for node in nodes for child in node.get("children", [])}
    roots = [number for number in range(len(nodes)) if number not in children]  # joints may lie outside of the scene
    world = {id(node): matrix for node, matrix in nodes_of({"nodes": nodes, "scenes": [{"nodes": roots}]})}
    for node in list(nodes):
        if "mesh" not in node:
            continue
        mesh = meshes[node["mesh"]]
        weights = np.asarray(node.get("weights", mesh.get("weights", ())), np.float64)
        skin = tree["skins"][node["skin"]] if "skin" in node else None
        if skin is None and not weights.any():
            continue
        joints = None if skin is None else _joints(tree, skin, world, buffers)
        made = [_deformed(tree, primitive, weights, joints, buffers) for primitive in mesh["primitives"]]
        meshes.append({**mesh, "primitives": made})
        node["mesh"] = len(meshes) - 1
        if joints is not None:  # which move it into the world; the node's own transform does not count
            scene = tree["scenes"][tree.get("scene", 0)]
            if id(node) in {id(each) for each, _ in nodes_of(tree)}:
                nodes.append({"mesh": node["mesh"]})
                scene["nodes"].append(len(nodes) - 1)
            del node["mesh"]


def _joints(tree: Tree, skin: Tree, world: dict[int, Any], buffers: Buffers) -> NDArray[np.float64]:
    """Return (J, 4, 4) what moves vertices with each joint, from the mesh into the world."""
    moved = np.stack([world[id(tree["nodes"][number])] for number in skin["joints"]])
    if "inverseBindMatrices" not in skin:
        return moved
    inverse = buffers.numbers(skin["inverseBindMatrices"]).astype(np.float64).reshape(-1, 4, 4)
    return product(moved, inverse.transpose(0, 2, 1)[: len(moved)])


def _deformed(
    tree: Tree, primitive: Tree, weights: NDArray[np.float64], joints: NDArray[np.float64] | None, buffers: Buffers
) -> Tree:
    """Return a primitive with other positions and normals."""
    attributes = dict(primitive["attributes"])
    values = {
        name: buffers.numbers(attributes[name]).astype(np.float64)
        for name in ("POSITION", "NORMAL")
        if name in attributes
    }
    for weight, target in zip(weights, primitive.get("targets", []), strict=False):
        for name in values:
            if weight and name in target:
                values[name] += weight * buffers.numbers(target[name])
    if joints is not None:
        blend = _blend(attributes, joints, len(values["POSITION"]), buffers)
        values["POSITION"] = np.einsum("nij,nj->ni", blend[:, :, :3], values["POSITION"]) + blend[:, :, 3]
        if "NORMAL" in values:
            a, b, c = (blend[:, k, :3] for k in range(3))
            cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
            values["NORMAL"] = np.einsum("nij,nj->ni", cofactors, values["NORMAL"])
    for name, rows in values.items():
        attributes[name] = buffers.add(rows.astype(np.float32))
    attributes.pop("TANGENT", None)
    return {**primitive, "attributes": attributes}


def _blend(attributes: Tree, joints: NDArray[np.float64], count: int, buffers: Buffers) -> NDArray[np.float64]:
    """Return (N, 3, 4) the weighted sum of joints for each vertex."""
    blend, total = np.zeros((count, 3, 4)), np.zeros(count)
    for number in range(_MOST_SETS):
        if f"JOINTS_{number}" not in attributes:
            break
        names = buffers.numbers(attributes[f"JOINTS_{number}"]).astype(np.int64)
        shares = buffers.numbers(attributes[f"WEIGHTS_{number}"]).astype(np.float64)
        if names.max(initial=0) >= len(joints):
            raise InputError(f"{buffers.path}: a vertex names a joint that its skin does not have")
        for k in range(4):
            blend += shares[:, k, None, None] * joints[names[:, k], :3]
            total += shares[:, k]
    blend[total > 0.0] /= total[total > 0.0, None, None]
    blend[total == 0.0] = np.eye(3, 4)
    return blend


# --- Instances -------------------------------------------------------------------------------------


def _add_instances(nodes: list[Tree], node: Tree, attributes: Tree, buffers: Buffers) -> None:
    """Put a node's mesh into children of it, one for each instance."""
    keys = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
    rows = {key: buffers.numbers(attributes[name]).tolist() for name, key in keys.items() if name in attributes}
    mesh = node.pop("mesh")
    children = list(node.get("children", []))
    counts = {len(each) for each in rows.values()}
    if len(counts) > 1:
        raise InputError(f"{buffers.path}: a node's instances have unlike numbers of places")
    for place in zip(*rows.values(), strict=True):
        children.append(len(nodes))
        nodes.append({"mesh": mesh, **dict(zip(rows, place, strict=True))})
    node["children"] = children


def share_out(tree: Tree, primitives: list[Tree], names: tuple[str, ...]) -> None:
    """Count the memory of what trimesh copies: accessors that several primitives use."""
    used: set[int] = set()
    for primitive in primitives:
        found = [primitive["attributes"].get(name) for name in names]
        for index in (*found, primitive.get("indices")):
            if index is None:
                continue
            if index in used:
                memory_limits.take(memory_limits.MESHES, tree["accessors"][index]["count"] * _BYTES_PER_ROW)
            used.add(index)
