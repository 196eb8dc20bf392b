"""USD files: meshes, instances, materials, cameras and lights, read by Pixar's library in a process of its own.

Format: OpenUSD 26, UsdGeom, UsdShade with UsdPreviewSurface, and UsdLux. Up axis and unit of the file become y
and metres. Values are taken at the stage's default time.
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
from wrt.io.usd.lights import Values, camera_of, light_of
from wrt.io.usd.materials import UsdMaterials
from wrt.io.usd.meshes import indices, part_of_solid, parts_of_mesh
from wrt.io.usd.process import description
from wrt.linalg import inverse, product
from wrt.scene.camera import Camera
from wrt.scene.environment import Environment
from wrt.scene.lights import Light

Matrix = NDArray[np.float64]

_MISSING = re.compile(r"Could not open asset @([^@]*)@")


def read_usd(path: Path) -> tuple[Contents, Environment | None]:
    """Return the content of a file, and the environment of its dome light.

    Raises:
        InputError: where Pixar's library is missing or cannot open the file, and on files that it may not read.
    """
    if importlib.util.find_spec("pxr") is None:
        raise InputError(f"{path}: USD files need Pixar's library: pip install 'wrt[usd]'")
    require_file(path)
    content = description(path)
    result = _Reader(path, content).read()
    for name in dict.fromkeys(name for text in content["notes"] for name in _MISSING.findall(text)):
        warn(f"{path}: {name!r}, which it refers to, cannot be opened; it is left out")
    return result


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
        cameras: list[tuple[str, Camera]] = []
        dome: Environment | None = None
        for prim, place in zip(self._content["prims"], self._content["places"].reshape(-1, 4, 4), strict=True):
            kind, name = prim["kind"], f"{self._path}: {prim['path']}"
            matrix = product(self._world, place.T)
            with np.errstate(all="ignore"):  # what is not finite is refused where it is used
                if kind == "Shape":
                    self._add(prim["shape"], matrix)
                elif kind == "PointInstancer":
                    self._add_instances(prim, name, matrix)
                elif kind == "Camera":
                    camera = camera_of(Values(prim["values"], name), matrix, self._scale)
                    cameras.append((prim["path"].rpartition("/")[2], camera))
                elif kind != "DomeLight":
                    lights.append(light_of(Values(prim["values"], name), kind, matrix))
                elif dome is None:
                    dome = self._materials.dome(Values(prim["values"], name), matrix)
                else:
                    warn(f"{name}: there is more than one dome of light; left out")
        for text in self._content["left_out"]:
            warn(f"{self._path}: {text}")
        parts = [placed(part, self._places[key]) for key, made in self._parts.items() for part in made]
        return Contents(parts, lights, cameras), dome

    def _add(self, key: str, matrix: Matrix) -> None:
        """Add a mesh at a place; instances of one prototype share their triangles."""
        if key not in self._parts:
            shape = self._content["shapes"][key]
            if shape["kind"] == "Mesh":
                self._parts[key] = parts_of_mesh(self._path, shape, self._materials)
            else:
                self._parts[key] = [part_of_solid(self._path, shape, self._materials)]
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE * len(self._parts[key]))
        self._places.setdefault(key, []).append(matrix)

    def _add_instances(self, prim: dict[str, Any], name: str, matrix: Matrix) -> None:
        """Add the prototypes of a point instancer at each of its places."""
        numbers = indices(prim["values"]["protoIndices"])
        places, is_shown = prim["instances"], np.array(prim["shown"] or np.ones(len(numbers)), bool)
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE * len(numbers))
        if not len(numbers) == len(places) == len(is_shown):
            reason = "at rest the numbers of its indices, positions, orientations and scales do not agree"
            warn(f"{name}: {reason}; left out")
            return
        if beyond := int(((numbers < 0) | (numbers >= len(prim["prototypes"]))).sum()):
            warn(f"{name}: {beyond} of its instances are of no prototype; left out")
        for number, prototype in enumerate(prim["prototypes"]):
            for key, place_of_shape in prototype["shapes"]:
                try:
                    local = product(inverse(prototype["above"].T), place_of_shape.T)
                except np.linalg.LinAlgError:
                    warn(f"{name}: its prototypes are shrunk to nothing; left out")
                    return
                for instance in np.flatnonzero(is_shown & (numbers == number)).tolist():
                    self._add(key, product(product(matrix, places[instance].T), local))
