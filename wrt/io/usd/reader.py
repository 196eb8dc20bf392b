"""USD files: meshes, instances, materials, cameras and lights, read by Pixar's library in a process of its own.

Format: OpenUSD 26, UsdGeom, UsdShade with UsdPreviewSurface, and UsdLux. The file says which way is up and how long its
unit is: the scene has y up and metres. Values are those of the stage's default time.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.mesh.parts import Contents, Part, placed
from wrt.io.safe_read import require_file
from wrt.io.usd.kinds import LIGHTS
from wrt.io.usd.lights import Values, camera_of, light_of
from wrt.io.usd.materials import UsdMaterials
from wrt.io.usd.meshes import indices, mesh_parts, solid
from wrt.io.usd.process import description
from wrt.linalg import inverse, product
from wrt.scene.camera import Camera
from wrt.scene.environment import Environment
from wrt.scene.lights import Light

Matrix = NDArray[np.float64]

_MISSING = re.compile(r"Could not open asset @([^@]*)@")


def read_usd(path: Path) -> tuple[Contents, Environment | None]:
    """Return the content of a file, and its dome of light.

    Raises:
        InputError: where Pixar's library is missing or cannot open the file, and on files that it may not read.
    """
    if importlib.util.find_spec("pxr") is None:
        raise InputError(f"{path}: USD files need Pixar's library: pip install 'wrt[usd]'")
    require_file(path)
    content = description(path)
    read = _Reader(path, content).read()
    for name in dict.fromkeys(name for text in content["notes"] for name in _MISSING.findall(text)):
        warn(f"{path}: {name!r}, which it refers to, cannot be opened; it is left out")
    return read


class _Reader:
    """Makes the content of a described stage; what several instances share is made once."""

    def __init__(self, path: Path, content: dict[str, Any]) -> None:
        self._path, self._content = path, content
        self._scale = content["metersPerUnit"]
        if self._scale is None:
            warn(f"{path}: its unit of length is not a number as it should be; taken as metres")
            self._scale = 1.0
        self._world = np.diag([self._scale, self._scale, self._scale, 1.0])
        if content["up"] == "Z":
            self._world = product(np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]]), self._world)
        self._materials = UsdMaterials(path, content)
        self._parts: dict[str, list[Part]] = {}
        self._places: dict[str, list[Matrix]] = {}

    def read(self) -> tuple[Contents, Environment | None]:
        lights: list[Light] = []
        cameras: list[Camera] = []
        dome: Environment | None = None
        for prim, place in zip(self._content["prims"], self._content["places"].reshape(-1, 4, 4), strict=True):
            kind, name = prim["kind"], f"{self._path}: {prim['path']}"
            matrix = product(self._world, place.T)
            if kind == "Shape":
                self._add(prim["shape"], matrix)
                continue
            values = Values(prim["values"], name)
            if kind == "PointInstancer":
                self._add_instances(prim, matrix)
            elif kind == "DomeLight" and dome is not None:
                warn(f"{name}: there is more than one dome of light; left out")
            else:
                with np.errstate(all="ignore"):  # what is not finite is refused where it is used
                    if kind == "Camera":
                        cameras.append(camera_of(values, matrix, self._scale))
                    elif kind in LIGHTS:
                        lights.append(light_of(values, kind, matrix))
                    else:
                        dome = self._materials.dome(values, matrix)
        for text in self._content["left_out"]:
            warn(f"{self._path}: {text}")
        parts = [placed(part, self._places[key]) for key, made in self._parts.items() for part in made]
        return Contents(parts, lights, cameras), dome

    def _add(self, key: str, matrix: Matrix) -> None:
        """Add a mesh at a place; instances of one prototype share their triangles."""
        if key not in self._parts:
            shape = self._content["shapes"][key]
            if shape["kind"] == "Mesh":
                self._parts[key] = mesh_parts(self._path, shape, self._materials)
            else:
                self._parts[key] = [solid(self._path, shape, self._materials)]
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE * len(self._parts[key]))
        self._places.setdefault(key, []).append(matrix)

    def _add_instances(self, prim: dict[str, Any], matrix: Matrix) -> None:
        """Add the prototypes of a point instancer at each of its places."""
        which = indices(prim["values"]["protoIndices"])
        places, shown = prim["instances"], np.array(prim["shown"] or np.ones(len(which)), bool)
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE * len(which))
        if not len(which) == len(places) == len(shown):
            reason = "at rest the numbers of its indices, positions, orientations and scales do not agree"
            warn(f"{self._path}: {prim['path']}: {reason}; left out")
            return
        if beyond := int(((which < 0) | (which >= len(prim["prototypes"]))).sum()):
            warn(f"{self._path}: {prim['path']}: {beyond} of its instances are of no prototype; left out")
        for number, prototype in enumerate(prim["prototypes"]):
            for key, own in prototype["shapes"]:
                try:
                    within = product(inverse(prototype["above"].T), own.T)
                except np.linalg.LinAlgError:
                    warn(f"{self._path}: {prim['path']}: its prototypes are shrunk to nothing; left out")
                    return
                for place in np.flatnonzero(shown & (which == number)).tolist():
                    self._add(key, product(product(matrix, places[place].T), within))
