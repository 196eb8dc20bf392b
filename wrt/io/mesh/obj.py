"""Wavefront OBJ: its faces, loaded by trimesh from text that it reads right, with the materials of MTL files.

Format: Wavefront, "Advanced Visualizer Manual", appendix B1.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from wrt.errors import InputError, warn
from wrt.io.account import warn_of_unused
from wrt.io.mesh.mtl import MtlMaterials, Statements, plain_name, statements_of
from wrt.io.mesh.parts import Part, as_specified, decoded, points_of
from wrt.io.mesh.sidecars import Sidecars, in_any_case
from wrt.io.mesh.trimesh_loaders import load, part_of
from wrt.io.safe_read import as_text, naming_file, read_file

_INTEGER = re.compile(r"[-+]?[0-9]{1,18}")
_BETWEEN_FILES = re.compile(r"(?<=\.mtl)\s+", re.IGNORECASE)


def _lines(line: str) -> str:
    """Return the pattern of some hundred lines; the engine remembers each, so not of as many as there are."""
    return rf"(?:{line}\n){{1,500}}"


_INDEX = "[1-9][0-9]*"
_CORNERS = (f" {_INDEX}", f" {_INDEX}/{_INDEX}", f" {_INDEX}//{_INDEX}", f" {_INDEX}/{_INDEX}/{_INDEX}")
_FACES = {f"f{size}{chr(97 + i)}": (size, corner) for size in (3, 4) for i, corner in enumerate(_CORNERS)}
"""Corners of faces, and the pattern of one, by the group of _RUN that is such faces."""

# Lines that trimesh takes as they are, many at once, by far the most of large files; or any one line.
_RUN = re.compile(
    "|".join(
        [
            *(f"(?P<{key}>{_lines(key + ' .*')})" for key in ("v", "vt", "vn")),
            *(f"(?P<{name}>{_lines('f' + size * corner)})" for name, (size, corner) in _FACES.items()),
            r"(?P<line>.*(?:\n|\Z))",
        ]
    )
)


def read_obj(path: Path, data: bytes) -> list[Part]:
    """Return a part for each material and kind of face, in the order of the file.

    Raises:
        InputError: on what trimesh cannot read and on indices that name nothing.
    """
    text = _PlainText(path, as_text(data))
    loaded = load(path, "\n".join(text.lines), "obj", split_groups=True, skip_materials=True)
    sidecars = Sidecars(path)
    described = _materials(path, text, sidecars)
    materials = MtlMaterials(path, sidecars.find)
    parts, names = [], list(text.materials)
    for group, fields in reversed(list(loaded.get("geometry", {}).items())):  # trimesh takes the last one first
        if text.smoothing_groups:
            fields["face_smoothing"] = np.concatenate([np.full(n, of) for n, of in text.smoothing[group]])
        name = names[int(group.partition(" ")[0])]
        statements = described.get(name, {})
        part = part_of(path, name if statements else path.stem, fields)
        if part is None:
            continue
        part.vertex_format = "a vertex"  # trimesh has renumbered them
        parts.append(materials.dressed(part, name, statements) if statements else part)
    materials.warn_of_unused()
    if not parts and text.counts["v"]:
        rows = [line.split()[1:7] for run in text.lines for line in run.split("\n") if line.startswith("v ")]
        with as_specified(path, "OBJ"):
            wide = min(map(len, rows)) == 6
            numbers = np.array([row if wide else row[:3] for row in rows], np.float64)
            parts = [points_of(path.stem, numbers[:, :3], decoded(numbers[:, 3:]) if wide else None)]
    return parts


def _materials(path: Path, text: _PlainText, sidecars: Sidecars) -> dict[str, Statements]:
    """Return the statements of each material that an OBJ file uses, from the files that it names or the one like it."""
    own_name = f"{path.stem}.mtl"  # people rename a mesh file and forget the name in it
    names: list[str] = []
    for line in dict.fromkeys(text.libraries):
        has_spaces = in_any_case(path.parent, line.replace("\\", "/").split("/"))
        names += [line] if has_spaces else _BETWEEN_FILES.split(line)
    used = [name for name in text.materials if name]
    if used and not names:
        guess = in_any_case(path.parent, [own_name])
        names = [] if guess is None else [guess.name]
        instead = "they are left out" if guess is None else f"{str(guess)!r} is taken"
        warn(f"{path}: it names no file (mtllib) that describes its materials, {_and_more(used)}; {instead}")
    found: dict[str, Statements] = {}
    files = 0
    for name in names:
        try:
            is_alone = len(names) == 1 and name.lower().rstrip('" ').endswith(".mtl")
            file = sidecars.find(name, [own_name] if is_alone else [])
            with naming_file(file):
                content = as_text(read_file(file))
        except InputError as error:
            warn(f"{error}; it is left out")
            continue
        files += 1
        sidecars.folders.append(file.parent)  # images of materials lie beside the mesh or beside their own file
        described = statements_of(content)
        warn_of_unused(file, (f"{key} before the first material" for key in described.pop("")), {})
        found |= described
    in_lower_case = {name.lower(): name for name in reversed(found)}
    others = {name: in_lower_case[name.lower()] for name in used if name not in found and name.lower() in in_lower_case}
    for name, other in others.items():
        warn(f"{path}: material {name!r} is not described; {other!r} is taken")
    missing = [name for name in used if name not in found and name not in others]
    if files and missing:
        warn(f"{path}: no material file describes {_and_more(missing)}; the default material is taken")
    return {name: found[others.get(name, name)] for name in used if name not in missing}


def _and_more(names: list[str]) -> str:
    return f"{names[0]!r} and {len(names) - 1} more" if len(names) > 1 else repr(names[0])


class _PlainText:
    """An OBJ file in the plain form that trimesh 5.2 takes, and what else it says.

    trimesh looks for statements at the very beginning of a line and for a space after them, takes comments after a face
    for corners, counts relative indices from the end of the file instead of from the line they are on, takes index 0
    for 1, drops coordinates and normals where faces differ in their number of corners or in which indices they give,
    and cuts such faces into fans. So faces of each material and kind get a group of their own, which makes trimesh
    separate them.

    Attributes:
        lines: vertices, faces, and their groups, whose names begin with the number of a material.
        materials: the numbers of materials by name; 0 is "", of faces without one.
        libraries: statements for material files, each one or several names.
        counts: vertices, texture coordinates and normals.
        smoothing_groups: the numbers of smoothing groups (s) by name; 0 is none. Empty if the file has none.
        smoothing: for the name of each group of lines, how many faces come next and their smoothing group.
    """

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        self.lines: list[str] = []
        self.materials = {"": 0}
        self.libraries: list[str] = []
        self.counts = {"v": 0, "vt": 0, "vn": 0}
        self.smoothing_groups: dict[str, int] = {}
        self.smoothing: dict[str, list[tuple[int, int]]] = {}
        self._smoothing = 0
        self._material = 0
        self._group: tuple[int, int, int, bool] | None = None
        text = text.replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ").replace("\t", " ")
        text = re.sub(r"#.*", "", text) if "#" in text else text
        number, short = 1, 0
        for run in _RUN.finditer(text):
            lines, kind = run[0], run.lastgroup
            if kind in self.counts:
                self.counts[kind] += lines.count("\n")
                if "  " in lines or " \n" in lines:
                    lines = "\n".join(" ".join(line.split()) for line in lines.split("\n"))
                self.lines.append(lines.rstrip("\n"))
            elif kind in _FACES:
                size, corner = _FACES[kind]
                self._add_faces(lines.rstrip("\n"), size, size * corner.count("/"), "//" in corner)
            else:
                short += self._add_line(number, lines.split())
            number += run[0].count("\n")
        if short:
            warn(f"{path}: {short} face(s) with fewer than 3 corners left out")

    def _add_line(self, number: int, words: list[str]) -> int:
        """Add any statement, and return how many faces are left out."""
        match words:
            case ["v" | "vt" | "vn" as key, *_]:
                self.counts[key] += 1
                self.lines.append(" ".join(words))
            case ["f", *corners]:
                if len(corners) < 3:
                    return 1
                self._add_face(number, corners)
            case ["s", name, *_]:
                number_of = 0 if name in ("off", "0", "null") else len(self.smoothing_groups) + 1
                self._smoothing = self.smoothing_groups.setdefault(name, number_of)
            case ["usemtl", *name]:
                self._material = self.materials.setdefault(plain_name(name), len(self.materials))
            case ["mtllib", name, *more]:
                self.libraries.append(" ".join([name, *more]))
        return 0

    def _add_face(self, number: int, corners: list[str]) -> None:
        slashes, skipping = [corner.count("/") for corner in corners], ["//" in corner for corner in corners]
        if len({*slashes}) > 1 or slashes[0] > 2 or len({*skipping}) > 1:
            corners = [corner.partition("/")[0] for corner in corners]
            slashes, skipping = [0] * len(corners), [False]
        line = " ".join(["f", *corners])
        if "-" in line or " 0" in line or "/0" in line:
            line = " ".join(["f", *(self._absolute(number, corner) for corner in corners)])
        self._add_faces(line, len(corners), sum(slashes), skipping[0])

    def _add_faces(self, lines: str, corners: int, slashes: int, skips_uvs: bool) -> None:
        group = self._material, corners, slashes, skips_uvs
        name = "{} {} {} {}".format(*group)
        if group != self._group:
            self.lines.append(f"g {name}")
            self._group = group
        self.smoothing.setdefault(name, []).append((lines.count("\n") + 1, self._smoothing))
        self.lines.append(lines)

    def _absolute(self, number: int, corner: str) -> str:
        """Return a face corner on a line, whose indices count from the beginning."""
        indices = []
        for word, (key, count) in zip(corner.split("/"), self.counts.items(), strict=False):
            index = int(word) if _INTEGER.fullmatch(word) else None
            absolute = index if index is None or index > 0 else index + count + 1
            if absolute is not None and (index == 0 or absolute < 1):
                reason = f"face corner {corner!r} names a {key!r} that is not there ({count} are)"
                raise InputError(f"{self._path}: line {number}: {reason}")
            indices.append(word if absolute is None else str(absolute))
        return "/".join(indices)
