"""Meshes as binary PLY files, which other renderers read as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import wrt


def write_ply(mesh: wrt.Mesh, path: Path) -> None:
    """Write a mesh with all that it has."""
    groups = (("x y z", mesh.vertices), ("nx ny nz", mesh.normals), ("u v", mesh.uvs), ("r g b", mesh.colors))
    names = [name for group, array in groups if array is not None for name in group.split()]
    arrays = [array for _, array in groups if array is not None]
    properties = "".join(f"property float {name}\n" for name in names)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.vertices)}\n{properties}"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("indices", "<i4", 3)])
    faces["count"] = 3
    faces["indices"] = mesh.faces
    path.write_bytes(header.encode() + np.hstack(arrays).astype("<f4").tobytes() + faces.tobytes())
