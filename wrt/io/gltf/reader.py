"""glTF 2.0 and GLB: triangles in world space, loaded by trimesh, with their materials, cameras and lights.

Format: Khronos Group 2021, "glTF 2.0 Specification"; section numbers below are its. Skins and morph targets are as at
rest, or as the first animation has them at a time.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.gltf.animation import ends_of, pose
from wrt.io.gltf.buffers import MESHOPT, Buffers, Tree
from wrt.io.gltf.geometry import prepare_nodes, prepare_primitive, share_out
from wrt.io.gltf.images import GltfImages
from wrt.io.gltf.materials import GltfMaterials, coordinate_sets
from wrt.io.gltf.scene import cameras_of, lights_of
from wrt.io.mesh.parts import Contents, Part, placed
from wrt.io.mesh.trimesh_loaders import load, part_of
from wrt.io.safe_read import first_line
from wrt.linalg import product

_KNOWN_EXTENSIONS = frozenset(
    (
        *(f"KHR_materials_{name}" for name in ("anisotropy", "clearcoat", "diffuse_transmission", "dispersion")),
        *(f"KHR_materials_{name}" for name in ("emissive_strength", "ior", "iridescence", "pbrSpecularGlossiness")),
        *(f"KHR_materials_{name}" for name in ("sheen", "specular", "transmission", "unlit", "variants", "volume")),
        "KHR_texture_basisu",
        "KHR_texture_transform",
        "EXT_texture_webp",
        "EXT_texture_avif",
        "KHR_lights_punctual",
        "KHR_mesh_quantization",
        "KHR_draco_mesh_compression",
        "KHR_node_visibility",
        "KHR_xmp_json_ld",
        "KHR_animation_pointer",
        "EXT_mesh_gpu_instancing",
        *MESHOPT,
    )
)
"""Extensions that a file may require: supported, without effect on what is read, or left out with a warning."""

NO_ANIMATION = "it has no animation, so there is no time to choose"
"""What is said of a file without animations if a time is given."""

_VERSION = re.compile(r"([0-9]+)\.([0-9]+)")

_SECOND = "_SECOND_COORDINATES"
"""trimesh passes on attributes of unknown names."""
_ATTRIBUTES = ("POSITION", "TEXCOORD_0", _SECOND, "NORMAL", "COLOR_0")
_POINTS_AND_LINES = {0: "points", 1: "lines", 2: "lines", 3: "lines"}


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
    binary = data[:4] == b"glTF"
    text, rest = _chunks(data)
    with _as_specified(path):
        tree = _tree(path, text)
        _add_scene(tree)
        buffers = Buffers(path, tree, _binary_chunk(rest))
        if seconds is not None:
            if ends_of(tree, buffers) is None:
                raise InputError(f"{path}: {NO_ANIMATION}")
            pose(tree, buffers, seconds)
        _name_variants(path, tree)
        lights, cameras = lights_of(tree), cameras_of(tree)
        images = GltfImages(path, tree, buffers)
        materials = GltfMaterials(path, _prepare(path, tree, buffers), images)
        buffers.finish()
        text = json.dumps(tree).encode()
        if binary:
            text += b" " * (-len(text) % 4)
            head = data[:8] + (20 + len(text) + len(rest)).to_bytes(4, "little")
            text = head + len(text).to_bytes(4, "little") + data[16:20] + text + rest
        modes = {p.get("mode") for mesh in tree.get("meshes", []) for p in mesh["primitives"]}
        if left_out := " and ".join(sorted({_POINTS_AND_LINES[mode] for mode in modes if mode in _POINTS_AND_LINES})):
            warn(f"{path}: {left_out} are left out: only triangles are rendered")
        parts = _parts(path, load(path, text, "glb" if binary else "gltf"), materials)
        return Contents(parts, lights, cameras)


def _name_variants(path: Path, tree: Tree) -> None:
    """Warn of the variants of materials that are not shown."""
    variants = tree.get("extensions", {}).get("KHR_materials_variants", {}).get("variants", [])
    if variants:
        names = ", ".join(repr(str(variant.get("name", number))) for number, variant in enumerate(variants))
        warn(f"{path}: material variants are left out ({names}); the default materials are shown")


def animation_ends(path: Path, data: bytes) -> tuple[float, float] | None:
    """Return the times of the first and last keyframe of a file's first animation, seconds; None if there is none.

    Raises:
        InputError: on a damaged file.
    """
    text, rest = _chunks(data)
    with _as_specified(path):
        tree = _tree(path, text)
        return ends_of(tree, Buffers(path, tree, _binary_chunk(rest)))


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """Return the JSON of a file, and what follows it in a GLB."""
    size = int.from_bytes(data[12:16], "little")
    return (data[20 : 20 + size], data[20 + size :]) if data[:4] == b"glTF" else (data, b"")


def _tree(path: Path, text: bytes) -> Tree:
    """Return the parsed JSON of a file whose nodes form trees."""
    tree = json.loads(text)
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise InputError(f"{path}: not a glTF file: it names no asset")
    version = "1.0" if isinstance(tree.get("meshes"), dict) else _newest_needed(tree["asset"])
    if version is not None:
        raise InputError(f"{path}: a file of glTF {version}, which is not supported; convert it to glTF 2.0")
    if len(children := _children(tree)) != len(set(children)):  # paths to a node may be exponentially many
        raise InputError("nodes share a child; each may have one parent at most")
    return tree


def _newest_needed(asset: Tree) -> str | None:
    """Return the version that a file needs (section 3.2), or None if that is one which is read, or is not said."""
    least, version = (str(asset[name]) if name in asset else None for name in ("minVersion", "version"))
    needed = least or version or "2.0"
    found = _VERSION.fullmatch(needed)
    if found is None or (found[1] == "2" and (least is None or found[2] == "0")):
        return None
    return needed


@contextmanager
def _as_specified(path: Path) -> Iterator[None]:
    """Report as InputError what code raises that follows the unchecked JSON of a damaged file."""
    try:
        yield
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        reason = f"{type(error).__name__}: {first_line(error)}"
        raise InputError(f"{path}: the glTF file is damaged or not as specified ({reason})") from None


def _add_scene(tree: Tree) -> None:
    """Add a scene of all nodes to a file without scenes, of which trimesh would load nothing."""
    if not tree.get("scenes"):
        nodes = tree.get("nodes", [])
        children = set(_children(tree))
        tree["scenes"] = [{"nodes": [k for k in range(len(nodes)) if k not in children]}]
        tree.pop("scene", None)


def _children(tree: Tree) -> list[int]:
    """Return the children of all nodes."""
    return [child for node in tree.get("nodes", []) for child in node.get("children", [])]


def _prepare(path: Path, tree: Tree, buffers: Buffers) -> list[Tree]:
    """Adapt what trimesh 5.2 misreads, and return the materials."""
    for name in tree.get("extensionsRequired", []):
        if str(name) not in _KNOWN_EXTENSIONS:
            raise InputError(f"{path}: requires the glTF extension {name}, which is not supported; export without it")
    materials = tree.get("materials", [])
    for view in tree.get("bufferViews", []):  # some are longer than their data, which hurts no accessor
        room = tree["buffers"][view["buffer"]]["byteLength"] - view.get("byteOffset", 0)
        view["byteLength"] = min(view["byteLength"], max(room, 0))
    for node in tree.get("nodes", []):
        node.pop("camera", None)  # trimesh drops nodes with a camera
    prepare_nodes(tree, buffers)
    described = [dict(material) for material in materials]
    # trimesh carries only the number of each material; images are decoded later, for their kind of use.
    tree["materials"] = [{"name": str(number)} for number in range(len(materials))]
    for unused in ("images", "textures", "samplers"):
        tree.pop(unused, None)
    meshes = tree.get("meshes", [])
    placed_primitives = sum(len(meshes[node["mesh"]]["primitives"]) for node in tree.get("nodes", []) if "mesh" in node)
    memory_limits.take(memory_limits.SHAPES, placed_primitives * memory_limits.BYTES_PER_SHAPE)
    primitives = [primitive for mesh in meshes for primitive in mesh["primitives"]]
    for primitive in primitives:
        _lay(path, primitive, described)
        prepare_primitive(tree, primitive, _ATTRIBUTES, buffers)
    share_out(tree, primitives, _ATTRIBUTES)
    return described


def _lay(path: Path, primitive: Tree, described: list[Tree]) -> None:
    """Put the coordinates by which a primitive's textures lie where trimesh takes them: it reads the first set only."""
    attributes = primitive["attributes"]
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


def _binary_chunk(rest: bytes) -> bytes:
    """Return the data of a GLB's second chunk; empty if there is none."""
    return rest[8 : 8 + int.from_bytes(rest[:4], "little")]


def _parts(path: Path, loaded: Tree, materials: GltfMaterials) -> list[Part]:
    world = {loaded["base_frame"]: np.eye(4)}
    places: dict[str, list[NDArray[np.float64]]] = {}
    for edge in loaded["graph"]:  # parents come before children
        if edge["frame_to"] in world:
            raise InputError(f"{path}: the nodes form a circle, or share a child")
        with np.errstate(all="ignore"):  # infinite scales are reported by their vertices
            world[edge["frame_to"]] = matrix = product(world[edge["frame_from"]], edge["matrix"])
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
