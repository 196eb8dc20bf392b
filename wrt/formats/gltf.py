"""glTF 2.0 and GLB, loaded by trimesh: triangles in world space with their base colours.

Format: Khronos Group 2021, "glTF 2.0 Specification"; section numbers below are its. Left aside:
alpha, animation, skins, morph targets, cameras, lights, and of materials all but the base colour.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.files import first_line
from wrt.formats.parts import Part, moved, warn
from wrt.formats.trimesh_files import load, part_of, reflectance

Tree = dict[str, Any]

# Extensions a file may require that change nothing which is taken here, or that are known.
_KNOWN_EXTENSIONS = ("KHR_materials_", "KHR_lights_punctual", "KHR_mesh_quantization", "KHR_texture_transform")
_INTEGERS = (5120, 5121, 5122, 5123, 5125)
_FAN = 6


def read_gltf(path: Path, data: bytes) -> list[Part]:
    """Return a part for each primitive of each node of the scene, moved into world space.

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
        materials = _prepare(path, tree)
        text = json.dumps(tree).encode()
        if binary:
            text += b" " * (-len(text) % 4)
            head = data[:8] + (20 + len(text) + len(rest)).to_bytes(4, "little")
            text = head + len(text).to_bytes(4, "little") + data[16:20] + text + rest
        return _parts(path, load(path, text, "glb" if binary else "gltf"), materials)
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        # The tree is whatever the file says; a key or type that is not as specified ends up here.
        reason = f"{type(error).__name__}: {first_line(error)}"
        raise InputError(f"{path}: the glTF file is damaged or not as specified ({reason})") from None


def _prepare(path: Path, tree: Tree) -> list[Tree]:
    """Refuse what trimesh 5.2 misreads, put the rest in the form that it takes; return the materials."""
    for name in tree.get("extensionsRequired", []):
        if not str(name).startswith(_KNOWN_EXTENSIONS):
            raise InputError(f"{path}: requires the glTF extension {name}, which is not supported; export without it")
    nodes, materials = tree.get("nodes", []), tree.get("materials", [])
    if not tree.get("scenes"):  # trimesh shows nothing then
        children = {child for node in nodes for child in node.get("children", [])}
        tree["scenes"] = [{"nodes": [k for k in range(len(nodes)) if k not in children]}]
        tree.pop("scene", None)
    for node in nodes:
        node.pop("camera", None)  # trimesh leaves out what hangs on a node with a camera
    described = [dict(material) for material in materials]
    for number, material in enumerate(materials):
        material["name"] = str(number)  # by which it is found again
    accessors = tree.get("accessors", [])
    for primitive in (p for mesh in tree.get("meshes", []) for p in mesh["primitives"]):
        attributes = primitive["attributes"]
        if primitive.get("mode") == _FAN:
            warn(f"{path}: triangle fans are left out; export triangles")
        # trimesh takes the first set of coordinates, whichever the texture asks for.
        texture = _texture(described[primitive["material"]]) if "material" in primitive else {}
        transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
        chosen = attributes.get(f"TEXCOORD_{transform.get('texCoord', texture.get('texCoord', 0))}")
        attributes.pop("TEXCOORD_0", None)
        if chosen is not None:
            attributes["TEXCOORD_0"] = chosen
        for key in ("POSITION", "TEXCOORD_0", "NORMAL", "COLOR_0", None):
            index = attributes.get(key) if key else primitive.get("indices")
            if index is None:
                continue
            accessor = accessors[index]
            if "sparse" in accessor or "bufferView" not in accessor:
                raise InputError(f"{path}: sparse or empty accessors are not supported; export without them")
            whole = accessor["componentType"] in _INTEGERS
            if whole and (key == "TEXCOORD_0" or (key == "POSITION" and accessor.get("normalized"))):
                raise InputError(f"{path}: {key} as integers is not supported; export floating-point numbers")
    return described


def _texture(material: Tree) -> Tree:
    texture: Tree = material.get("pbrMetallicRoughness", {}).get("baseColorTexture") or {}
    return texture


def _parts(path: Path, loaded: Tree, materials: list[Tree]) -> list[Part]:
    world = {loaded["base_frame"]: np.eye(4)}
    known: dict[int, NDArray[np.float32]] = {}
    parts = []
    for edge in loaded["graph"]:  # parents come before children
        if edge["frame_to"] in world:
            raise InputError(f"{path}: the nodes form a circle, or share a child")
        world[edge["frame_to"]] = matrix = world[edge["frame_from"]] @ edge["matrix"]
        name = edge.get("geometry")
        part = None if name is None else part_of(path, str(name), loaded["geometry"][name], linear=True)
        if part is None:
            continue
        material = getattr(loaded["geometry"][name].get("visual"), "material", None)
        if material is not None:
            _add_material(path, part, material, materials[int(material.name)], known)
        parts.append(moved(part, matrix))
    return parts[::-1]  # trimesh takes the last child first


def _add_material(path: Path, part: Part, material: Any, described: Tree, known: dict[int, Any]) -> None:
    """Fill in base colour and coordinates from trimesh's material and what the file says of it."""
    pbr, texture = described.get("pbrMetallicRoughness", {}), _texture(described)
    # trimesh rounds the factor to 8 bits. It is linear, as vertex colours are (sections 3.9.2, 3.7.2.1).
    factor = np.ones(3)
    if "baseColorFactor" in pbr:
        factor = np.array(pbr["baseColorFactor"], np.float64)[:3]
    elif material.baseColorFactor is not None:  # made of KHR_materials_pbrSpecularGlossiness
        factor = np.asarray(material.baseColorFactor)[:3] / 255.0
    image = material.baseColorTexture if part.uvs is not None else None
    if texture and part.uvs is not None and image is None:
        warn(f"{path}: texture {texture.get('index')} of {part.name} left out: its image cannot be read")
    label = f"{path.name} texture {texture.get('index')}"
    part.reflectance = reflectance(path, label, image, factor, known)
    if part.colors is not None:
        part.colors = part.colors * factor
    transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
    if transform and part.uvs is not None:
        uvs = part.uvs * (1.0, -1.0) + (0.0, 1.0)  # v runs downwards in the file
        turn = float(transform.get("rotation", 0.0))
        c, s = np.cos(turn), np.sin(turn)
        uvs = uvs * np.array(transform.get("scale", (1.0, 1.0)), np.float64) @ np.array([[c, -s], [s, c]])
        uvs = uvs + np.array(transform.get("offset", (0.0, 0.0)), np.float64)
        part.uvs = uvs * (1.0, -1.0) + (0.0, 1.0)
