"""Files that a mesh file names: materials, images and buffers."""

from __future__ import annotations

import contextlib
import io
import os
import re
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from urllib.parse import unquote

from wrt.errors import InputError, warn
from wrt.io.images import open_image
from wrt.io.safe_read import as_text, is_inside, read_file, reason_alone, require_file

COLOR_MAP = "map_color"
"""Replaces map_Kd in material files: trimesh would open the image itself, and knows fewer formats."""

_COLOR_MAP = re.compile(r"^(\s*)map_kd(?=\s)", re.IGNORECASE | re.MULTILINE)

_BETWEEN_NAMES = re.compile(r"(?<=\.mtl)\s+", re.IGNORECASE)
_TEXTURE_FOLDERS = ("textures", "../textures", "../materials/textures")
"""Where programs keep the images of meshes that name no folder; the last is Gazebo's."""


class Sidecars:
    """Finds and reads the files that a mesh file names; a resolver for trimesh, which hides warnings and errors."""

    def __init__(self, path: Path, *, images: bool = True) -> None:
        """Take the path of the file, and whether all files that trimesh reads beside material files are images."""
        self._path, self._images = path, images
        self._folders = [path.parent]
        self._material_files: list[str] = []
        self._material_statement: str | None = None  # the name by which trimesh requests all material files
        self._missing: list[str] = []
        self._replaced: list[str] = []

    def find(self, name: str) -> Path:
        """Return the path of a file that may be read, with a warning if its name differs.

        Raises:
            InputError: where there is none.
        """
        file, note = self._find(name)
        if note:
            warn(note)
        return file

    def _find(self, name: str) -> tuple[Path, str]:
        """Return the path of a file that may be read, and a note, which is empty unless its name differs."""
        # Exporters on Windows write backslashes and quotes; glTF writes spaces as %20.
        plain = name.strip().strip('"').replace("\\", "/")
        for file in (folder / each for folder in self._folders for each in (name.strip(), plain, unquote(plain))):
            with contextlib.suppress(InputError):
                require_file(file)
                return file, ""
        # Windows takes names in any case, and paths of another machine lead nowhere.
        found = None
        for folder, names in product(self._folders, (plain.split("/"), plain.split("/")[-1:])):
            found = found or _in_any_case(folder, names)
        for usual in (folder / below for folder in self._folders for below in _TEXTURE_FOLDERS):
            found = found or (_in_any_case(usual, plain.split("/")[-1:]) if is_inside(usual) else None)
        if plain.lower().endswith(".mtl") and len(self._material_files) < 2:
            found = found or self.own_material_file()
        if found is not None:
            return found, f"{self._path}: {name.strip()!r}, which it refers to, is not there; {str(found)!r} is taken"
        file = self._path.parent / unquote(plain)
        try:
            require_file(file)
        except InputError as error:
            self._missing.append(f"{self._path}: {str(file)!r}, which it refers to: {reason_alone(file, error)}")
            raise InputError(self._missing[-1]) from None
        return file, ""

    def own_material_file(self) -> Path | None:
        """Return the material file of the mesh's own name, which people forget to name when they rename both."""
        return _in_any_case(self._path.parent, [f"{self._path.stem}.mtl"])

    def set_material_statements(self, statements: Sequence[str]) -> None:
        """Take the statements for material files, each one or several names; trimesh requests the first only."""
        for line in dict.fromkeys(statements):
            with_spaces = _in_any_case(self._path.parent, line.replace("\\", "/").split("/"))
            self._material_files += [line] if with_spaces else _BETWEEN_NAMES.split(line)
        self._material_statement = next(iter(statements), None)

    def get(self, name: str) -> bytes | str:
        """Return a file's bytes, or the text of a material file, or of all if they are several.

        Raises:
            InputError: where it cannot be read, or is an image that is too large.
        """
        if len(self._material_files) < 2 or name != self._material_statement:
            return self._content(name)
        texts = []
        for each in self._material_files:
            with contextlib.suppress(InputError):  # `_missing` has it
                texts.append(str(self._content(each)))
        return "\n".join(texts)

    __getitem__ = get

    def _content(self, name: str) -> bytes | str:
        file, note = self._find(name)
        if note:
            self._replaced.append(note)
        data = read_file(file)
        if file.suffix.lower() == ".mtl":
            self._folders.append(file.parent)  # images of materials lie beside the mesh or beside their own file
            try:
                text = as_text(data)
            except InputError as error:  # trimesh would swallow it
                self._missing.append(f"{file}: {error}")
                raise
            return _COLOR_MAP.sub(rf"\1{COLOR_MAP}", text)
        if self._images:
            _refuse_large_image(file, data)
        return data

    def warn_of_changes(self) -> None:
        """Warn of the files that trimesh was not given, or others instead, once each."""
        for line in dict.fromkeys([*self._replaced, *(f"{line}; it is left out" for line in self._missing)]):
            warn(line)


def _refuse_large_image(file: Path, data: bytes) -> None:
    """Raise an InputError for an image that is too large, as trimesh decodes images of any size."""
    try:
        open_image(io.BytesIO(data)).close()
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    except Exception:  # noqa: BLE001 - a damaged image, which is reported when it is decoded
        pass


def _in_any_case(folder: Path, names: list[str]) -> Path | None:
    """Return the file of a path below a folder whose names may differ in case, or None."""
    for name in names:
        try:
            folder /= min(each for each in os.listdir(folder) if each.lower() == name.lower())
        except (OSError, ValueError):  # no folder, or no such name in it
            return None
    with contextlib.suppress(InputError):
        require_file(folder)
        return folder
    return None
