"""Normals of large meshes, computed by a kernel (`kernels/files/creases.py`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene.mesh import Mesh, box_around
from wrt.scene.normals import CREASE_LIMIT, same_positions, with_normals

FACES = range(1 << 18, CREASE_LIMIT + 1)
"""Numbers of faces for the kernel: NumPy takes fewer in the time of compiling it, and more have no creases."""


def smoothed(mesh: Mesh, crease_degrees: float, smoothing: NDArray[np.integer[Any]] | None = None) -> Mesh:
    """Return what `with_normals` does."""
    if mesh.normals is None and smoothing is None and crease_degrees < 180.0 and len(mesh.faces) in FACES:
        found = creased(mesh, crease_degrees)
        if found is not None:
            return found
    return with_normals(mesh, crease_degrees, smoothing)


def creased(mesh: Mesh, crease_degrees: float) -> Mesh | None:
    """Return a mesh with normals, or None where the kernel leaves it to the host."""
    from wrt.backend.device import Device

    device = Device("cpu", threads=1)
    backend = device.backend
    kernels = backend.kernels("wrt.kernels.files.creases")
    positions = same_positions(mesh.vertices).astype(np.int32)
    places, corners = int(positions.max()) + 1, mesh.faces.size
    origin = mesh.vertices[0].astype(np.float64)
    arguments = kernels.Mesh()
    arguments.vertices = backend.array(mesh.vertices.reshape(-1), float, copy=False)
    arguments.faces = backend.array(mesh.faces.reshape(-1), int, copy=False)
    arguments.positions = backend.array(positions, int, copy=False)
    arguments.begins, arguments.counts = backend.zeros(places + 2, int), backend.zeros(len(positions), int)
    for name in ("corners", "copies", "sources"):
        setattr(arguments, name, backend.empty(corners, int))
    arguments.normals, arguments.is_done = backend.empty(3 * corners), backend.empty(places, int)
    arguments.origin = origin
    arguments.scale = float(np.abs(box_around(mesh.vertices) - origin).max()) or 1.0
    arguments.least_cosine = np.cos(np.deg2rad(crease_degrees)) - 1e-9
    try:
        device.launch(kernels.list_corners, 1, [arguments])
    except OSError:
        return None  # no space to compile it
    backend.artefacts.save()  # for processes that only load files
    device.launch(kernels.join_corners, places, [arguments])
    if not arguments.is_done.numpy().all():
        return None
    counts = arguments.counts.numpy()
    begins = np.cumsum(counts, dtype=np.int32) - counts
    faces = begins.take(mesh.faces) + arguments.copies.numpy().reshape(-1, 3)
    source, rows = np.repeat(np.arange(len(counts)), counts), np.empty(int(counts.sum()), np.int32)
    rows[faces.reshape(-1)] = arguments.sources.numpy()
    return mesh.reindexed(source, faces, normals=arguments.normals.numpy().reshape(-1, 3)[rows])
