"""glTF 2.0 and GLB: triangles in world space, loaded by trimesh, with their materials, cameras and lights.

Format: Khronos Group 2021, "glTF 2.0 Specification"; section numbers below are its. Left aside: animation, skins
and morph targets.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.files import first_line
from wrt.formats import growth
from wrt.formats.gltf_images import IMAGE_KEYS, GltfImages, Tree
from wrt.formats.gltf_materials import GltfMaterials, coordinate_sets
from wrt.formats.gltf_scene import cameras_of, lights_of
from wrt.formats.parts import Contents, Part, placed, warn
from wrt.formats.trimesh_files import load, part_of

# Extensions a file may require that change nothing which is taken here, or that are known.
_KNOWN_EXTENSIONS = ("KHR_materials_", "KHR_lights_punctual", "KHR_mesh_quantization", "KHR_texture_transform")
_INTEGERS = (5120, 5121, 5122, 5123, 5125)
_FAN = 6
_BYTES_PER_ROW = 12
"""Memory of one element of an accessor: an index, or a vertex's position, normal or texture coordinates."""
_SECOND = "_SECOND_COORDINATES"
"""Under such a name trimesh hands on what it does not know."""


def read_gltf(path: Path, data: bytes) -> Contents:
    """Return a part for each primitive of each node of the scene, moved into world space, its cameras and its lights.

    Raises:
        InputError: on a damaged file, on extensions that compress or replace the geometry, and
            on what trimesh would take for something else: sparse accessors and coordinates as
            normalised integers.
    """
    binary = data[:4] == b"glTF"
    size = int.from_bytes(data[12:16], "little")
    text, rest = (data[20 : 20 + size], data[20 + size :]) if binary else (data, b"")
    try:
        tree = json.loads(text)
        if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
            raise InputError(f"{path}: not a glTF file: it names no asset")
        if len(children := _children(tree)) != len(set(children)):  # the ways to a node may be more than can be gone
            raise InputError("nodes share a child; each may have one parent at most")
        _add_scene(tree)
        # What hangs on the nodes is taken from a copy: trimesh must not see it.
        nodes = {**tree, "nodes": [dict(node) for node in tree.get("nodes", [])]}
        images = GltfImages(path, {key: tree.get(key, []) for key in IMAGE_KEYS}, _binary_chunk(rest))
        materials = GltfMaterials(path, _prepare(path, tree), images)
        text = json.dumps(tree).encode()
        if binary:
            text += b" " * (-len(text) % 4)
            head = data[:8] + (20 + len(text) + len(rest)).to_bytes(4, "little")
            text = head + len(text).to_bytes(4, "little") + data[16:20] + text + rest
        parts = _parts(path, load(path, text, "glb" if binary else "gltf"), materials)
        return Contents(parts, lights_of(nodes), cameras_of(nodes))
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        # The tree is whatever the file says; a key or type that is not as specified ends up here.
        reason = f"{type(error).__name__}: {first_line(error)}"
        raise InputError(f"{path}: the glTF file is damaged or not as specified ({reason})") from None


def _add_scene(tree: Tree) -> None:
    """Add a scene of all nodes to a file without scenes, of which trimesh shows nothing."""
    if not tree.get("scenes"):
        nodes = tree.get("nodes", [])
        children = set(_children(tree))
        tree["scenes"] = [{"nodes": [k for k in range(len(nodes)) if k not in children]}]
        tree.pop("scene", None)


def _children(tree: Tree) -> list[int]:
    """Return the children of all nodes."""
    return [child for node in tree.get("nodes", []) for child in node.get("children", [])]


def _prepare(path: Path, tree: Tree) -> list[Tree]:
    """Refuse what trimesh 5.2 misreads, put the rest in the form that it takes; return the materials."""
    for name in tree.get("extensionsRequired", []):
        if not str(name).startswith(_KNOWN_EXTENSIONS):
            raise InputError(f"{path}: requires the glTF extension {name}, which is not supported; export without it")
    materials = tree.get("materials", [])
    for node in tree.get("nodes", []):
        node.pop("camera", None)  # trimesh leaves out what hangs on a node with a camera
    described = [dict(material) for material in materials]
    # trimesh only carries the number of each on; images are decoded where they are used, and as what they are.
    tree["materials"] = [{"name": str(number)} for number in range(len(materials))]
    for unused in ("images", "textures", "samplers"):
        tree.pop(unused, None)
    accessors = tree.get("accessors", [])
    meshes = tree.get("meshes", [])
    placed_primitives = sum(len(meshes[node["mesh"]]["primitives"]) for node in tree.get("nodes", []) if "mesh" in node)
    growth.take(growth.SHAPES, placed_primitives * growth.BYTES_PER_SHAPE)
    used: set[int] = set()
    for primitive in (p for mesh in meshes for p in mesh["primitives"]):
        attributes = primitive["attributes"]
        if primitive.get("mode") == _FAN:
            warn(f"{path}: triangle fans are left out; export triangles")
        # trimesh takes the first set of coordinates, whichever the texture asks for.
        sets = coordinate_sets(described[primitive["material"]]) if "material" in primitive else []
        if len(sets) > 2:
            warn(
                f"{path}: textures of material {primitive['material']} lie by more than two sets of coordinates; all "
                f"but those of set {sets[1]} are laid by set {sets[0]}"
            )
        laid = [attributes.get(f"TEXCOORD_{number}") for number in (sets or [0])[:2]]
        if len(laid) > 1 and laid[1] is None:
            warn(f"{path}: there is no TEXCOORD_{sets[1]}, by which textures of material {primitive['material']} lie")
        attributes.pop("TEXCOORD_0", None)
        attributes |= {name: n for name, n in zip(("TEXCOORD_0", _SECOND), laid, strict=False) if n is not None}
        for key in ("POSITION", "TEXCOORD_0", _SECOND, "NORMAL", "COLOR_0", None):
            index = attributes.get(key) if key else primitive.get("indices")
            if index is None:
                continue
            accessor = accessors[index]
            if "sparse" in accessor or "bufferView" not in accessor:
                raise InputError(f"{path}: sparse or empty accessors are not supported; export without them")
            if index in used:  # shared accessors are copied for each primitive
                growth.take(growth.MESHES, accessor["count"] * _BYTES_PER_ROW)
            used.add(index)
            whole = accessor["componentType"] in _INTEGERS
            if whole and (key in ("TEXCOORD_0", _SECOND) or (key == "POSITION" and accessor.get("normalized"))):
                name = "POSITION" if key == "POSITION" else "TEXCOORD"
                raise InputError(f"{path}: {name} as integers is not supported; export floating-point numbers")
    return described


def _binary_chunk(rest: bytes) -> bytes:
    """Return the data of a GLB's second chunk, empty where there is none."""
    return rest[8 : 8 + int.from_bytes(rest[:4], "little")]


def _parts(path: Path, loaded: Tree, materials: GltfMaterials) -> list[Part]:
    world = {loaded["base_frame"]: np.eye(4)}
    places: dict[str, list[NDArray[np.float64]]] = {}
    for edge in loaded["graph"]:  # parents come before children
        if edge["frame_to"] in world:
            raise InputError(f"{path}: the nodes form a circle, or share a child")
        with np.errstate(all="ignore"):  # a node scaled to infinity is told by its vertices
            world[edge["frame_to"]] = matrix = world[edge["frame_from"]] @ edge["matrix"]
        if edge.get("geometry") is not None:
            places.setdefault(edge["geometry"], []).append(matrix)
    made = {name: _part(path, str(name), loaded["geometry"][name], materials) for name in places}
    # trimesh takes the last child first.
    return [placed(part, places[name][::-1]) for name, part in reversed(made.items()) if part is not None]


def _part(path: Path, name: str, fields: Any, materials: GltfMaterials) -> Part | None:
    part = part_of(path, name, fields, linear=True)
    material = getattr(fields.get("visual"), "material", None)
    if part is None:
        return None
    if material is None:
        part.colors = None if part.colors is None else part.colors[:, :3]
        return part
    second = fields.get("vertex_attributes", {}).get(_SECOND)
    return materials.dressed(part, int(material.name), second)
