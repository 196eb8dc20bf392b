"""USD files: meshes, instances, materials, cameras and lights, read by Pixar's library in a process of its own.

Format: OpenUSD 26, UsdGeom, UsdShade with UsdPreviewSurface, and UsdLux. Up axis and unit of the file become y
and metres. Values are those of the file's first time, unless a time is given.
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
from wrt.io.account import warn_of_unused
from wrt.io.mesh.parts import NO_ANIMATION, Contents, Part, placed
from wrt.io.safe_read import require_file
from wrt.io.usd.lights import Values, camera_of, light_of
from wrt.io.usd.materials import UsdMaterials
from wrt.io.usd.meshes import indices, part_of_points, part_of_solid, parts_of_mesh
from wrt.io.usd.process import description
from wrt.linalg import inverse, product
from wrt.scene.camera import Camera
from wrt.scene.environment import Environment
from wrt.scene.lights import Light
from wrt.values import vec3

Matrix = NDArray[np.float64]

_NO_BLUR = "within a frame of a file nothing moves"
_OF_CAGES = "of subdivision surfaces, which are rendered as their cages with a warning"

WITHOUT_EFFECT = {
    "*.accelerations": _NO_BLUR,
    "*.angularVelocities": _NO_BLUR,
    "*.velocities": _NO_BLUR,
    "*.motion:*": _NO_BLUR,
    "Camera.shutter:*": _NO_BLUR,
    "*.doubleSided": "surfaces are seen from both sides",
    "*.extent": "a bound that follows from the shape",
    "*.extentsHint": "a bound that follows from the shapes",
    "*.proxyPrim": "proxies are not drawn",
    "*.guideVisibility": "guides are not drawn",
    "*.proxyVisibility": "proxies are not drawn",
    "*.guideRadius": "the size of a guide, which is not drawn",
    "*.primvars:*": "materials read them by name; what a material reads is accounted for there",
    "*.model:*": "how viewers draw an asset that is not loaded",
    "*.ui:*": "how programs show a node",
    "*.houdini:*": "how a program shows a prim",
    "*.physics:*": "how bodies move",
    "*.skel:joint*": "a part of skins, which are named",
    "*.collection:*Link": "the collection itself; its members are named",
    "*.collection:*Link:expansionRule": "how members of a collection are listed",
    "DomeLight*.inputs:normalize": "a dome has no size",
    "Camera.clippingRange": "bounds of a depth buffer",
    "Camera.horizontalAperture": "the picture's size decides about its width",
    "Camera.stereoRole": "one of the two eyes is rendered alone",
    "*.light:materialSyncMode": "of lights by the material of a mesh",
    "*.light:shaderId": "the shader for other renderers; the type of the light is used",
    "Mesh.cornerIndices": _OF_CAGES,
    "Mesh.cornerSharpnesses": _OF_CAGES,
    "Mesh.creaseIndices": _OF_CAGES,
    "Mesh.creaseLengths": _OF_CAGES,
    "Mesh.creaseSharpnesses": _OF_CAGES,
    "Mesh.faceVaryingLinearInterpolation": _OF_CAGES,
    "Mesh.interpolateBoundary": _OF_CAGES,
    "Mesh.triangleSubdivisionRule": _OF_CAGES,
    "Points.ids": "names of points over time",
    "Points.normals": "spheres have their own",
    "Points.orientation": "the outside of spheres is known",
    "Material.inputs:*": "values that shaders read; what a shader reads is accounted for there",
    "Material.outputs:*:*": "the same material for other renderers",
    "*.preliminary:*": "how a viewer places and moves things in a room",
    "*.subsetFamily:*:familyType": "whether subsets cover a mesh; each is read by itself",
    "a prim of type Physics*": "how bodies move",
    "a prim of type Preliminary_*": "how a viewer places and moves things in a room",
    "a prim of type SpatialAudio": "sound",
    "a prim of type Render*": "settings of other renderers; the command line has wrt's",
    "a prim of type Skel*": "moves a skin, which is named",
    "UsdPreviewSurface.occlusion": "paths compute how surfaces shade each other",
    "UsdPreviewSurface.specular": "no input of this shader; Blender writes it",
    "UsdUVTexture.m??Filter": "no input of this shader; textures are filtered by what a pixel covers",
}
"""Content that does not change a picture, and why."""

Color = tuple[float, float, float]

MOST_COLORS = 256
"""Maximum number of colours of a point instancer's instances, since each is a mesh of its own."""

_Y_FROM_X = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
_Y_FROM_Z = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
_UPRIGHT = {"x": _Y_FROM_X, "-x": _Y_FROM_X.T, "-y": np.diag([1.0, -1.0, -1.0, 1.0]), "z": _Y_FROM_Z, "-z": _Y_FROM_Z.T}
"""The rotations that turn axes to +y."""

_MISSING = re.compile(r"Could not open asset @([^@]*)@")


def read_usd(path: Path, time: float | None = None, up: str | None = None) -> tuple[Contents, Environment | None]:
    """Return the content of a file, and the environment of its dome light, at `time` seconds after its first time.

    `up` is the axis that points up, in place of the one that the file declares.

    Raises:
        InputError: where Pixar's library is missing or cannot open the file, and on files that it may not read.
    """
    content = _described(path, time)
    if time is not None and content["animation"] is None:
        raise InputError(f"{path}: {NO_ANIMATION}")
    result = _Reader(path, content, up).read()
    for name in dict.fromkeys(name for text in content["notes"] for name in _MISSING.findall(text)):
        warn(f"{path}: {name!r}, which it refers to, cannot be opened; it is left out")
    return result


def animation_ends(path: Path) -> tuple[float, float] | None:
    """Return the first and the last second of a file in which anything changes; None if nothing does.

    Raises:
        InputError: see `read_usd`.
    """
    ends = _described(path)["animation"]
    return (ends[0], ends[1]) if ends else None


def _described(path: Path, time: float | None = None) -> dict[str, Any]:
    if importlib.util.find_spec("pxr") is None:
        raise InputError(f"{path}: USD files need Pixar's library: pip install 'wrt[usd]'")
    require_file(path)
    return description(path, time)


class _Reader:
    """Makes the content of a described stage; what several instances share is made once."""

    def __init__(self, path: Path, content: dict[str, Any], up: str | None) -> None:
        self._path, self._content = path, content
        self._scale = content["metersPerUnit"]
        if self._scale is None:
            warn(f"{path}: its unit of length is not a number as it should be; taken as metres")
            self._scale = 1.0
        self._world = np.diag([self._scale, self._scale, self._scale, 1.0])
        if content["up"] not in ("Y", "Z"):
            warn(f"{path}: its up axis {content['up']!r} is not one of USD; taken as Y")
        if (turn := _UPRIGHT.get(up or content["up"].lower())) is not None:
            self._world = product(turn, self._world)
        self._materials = UsdMaterials(path, content)
        self._parts: dict[tuple[str, Color | None], list[Part]] = {}
        self._places: dict[tuple[str, Color | None], list[Matrix]] = {}
        self._lights: list[Light] = []
        self._cameras: list[tuple[str, Camera]] = []
        self._dome: Environment | None = None

    def read(self) -> tuple[Contents, Environment | None]:
        self._read(self._content["prims"], self._world, ())
        for text in self._content["left_out"]:
            warn(f"{self._path}: {text}")
        unused = [kind for kind, count in self._content["unused"].items() for _ in range(count)]
        warn_of_unused(self._path, [*unused, *self._materials.unused()], WITHOUT_EFFECT)
        cages = sum(1 for key in {path for path, _ in self._parts} if self._content["shapes"][key].get("subdivided"))
        if cages:
            warn(f"{self._path}: subdivision surfaces are rendered as their cages, smoothed ({cages})")
        parts = [placed(part, self._places[key]) for key, made in self._parts.items() for part in made]
        return Contents(parts, self._lights, self._cameras), self._dome

    def _read(
        self, prims: list[dict[str, Any]], world: Matrix, prototypes: tuple[str, ...], color: Color | None = None
    ) -> None:
        """Add prims, transformed by a matrix.

        `prototypes` are those of point instancers that they are within, `color` that of their instance.
        """
        for prim in prims:
            kind, name = prim["kind"], f"{self._path}: {prim['path']}"
            matrix = product(world, self._place(prim["place"]))
            with np.errstate(all="ignore"):  # what is not finite is refused where it is used
                if kind == "Shape":
                    self._add(prim["shape"], matrix, color)
                elif kind == "PointInstancer":
                    self._add_instances(prim, name, matrix, prototypes)
                elif kind == "Camera":
                    camera = camera_of(Values(prim["values"], name), matrix, self._scale)
                    self._cameras.append((prim["path"].rpartition("/")[2], camera))
                elif not kind.startswith("DomeLight"):
                    self._lights.append(light_of(Values(prim["values"], name), kind, matrix))
                elif self._dome is None:
                    values = Values(prim["values"], name)
                    pole = values.word("poleAxis")
                    if (self._content["up"] if pole == "scene" else pole) == "Z":
                        matrix = product(matrix, _Y_FROM_Z.T)
                    self._dome = self._materials.dome(values, matrix)
                else:
                    warn(f"{name}: there is more than one dome of light; left out")

    def _place(self, number: int) -> Matrix:
        """Return the (4, 4) transform that the description has under a number."""
        place: Matrix = self._content["places"].reshape(-1, 4, 4)[number].T
        return place

    def _add(self, path: str, matrix: Matrix, color: Color | None) -> None:
        """Add a mesh at a place; instances of one prototype and colour share their triangles."""
        key = path, color
        if key not in self._parts:
            shape = self._content["shapes"][path]
            if color is not None:  # a mesh has its own first
                own = [each for each in shape["colors"] if each[0] == "displayColor"]
                shape = {**shape, "colors": own or [["displayColor", [np.array([color]), "constant"]]]}
            if shape["kind"] == "Mesh":
                self._parts[key] = parts_of_mesh(self._path, shape, self._materials)
            elif shape["kind"] == "Points":
                self._parts[key] = [part_of_points(shape, self._materials)]
            else:
                self._parts[key] = [part_of_solid(self._path, shape, self._materials)]
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE * len(self._parts[key]))
        self._places.setdefault(key, []).append(matrix)

    def _add_instances(self, prim: dict[str, Any], name: str, matrix: Matrix, within: tuple[str, ...]) -> None:
        """Add the prototypes of a point instancer at each of its places."""
        numbers = indices(prim["values"]["protoIndices"])
        places, is_shown = prim["instances"], np.array(prim["shown"] or np.ones(len(numbers)), bool)
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE * len(numbers))
        if not len(numbers) == len(places) == len(is_shown):
            reason = "the numbers of its indices, positions, orientations and scales do not agree"
            warn(f"{name}: {reason}; left out")
            return
        if beyond := int(((numbers < 0) | (numbers >= len(prim["prototypes"]))).sum()):
            warn(f"{name}: {beyond} of its instances are of no prototype; left out")
        colors = self._colors(prim["colors"], len(numbers), name)
        for number, path in enumerate(prim["prototypes"]):
            instances = np.flatnonzero(is_shown & (numbers == number)).tolist()
            if path is None or not instances:
                continue
            if path in within:
                raise InputError(f"{name}: its prototype {path} has the instancer within it")
            prototype = self._content["prototypes"][path]
            try:
                above = inverse(self._place(prototype["above"]))
            except np.linalg.LinAlgError:
                warn(f"{name}: its prototypes are shrunk to nothing; left out")
                return
            for instance in instances:
                # Its prims have their places in the stage.
                world = product(product(matrix, places[instance].T), above)
                self._read(prototype["prims"], world, (*within, path), colors[instance] if colors else None)

    def _colors(self, primvar: list[Any] | None, count: int, name: str) -> list[Color] | None:
        """Return the colour of each instance, or None if there are none."""
        if primvar is None or primvar[1] == "constant":  # which prims below an instancer inherit
            return None
        rows = primvar[0]
        if not isinstance(rows, np.ndarray) or rows.shape != (count, 3):
            warn(f"{name}: its displayColor has not a colour for each instance; left out")
            return None
        if len(np.unique(rows, axis=0)) > MOST_COLORS:
            warn(f"{name}: its instances have more than {MOST_COLORS} colours; left out")
            return None
        return [vec3(row) for row in rows]
