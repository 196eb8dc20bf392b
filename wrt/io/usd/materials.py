"""Materials and images of USD files.

Format: OpenUSD, "UsdPreviewSurface Specification" 2.6: a metallic-roughness or specular material with UsdUVTexture,
UsdTransform2d and UsdPrimvarReader.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections import Counter
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io.account import TrackedObject
from wrt.io.images import FLOAT_SUFFIXES, read_image
from wrt.io.mesh.parts import as_specified
from wrt.io.safe_read import read_file, require_inside
from wrt.io.texture_images import Source, TextureImages
from wrt.io.usd.lights import Matrix, Values, path_of, radiance_of
from wrt.io.usd.process import PREVIEW
from wrt.linalg import product
from wrt.scene.environment import ConstantEnvironment, Environment, ImageEnvironment
from wrt.scene.materials import Material, Principled
from wrt.scene.textures import CHANNELS, ColorSource, ImageTexture, NormalMap, VertexColor
from wrt.values import sealed, vec3

_WRAPS = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp", "black": "clamp", "useMetadata": "clamp"}
"""Ways to continue an image. Images have no such metadata, and are then black beyond their edges, too."""

_BLACK = ("black", "useMetadata")

_SPACES = {"raw": "data", "sRGB": "color", "auto": ""}
"""The kind of pixels of each color space. For "auto" the input decides: colors are sRGB, numbers are data."""

_LEAST_FOR_COPY = 16
"""Texels from which on the border begins one texel beyond the image, so that its edge is not blended with black."""

_NEUTRAL = {
    "displacement": (0.0,),
    "normal": (0.0, 0.0, 1.0),
    "opacityMode": ("presence",),
    "fallback": (0.0, 0.0),  # of coordinates: a mesh without them has the colour of the first texel
}
"""Inputs without effect at a value."""

_MOST_UV_SETS = 2
_COLOR_READER = "UsdPrimvarReader_float3"

_Move = tuple[tuple[float, ...], float, tuple[float, ...]]
_NOT_MOVED: _Move = ((1.0, 1.0), 0.0, (0.0, 0.0))

Coordinates = tuple[str, _Move]
"""A primvar of texture coordinates ("" for the mesh's first), and the scale, rotation and offset applied to it."""

_Node = dict[str, Any]
"""A shader: its `id`, the values of its `inputs`, and the node and output that each of its `sources` is."""


class UsdMaterials:
    """The materials of one file; each is made once for meshes with the same texture coordinates and with colours."""

    def __init__(self, path: Path, content: dict[str, Any]) -> None:
        """Take the file, for messages and the images beside it, and the description of its stage."""
        self._path = path
        self._materials, self._nodes = content["materials"], content["nodes"]
        self._images = TextureImages(path)
        self._bordered: dict[tuple[int, ...], tuple[NDArray[np.float32], NDArray[np.float32]]] = {}
        self._made: dict[tuple[str, tuple[Coordinates, ...], bool], Material | None] = {}
        self.unsupported: set[str] = set()
        self._without_preview: Counter[str] = Counter()

    def bound_to(self, name: str | None, *, uv_sets: tuple[Coordinates, ...], has_colors: bool) -> Material | None:
        """Return the material of a path, or None, for meshes with some texture coordinates, and with colours or not."""
        if name is None:
            return None
        key = (name, uv_sets, has_colors)
        if key not in self._made:
            made = self._make(name, uv_sets, has_colors)
            self._made[key] = made and made.named(name)
        return self._made[key]

    def uv_sets(self, name: str | None) -> list[Coordinates]:
        """Return the texture coordinates that the material of a path needs.

        The transform of a normal map, which comes first, and any rotation apply to the mesh's coordinates; other
        transforms belong to the texture.
        """
        shader = self._nodes.get(self._materials[name]) if name is not None else None
        if shader is None:
            return []
        nodes = {key: self.node(source) for key, source in shader["sources"].items()}
        images = {key: node for key, node in nodes.items() if node["id"] == "UsdUVTexture" and "st" in node["sources"]}
        placed = {key: self.coordinates(node) for key, node in images.items()}
        found = [placed.pop("normal")] if "normal" in placed else []
        for name_of_primvar, move in placed.values():
            each = name_of_primvar, move if move[1] else _NOT_MOVED
            if each not in found and (name_of_primvar, move) not in found:
                found.append(each)
        if len(found) > _MOST_UV_SETS:
            self.unsupported.add("a third set of texture coordinates in a material")
        return found[:_MOST_UV_SETS]

    def color_primvar(self, name: str | None) -> str:
        """Return the name of the primvar that the material of a path, or what is drawn without one, has as colours."""
        shader = self._nodes.get(self._materials[name]) if name is not None else None
        return self.color_primvar_of(shader) if shader is not None else "displayColor"

    def color_primvar_of(self, shader: _Node) -> str:
        """Return the name of the first primvar that a shader reads as a colour."""
        nodes = (self.node(shader["sources"].get(key)) for key in ("diffuseColor", "emissiveColor", "specularColor"))
        readers = (node for node in nodes if node["id"] == _COLOR_READER)
        return next((str(node["inputs"].get("varname")) for node in readers), "displayColor")

    def coordinates(self, image: _Node) -> Coordinates:
        """Return the texture coordinates of an image: scaled, turned, then moved."""
        place, move = self.node(image["sources"].get("st")), _NOT_MOVED
        if place["id"] == "UsdTransform2d":
            scale, offset = _numbers(place, "scale", (1.0, 1.0)), _numbers(place, "translation", (0.0, 0.0))
            move = tuple(scale.tolist()), _number(place, "rotation", 0.0), tuple(offset.tolist())
            place = self.node(place["sources"].get("in"))
        if place["id"] in ("UsdPrimvarReader_float2", ""):
            return str(place["inputs"].get("varname") or ""), move
        self.unsupported.add(f"a {place['id']} of texture coordinates")
        return "", move

    def unused(self) -> Iterator[str]:
        """Yield the kinds of inputs of shaders that no material used."""
        yield from self.unsupported
        yield from self._without_preview.elements()
        for node in self._nodes.values():
            if "inputs" not in node.asked:  # not reached
                continue
            inputs, sources = node["inputs"], node["sources"]
            for name in (inputs.keys() | sources.keys()) - inputs.asked - (sources.asked & sources.keys()):
                value = inputs.get(name)
                values = tuple(value.tolist()) if isinstance(value, np.ndarray) else (value,)
                if name in sources or values != _NEUTRAL.get(name):
                    yield f"{node['id']}.{name}"

    def dome(self, values: Values, matrix: Matrix) -> Environment:
        """Return the environment of a dome light, whose pole is +y and whose middle is +z of its own axes."""
        from wrt.io.mitsuba.transforms import axis_and_degrees

        radiance = np.array(radiance_of(values))
        name = values.asset("inputs:texture:file")
        if (layout := values.word("inputs:texture:format")) not in ("", "automatic", "latlong"):
            self.unsupported.add(f"the layout {layout!r} of the image of a DomeLight")
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

    def _make(self, name: str, uv_sets: tuple[Coordinates, ...], has_colors: bool) -> Material | None:
        shader = self._nodes.get(self._materials[name])
        if shader is None or shader["id"] != PREVIEW:
            kind = f"shader {shader['id'] or 'of no type'}" if shader else "material without a shader for all renderers"
            self._without_preview[f"a {kind}, where a {PREVIEW} is expected,"] += 1
            return None
        read = _Inputs(self, shader, uv_sets, has_colors)
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
        metallic, specular = read.number("metallic", 0.0), read.color("specularColor", (0.0,) * 3)
        if _number(shader, "useSpecularWorkflow", 0):
            # As its reflectance at normal incidence, with an infinite index.
            values |= {"ior": 0.0, "specular_color": specular}
        else:
            values["metallic"] = metallic
        normal = read.texture("normal", "data")
        if isinstance(normal, ImageTexture):
            values["normal_map"] = NormalMap(normal, name=normal.name, wrap=normal.wrap)
        return Principled(**values)

    def node(self, source: list[str] | None) -> _Node:
        """Return what is connected to an input, or a node of no type."""
        node: _Node = self._nodes[source[0]] if source else TrackedObject(id="", inputs={}, sources={})
        return node

    def pixels(self, name: str, kind: str) -> Any:
        """Return the pixels of an image, or None with a warning."""
        return self._images.pixels(name, kind, f"image {_file_name(name)}", lambda: self._located(name))

    def has_alpha(self, name: str) -> bool:
        """Return whether an image may have an alpha channel; without one it is 1."""
        if Path(name).suffix.lower() in FLOAT_SUFFIXES:
            return True
        return self._images.has_alpha(name, f"image {_file_name(name)}", lambda: self._located(name))

    def bordered(
        self, pixels: NDArray[np.float32], black: list[bool], move: _Move
    ) -> tuple[NDArray[np.float32], _Move]:
        """Return an image with a border that is black along u or v, and a move of coordinates for it."""
        sizes = [pixels.shape[1], pixels.shape[0]]
        copies = [int(is_black and size >= _LEAST_FOR_COPY) for is_black, size in zip(black, sizes, strict=True)]
        key = id(pixels), *black
        if key not in self._bordered:
            (u, v), (s, t) = copies, map(int, black)
            bordered = np.pad(np.pad(pixels, ((v, v), (u, u), (0, 0)), "edge"), ((t, t), (s, s), (0, 0)))
            self._bordered[key] = pixels, sealed(bordered)  # with the image, so that its number stays its own
        bordered = self._bordered[key][1]
        shares = [size / new_size for size, new_size in zip(sizes, (bordered.shape[1], bordered.shape[0]), strict=True)]
        scale = tuple(a * share for a, share in zip(move[0], shares, strict=True))
        offset = tuple(a * share + 0.5 * (1.0 - share) for a, share in zip(move[2], shares, strict=True))
        return bordered, (scale, move[1], offset)

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

    def __init__(self, owner: UsdMaterials, shader: _Node, uv_sets: tuple[Coordinates, ...], has_colors: bool) -> None:
        self._owner, self._shader, self._uv_sets, self._has_colors = owner, shader, uv_sets, has_colors

    def color(self, name: str, default: tuple[float, ...]) -> ColorSource:
        reader = self._owner.node(self._shader["sources"].get(name))
        if reader["id"] == _COLOR_READER and reader["inputs"].get("varname") == self._owner.color_primvar_of(
            self._shader
        ):
            fallback = _numbers(reader, "fallback", (0.0,) * 3)
            return VertexColor() if self._has_colors else vec3(np.maximum(fallback, 0.0))
        texture = self.texture(name, "color")
        if isinstance(texture, ImageTexture):
            return texture
        return vec3(np.maximum(_numbers(self._shader, name, default) if texture is None else texture, 0.0))

    def number(self, name: str, default: float, cutoff: float | None = None) -> ColorSource:
        """Return a number from 0 to 1; with a cutoff 0 or 1."""
        texture = self.texture(name, "data", cutoff=cutoff)
        if isinstance(texture, ImageTexture):
            return texture
        value = float(np.clip(_number(self._shader, name, default) if texture is None else texture[0], 0.0, 1.0))
        return value if cutoff is None else float(value >= cutoff)

    def texture(self, name: str, kind: str, cutoff: float | None = None) -> ImageTexture | NDArray[np.float64] | None:
        """Return the texture that is connected to an input, or (3,) its value if it has one, or None."""
        source = self._shader["sources"].get(name)
        image = self._owner.node(source)
        if source is None:
            return None
        if image["id"] != "UsdUVTexture":
            self._owner.unsupported.add(f"a {image['id'] or 'shader of no type'} as {self._shader['id']}.{name}")
            return None
        file, channel = path_of(image["inputs"].get("file")), source[1]
        wraps = [self._word(image, key, "useMetadata", _WRAPS) for key in ("wrapS", "wrapT")]
        space = self._word(image, "sourceColorSpace", "auto", _SPACES)
        channels = {"rgb": [0, 1, 2], "a": [3, 3, 3]}.get(channel) or [max(0, "rgb".find(channel))] * 3
        scale, bias = _numbers(image, "scale", (1.0,) * 4)[channels], _numbers(image, "bias", (0.0,) * 4)[channels]
        fallback = image["inputs"].get("fallback")
        coordinates = self._owner.coordinates(image) if "st" in image["sources"] else None
        kind = "alpha" if channel == "a" else _SPACES[space] or kind
        if file and channel == "a" and not self._owner.has_alpha(file):
            return np.ones(3) * scale + bias
        pixels = self._owner.pixels(file, kind) if file else None
        if pixels is None:
            values = _numbers(image, "fallback", (0.0, 0.0, 0.0))  # some have three numbers
            values = _numbers(image, "fallback", (*values.tolist(), 1.0))
            return None if fallback is None else values[channels]
        move = _NOT_MOVED
        if coordinates is not None and coordinates not in self._uv_sets:  # those of a normal map are moved already
            coordinates, move = (coordinates[0], _NOT_MOVED), coordinates[1]
        if coordinates is None or coordinates not in self._uv_sets:  # the colour at (0, 0), without coordinates
            return np.asarray(pixels[-1, 0][[each % 3 for each in channels]] * scale + bias)
        if name == "normal":
            # To −1 to 1 in the file, from 0 to 1 here.
            scale, bias = 0.5 * scale, 0.5 * bias + 0.5
        elif any(wrap in _BLACK for wrap in wraps):
            pixels, move = self._owner.bordered(pixels, [wrap in _BLACK for wrap in wraps], move)
        if name == "normal" or bias.any():
            pixels, scale = np.clip(pixels * scale + bias, 0.0, 1.0).astype(np.float32), np.ones(3)
        return ImageTexture(
            pixels,
            _file_name(file),
            channel=channel if channel in CHANNELS else None,
            factor=vec3(scale),
            scale=move[0],
            rotation_degrees=move[1],
            offset=move[2],
            wrap=tuple(_WRAPS[wrap] for wrap in wraps),
            cutoff=cutoff,
            uv_set=self._uv_sets.index(coordinates),
        )

    def _word(self, image: _Node, key: str, default: str, supported: Container[str]) -> str:
        """Return the word of an input if it is supported, or else its default with a warning."""
        word = str(image["inputs"].get(key) or default)
        if word not in supported:
            self._owner.unsupported.add(f"the {key} {word!r} of a UsdUVTexture")
            return default
        return word


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
