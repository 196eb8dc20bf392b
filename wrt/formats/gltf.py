"""glTF 2.0 and GLB: triangles in world space with their base colours.

Format: Khronos Group 2021, "glTF 2.0 Specification"; section numbers below are its. Read here
because trimesh takes sparse accessors for zeros, leaves normalised integers unscaled and rounds
linear colour factors to 8 bits. Left aside: alpha, animation, skins, morph targets, cameras,
lights, and of materials all but the base colour.
"""

from __future__ import annotations

import base64
import io
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.formats.images import first_line, pixels_of
from wrt.formats.parts import Part, warn
from wrt.textures import ColorSource, ImageTexture

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_MAX_NODES = 1_000_000  # visits, not nodes: a graph that shares children multiplies them
_TRIANGLES, _STRIP, _FAN = 4, 5, 6

# Extensions a file may require that change nothing this reader takes, or that it knows.
_KNOWN_EXTENSIONS = ("KHR_materials_", "KHR_lights_punctual", "KHR_mesh_quantization", "KHR_texture_transform")


@dataclass
class _Document:
    path: Path
    tree: dict[str, Any]
    chunk: bytes | None
    buffers: dict[int, bytes] = field(default_factory=dict)
    textures: dict[int, NDArray[np.float32] | None] = field(default_factory=dict)


def read_gltf(path: Path, data: bytes) -> list[Part]:
    """Return a part for each primitive of each node of the scene, moved into world space.

    Raises:
        InputError: on a damaged file and on extensions that compress or replace the geometry.
    """
    document = _document(path, data)
    try:
        return _parts(document)
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        # The tree is whatever the file says; a key or type that is not as specified ends up here.
        kind = type(error).__name__
        raise InputError(f"{path}: the glTF file is not as specified ({kind}: {first_line(error)})") from None


def _document(path: Path, data: bytes) -> _Document:
    """Take the container apart (section 4.4) and check what the file asks of its reader."""
    chunk: bytes | None = None
    if data[:4] == b"glTF":
        version, length = (int.from_bytes(data[k : k + 4], "little") for k in (4, 8))
        if version != 2:
            raise InputError(f"{path}: GLB version {version}; only version 2 is supported")
        if length > len(data):
            raise InputError(f"{path}: the GLB header says {length} bytes, the file has {len(data)}; it is truncated")
        size = int.from_bytes(data[12:16], "little")
        if data[16:20] != b"JSON" or 20 + size > len(data):
            raise InputError(f"{path}: the first chunk of the GLB file is not JSON; the file is damaged")
        text = data[20 : 20 + size]
        begin = 20 + size
        if data[begin + 4 : begin + 8] == b"BIN\0":
            chunk = data[begin + 8 : begin + 8 + int.from_bytes(data[begin : begin + 4], "little")]
    else:
        text = data
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a glTF file, or damaged: {first_line(error)}") from None
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise InputError(f"{path}: not a glTF file: it names no asset")
    if not str(tree["asset"].get("version", "")).startswith("2."):
        raise InputError(f"{path}: glTF version {tree['asset'].get('version')}; only version 2 is supported")
    for name in tree.get("extensionsRequired", []):
        if not str(name).startswith(_KNOWN_EXTENSIONS):
            raise InputError(f"{path}: requires the glTF extension {name}, which is not supported; export without it")
    return _Document(path, tree, chunk)


def _parts(document: _Document) -> list[Part]:
    tree = document.tree
    nodes, meshes = tree.get("nodes", []), tree.get("meshes", [])
    if tree.get("scenes"):
        roots = tree["scenes"][tree.get("scene", 0)].get("nodes", [])
    else:
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [k for k in range(len(nodes)) if k not in children]
    parts = []
    stack = [(root, np.eye(4), 0) for root in reversed(roots)]
    visits = 0
    while stack:
        number, parent, depth = stack.pop()
        visits += 1
        if depth > len(nodes) or visits > _MAX_NODES:
            raise InputError(f"{document.path}: the nodes form a circle, or are too many")
        node = nodes[_index(number)]
        matrix = parent @ _local(node)
        stack += [(child, matrix, depth + 1) for child in reversed(node.get("children", []))]
        if "mesh" in node:
            mesh = meshes[_index(node["mesh"])]
            name = str(node.get("name") or mesh.get("name") or document.path.stem)
            for primitive in mesh["primitives"]:
                part = _primitive(document, primitive, matrix, name)
                if part is not None:
                    parts.append(part)
    return parts


def _index(value: Any) -> int:
    """Return a reference into a list; Python would take a negative one from the end."""
    if not isinstance(value, int) or value < 0:
        raise ValueError(f"{value!r} is not an index")
    return value


def _local(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return a node's (4, 4) transform: its matrix, or translation * rotation * scale (section 3.5.2)."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T  # stored by columns
    matrix = np.eye(4)
    x, y, z, w = (float(q) for q in node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    length = (x * x + y * y + z * z + w * w) ** 0.5 or 1.0
    x, y, z, w = x / length, y / length, z / length, w / length
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)), np.float64)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _primitive(document: _Document, primitive: dict[str, Any], matrix: NDArray[np.float64], name: str) -> Part | None:
    """Return a primitive's triangles in world space, or None for points and lines."""
    attributes = primitive["attributes"]
    mode = primitive.get("mode", _TRIANGLES)
    if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in attributes:
        return None
    vertices = _accessor(document, attributes["POSITION"])[:, :3]
    if "indices" in primitive:
        order = _accessor(document, primitive["indices"]).reshape(-1).astype(np.int64)
    else:
        order = np.arange(len(vertices))
    faces = _faces(order, mode)
    linear = matrix[:3, :3]
    mirrored = np.linalg.det(linear) < 0.0
    part = Part(name, vertices @ linear.T + matrix[:3, 3], faces[:, ::-1] if mirrored else faces)
    if "NORMAL" in attributes:
        normals = _accessor(document, attributes["NORMAL"])
        # The transposed inverse but for its scale; the cofactors exist for flattening transforms too.
        a, b, c = linear
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
        part.normals = (normals @ cofactors.T) * (-1.0 if mirrored else 1.0)
    factor, texture = np.ones(3), None
    if "material" in primitive:
        material = document.tree["materials"][_index(primitive["material"])]
        pbr = material.get("pbrMetallicRoughness", {})
        # Linear already, as are vertex colours (sections 3.9.2, 3.7.2.1); only images are sRGB.
        factor = np.clip(np.array(pbr.get("baseColorFactor", [1.0] * 4), np.float64)[:3], 0.0, 1.0)
        texture = pbr.get("baseColorTexture")
        r, g, b = (float(x) for x in factor)
        part.reflectance = (r, g, b)
    if texture is not None:
        part.uvs, laid = _texture(document, texture, attributes, factor)
        part.reflectance = laid or part.reflectance
    if "COLOR_0" in attributes and not isinstance(part.reflectance, ImageTexture):
        part.colors = _accessor(document, attributes["COLOR_0"])[:, :3] * factor
    for what, array in (("normals", part.normals), ("texture coordinates", part.uvs), ("colours", part.colors)):
        if array is not None and len(array) != len(vertices):
            raise InputError(f"{document.path}: {name}: {len(array)} {what} for {len(vertices)} vertices")
    return part


def _faces(order: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Return (M, 3) triangles of a list, strip or fan (section 3.7.2.1)."""
    if mode == _TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    count = max(len(order) - 2, 0)
    k = np.arange(count)
    if mode == _STRIP:
        odd = k % 2
        return np.stack([order[k], order[k + 1 + odd], order[k + 2 - odd]], axis=1)
    return np.stack([order[k + 1], order[k + 2], np.broadcast_to(order[:1], (count,))], axis=1)


def _texture(
    document: _Document, texture: dict[str, Any], attributes: dict[str, Any], factor: NDArray[np.float64]
) -> tuple[NDArray[np.float64] | None, ColorSource | None]:
    """Return the coordinates and the image of a base colour texture, times the factor."""
    transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
    key = f"TEXCOORD_{transform.get('texCoord', texture.get('texCoord', 0))}"
    number = document.tree["textures"][_index(texture["index"])].get("source")
    if key not in attributes or number is None:
        return None, None
    uvs = _accessor(document, attributes[key])[:, :2]
    if transform:
        turn = float(transform.get("rotation", 0.0))
        c, s = np.cos(turn), np.sin(turn)
        uvs = uvs * np.array(transform.get("scale", (1.0, 1.0)), np.float64) @ np.array([[c, -s], [s, c]])
        uvs = uvs + np.array(transform.get("offset", (0.0, 0.0)), np.float64)
    uvs = uvs * (1.0, -1.0) + (0.0, 1.0)  # v runs downwards in the file
    image = document.tree["images"][_index(number)]
    if number not in document.textures:
        try:
            document.textures[number] = _image(document, image)
        except Exception as error:  # noqa: BLE001 - decoders fail on damaged images in ways they do not list
            document.textures[number] = None
            warn(f"{document.path}: texture {number} left out: {first_line(error)}")
    pixels = document.textures[number]
    if pixels is None:
        return uvs, None
    if not (factor == 1.0).all():
        pixels = pixels * factor.astype(np.float32)
    return uvs, ImageTexture(pixels, str(image.get("name") or f"{document.path.name} image {number}"))


def _image(document: _Document, image: dict[str, Any]) -> NDArray[np.float32]:
    from PIL import Image

    data = _view(document, image["bufferView"])[0] if "bufferView" in image else _resource(document, image["uri"])
    with Image.open(io.BytesIO(data)) as opened:
        return pixels_of(opened)


def _accessor(document: _Document, number: Any) -> NDArray[np.float64]:
    """Return an accessor's (count, width) numbers as float64 (section 3.6.2)."""
    accessor = document.tree["accessors"][_index(number)]
    count, width = _index(accessor["count"]), _WIDTHS[accessor["type"]]
    dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
    if "bufferView" in accessor:
        values = _items(document, accessor["bufferView"], accessor.get("byteOffset", 0), dtype, count, width)
    elif "sparse" in accessor and count <= 2**31:
        values = np.zeros((count, width))
    else:
        raise InputError(f"{document.path}: accessor {number} holds no data; an extension may, export without it")
    if "sparse" in accessor:
        sparse = accessor["sparse"]
        n, where, what = _index(sparse["count"]), sparse["indices"], sparse["values"]
        index_type = np.dtype(_COMPONENTS[where["componentType"]])
        rows = _items(document, where["bufferView"], where.get("byteOffset", 0), index_type, n, 1)
        replacements = _items(document, what["bufferView"], what.get("byteOffset", 0), dtype, n, width)
        values = values.copy()
        values[rows[:, 0].astype(np.int64)] = replacements
    if accessor.get("normalized") and dtype.kind in "iu":
        values = np.maximum(values / np.iinfo(dtype).max, -1.0)
    return values


def _items(
    document: _Document, view: Any, offset: Any, dtype: np.dtype[Any], count: int, width: int
) -> NDArray[np.float64]:
    data, stride = _view(document, view)
    size = dtype.itemsize * width
    stride, offset = stride or size, _index(offset)
    if count == 0:
        return np.zeros((0, width))
    if offset + (count - 1) * stride + size > len(data):
        raise InputError(f"{document.path}: an accessor reaches past the end of its buffer; the file is damaged")
    items = np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))
    return items.astype(np.float64)


def _view(document: _Document, number: Any) -> tuple[bytes, int]:
    """Return the bytes of a buffer view and its stride, 0 if tightly packed."""
    view = document.tree["bufferViews"][_index(number)]
    which = _index(view["buffer"])
    if which not in document.buffers:
        buffer = document.tree["buffers"][which]
        if "uri" in buffer:
            document.buffers[which] = _resource(document, buffer["uri"])
        elif which == 0 and document.chunk is not None:
            document.buffers[which] = document.chunk
        else:
            raise InputError(f"{document.path}: buffer {which} is not in the file; it is truncated")
    begin, length = _index(view.get("byteOffset", 0)), _index(view["byteLength"])
    data = document.buffers[which][begin : begin + length]
    if len(data) != length:
        raise InputError(f"{document.path}: buffer {which} is shorter than the file says; it is truncated")
    return data, _index(view.get("byteStride", 0))


def _resource(document: _Document, uri: str) -> bytes:
    """Return what a URI names: data in the URI itself, or a file beside this one (section 3.6.1.1)."""
    if uri.startswith("data:"):
        kind, _, text = uri.partition(",")
        return base64.b64decode(text) if kind.endswith(";base64") else unquote_to_bytes(text)
    file = document.path.parent / unquote(uri)
    try:
        return file.read_bytes()
    except (OSError, ValueError) as error:
        reason = first_line(error)
        raise InputError(f"{document.path}: {str(file)!r}, which it refers to, cannot be read: {reason}") from None
