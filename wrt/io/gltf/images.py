"""Textures of glTF files: their images, samplers and texture transforms.

Format: Khronos Group 2021, "glTF 2.0 Specification", sections 3.6.1, 3.8; KHR_texture_transform.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import warn
from wrt.io.gltf.buffers import Buffers, Tree
from wrt.io.texture_images import KTX2_HINT, Source, TextureImages, has_ktx2_decoder
from wrt.scene.textures import ImageTexture

WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
NEAREST, LINEAR = 9728, 9729
MIPMAPS = (9984, 9985, 9986, 9987)


class GltfImages:
    """The images of one file: each is decoded once per kind of use."""

    def __init__(self, path: Path, tree: Tree, buffers: Buffers) -> None:
        """Take the JSON of a file and its binary data."""
        self._path, self._tree, self._buffers = path, tree, buffers
        self._images = TextureImages(path)

    def texture(self, info: Tree | None, kind: str, *, placed: bool, **options: Any) -> ImageTexture | None:
        """Return the texture of a reference with further attributes, or None if there is none; for `kind` see `pixels`.

        If `placed`, the texture applies the transform of the reference, otherwise the coordinates of the mesh do.
        """
        pixels = self.pixels(info, kind)
        if pixels is None or info is None:
            return None
        sampler = self._sampler(info)
        options["filter"] = "trilinear" if sampler.get("minFilter") in MIPMAPS else "bilinear"
        if self.is_nearest(info):
            options["filter"] = "nearest"
        placement = placement_of(info) if placed else {}
        return ImageTexture(pixels, self.label(info), wrap=self.wrap(info), **placement, **options)

    def label(self, info: Tree) -> str:
        """Return a name for messages."""
        return f"{self._path.name} texture {info.get('index')}"

    def wrap(self, info: Tree) -> tuple[str, str]:
        """Return the wrap modes along u and v."""
        sampler = self._sampler(info)
        return WRAPS.get(sampler.get("wrapS", 0), "repeat"), WRAPS.get(sampler.get("wrapT", 0), "repeat")

    def is_nearest(self, info: Tree) -> bool:
        """Return whether a texture is the nearest texel, not smoothed."""
        return bool(self._sampler(info).get("magFilter") == NEAREST)

    def pixels(self, info: Tree | None, kind: str) -> NDArray[np.float32] | None:
        """Return (H, W, 3) the pixels of an image, or None if there is none; for `kind` see TextureImages."""
        if (image := self._image(info)) is None:
            return None
        place, label, read = image
        return self._images.pixels(place, kind, label, read)

    def has_alpha(self, info: Tree | None) -> bool:
        """Return whether the image has an alpha channel that is not opaque everywhere."""
        image = self._image(info)
        return image is not None and self._images.has_alpha(*image)

    def _texture(self, info: Tree) -> Tree:
        texture: Tree = self._tree["textures"][info["index"]]
        return texture

    def _sampler(self, info: Tree) -> Tree:
        number = self._texture(info).get("sampler")
        sampler: Tree = {} if number is None else self._tree["samplers"][number]
        return sampler

    def _image(self, info: Tree | None) -> tuple[Hashable, str, Callable[[], Source]] | None:
        """Return where the bytes of a reference's image are, its label, and a function that reads them, or None."""
        if not info:
            return None
        texture = self._texture(info)
        extensions = texture.get("extensions", {})
        number: int | None = texture.get("source")
        for name in ("EXT_texture_webp", "EXT_texture_avif"):
            number = extensions.get(name, {}).get("source", number)
        if number is None and "KHR_texture_basisu" in extensions:
            number = extensions["KHR_texture_basisu"]["source"]
            if not self._has_ktx2:
                return None
        if number is None:
            formats = ", ".join(extensions) or "no source"
            reason = f"its image is in a format not supported ({formats})"
            warn(f"{self._path}: texture {info['index']} left out: {reason}")
            return None
        image = self._tree["images"][number]
        place = image.get("bufferView"), image.get("uri")
        return place, f"image {number}", functools.partial(self._bytes, number)

    @functools.cached_property
    def _has_ktx2(self) -> bool:
        """Whether KTX2 images can be decoded; warns once if not."""
        if not (has_decoder := has_ktx2_decoder()):
            warn(f"{self._path}: textures in KTX2 images are left out, which need a decoder: {KTX2_HINT}")
        return has_decoder

    def _bytes(self, number: int) -> Source:
        image = self._tree["images"][number]
        return self._buffers.view(image["bufferView"]) if "bufferView" in image else self._buffers.at_uri(image["uri"])


def placement_of(info: Tree) -> Tree:
    """Return `scale`, `rotation_degrees` and `offset` of an ImageTexture, whose v points up, for a reference.

    In the file v points down, and (u, v) becomes (ou + c su u + s sv v, ov − s su u + c sv v). With v' = 1 − v
    before and after, that is the same rotation seen the other way up, and another offset.
    """
    transform = info.get("extensions", {}).get("KHR_texture_transform", {})
    turn = float(transform.get("rotation", 0.0))
    c, s = math.cos(turn), math.sin(turn)
    (su, sv), (ou, ov) = transform.get("scale", (1.0, 1.0)), transform.get("offset", (0.0, 0.0))
    return {
        "scale": (su, sv),
        "rotation_degrees": math.degrees(turn),
        "offset": (ou + s * sv, 1.0 - ov - c * sv),
    }
