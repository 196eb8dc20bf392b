"""3MF: objects, components and places; base materials, colours and textures of triangles.

Format: 3MF Consortium, "3MF Core Specification" 1.3, "Materials and Properties Extension" 1.2, "Production Extension".
"""

from __future__ import annotations

import io
import posixpath
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.account import warn_of_unused
from wrt.io.mesh.parts import Contents, Part, as_specified, checked_faces, placed, split_vertices
from wrt.io.texture_images import TextureImages
from wrt.linalg import product
from wrt.scene.srgb import linear_from_srgb
from wrt.scene.textures import ImageTexture

_PER_BYTE = 4
"""Memory of a byte of text once it is parsed, roughly."""

_METRES = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "meter": 1.0,
    "inch": 0.0254,
    "foot": 0.3048,
}
"""Metres in the units that a model may have (core specification, 3.4)."""

_WRAPS = {"wrap": "repeat", "mirror": "mirror", "clamp": "clamp"}
_FILTERS = {"auto": "bilinear", "linear": "bilinear", "nearest": "nearest"}
_SUPPORTED = ("basematerials", "colorgroup", "compositematerials", "texture2dgroup")
_ABOUT_PRINTING = "how a thing is printed, not how it looks"
_FOR_PROGRAMS = "names and numbers by which programs find a thing again"

WITHOUT_EFFECT = {
    "model.*extensions": "what an extension adds is accounted for where it occurs",
    "model.lang": "the language of texts",
    "model.version": _FOR_PROGRAMS,
    "metadata*": "texts about the file",
    "trianglesets": _FOR_PROGRAMS,
    "triangleset*": _FOR_PROGRAMS,
    "ref*": "a member of a set of triangles",
    "*.UUID": _FOR_PROGRAMS,
    "*.partnumber": _FOR_PROGRAMS,
    "*.name": _FOR_PROGRAMS,
    "object.type": _ABOUT_PRINTING,
    "object.thumbnail": "a picture of the object",
    "object.slicestackid": _ABOUT_PRINTING,
    "object.meshresolution": _ABOUT_PRINTING,
    "slice*": _ABOUT_PRINTING,
    "item.printable": _ABOUT_PRINTING,
    "triangle.*supports": _ABOUT_PRINTING,
    "triangle.*seam": _ABOUT_PRINTING,
    "texture2d.contenttype": "images tell their type",
}
"""Elements and attributes that do not change a picture, and why."""

_GROUPS = frozenset(("resources", "build", "mesh", "vertices", "triangles", "components"))
"""Elements that hold others."""

_NO_COLOR = (1.0, 1.0, 1.0, 1.0)

_Matrix = NDArray[np.float64]
_Property = tuple[str, int, int, int]
"""Number of a group of properties, and the entries of it that the three corners have."""


@dataclass
class _Object:
    vertices: list[tuple[float, ...]] = field(default_factory=list)
    faces: list[tuple[int, ...]] = field(default_factory=list)
    properties: list[_Property | None] = field(default_factory=list)
    components: list[tuple[str, str, _Matrix]] = field(default_factory=list)
    default: _Property | None = None


@dataclass
class _Group:
    """Properties of triangles: colours, or coordinates on an image, or entries of several groups, its members."""

    kind: str
    values: list[Any] = field(default_factory=list)
    image: str = ""
    members: list[str] = field(default_factory=list)


class _Model:
    """One model part of the archive; `unused` counts what was not used. Names are without prefixes of namespaces."""

    def __init__(self, text: bytes) -> None:
        self.objects: dict[str, _Object] = {}
        self.groups: dict[str, _Group] = {}
        self.images: dict[str, tuple[str, tuple[str, ...], str]] = {}
        self.unit = "millimeter"
        self.unused: Counter[str] = Counter()
        self.items: list[tuple[str, str, _Matrix]] = []
        self._object = _Object()
        self._group = _Group("")
        self._mixed: list[int] = []
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._read
        parser.StartDoctypeDeclHandler = self._refuse
        parser.Parse(text, True)

    def _refuse(self, *_: Any) -> None:
        raise ValueError("it has a document type, which 3MF forbids")

    def _read(self, tag: str, attributes: dict[str, str]) -> None:
        values = {key.rpartition(":")[2]: value for key, value in attributes.items() if not key.startswith("xmlns")}
        match kind := tag.rpartition(":")[2]:
            case "model":
                self.unit = values.pop("unit", self.unit)
            case "vertex":
                self._object.vertices.append((float(values.pop("x")), float(values.pop("y")), float(values.pop("z"))))
            case "triangle":
                self._object.faces.append((int(values.pop("v1")), int(values.pop("v2")), int(values.pop("v3"))))
                self._object.properties.append(self._property(values))
            case "object":
                self._object = self.objects[values.pop("id")] = _Object()
                if "pid" in values:
                    index = int(values.pop("pindex", 0))
                    self._object.default = values.pop("pid"), index, index, index
            case "component":
                self._object.components.append(_reference(values))
            case "item":
                self.items.append(_reference(values))
            case "basematerials" | "colorgroup":
                self._group = self.groups[values.pop("id")] = _Group(kind)
            case "base" | "color":
                self._group.values.append(_color(values.pop("displaycolor" if kind == "base" else "color")))
            case "texture2dgroup":
                self._group = self.groups[values.pop("id")] = _Group(kind, image=values.pop("texid"))
            case "tex2coord":
                self._group.values.append((float(values.pop("u")), float(values.pop("v"))))
            case "texture2d":
                styles = [self._word(_WRAPS, values.pop(f"tilestyle{axis}", "wrap")) for axis in "uv"]
                kind_of_filter = self._word(_FILTERS, values.pop("filter", "auto"))
                self.images[values.pop("id")] = values.pop("path"), tuple(styles), kind_of_filter
            case "multiproperties":
                self._group = self.groups[values.pop("id")] = _Group(kind, members=values.pop("pids").split())
            case "multi":
                self._group.values.append([int(word) for word in values.pop("pindices").split()])
            case "compositematerials":
                self._group = self.groups[values.pop("id")] = _Group(kind, members=[values.pop("matid")])
                self._mixed = [int(word) for word in values.pop("matindices").split()]
            case "composite":
                self._group.values.append(self._mixture([float(word) for word in values.pop("values").split()]))
            case _ if kind not in _GROUPS:
                self.unused[kind] += 1
                values = {}  # of what is unknown as a whole
        for key in values:
            self.unused[f"{kind}.{key}"] += 1

    def _word(self, supported: dict[str, str], word: str) -> str:
        """Return what wrt calls a word of an image; of an unknown one what it calls the first."""
        if word not in supported:
            self.unused[f"the word {word!r} of a texture2d"] += 1
        return supported.get(word, next(iter(supported.values())))

    def _property(self, values: dict[str, str]) -> _Property | None:
        """Return the property of a triangle, or that of its object."""
        default = self._object.default
        group = values.pop("pid", "") or (default[0] if default else "")
        if "p1" not in values:
            return default
        first = int(values.pop("p1"))
        return group, first, int(values.pop("p2", first)), int(values.pop("p3", first))

    def _mixture(self, shares: list[float]) -> tuple[float, ...]:
        """Return the mean of the colours of base materials, by their shares."""
        bases = self.groups[self._group.members[0]].values
        colors = np.array([bases[index] for index in self._mixed[: len(shares)]])
        total = float(sum(shares))
        if not np.isfinite(total):
            raise ValueError(f"shares of a mixture are not finite: {shares}")
        weights = np.array(shares[: len(colors)]) / total if total > 0.0 else np.full(len(colors), 1.0 / len(colors))
        return tuple(product(weights, colors))


def _reference(values: dict[str, str]) -> tuple[str, str, _Matrix]:
    """Return the model part, the object, and the (4, 4) transform of a component or an item."""
    matrix = np.eye(4)
    if "transform" in values:
        matrix[:3] = np.array([float(word) for word in values.pop("transform").split()]).reshape(4, 3).T
    return values.pop("path", ""), values.pop("objectid"), matrix


def _color(text: str) -> tuple[float, ...]:
    codes = bytes.fromhex(text.lstrip("#"))
    if len(codes) not in (3, 4):
        raise ValueError(f"{text!r} is no colour")
    return tuple(code / 255.0 for code in (codes + b"\xff")[:4])


def read_3mf(path: Path, data: bytes) -> Contents:
    """Return a part for each object and image, at the places where the file builds it.

    Raises:
        InputError: on a damaged file.
    """
    errors = zipfile.BadZipFile, zlib.error, expat.ExpatError
    with as_specified(path, "3MF", *errors), zipfile.ZipFile(io.BytesIO(data)) as archive:
        memory_limits.take(memory_limits.MESHES, _PER_BYTE * sum(each.file_size for each in archive.infolist()))
        return Contents(_Reader(path, archive).parts())


class _Reader:
    """Reads the model parts of one archive when something refers to them."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self._path, self._archive = path, archive
        self._models: dict[str, _Model] = {}
        self._images = TextureImages(path)
        self._left_out: set[str] = set()
        self._names = {name.lstrip("/").lower(): name for name in archive.namelist()}
        models = [name for name in archive.namelist() if name.lower().endswith(".model")]
        if not models:
            raise InputError(f"{path}: not a 3MF file: there is no model in it")
        self._root = self._root_model() or models[0]

    def _root_model(self) -> str:
        """Return the model part that the archive's relationships name, or "" if there is none."""
        targets: list[str] = []

        def note(_: str, attributes: dict[str, str]) -> None:
            if attributes.get("Type", "").endswith("/3dmodel"):
                targets.append(attributes.get("Target", ""))

        if "_rels/.rels" not in self._names:
            return ""
        parser = expat.ParserCreate()
        parser.StartElementHandler = note
        parser.Parse(self._bytes("_rels/.rels"), True)
        return next((name for name in targets if name.lstrip("/").lower() in self._names), "")

    def _bytes(self, name: str) -> bytes:
        return self._archive.read(self._names[posixpath.normpath(name).lstrip("/").lower()])

    def _model(self, name: str) -> _Model:
        if name not in self._models:
            self._models[name] = _Model(self._bytes(name))
        return self._models[name]

    def parts(self) -> list[Part]:
        """Return the parts of all that is built."""
        places: dict[tuple[str, str], list[_Matrix]] = {}
        root = self._model(self._root)
        if root.unit not in _METRES:
            warn(f"{self._path}: its unit of length {root.unit!r} is unknown; taken as millimeter")
        metres = _METRES.get(root.unit, _METRES["millimeter"])
        world = np.diag([metres, metres, metres, 1.0])
        for name, number, matrix in root.items:
            for key, place in self._meshes(name or self._root, number, product(world, matrix), ()):
                places.setdefault(key, []).append(place)
        parts = [placed(part, matrices) for key, matrices in places.items() for part in self._parts_of(*key)]
        unused = sum((model.unused for model in self._models.values()), Counter[str]())
        warn_of_unused(self._path, unused.elements(), WITHOUT_EFFECT)
        return parts

    def _meshes(
        self, name: str, number: str, matrix: _Matrix, ancestors: tuple[tuple[str, str], ...]
    ) -> Iterator[tuple[tuple[str, str], _Matrix]]:
        """Yield the objects with triangles that an object consists of, and where they are."""
        key = (name, number)
        if key in ancestors:
            raise InputError(f"{self._path}: object {number} is a component of itself")
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE)  # paths may be exponentially many
        found = self._model(name).objects[number]
        if found.faces:
            yield key, matrix
        for model, component, place in found.components:
            yield from self._meshes(model or name, component, product(matrix, place), (*ancestors, key))

    def _parts_of(self, name: str, number: str) -> Iterator[Part]:
        """Yield a part for the colours and one for each image of an object."""
        model = self._model(name)
        found = model.objects[number]
        vertices, faces = np.array(found.vertices, np.float64).reshape(-1, 3), np.array(found.faces, np.int64)
        checked_faces(self._path, faces, len(vertices))
        corners = [self._corners(model, each) for each in found.properties]
        by_image: dict[str, list[int]] = {}
        for k, each in enumerate(corners):
            by_image.setdefault(each[0] if each else "", []).append(k)
        for image, rows in by_image.items():
            part = Part(f"object {number}", vertices, faces[rows])
            values = np.array([each[1] if (each := corners[k]) else [_NO_COLOR] * 3 for k in rows], np.float64)
            values = values.reshape(-1, values.shape[2])
            if image:
                part.vertices, part.faces, part.uvs = split_vertices(vertices, part.faces, values)
                part.reflectance = self._texture(model, image)
            elif any(corners[k] for k in rows):
                values[:, :3] = linear_from_srgb(values[:, :3])
                alpha = values[:, 3]  # 0 everywhere counts as none: OpenSCAD has written that for what is opaque
                colors = values if (alpha < 1.0).any() and alpha.any() else values[:, :3]
                part.vertices, part.faces, part.colors = split_vertices(vertices, part.faces, colors)
            yield part

    def _corners(self, model: _Model, assigned: _Property | None) -> tuple[str, list[Any]] | None:
        """Return the image and the coordinates, or "" and the colours, of a triangle's corners; None if it has none."""
        if assigned is None:
            return None
        group, entries = model.groups.get(assigned[0]), assigned[1:]
        if group is not None and group.kind == "multiproperties" and max(entries) < len(group.values):
            rows = [group.values[index] for index in entries]
            for k in reversed(range(len(group.members))):  # the last is laid over the others
                member = model.groups.get(group.members[k])
                if member is not None and member.kind in _SUPPORTED:
                    group, entries = member, tuple(row[k] if k < len(row) else 0 for row in rows)  # type: ignore[assignment]
                    break
        is_supported = group is not None and group.kind in _SUPPORTED
        if group is not None and is_supported and 0 <= min(entries) <= max(entries) < len(group.values):
            return group.image, [group.values[index] for index in entries]
        what = group.kind if group is not None and not is_supported else "a property that is not there"
        if what not in self._left_out:
            warn(f"{self._path}: {what} is left out of the triangles that have it")
            self._left_out.add(what)
        return None

    def _texture(self, model: _Model, number: str) -> ImageTexture | None:
        name, wrap, kind_of_filter = model.images[number]
        pixels = self._images.pixels(name, "color", f"image {name}", lambda: self._bytes(name))
        return (
            None if pixels is None else ImageTexture(pixels, posixpath.basename(name), wrap=wrap, filter=kind_of_filter)
        )
