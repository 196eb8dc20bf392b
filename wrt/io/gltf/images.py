"""Textures of glTF files: their images, samplers and texture transforms.

Format: Khronos Group 2021, "glTF 2.0 Specification", sections 3.6.1, 3.8; KHR_texture_transform.
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import warn
from wrt.io.gltf.buffers import Buffers, Tree
from wrt.io.texture_images import KTX2_HINT, Source, TextureImages, has_ktx2_decoder
from wrt.scene.textures import ImageTexture

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_NEAREST = 9728
_MIPMAPS = (9984, 9985, 9986, 9987)


class GltfImages:
    """The images of one file: each is decoded once per kind of use."""

    def __init__(self, path: Path, tree: Tree, buffers: Buffers) -> None:
        """Take the JSON of a file and its binary data; images may be removed from the JSON later."""
        self._path, self._buffers = path, buffers
        self._tree = {key: tree.get(key, []) for key in ("images", "textures", "samplers")}
        self._images = TextureImages(path)
        self._firsts: dict[tuple[int | None, str | None], int] = {}  # images by where their bytes are
        self._needs_ktx2 = False

    def texture(self, info: Tree | None, kind: str, *, placed: bool, **options: Any) -> ImageTexture | None:
        """Return the texture of a reference, or None if there is none.

        Args:
            info: the reference.
            kind: content of the image, see `pixels`.
            placed: whether the texture applies the transform of the reference, rather than the coordinates of the mesh.
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
        """Return (H, W, 3) the pixels of an image, or None if there is none; for `kind` see TextureImages."""
        number = None if not info else self._source(info)
        if number is None:
            return None
        return self._images.pixels(number, kind, f"image {number}", partial(self._bytes, number))

    def has_alpha(self, info: Tree | None) -> bool:
        """Whether the image has an alpha channel that is not opaque everywhere."""
        number = None if not info else self._source(info)
        return number is not None and self._images.has_alpha(number, f"image {number}", partial(self._bytes, number))

    def wrap(self, info: Tree) -> tuple[str, str]:
        """Return the wrap modes along u and v."""
        sampler = self._sampler(info)
        return _WRAPS.get(sampler.get("wrapS", 0), "repeat"), _WRAPS.get(sampler.get("wrapT", 0), "repeat")

    def _filter(self, info: Tree) -> str:
        """Return the filter."""
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
        """Return the number of the image of a reference; of images with the same source, the first."""
        entry = self._entry(info)
        extensions = entry.get("extensions", {})
        source: int | None = entry.get("source")
        for name in ("EXT_texture_webp", "EXT_texture_avif"):
            source = extensions.get(name, {}).get("source", source)
        if source is None and "KHR_texture_basisu" in extensions:
            if not has_ktx2_decoder():
                self._warn_of_ktx2()
                return None
            source = extensions["KHR_texture_basisu"]["source"]
        if source is None:
            kinds = ", ".join(extensions) or "no source"
            what = f"texture {info['index']} left out: its image is in a format not supported ({kinds})"
            warn(f"{self._path}: {what}")
            return None
        image = self._tree["images"][source]
        return self._firsts.setdefault((image.get("bufferView"), image.get("uri")), source)

    def _warn_of_ktx2(self) -> None:
        if not self._needs_ktx2:
            warn(f"{self._path}: textures in KTX2 images are left out, which need a decoder: {KTX2_HINT}")
        self._needs_ktx2 = True

    def _bytes(self, number: int) -> Source:
        image = self._tree["images"][number]
        return self._buffers.view(image["bufferView"]) if "bufferView" in image else self._buffers.at_uri(image["uri"])


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
