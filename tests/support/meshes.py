"""Small mesh files, and measures of meshes that wrong triangles change."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np

import wrt

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
"""The corners of a unit square as OBJ."""


def write(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def triangles(mesh: wrt.Mesh) -> np.ndarray:
    return mesh.vertices[mesh.faces]


def check_message(error: wrt.InputError, path: Path) -> None:
    assert str(error).startswith(f"{path}: ")
    assert "\n" not in str(error)
    assert str(error).count(str(path)) == 1


def area_vector(mesh: wrt.Mesh) -> np.ndarray:
    """Sum of the triangles' area vectors; winding flips and overlaps change it."""
    a, b, c = np.moveaxis(triangles(mesh).astype(np.float64), 1, 0)
    return np.cross(b - a, c - a).sum(axis=0) / 2.0


def area(mesh: wrt.Mesh) -> float:
    a, b, c = np.moveaxis(triangles(mesh).astype(np.float64), 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def volume(mesh: wrt.Mesh) -> float:
    a, b, c = np.moveaxis(triangles(mesh).astype(np.float64), 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def repeated_edges(mesh: wrt.Mesh) -> int:
    """Directed edges, by position, that more than one face has: zero on a consistently wound surface."""
    _, index = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces].astype(np.int64)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, counts = np.unique(edges[:, 0] * len(mesh.vertices) + edges[:, 1], return_counts=True)
    return int((counts > 1).sum())


def gltf_box(points: np.ndarray, faces: np.ndarray) -> dict:
    data = points.astype("<f4").tobytes() + faces.astype("<u2").tobytes()
    return {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(points)},
            {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": faces.size},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": points.size * 4},
            {"buffer": 0, "byteOffset": points.size * 4, "byteLength": faces.size * 2},
        ],
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
    }
