"""3MF: objects, components and places; base materials, colours and textures of triangles.

Format: 3MF Consortium, "3MF Core Specification" 1.3, "Materials and Properties Extension" 1.2, "Production Extension".
"""

from __future__ import annotations

import io
import posixpath
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.mesh.parts import Contents, Part, checked_faces, placed
from wrt.io.safe_read import first_line
from wrt.io.texture_images import TextureImages
from wrt.linalg import product
from wrt.scene.srgb import linear_from_srgb
from wrt.scene.textures import ImageTexture

_PER_BYTE = 4
"""Memory of a byte of text once it is parsed, roughly."""

_WRAPS = {"wrap": "repeat", "mirror": "mirror", "clamp": "clamp", "none": "clamp"}
_COLORS, _TEXTURES = ("basematerials", "colorgroup", "compositematerials"), "texture2dgroup"
_NO_COLOR = (1.0, 1.0, 1.0, 1.0)

_Matrix = NDArray[np.float64]
_Property = tuple[str, int, int, int]
"""Number of a group of properties, and the entries of it that the three corners have."""


@dataclass
class _Object:
    vertices: list[tuple[float, float, float]] = field(default_factory=list)
    faces: list[tuple[int, int, int]] = field(default_factory=list)
    properties: list[_Property | None] = field(default_factory=list)
    components: list[tuple[str, str, _Matrix]] = field(default_factory=list)
    default: _Property | None = None


@dataclass
class _Group:
    """Properties of triangles: colours, or coordinates on an image, or entries of several groups."""

    kind: str
    values: list[Any] = field(default_factory=list)
    image: str = ""
    members: list[str] = field(default_factory=list)


class _Model:
    """One model part of the archive, as expat calls tell it. Names are read without the prefixes of their spaces."""

    def __init__(self, text: bytes) -> None:
        self.objects: dict[str, _Object] = {}
        self.groups: dict[str, _Group] = {}
        self.images: dict[str, tuple[str, tuple[str, str]]] = {}
        self.items: list[tuple[str, str, _Matrix]] = []
        self._object = _Object()
        self._group = _Group("")
        self._mixed: list[int] = []
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._start
        parser.StartDoctypeDeclHandler = self._refuse
        parser.Parse(text, True)

    def _refuse(self, *_: Any) -> None:
        raise ValueError("it has a document type, which 3MF forbids")

    def _start(self, name: str, given: dict[str, str]) -> None:
        read = getattr(self, f"_read_{name.rpartition(':')[2]}", None)
        if read is not None:
            read({key.rpartition(":")[2]: value for key, value in given.items()})

    def _read_vertex(self, given: dict[str, str]) -> None:
        self._object.vertices.append((float(given["x"]), float(given["y"]), float(given["z"])))

    def _read_triangle(self, given: dict[str, str]) -> None:
        self._object.faces.append((int(given["v1"]), int(given["v2"]), int(given["v3"])))
        own = self._object.default
        if "p1" in given:
            first = int(given["p1"])
            group = given.get("pid") or (own[0] if own else "")
            own = group, first, int(given.get("p2", first)), int(given.get("p3", first))
        self._object.properties.append(own)

    def _read_object(self, given: dict[str, str]) -> None:
        self._object = self.objects[given["id"]] = _Object()
        if "pid" in given:
            index = int(given.get("pindex", 0))
            self._object.default = given["pid"], index, index, index

    def _read_component(self, given: dict[str, str]) -> None:
        self._object.components.append(_reference(given))

    def _read_item(self, given: dict[str, str]) -> None:
        self.items.append(_reference(given))

    def _read_basematerials(self, given: dict[str, str]) -> None:
        self._group = self.groups[given["id"]] = _Group("basematerials")

    def _read_base(self, given: dict[str, str]) -> None:
        self._group.values.append(_color(given["displaycolor"]))

    def _read_colorgroup(self, given: dict[str, str]) -> None:
        self._group = self.groups[given["id"]] = _Group("colorgroup")

    def _read_color(self, given: dict[str, str]) -> None:
        self._group.values.append(_color(given["color"]))

    def _read_texture2dgroup(self, given: dict[str, str]) -> None:
        self._group = self.groups[given["id"]] = _Group(_TEXTURES, image=given["texid"])

    def _read_tex2coord(self, given: dict[str, str]) -> None:
        self._group.values.append((float(given["u"]), float(given["v"])))

    def _read_texture2d(self, given: dict[str, str]) -> None:
        u, v = (_WRAPS.get(given.get(key, "wrap"), "repeat") for key in ("tilestyleu", "tilestylev"))
        self.images[given["id"]] = given["path"], (u, v)

    def _read_multiproperties(self, given: dict[str, str]) -> None:
        self._group = self.groups[given["id"]] = _Group("multiproperties", members=given["pids"].split())

    def _read_multi(self, given: dict[str, str]) -> None:
        self._group.values.append([int(word) for word in given["pindices"].split()])

    def _read_compositematerials(self, given: dict[str, str]) -> None:
        self._group = self.groups[given["id"]] = _Group("compositematerials", members=[given["matid"]])
        self._mixed = [int(word) for word in given["matindices"].split()]

    def _read_composite(self, given: dict[str, str]) -> None:
        """Add a mixture of base materials, whose colours are mixed."""
        shares = np.array([float(word) for word in given["values"].split()])
        bases = self.groups[self._group.members[0]].values
        colors = np.array([bases[index] for index in self._mixed[: len(shares)]])
        total = float(shares.sum())
        if not np.isfinite(total):
            raise ValueError(f"shares of a mixture are not finite: {given['values']}")
        weights = shares[: len(colors)] / total if total > 0.0 else np.full(len(colors), 1.0 / len(colors))
        self._group.values.append(tuple(product(weights, colors)))


def _reference(given: dict[str, str]) -> tuple[str, str, _Matrix]:
    """Return the model part, the object, and the (4, 4) transform of a component or an item."""
    matrix = np.eye(4)
    if "transform" in given:
        matrix[:3] = np.array([float(word) for word in given["transform"].split()]).reshape(4, 3).T
    return given.get("path", ""), given["objectid"], matrix


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
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            memory_limits.take(memory_limits.MESHES, _PER_BYTE * sum(each.file_size for each in archive.infolist()))
            return Contents(_Reader(path, archive).parts())
    except InputError:
        raise
    except zipfile.BadZipFile as error:
        raise InputError(f"{path}: not a 3MF file: {first_line(error)}") from None
    except (KeyError, IndexError, ValueError, OverflowError, RuntimeError, NotImplementedError, EOFError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else first_line(error)
        raise InputError(f"{path}: not a whole 3MF file that can be read: {reason}") from None
    except (expat.ExpatError, zlib.error) as error:
        raise InputError(f"{path}: not a whole 3MF file that can be read: {first_line(error)}") from None


class _Reader:
    """Reads the model parts of one archive when something refers to them."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self._path, self._archive = path, archive
        self._models: dict[str, _Model] = {}
        self._images = TextureImages(path)
        self._told: set[str] = set()
        names = archive.namelist()
        self._names = {name.lstrip("/").lower(): name for name in names}
        models = [name for name in names if name.lower().endswith(".model")]
        if not models:
            raise InputError(f"{path}: not a 3MF file: there is no model in it")
        self._root = self._start() or models[0]

    def _start(self) -> str:
        """Return the model part that the archive begins with."""
        found: list[str] = []

        def note(_: str, given: dict[str, str]) -> None:
            if given.get("Type", "").endswith("/3dmodel"):
                found.append(given.get("Target", ""))

        if "_rels/.rels" not in self._names:
            return ""
        parser = expat.ParserCreate()
        parser.StartElementHandler = note
        parser.Parse(self._bytes("_rels/.rels"), True)
        return next((name for name in found if name.lstrip("/").lower() in self._names), "")

    def _bytes(self, name: str) -> bytes:
        return self._archive.read(self._names[posixpath.normpath(name).lstrip("/").lower()])

    def _model(self, name: str) -> _Model:
        if name not in self._models:
            self._models[name] = _Model(self._bytes(name))
        return self._models[name]

    def parts(self) -> list[Part]:
        """Return the parts of all that is built."""
        places: dict[tuple[str, str], list[_Matrix]] = {}
        for name, number, matrix in self._model(self._root).items:
            for key, place in self._meshes(name or self._root, number, matrix, ()):
                places.setdefault(key, []).append(place)
        return [
            placed(part, matrices) for (name, number), matrices in places.items() for part in self._of(name, number)
        ]

    def _meshes(
        self, name: str, number: str, matrix: _Matrix, above: tuple[tuple[str, str], ...]
    ) -> Iterator[tuple[tuple[str, str], _Matrix]]:
        """Yield the objects with triangles that an object consists of, and where they are."""
        key = (name, number)
        if key in above:
            raise InputError(f"{self._path}: object {number} is a component of itself")
        memory_limits.take(memory_limits.SHAPES, memory_limits.BYTES_PER_SHAPE)  # paths may be exponentially many
        found = self._model(name).objects[number]
        if found.faces:
            yield key, matrix
        for other, inner, place in found.components:
            yield from self._meshes(other or name, inner, product(matrix, place), (*above, key))

    def _of(self, name: str, number: str) -> Iterator[Part]:
        """Yield a part for the colours and one for each image of an object."""
        model = self._model(name)
        found = model.objects[number]
        vertices, faces = np.array(found.vertices, np.float64).reshape(-1, 3), np.array(found.faces, np.int64)
        checked_faces(self._path, faces, len(vertices))
        by_group: dict[str, list[int]] = {}
        looked_up = [self._resolved(model, each) for each in found.properties]
        for k, each in enumerate(looked_up):
            by_group.setdefault(each[0].image if each is not None and each[0].kind == _TEXTURES else "", []).append(k)
        for image, rows in by_group.items():
            part = Part(f"object {number}", vertices, faces[rows])
            chosen = [looked_up[k] for k in rows]
            if image:
                values = [group.values[index] for group, *entries in chosen for index in entries]  # type: ignore[misc]
                _split(part, "uvs", np.array(values, np.float64))
                part.reflectance = self._texture(model, image)
            elif any(each is not None for each in chosen):
                colors = [
                    color
                    for each in chosen
                    for color in ((_NO_COLOR,) * 3 if each is None else [each[0].values[k] for k in each[1:]])
                ]
                rgba = np.array(colors, np.float64)
                rgba[:, :3] = linear_from_srgb(rgba[:, :3])
                alpha = rgba[:, 3]  # 0 everywhere counts as none: OpenSCAD has written that for what is opaque
                _split(part, "colors", rgba if (alpha < 1.0).any() and alpha.any() else rgba[:, :3])
            yield part

    def _resolved(self, model: _Model, given: _Property | None) -> tuple[_Group, int, int, int] | None:
        """Return the group of colours or coordinates of a triangle, and its entries; None where it has none."""
        if given is None:
            return None
        group, entries = model.groups.get(given[0]), given[1:]
        if group is not None and group.kind == "multiproperties" and max(entries) < len(group.values):
            rows = [group.values[index] for index in entries]
            for k in reversed(range(len(group.members))):  # the last is laid over the others
                member = model.groups.get(group.members[k])
                if member is not None and member.kind in (*_COLORS, _TEXTURES):
                    group, entries = member, tuple(row[k] if k < len(row) else 0 for row in rows)  # type: ignore[assignment]
                    break
        known = group is not None and group.kind in (*_COLORS, _TEXTURES)
        if group is None or not known or not 0 <= min(entries) <= max(entries) < len(group.values):
            what = group.kind if group is not None and not known else "a property that is not there"
            if what not in self._told:
                warn(f"{self._path}: {what} is left out of the triangles that have it")
                self._told.add(what)
            return None
        return group, *entries

    def _texture(self, model: _Model, number: str) -> ImageTexture | None:
        name, wrap = model.images[number]
        pixels = self._images.pixels(name, "color", f"image {name}", lambda: self._bytes(name))
        return None if pixels is None else ImageTexture(pixels, posixpath.basename(name), wrap=wrap)


def _split(part: Part, what: str, values: NDArray[np.float64]) -> None:
    """Give the corners of a part values of their own: vertices with several of them become several."""
    corners = part.faces.reshape(-1)
    rows = np.column_stack([corners, values])
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    part.vertices, part.faces = part.vertices[corners[first]], inverse.reshape(-1, 3)
    setattr(part, what, values[first])
