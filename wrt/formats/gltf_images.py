"""Images of glTF files as textures: where their bytes are, how they are laid, what of them is read.

Format: Khronos Group 2021, "glTF 2.0 Specification", sections 3.6.1, 3.8; KHR_texture_transform.
"""

from __future__ import annotations

import base64
import binascii
import math
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.files import read_file, why_not
from wrt.formats.parts import warn
from wrt.formats.texture_images import Source, TextureImages
from wrt.textures import ImageTexture

Tree = dict[str, Any]

IMAGE_KEYS = ("images", "textures", "samplers", "bufferViews", "buffers")
"""What of a file's JSON leads to its images."""

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_NEAREST = 9728
_MIPMAPS = (9984, 9985, 9986, 9987)


class GltfImages:
    """The images of one file, each decoded once for each use."""

    def __init__(self, path: Path, tree: Tree, binary: bytes) -> None:
        """Take a file's JSON, and the binary chunk of a GLB."""
        self._path, self._tree, self._binary = path, tree, binary
        self._images = TextureImages(path)
        self._firsts: dict[tuple[int | None, str | None], int] = {}  # images by where their bytes are

    def texture(self, info: Tree | None, kind: str, *, placed: bool, **options: Any) -> ImageTexture | None:
        """Return the texture that a reference names, or None without one.

        Args:
            info: the reference.
            kind: what is read of the image, see `pixels`.
            placed: whether the reference's transform is applied, and not to the mesh's coordinates.
            **options: further attributes of the ImageTexture.
        """
        pixels = self.pixels(info, kind)
        if pixels is None or info is None:
            return None
        return ImageTexture(
            pixels,
            self.label(info),
            wrap=self.wrap(info),
            filter=self._filter(info),
            **(placement_of(info) if placed else {}),
            **options,
        )

    def label(self, info: Tree) -> str:
        """Return a name for messages."""
        return f"{self._path.name} texture {info.get('index')}"

    def pixels(self, info: Tree | None, kind: str) -> NDArray[np.float32] | None:
        """Return (H, W, 3) what an image holds, `kind` as in TextureImages, or None without one."""
        number = None if not info else self._source(info)
        if number is None:
            return None
        return self._images.pixels(number, kind, f"image {number}", partial(self._bytes, number))

    def has_alpha(self, info: Tree | None) -> bool:
        """Whether the image has an alpha channel that is not opaque everywhere."""
        number = None if not info else self._source(info)
        return number is not None and self._images.has_alpha(number, f"image {number}", partial(self._bytes, number))

    def wrap(self, info: Tree) -> tuple[str, str]:
        """Return how a texture goes on beyond its edges, along u and v."""
        sampler = self._sampler(info)
        return _WRAPS.get(sampler.get("wrapS", 0), "repeat"), _WRAPS.get(sampler.get("wrapT", 0), "repeat")

    def _filter(self, info: Tree) -> str:
        """Return how texels are interpolated."""
        sampler = self._sampler(info)
        if sampler.get("magFilter") == _NEAREST:
            return "nearest"
        return "trilinear" if sampler.get("minFilter") in _MIPMAPS else "bilinear"

    def _entry(self, info: Tree) -> Tree:
        entry: Tree = self._tree["textures"][info["index"]]
        return entry

    def _sampler(self, info: Tree) -> Tree:
        number = self._entry(info).get("sampler")
        sampler: Tree = {} if number is None else self._tree["samplers"][number]
        return sampler

    def _source(self, info: Tree) -> int | None:
        """Return the number of the image that a texture reference leads to, the first of those with the same bytes."""
        entry = self._entry(info)
        extensions = entry.get("extensions", {})
        source: int | None = extensions.get("EXT_texture_webp", {}).get("source", entry.get("source"))
        if source is None:
            kinds = ", ".join(extensions) or "no source"
            warn(f"{self._path}: texture {info['index']} left out: its image is in a format not supported ({kinds})")
            return None
        image = self._tree["images"][source]
        return self._firsts.setdefault((image.get("bufferView"), image.get("uri")), source)

    def _bytes(self, number: int) -> Source:
        image = self._tree["images"][number]
        if "bufferView" in image:
            view = self._tree["bufferViews"][image["bufferView"]]
            buffer = self._tree["buffers"][view["buffer"]]
            data = self._located(buffer["uri"]) if "uri" in buffer else self._binary
            start = view.get("byteOffset", 0)
            return data[start : start + view["byteLength"]]
        return self._located(image["uri"])

    def _located(self, uri: str) -> bytes:
        """Return the bytes of a data URI, or of a file beside this one."""
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=True)
            except binascii.Error as error:
                raise InputError(f"{self._path}: a data URI in it is damaged: {error}") from None
        file = self._path.parent / unquote(uri)
        try:
            data = read_file(file)
        except InputError as error:
            raise InputError(f"{self._path}: {str(file)!r}, which it refers to: {why_not(file, error)}") from None
        return data


def placement_of(info: Tree) -> Tree:
    """Return `scale`, `rotation_degrees` and `offset` of an ImageTexture, whose v points up, for a reference.

    In the file v points down, and (u, v) becomes (ou + c su u + s sv v, ov − s su u + c sv v). With v' = 1 − v
    before and after, that is the same rotation seen the other way up, and another offset.
    """
    given = info.get("extensions", {}).get("KHR_texture_transform", {})
    turn = float(given.get("rotation", 0.0))
    c, s = math.cos(turn), math.sin(turn)
    (su, sv), (ou, ov) = given.get("scale", (1.0, 1.0)), given.get("offset", (0.0, 0.0))
    return {
        "scale": (su, sv),
        "rotation_degrees": math.degrees(turn),
        "offset": (ou + s * sv, 1.0 - ov - c * sv),
    }
