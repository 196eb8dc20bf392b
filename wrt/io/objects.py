"""What people hand over where a mesh or a material is expected: objects of other libraries, files, words, colours."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wrt.errors import InputError
from wrt.io.archives import unpacked
from wrt.io.load_mesh import load_file, load_object
from wrt.scene.materials import Diffuse, Material
from wrt.scene.materials.named import named_material
from wrt.scene.scene import Shape
from wrt.scene.textures import ImageTexture
from wrt.values import color

_IMAGES = (".png", ".jpg", ".jpeg", ".exr", ".hdr", ".tif", ".tiff", ".webp", ".bmp", ".tga")


def shapes_of(source: Any) -> list[Shape]:
    """Return the shapes of a mesh file, or of an object of trimesh, PyVista, Open3D or another library.

    Raises:
        InputError: if it cannot be used; see `wrt.load_mesh`.
    """
    if isinstance(source, (str, os.PathLike)):
        with unpacked(source, None) as file:
            return load_file(file).shapes
    return load_object(source).shapes


def material_of(value: Any) -> Material:
    """Return a material that is given itself, by a text, by a colour or by the image file of its texture.

    Args:
        value: a material; the text of `wrt.scene.materials.named.named_material`, such as "gold", "red" or
            "#ff8800"; three linear numbers; or the path of an image.

    Raises:
        InputError: if there is no such material, or the image cannot be read.
    """
    if isinstance(value, Material):
        return value
    if isinstance(value, (str, os.PathLike)):
        path = Path(value)
        if path.suffix.lower() in _IMAGES:
            from wrt.io.images import read_image

            return Diffuse(ImageTexture(read_image(path), name=path.name))
        if isinstance(value, str):
            return named_material(value)
    if isinstance(value, (Sequence, np.ndarray)) and len(value) == 3:
        return Diffuse(color(value, "material"))
    raise InputError(f"material must be a material, its name, a colour or an image file, not {type(value).__name__}")
