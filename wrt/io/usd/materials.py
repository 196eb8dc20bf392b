"""Materials and images of USD files.

Format: OpenUSD, "UsdPreviewSurface Specification" 2.6: a metallic-roughness or specular material with UsdUVTexture,
UsdTransform2d and UsdPrimvarReader.
"""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.images import FLOAT_SUFFIXES, read_image
from wrt.io.mesh.parts import as_specified
from wrt.io.safe_read import read_file, require_inside
from wrt.io.texture_images import Source, TextureImages
from wrt.io.usd.lights import Matrix, Values, path_of, radiance_of
from wrt.linalg import product
from wrt.scene.environment import ConstantEnvironment, Environment, ImageEnvironment
from wrt.scene.materials import Material, Principled
from wrt.scene.textures import CHANNELS, ColorSource, ImageTexture, NormalMap, VertexColor
from wrt.values import vec3

_WRAPS = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp", "black": "clamp"}

_Node = dict[str, Any]
"""A shader: its `id`, the values of its `inputs`, and the node and output that each of its `sources` is."""

_NO_NODE: _Node = {"id": "", "inputs": {}, "sources": {}}


class UsdMaterials:
    """The materials of one file; each is made once for meshes that both have or lack coordinates and colours."""

    def __init__(self, path: Path, content: dict[str, Any]) -> None:
        """Take the file, for messages and the images beside it, and the description of its stage."""
        self._path = path
        self._materials, self._nodes = content["materials"], content["nodes"]
        self._images = TextureImages(path)
        self._made: dict[tuple[str, bool, bool], Material | None] = {}

    def bound_to(self, name: str | None, *, has_uvs: bool, has_colors: bool) -> Material | None:
        """Return the material of a path, or None, for meshes with or without texture coordinates and colours."""
        if name is None:
            return None
        key = (name, has_uvs, has_colors)
        if key not in self._made:
            self._made[key] = self._make(name, has_uvs, has_colors)
        return self._made[key]

    def dome(self, values: Values, matrix: Matrix) -> Environment:
        """Return the environment of a dome light, whose pole is +y and whose middle is +z of its own axes."""
        from wrt.io.mitsuba.transforms import axis_and_degrees

        radiance = np.array(radiance_of(values))
        name = values.asset("inputs:texture:file")
        if not name:
            return ConstantEnvironment(vec3(radiance))
        file = self._path.parent / name
        if "[" in name:
            warn(f"{self._path}: {name}: the image of a dome within an archive is left out; unpack it")
            return ConstantEnvironment(vec3(radiance))
        require_inside(file)  # before its existence makes any difference
        if not file.is_file():
            warn(f"{self._path}: {str(file)!r}, which it refers to: no such file; the dome has one colour")
            return ConstantEnvironment(vec3(radiance))
        pixels = read_image(file) * radiance.astype(np.float32)
        axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
        axis, degrees = axis_and_degrees(product(axes, np.diag([-1.0, 1.0, -1.0])))
        return ImageEnvironment(pixels, 1.0, degrees, file.name, axis)

    def _make(self, name: str, has_uvs: bool, has_colors: bool) -> Material | None:
        shader = self._nodes.get(self._materials[name])
        if shader is None or shader["id"] != "UsdPreviewSurface":
            warn(f"{self._path}: {name}: only UsdPreviewSurface is supported; left out")
            return None
        read = _Inputs(self, shader, has_uvs, has_colors)
        cutoff = _number(shader, "opacityThreshold", 0.0)
        values: dict[str, Any] = {
            "base_color": read.color("diffuseColor", (0.18,) * 3),
            "roughness": read.number("roughness", 0.5),
            "opacity": read.number("opacity", 1.0, cutoff=cutoff if cutoff > 0.0 else None),
            "coat": read.number("clearcoat", 0.0),
            "coat_roughness": read.number("clearcoatRoughness", 0.01),
            "emission": read.color("emissiveColor", (0.0,) * 3),
            "ior": max(1.0, _number(shader, "ior", 1.5)),
        }
        if _number(shader, "useSpecularWorkflow", 0):
            # As its reflectance at normal incidence, with an infinite index.
            values |= {"ior": 0.0, "specular_color": read.color("specularColor", (0.0,) * 3)}
        else:
            values["metallic"] = read.number("metallic", 0.0)
        normal = read.texture("normal", "data")
        if normal is not None and has_uvs:
            values["normal_map"] = NormalMap(normal, name=normal.name)
        return Principled(**values)

    def node(self, source: list[str] | None) -> _Node:
        """Return what is connected to an input, or a node of no type."""
        node: _Node = self._nodes[source[0]] if source else _NO_NODE
        return node

    def pixels(self, name: str, kind: str) -> Any:
        """Return the pixels of an image, or None with a warning."""
        return self._images.pixels(name, kind, f"image {_file_name(name)}", lambda: self._located(name))

    def _located(self, name: str) -> Source:
        """Return the file of an image, or its bytes within a USDZ archive."""
        archive, is_packed, inner = name.partition("[")
        if not is_packed:
            return self._path.parent / name
        inner = inner.removesuffix("]")
        if "[" in inner or Path(inner).suffix.lower() in FLOAT_SUFFIXES:
            raise InputError(f"{self._path}: {name}: archives and images of floats within an archive are not supported")
        data = read_file(self._path.parent / archive)
        specified = as_specified(f"{self._path}: {name}", "USDZ", zipfile.BadZipFile)
        with specified, zipfile.ZipFile(io.BytesIO(data)) as opened:
            if opened.getinfo(inner).compress_type != zipfile.ZIP_STORED:
                raise InputError(f"{self._path}: {name}: it is compressed, which USDZ forbids")
            return opened.read(inner)


class _Inputs:
    """The inputs of one shader: constants, and textures that are connected."""

    def __init__(self, owner: UsdMaterials, shader: _Node, has_uvs: bool, has_colors: bool) -> None:
        self._owner, self._shader, self._has_uvs, self._has_colors = owner, shader, has_uvs, has_colors

    def color(self, name: str, default: tuple[float, ...]) -> ColorSource:
        texture = self.texture(name, "color")
        if texture is not None:
            return texture if self._has_uvs else vec3(_first(texture))
        reader = self._owner.node(self._shader["sources"].get(name))
        if reader["id"] == "UsdPrimvarReader_float3":
            if self._has_colors and reader["inputs"].get("varname") == "displayColor":
                return VertexColor()
            default = tuple(_numbers(reader, "fallback", default))
        return vec3(np.maximum(_numbers(self._shader, name, default), 0.0))

    def number(self, name: str, default: float, cutoff: float | None = None) -> ColorSource:
        """Return a number from 0 to 1; with a cutoff 0 or 1."""
        texture = self.texture(name, "data", cutoff=cutoff)
        if texture is not None and self._has_uvs:
            return texture
        value = float(np.clip(_number(self._shader, name, default), 0.0, 1.0))
        if texture is not None:
            value = float(_first(texture)[CHANNELS.index(texture.channel or "r")])
        return value if cutoff is None else float(value >= cutoff)

    def texture(self, name: str, kind: str, cutoff: float | None = None) -> ImageTexture | None:
        """Return the texture that is connected to an input, or None."""
        source = self._shader["sources"].get(name)
        image = self._owner.node(source)
        if image["id"] != "UsdUVTexture" or not (file := path_of(image["inputs"].get("file"))):
            return None
        channel = source[1]
        space = str(image["inputs"].get("sourceColorSpace"))
        if kind == "data" and channel == "a":
            kind, channel = "alpha", "r"
        elif space in ("raw", "sRGB"):
            kind = "data" if space == "raw" else "color"
        pixels = self._owner.pixels(file, kind)
        if pixels is None:
            return None
        scale, bias = _numbers(image, "scale", (1.0,) * 4)[:3], _numbers(image, "bias", (0.0,) * 4)[:3]
        if name == "normal":
            # To −1 to 1 in the file, from 0 to 1 here.
            scale, bias = 0.5 * scale, 0.5 * bias + 0.5
        if name == "normal" or bias.any():
            pixels, scale = np.clip(pixels * scale + bias, 0.0, 1.0).astype(np.float32), np.ones(3)
        is_plane = channel in CHANNELS
        options: dict[str, Any] = {
            "factor": vec3(scale[CHANNELS.index(channel)] * np.ones(3) if is_plane else scale),
            "wrap": tuple(_WRAPS.get(str(image["inputs"].get(key)), "repeat") for key in ("wrapS", "wrapT")),
            "channel": channel if is_plane else None,
            "cutoff": cutoff,
        }
        place = self._owner.node(image["sources"].get("st"))
        if place["id"] == "UsdTransform2d":  # scaled, turned, then moved
            options["scale"] = tuple(_numbers(place, "scale", (1.0, 1.0)).tolist())
            options["rotation_degrees"] = _number(place, "rotation", 0.0)
            options["offset"] = tuple(_numbers(place, "translation", (0.0, 0.0)).tolist())
        return ImageTexture(pixels, _file_name(file), **options)


def _first(texture: ImageTexture) -> Any:
    """Return (3,) the colour at (0, 0), which a mesh without coordinates has everywhere."""
    return np.clip(np.array(texture.pixels[-1, 0], np.float64) * np.array(texture.factor), 0.0, 1.0)


def _file_name(name: str) -> str:
    return Path(name.removesuffix("]")).name


def _number(node: _Node, name: str, default: float) -> float:
    """Return an input's number, or the default where it has none."""
    value = node["inputs"].get(name)
    return float(value) if isinstance(value, (bool, int, float)) and math.isfinite(value) else default


def _numbers(node: _Node, name: str, default: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the numbers of an input, as many as the default has, or the default where it has others."""
    value = node["inputs"].get(name)
    fits = isinstance(value, np.ndarray) and value.shape == (len(default),) and value.dtype.kind in "fiu"
    return np.array(value if fits and np.isfinite(value).all() else default, np.float64)
