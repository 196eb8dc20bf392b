"""USD files: meshes, instances, materials, cameras and lights, read by Pixar's library.

Format: OpenUSD 26, UsdGeom, UsdShade with UsdPreviewSurface, and UsdLux. The file says which way is up and how long its
unit is: the scene has y up and metres. Values are those of the stage's default time.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.mesh.parts import Contents, Part, placed
from wrt.io.safe_read import first_line, require_file
from wrt.io.usd.lights import LIGHT_KINDS, camera_of, light_of
from wrt.io.usd.materials import UsdMaterials
from wrt.io.usd.meshes import SOLIDS, mesh_parts, solid
from wrt.linalg import inverse, product
from wrt.scene.camera import Camera
from wrt.scene.environment import Environment
from wrt.scene.lights import Light

Matrix = NDArray[np.float64]

_MISSING = re.compile(r"Could not open asset @([^@]*)@")
_SILENT = ("Xform", "Scope", "Material", "Shader", "GeomSubset", "NodeGraph", "SkelRoot", "", "DomeLight")
"""Types that hold others, or are read with those that use them."""


def read_usd(path: Path) -> tuple[Contents, Environment | None]:
    """Return the content of a file, and its dome of light.

    Raises:
        InputError: where Pixar's library is missing or cannot open the file, and on files that it may not read.
    """
    try:
        from pxr import Tf, Usd, UsdUtils
    except ImportError:
        raise InputError(f"{path}: USD files need Pixar's library: pip install 'wrt[usd]'") from None
    require_file(path)
    notes = UsdUtils.CoalescingDiagnosticDelegate()  # or they are printed
    try:
        read = _read(path, Usd.Stage.Open(str(path), Usd.Stage.LoadAll))
    except Tf.ErrorException as error:
        raise InputError(f"{path}: not a USD file that can be read: {first_line(error)}") from None
    finally:
        told = [str(note.commentary) for note in notes.TakeUncoalescedDiagnostics()]
    for name in dict.fromkeys(name for text in told for name in _MISSING.findall(text)):
        warn(f"{path}: {name!r}, which it refers to, cannot be opened; it is left out")
    return read


def _read(path: Path, stage: Any) -> tuple[Contents, Environment | None]:
    from pxr import Tf, UsdGeom

    for layer in stage.GetUsedLayers():
        if layer.realPath:
            require_file(Path(layer.realPath))
    try:
        scale = UsdGeom.GetStageMetersPerUnit(stage)
    except Tf.ErrorException:
        warn(f"{path}: its unit of length is not a number as it should be; taken as metres")
        scale = 1.0
    world = np.diag([scale, scale, scale, 1.0])
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z:
        world = product(np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]]), world)
    return _Reader(path, world, scale).read(stage)


class _Reader:
    """Walks over one stage; what several instances share is made once."""

    def __init__(self, path: Path, world: Matrix, scale: float) -> None:
        self._path, self._world, self._scale = path, world, scale
        self._materials = UsdMaterials(path)
        self._parts: dict[Any, list[Part]] = {}
        self._places: dict[Any, list[Matrix]] = {}
        self._unknown: set[str] = set()

    def read(self, stage: Any) -> tuple[Contents, Environment | None]:
        from pxr import Usd, UsdGeom

        lights: list[Light] = []
        cameras: list[Camera] = []
        dome: Environment | None = None
        cache = UsdGeom.XformCache(Usd.TimeCode.Default())
        walk = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
        for prim in walk:
            if _is_hidden(prim):
                walk.PruneChildren()
                continue
            kind = str(prim.GetTypeName())
            matrix = product(self._world, np.array(cache.GetLocalToWorldTransform(prim)).T)
            if prim.IsA(UsdGeom.PointInstancer):
                self._add_instances(stage, UsdGeom.PointInstancer(prim), matrix)
                walk.PruneChildren()
            elif kind == "Mesh" or kind in SOLIDS:
                self._add(prim, matrix)
            elif kind == "Camera":
                cameras.append(camera_of(UsdGeom.Camera(prim), matrix, self._scale))
            elif kind in LIGHT_KINDS:
                lights.append(light_of(prim, kind, matrix))
            elif kind == "DomeLight":
                if dome is not None:
                    warn(f"{self._path}: {prim.GetPath()}: there is more than one dome of light; left out")
                    continue
                dome = self._materials.dome(prim, matrix)
            elif kind not in _SILENT and kind not in self._unknown:
                self._unknown.add(kind)
                warn(f"{self._path}: {prim.GetPath()}: a {kind} is not supported; left out")
        parts = [placed(part, self._places[key]) for key, made in self._parts.items() for part in made]
        return Contents(parts, lights, cameras), dome

    def _add(self, prim: Any, matrix: Matrix) -> None:
        """Add a mesh at a place; instances of one prototype share their triangles."""
        shared = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = shared.GetPath()
        if key not in self._parts:
            if str(prim.GetTypeName()) == "Mesh":
                self._parts[key] = mesh_parts(self._path, prim, self._materials)
            else:
                self._parts[key] = [solid(self._path, prim, self._materials)]
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE * len(self._parts[key]))
        self._places.setdefault(key, []).append(matrix)

    def _add_instances(self, stage: Any, instancer: Any, matrix: Matrix) -> None:
        """Add the prototypes of a point instancer at each of its places."""
        from pxr import Usd, UsdGeom

        time = Usd.TimeCode.Default()
        which = np.array(instancer.GetProtoIndicesAttr().Get() or [], np.int64)
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE * len(which))
        places = instancer.ComputeInstanceTransformsAtTime(time, time, UsdGeom.PointInstancer.ExcludeProtoXform)
        for number, root in enumerate(instancer.GetPrototypesRel().GetTargets()):
            prototype = stage.GetPrimAtPath(root)
            own = UsdGeom.XformCache(time)
            above = np.array(own.GetLocalToWorldTransform(prototype.GetParent())).T
            for prim in Usd.PrimRange(prototype, Usd.TraverseInstanceProxies()):
                if str(prim.GetTypeName()) != "Mesh" and str(prim.GetTypeName()) not in SOLIDS:
                    continue
                within = product(inverse(above), np.array(own.GetLocalToWorldTransform(prim)).T)
                for place in np.flatnonzero(which == number).tolist():
                    self._add(prim, product(product(matrix, np.array(places[place]).T), within))


def _is_hidden(prim: Any) -> bool:
    """Return whether a prim and those below it are not to be rendered."""
    from pxr import UsdGeom

    imageable = UsdGeom.Imageable(prim)
    if not imageable or prim.IsPseudoRoot():
        return False
    purpose = str(imageable.GetPurposeAttr().Get() or "default")
    return str(imageable.GetVisibilityAttr().Get()) == "invisible" or purpose in ("guide", "proxy")
