"""Files that a mesh file names: materials, images and buffers."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from urllib.parse import unquote

from wrt.errors import InputError, warn
from wrt.io.safe_read import is_inside, reason_alone, require_file

_TEXTURE_FOLDERS = ("textures", "../textures", "../materials/textures")
"""Where programs keep the images of meshes that name no folder; the last is Gazebo's."""


class Sidecars:
    """Finds the files that a mesh file names.

    Attributes:
        folders: where to look, the mesh file's own first; readers may add more.
    """

    def __init__(self, path: Path) -> None:
        """Take the path of the mesh file."""
        self._path = path
        self.folders = [path.parent]

    def find(self, name: str, instead: Sequence[str] = ()) -> Path:
        """Return the path of a file that may be read, with a warning if its name differs.

        If there is none of its name, the first of the names `instead` beside the mesh file is taken.

        Raises:
            InputError: where there is no such file.
        """
        file, note = self.located(name, instead)
        if note:
            warn(note)
        return file

    def located(self, name: str, instead: Sequence[str] = ()) -> tuple[Path, str]:
        """Return what `find` returns, and its warning, which is empty unless the name differs."""
        # Exporters on Windows write backslashes and quotes; glTF writes spaces as %20.
        plain = name.strip().strip('"').replace("\\", "/")
        for file in (folder / each for folder in self.folders for each in (name.strip(), plain, unquote(plain))):
            with contextlib.suppress(InputError):
                require_file(file)
                return file, ""
        # Windows takes names in any case, and paths of another machine lead nowhere.
        found = None
        for folder, names in product(self.folders, (plain.split("/"), plain.split("/")[-1:])):
            found = found or in_any_case(folder, names)
        for usual in (folder / below for folder in self.folders for below in _TEXTURE_FOLDERS):
            found = found or (in_any_case(usual, plain.split("/")[-1:]) if is_inside(usual) else None)
        for substitute in instead:
            found = found or in_any_case(self._path.parent, [substitute])
        if found:
            return found, f"{self._path}: {name.strip()!r}, which it refers to, is not there; {str(found)!r} is taken"
        file = self._path.parent / unquote(plain)
        try:
            require_file(file)
        except InputError as error:
            reason = reason_alone(file, error)
            raise InputError(f"{self._path}: {str(file)!r}, which it refers to: {reason}") from None
        return file, ""


def in_any_case(folder: Path, names: list[str]) -> Path | None:
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
