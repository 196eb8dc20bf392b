"""Bytes of small mesh files: PLY of any elements, one box in every format, arrays added to glTF files."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

import wrt
from support.meshes import check_message, gltf_box, write

ORDERS = "ascii", "binary_little_endian", "binary_big_endian"
CODES = {"uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}
XYZ = "float x", "float y", "float z"
INDICES = "list uchar int vertex_indices"

Element = tuple[str, Sequence[str], Sequence[Sequence[Any]]]
"""Name, properties as in the header, and rows; the value of a list is a sequence."""


def ply(order: str, *elements: Element, head: str = "") -> bytes:
    body, end = b"", ">" if "big" in order else "<"
    for name, properties, rows in elements:
        head += f"element {name} {len(rows)}\n" + "".join(f"property {text}\n" for text in properties)
        for row in rows:
            code, values = end, []
            for text, value in zip(properties, row, strict=True):
                kinds = text.split()
                if kinds[0] == "list":
                    code += CODES[kinds[1]] + CODES[kinds[2]] * len(value)
                    values += [len(value), *value]
                else:
                    code += CODES[kinds[0]]
                    values.append(value)
            binary = struct.pack(code, *values)
            body += (" ".join(map(str, values)) + "\n").encode() if order == "ascii" else binary
    return f"ply\nformat {order} 1.0\n{head}end_header\n".encode() + body


def off_binary(order: str, points: ArrayLike, faces: Sequence[Sequence[int]], colors: int = 0) -> bytes:
    """Return a binary OFF file whose faces have some numbers of a colour each."""
    data = b"OFF BINARY\n" + struct.pack(f"{order}3i", np.shape(points)[0], len(faces), 0)
    data += np.asarray(points, f"{order}f4").tobytes()
    for face in faces:
        data += struct.pack(f"{order}{len(face) + 2}i{colors}f", len(face), *face, colors, *[0.5] * colors)
    return data


def facets(corners: np.ndarray, normal: str = "0 0 0") -> str:
    """Return (T, 3, 3) triangles as an STL file in words has them."""
    text = ""
    for triangle in corners.tolist():
        vertices = "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle)
        text += f"facet normal {normal}\nouter loop\n{vertices}endloop\nendfacet\n"
    return text


def joined(tree: dict[str, Any], binary: bytes) -> bytes:
    """Return the GLB of a JSON and a binary chunk ("glTF 2.0 Specification", section 4.4)."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    parts = [b"glTF", (2).to_bytes(4, "little"), (28 + len(text) + len(binary)).to_bytes(4, "little")]
    parts += [len(text).to_bytes(4, "little"), b"JSON", text, len(binary).to_bytes(4, "little"), b"BIN\0", binary]
    return b"".join(parts)


def box_files() -> dict[str, bytes]:
    """Return the contents of files of one box, which the readers that wrt has for itself read."""
    box = wrt.box((0, 0, 0), (1, 2, 3))
    points, faces = box.vertices.astype("<f4"), box.faces.astype("<i4")
    corners = points[faces]
    lines = ["\n".join(" ".join(map(str, row)) for row in array.tolist()) for array in (points, faces)]
    records = b"".join(struct.pack("<12fH", 0, 0, 1, *triangle, 0) for triangle in corners.reshape(-1, 9).tolist())
    elements: tuple[Element, Element] = (
        ("vertex", XYZ, points.tolist()),
        ("face", (INDICES,), [[face] for face in faces.tolist()]),
    )
    tree = gltf_box(points, faces)
    data = base64.b64decode(tree["buffers"][0]["uri"].partition(",")[2])
    off = f"OFF # a box\n8 12 0\n{lines[0]}" + "".join(f"\n3 {row}" for row in lines[1].splitlines())
    obj = [f"v {row}" for row in lines[0].splitlines()] + [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return {
        "box.obj": "\n".join(obj).encode(),
        "text.stl": f"solid box\n{facets(corners, '0 0 1')}endsolid box\n".encode(),
        "binary.stl": b"solid though binary".ljust(80) + struct.pack("<I", 12) + records,
        "box.off": off.encode(),
        "big.off": off_binary(">", points, faces.tolist()),
        **{f"{order}.ply": ply(order, *elements) for order in ORDERS},
        "box.gltf": json.dumps(tree).encode(),
        "box.glb": joined({**tree, "buffers": [{"byteLength": len(data)}]}, data),
    }


TYPES = {"f4": 5126, "i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125}
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def data_uri(data: bytes, kind: str = "application/octet-stream") -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def add_view(tree: dict[str, Any], data: bytes, **fields: object) -> int:
    tree["buffers"].append({"uri": data_uri(data), "byteLength": len(data)})
    tree["bufferViews"].append({"buffer": len(tree["buffers"]) - 1, "byteLength": len(data), **fields})
    return len(tree["bufferViews"]) - 1


def add(tree: dict[str, Any], values: ArrayLike, dtype: str = "<f4", **fields: object) -> int:
    """Add an accessor of an array, and return its number."""
    rows = np.asarray(values, dtype)
    kind = {"componentType": TYPES[dtype[1:]], "type": WIDTHS[1 if rows.ndim == 1 else rows.shape[1]]}
    tree["accessors"].append({"bufferView": add_view(tree, rows.tobytes()), "count": len(rows), **kind, **fields})
    return len(tree["accessors"]) - 1


def attributes(tree: dict[str, Any]) -> dict[str, int]:
    """Return what the first primitive has of each vertex."""
    return tree["meshes"][0]["primitives"][0]["attributes"]


def saved(folder: Path, tree: dict[str, Any], name: str = "a.gltf") -> Path:
    return write(folder, name, json.dumps(tree))


def check_refused(message: str, read: Any, path: Path, *arguments: object) -> None:
    """Check that a file is refused in one line, which begins with its name and matches a pattern."""
    with pytest.raises(wrt.InputError, match=message) as caught:
        read(path, *arguments)
    check_message(caught.value, path)


def values_of(value: Any) -> Any:
    """Return what a value of a material is at each texel, if it is an image."""
    if not isinstance(value, wrt.ImageTexture):
        return value
    if value.channel:
        return value.pixels[..., "rgb".index(value.channel)] * value.factor[0]
    return value.pixels * np.float32(value.factor)


def check_values(material: wrt.Material, **expected: Any) -> None:
    """Check what the values of a material are, whatever images hold them."""
    for name, value in expected.items():
        found = values_of(getattr(material, name))
        if value is None or isinstance(value, bool):
            assert found is value, name
        else:
            np.testing.assert_allclose(found, value, rtol=1e-5, atol=1e-6, err_msg=name)
