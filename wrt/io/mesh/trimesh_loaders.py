"""trimesh's loaders of mesh files, and their output as parts.

The loaders are called directly, which return the arguments of Trimesh's constructor. Trimesh objects would round
colours to 8 bits, and do not tell normals of the file from normals that trimesh computes.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.encodings import as_text
from wrt.io.images import open_image
from wrt.io.mesh.parts import FloatArray, Part, checked_faces, rows_of
from wrt.io.mesh.polygons import triangulate
from wrt.io.safe_read import first_line, is_inside, read_file, reason_alone, require_file
from wrt.io.texture_images import TextureImages
from wrt.scene.srgb import linear_from_srgb
from wrt.scene.textures import ColorSource, ImageTexture
from wrt.values import array

Fields = dict[str, Any]
"""Output of a trimesh loader for one mesh: arguments of trimesh.Trimesh."""

COLOR_MAP = "map_color"
"""Replaces map_Kd in material files: trimesh would open the image itself, and knows fewer formats."""

_COLOR_MAP = re.compile(r"^(\s*)map_kd(?=\s)", re.IGNORECASE | re.MULTILINE)


_AFTER_NAME = re.compile(r"(?<=\.mtl)\s+", re.IGNORECASE)
_TEXTURE_FOLDERS = ("textures", "../textures", "../materials/textures")
"""Where programs keep the images of meshes that name no folder; the last is Gazebo's."""


class Beside:
    """Gives trimesh the files that a file refers to, and remembers the missing ones."""

    def __init__(self, path: Path, *, images: bool = True) -> None:
        """Take the path of the file, and whether all that it refers to are images."""
        self.path = path
        self.file_name = path.name
        self.missing: list[str] = []
        self._materials: list[str] = []
        self._statement: str | None = None  # of the first material files, by which trimesh asks
        self.replaced: list[str] = []  # notes on other files that trimesh was given, which cannot warn itself
        self._images = images
        self._folders = [path.parent]

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
        """Return the path of a file that may be read, and a note if its name differs, or else ""."""
        # Exporters on Windows write backslashes and quotes; glTF writes spaces as %20.
        plain = name.strip().strip('"').replace("\\", "/")
        files = [folder / each for folder in self._folders for each in (name.strip(), plain, unquote(plain))]
        for file in files:
            with contextlib.suppress(InputError):
                require_file(file)
                return file, ""
        # Windows takes names in any case, and paths of another machine lead nowhere.
        found = None
        for folder, names in product(self._folders, (plain.split("/"), plain.split("/")[-1:])):
            found = found or _in_any_case(folder, names)
        for usual in (folder / below for folder in self._folders for below in _TEXTURE_FOLDERS):
            found = found or (_in_any_case(usual, plain.split("/")[-1:]) if is_inside(usual) else None)
        if plain.lower().endswith(".mtl") and len(self._materials) < 2:
            found = found or self.own_materials()
        if found is not None:
            return found, f"{self.path}: {name.strip()!r}, which it refers to, is not there; {str(found)!r} is taken"
        beside = self.path.parent / unquote(plain)
        try:
            require_file(beside)
        except InputError as error:
            self.missing.append(f"{self.path}: {str(beside)!r}, which it refers to: {reason_alone(beside, error)}")
            raise InputError(self.missing[-1]) from None
        return beside, ""

    def own_materials(self) -> Path | None:
        """Return the material file of the mesh's own name, which people forget to name when they rename both."""
        return _in_any_case(self.path.parent, [f"{self.path.stem}.mtl"])

    def name_materials(self, lines: Sequence[str]) -> None:
        """Take what the statements for material files say, each one or several names; trimesh asks for the first."""
        for line in dict.fromkeys(lines):
            whole = _in_any_case(self.path.parent, line.replace("\\", "/").split("/"))  # a name may contain spaces
            self._materials += [line] if whole else _AFTER_NAME.split(line)
        self._statement = next(iter(lines), None)

    def get(self, name: str) -> bytes | str:
        """Return a file's bytes, or the text of a material file, or of all if they are several.

        Raises:
            InputError: where it cannot be read, or is an image that is too large.
        """
        if len(self._materials) < 2 or name != self._statement:
            return self._got(name)
        texts = []
        for each in self._materials:
            with contextlib.suppress(InputError):  # `missing` has it
                texts.append(str(self._got(each)))
        return "\n".join(texts)

    def _got(self, name: str) -> bytes | str:
        file, note = self._find(name)
        if note:
            self.replaced.append(note)
        data = read_file(file)
        if file.suffix.lower() == ".mtl":
            self._folders.append(file.parent)  # images of materials lie beside the mesh or beside their own file
            try:
                text = as_text(data)
            except InputError as error:  # trimesh would swallow it
                self.missing.append(f"{file}: {error}")
                raise
            return _COLOR_MAP.sub(rf"\1{COLOR_MAP}", text)
        return self._not_too_large(file, data)

    def tell(self) -> None:
        """Warn of the files that trimesh was not given, or others instead, once each."""
        for line in dict.fromkeys([*self.replaced, *(f"{line}; it is left out" for line in self.missing)]):
            warn(line)

    def _not_too_large(self, file: Path, data: bytes) -> bytes:
        """Return the data unless it is an image that is too large; trimesh decodes images of any size."""
        if not self._images:
            return data
        try:
            open_image(io.BytesIO(data)).close()
        except InputError as error:
            raise InputError(f"{file}: {error}") from None
        except Exception:  # noqa: BLE001 - a damaged image, which is reported when it is decoded
            pass
        return data

    __getitem__ = get


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


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Silence trimesh's log and NumPy's warnings, but raise on text that is not a number."""
    from trimesh.constants import log

    disabled, log.disabled = log.disabled, True
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            # np.fromstring only warns when it stops at such text.
            warnings.filterwarnings("error", message="string or file could not be read")
            yield
    finally:
        log.disabled = disabled


class _Views(io.BytesIO):
    """A file whose reads return views of its bytes instead of copies."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self._view = memoryview(data)

    def read(self, size: int | None = -1, /) -> Any:
        """Return up to `size` bytes, or all the rest."""
        start = self.tell()
        stop = self.seek(0, io.SEEK_END) if size is None or size < 0 else min(start + size, len(self._view))
        self.seek(stop)
        return self._view[start:stop]


def in_words(error: Exception) -> str:
    """Return the reason of a loader's failure; its own words if it noticed, and what Python noticed in brackets."""
    noticed = (IndexError, KeyError, AttributeError, TypeError, AssertionError, UnboundLocalError)
    reason = first_line(error)
    return f"something in it is missing or not as specified ({reason})" if isinstance(error, noticed) else reason


def load(
    path: Path, data: bytes | str, kind: str, *, views: bool = False, beside: Beside | None = None, **options: Any
) -> Fields:
    """Return the output of a trimesh loader.

    Args:
        path: the file.
        data: its content.
        kind: the type of the file, such as "obj".
        views: whether reads may return memoryviews, which not all loaders accept.
        beside: what finds the files that it refers to; by default a new one.
        options: further arguments of the loader.

    Raises:
        InputError: where the loader fails for any reason.
    """
    from trimesh.exchange.load import mesh_loaders

    beside = beside or Beside(path, images=kind != "gltf")
    file = io.StringIO(data) if isinstance(data, str) else (_Views if views else io.BytesIO)(data)
    with quiet():
        try:
            loaded: Fields = mesh_loaders[kind](file_obj=file, resolver=beside, **options)
        except InputError:
            raise
        except Exception as error:  # noqa: BLE001 - loaders raise undocumented exceptions on damaged files
            reason = first_line(error)
            if "could not be read" in reason:
                reason = "there is something else where a number should be"
            elif isinstance(error, IndexError) and "out of bounds" in reason:
                reason = f"a face names something that is not there ({reason})"
            else:
                reason = in_words(error)
            raise InputError(f"{path}: not a whole {kind.upper()} file that can be read: {reason}") from None
    beside.tell()
    return loaded


def part_of(path: Path, name: str, fields: Fields, *, linear: bool = False) -> Part | None:
    """Return a loader's mesh as a part without a material, or None if it has no triangles.

    Args:
        path: the file, for messages.
        name: of the part.
        fields: output of the loader; polygons of more than three corners are triangulated here.
        linear: whether colours are linear; otherwise they are sRGB.

    Raises:
        InputError: where faces name missing vertices.
    """
    faces = array(() if fields.get("faces") is None else fields["faces"], f"{path}: faces")
    if faces.dtype.kind not in "iu":
        faces = array(faces, f"{path}: faces", np.int64)
    if faces.ndim != 2 or faces.shape[1] < 3 or not len(faces):
        return None
    vertices = rows_of(path, fields.get("vertices", ()), "vertices", 3)
    count, size = faces.shape
    owner: Any = slice(None)
    if size > 3:
        checked_faces(path, faces, len(vertices))
        corners = faces.reshape(-1)
        triangles, owner = triangulate(vertices, corners, np.full(count, size))
        if memory_limits.patience() <= 0:
            warn(f"{path}: its concave polygons take too long to cut into triangles; some of them come out as fans")
        faces = corners[triangles]
    part = Part(name, vertices, faces)
    visual = fields.get("visual")
    colors = fields.get("vertex_colors")
    if colors is None and visual is not None:
        colors = visual.vertex_attributes.get("color")
    part.normals = matching(fields.get("vertex_normals"), len(vertices))
    part.uvs = matching(getattr(visual, "uv", None), len(vertices))
    colors, face_colors = matching(colors, len(vertices)), matching(fields.get("face_colors"), count)
    if colors is not None:
        part.colors = decoded(colors, linear=linear)
    elif face_colors is not None:
        part.face_colors = decoded(face_colors, linear=linear)[owner]
    return part


def matching(array: Any, count: int) -> NDArray[Any] | None:
    """Return an array if it has a row for each vertex or face, which trimesh does not ensure; otherwise None."""
    try:
        rows = np.asarray(array)
    except ValueError:  # rows of different lengths
        return None
    return rows if rows.ndim == 2 and len(rows) == count and rows.dtype.kind in "fiu" else None


def decoded(colors: NDArray[Any], *, linear: bool = False) -> FloatArray:
    """Return (N, 3) linear colours, or (N, 4) if any is not opaque. Integers span the range of their type.

    Args:
        colors: (N, 3) or (N, 4).
        linear: whether they are linear, as in glTF. Otherwise they are sRGB, except for alpha, and an alpha of 0
            everywhere counts as none, since some programs leave it unset.
    """
    values = colors[:, :4].astype(np.float64)
    if colors.dtype.kind in "iu":
        values /= np.iinfo(colors.dtype).max
    elif (values[np.isfinite(values)] > 1.0).any():
        values /= 255.0
    with np.errstate(all="ignore"):  # invalid colours are left out later, with a warning
        rgb, alpha = values[:, :3], np.clip(values[:, 3:], 0.0, 1.0)
        rgb = rgb if linear else linear_from_srgb(rgb)
        return np.column_stack([rgb, alpha]) if (alpha < 1.0).any() and (linear or alpha.any()) else rgb


def reflectance(path: str | Path, name: str, image: Any, factor: Any) -> ColorSource | None:
    """Return a linear factor times an sRGB image, or whichever of the two there is.

    Args:
        path: the file, for messages.
        name: of the texture.
        image: a PIL image or None; one that cannot be decoded is left out with a warning.
        factor: one or three numbers, or None.
    """
    constant = None
    values = np.ravel(np.asarray(() if factor is None else factor, np.float64))[:3]
    if len(values) in (1, 3) and np.isfinite(values).all():
        r, g, b = (float(x) for x in np.clip(np.broadcast_to(values, 3), 0.0, 1.0))
        constant = (r, g, b)
    if image is None:
        return constant
    pixels = TextureImages(path).pixels(0, "color", f"texture {name}", lambda: image)
    if pixels is None:
        return constant
    # Many exporters write Kd 0 0 0 beside an image, which would make it black.
    return ImageTexture(pixels, name, factor=constant if constant is not None and any(constant) else 1.0)


def is_stand_in(image: Any) -> bool:
    """Whether an image is the grey patch that trimesh creates for coordinates without an image."""
    from trimesh.visual.material import color_image

    return image is not None and image.format is None and np.array_equal(np.asarray(image), np.asarray(color_image()))
