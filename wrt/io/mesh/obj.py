"""Wavefront OBJ with its MTL materials, loaded by trimesh from text that it reads right.

Format: Wavefront, "Advanced Visualizer Manual", appendix B1.
"""

from __future__ import annotations

import re
from pathlib import Path

from wrt.errors import InputError, warn
from wrt.io.mesh.mtl import MtlMaterials
from wrt.io.mesh.parts import Part, only_points
from wrt.io.mesh.sidecars import COLOR_MAP, Sidecars
from wrt.io.mesh.trimesh_loaders import load, part_of
from wrt.io.safe_read import as_text

_INTEGER = re.compile(r"[-+]?[0-9]{1,18}")


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
    text = _plain(path, as_text(data))
    sidecars = Sidecars(path)
    if "usemtl" in text and "mtllib" not in text:
        names = dict.fromkeys(re.findall(r"^usemtl (.+)$", text, re.MULTILINE))
        first = f"{next(iter(names), '')!r}" + (f" and {len(names) - 1} more" if len(names) > 1 else "")
        guess = sidecars.own_material_file()
        instead = "they are left out" if guess is None else f"{str(guess)!r} is taken"
        warn(f"{path}: it names no file (mtllib) that describes its materials, {first}; {instead}")
        text = text if guess is None else f"mtllib {guess.name}\n{text}"
    sidecars.set_material_statements(re.findall(r"^mtllib (.+)$", text, re.MULTILINE))
    loaded = load(path, text, "obj", sidecars=sidecars, split_groups=True)
    materials = MtlMaterials(path, sidecars.find)
    parts = []
    for fields in reversed(list(loaded.get("geometry", {}).values())):  # trimesh takes the last one first
        described = getattr(fields.get("visual"), "material", None)
        name = str(getattr(described, "name", None) or path.stem)
        part = part_of(path, name, fields)
        if part is None:
            continue
        part.vertex_format = "a vertex"  # trimesh has renumbered them
        statements = getattr(described, "kwargs", {})
        if COLOR_MAP in statements and part.uvs is None and "\nvt " in text:
            # trimesh drops all coordinates where one is not there.
            label = " ".join(statements[COLOR_MAP])
            warn(f"{path}: texture {label} cannot be laid: its faces name texture coordinates that are not there")
        if statements:
            laid, colored = part.uvs is not None, part.colors is not None
            part.material = materials.material(name, statements, laid=laid, colored=colored)
        parts.append(part)
    if not parts and (count := text.count("\nv ") + text.startswith("v ")):
        raise only_points(path, count)
    return parts


def _plain(path: Path, text: str) -> str:
    """Return the statements in the plain form that trimesh 5.2 takes.

    trimesh looks for statements at the very beginning of a line and for a space after them, takes
    comments after a face for corners, counts relative indices from the end of the file instead
    of from the line they are on, takes index 0 for 1, drops coordinates and normals where faces
    differ in their number of corners or in which indices they give, and cuts such faces into
    fans. So faces of each kind get a group of their own, by which trimesh is told to part them.
    """
    text = text.replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ").replace("\t", " ")
    text = re.sub(r"#.*", "", text) if "#" in text else text
    counts = {"v": 0, "vt": 0, "vn": 0}
    kind: tuple[int, int, bool] | None = None
    result, short = [], 0
    number = 0
    for run in _RUN.finditer(text):
        line, group = run[0], run.lastgroup
        number += 1
        if group in counts:
            number += line.count("\n") - 1
            counts[group] += line.count("\n")
            if "  " in line or " \n" in line:
                line = "\n".join(" ".join(each.split()) for each in line.split("\n"))
            result.append(line.rstrip("\n"))
            continue
        if group in _FACES:
            number += line.count("\n") - 1
            size, corner = _FACES[group]
            if kind != (kind := (size, size * corner.count("/"), "//" in corner)):
                result.append("g {} {} {}".format(*kind))
            result.append(line.rstrip("\n"))
            continue
        words = line.split()
        key = words[0] if words else ""
        if key in counts:
            counts[key] += 1
        elif key == "f":
            corners, slashes, skips = len(words) - 1, line.count("/"), "//" in line
            if corners < 3:
                short += 1
                continue
            if slashes not in (0, corners, 2 * corners) or (skips and line.count("//") != corners):
                words[1:] = [word.partition("/")[0] for word in words[1:]]
                slashes, skips = 0, False
            if "-" in line or " 0" in line or "/0" in line:
                words[1:] = [_absolute(path, number, word, counts) for word in words[1:]]
            if kind != (corners, slashes, skips):
                kind = (corners, slashes, skips)
                result.append(f"g {corners} {slashes} {skips}")
        elif key in ("g", "o", "s", "l", "p", ""):
            continue
        result.append(" ".join(words))
    if short:
        warn(f"{path}: {short} face(s) with fewer than 3 corners left out")
    return "\n".join(result)


def _absolute(path: Path, number: int, corner: str, counts: dict[str, int]) -> str:
    """Return a face corner whose indices count from the beginning."""
    indices = []
    for word, (key, count) in zip(corner.split("/"), counts.items(), strict=False):
        index = int(word) if _INTEGER.fullmatch(word) else None
        absolute = index if index is None or index > 0 else index + count + 1
        if absolute is not None and (index == 0 or absolute < 1):
            raise InputError(
                f"{path}: line {number}: face corner {corner!r} names a {key!r} that is not there ({count} are)"
            )
        indices.append(word if absolute is None else str(absolute))
    return "/".join(indices)
