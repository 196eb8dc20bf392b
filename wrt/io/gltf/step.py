"""STEP files (ISO 10303-21), whose exact surfaces Open CASCADE turns into triangles, by the library cascadio.

It runs in a process of its own: it prints what it thinks of a file, and a damaged one may end it.
"""

from __future__ import annotations

import importlib.util
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from wrt import child
from wrt.errors import InputError
from wrt.io.gltf.reader import read_gltf
from wrt.io.mesh.parts import Contents, Part

LINEAR, ANGULAR = 0.005, 0.15
"""Deflection of triangles: relative to the size of an edge, and radians between neighbours, 42 around a cylinder."""

_CONVERT = (
    "import cascadio; "
    f"sys.exit(cascadio.step_to_glb(*sys.argv[1:], tol_linear={LINEAR}, tol_angular={ANGULAR}, tol_relative=True))"
)


def read_step(path: Path, data: bytes) -> Contents:
    """Return a part for each colour of each solid, in metres, with the normals of the exact surfaces.

    Raises:
        InputError: where the library is not installed, or cannot read the file.
    """
    if importlib.util.find_spec("cascadio") is None:
        raise InputError(f"{path}: STEP files need Open CASCADE: pip install 'wrt[step]'")
    if not data.lstrip().startswith(b"ISO-10303-21;"):
        raise InputError(f"{path}: not a STEP file: it does not begin with ISO-10303-21;")
    with tempfile.TemporaryDirectory(prefix="wrt-step-") as folder:
        source, target = Path(folder, "part.step"), Path(folder, "part.glb")
        source.write_bytes(data)
        command = child.command(_CONVERT, str(source), str(target))
        status = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False).returncode
        triangles = target.read_bytes() if status == 0 and target.exists() else b""
    if not triangles:
        raise InputError(f"{path}: not a whole STEP file that can be read, or without surfaces")
    contents = read_gltf(path, triangles)
    return replace(contents, parts=[_without_slivers(part) for part in contents.parts])


def _without_slivers(part: Part) -> Part:
    """Return a part without triangles of corners at one place, which Open CASCADE makes at the poles of balls."""
    corners = np.asarray(part.vertices)[part.faces]
    meet = (corners == np.roll(corners, 1, axis=1)).all(axis=2).any(axis=1)
    return replace(part, faces=part.faces[~meet]) if meet.any() else part
