"""Materials and images of USD files.

Format: OpenUSD, "UsdPreviewSurface Specification" 2.6: a metallic-roughness or specular material with UsdUVTexture,
UsdTransform2d and UsdPrimvarReader.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from wrt.errors import InputError, warn
from wrt.io.images import FLOAT_SUFFIXES, read_image
from wrt.io.safe_read import first_line, read_file
from wrt.io.texture_images import Source, TextureImages
from wrt.io.usd.lights import Matrix, radiance_of
from wrt.linalg import product
from wrt.scene.environment import ConstantEnvironment, Environment, ImageEnvironment
from wrt.scene.materials import Material, Principled
from wrt.scene.textures import ColorSource, ImageTexture, NormalMap, VertexColor
from wrt.values import vec3

_WRAPS = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp", "black": "clamp"}
_CHANNELS = ("r", "g", "b", "a")


class UsdMaterials:
    """The materials of one file; each is made once for meshes that have the same of coordinates and colours."""

    def __init__(self, path: Path) -> None:
        """Take the file, for messages and the images beside it."""
        self._path = path
        self._images = TextureImages(path)
        self._made: dict[tuple[str, bool, bool], Material | None] = {}

    def bound_to(self, prim: Any, *, laid: bool, colored: bool) -> Material | None:
        """Return the material that is bound to a prim, or None.

        Args:
            prim: the mesh, or a part of one.
            laid: whether it has texture coordinates.
            colored: whether it has colours for display.
        """
        from pxr import UsdShade

        bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if not bound:
            return None
        key = (str(bound.GetPath()), laid, colored)
        if key not in self._made:
            self._made[key] = self._make(bound, laid, colored)
        return self._made[key]

    def dome(self, prim: Any, matrix: Matrix) -> Environment:
        """Return the environment of a dome of light, whose pole is +y and whose middle is +z of its own axes."""
        from pxr import UsdLux

        from wrt.io.mitsuba.transforms import axis_and_degrees

        radiance = np.array(radiance_of(prim))
        asset = UsdLux.DomeLight(prim).GetTextureFileAttr().Get()
        if not asset or not asset.path:
            return ConstantEnvironment(vec3(radiance))
        file = self._path.parent / _name(asset)
        if "[" in _name(asset):
            warn(f"{self._path}: {_name(asset)}: the image of a dome within an archive is left out; unpack it")
            return ConstantEnvironment(vec3(radiance))
        if not file.is_file():
            warn(f"{self._path}: {str(file)!r}, which it refers to: no such file; the dome has one colour")
            return ConstantEnvironment(vec3(radiance))
        pixels = read_image(file) * radiance.astype(np.float32)
        axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
        axis, degrees = axis_and_degrees(product(axes, np.diag([-1.0, 1.0, -1.0])))
        return ImageEnvironment(pixels, 1.0, degrees, file.name, axis)

    def _make(self, bound: Any, laid: bool, colored: bool) -> Material | None:
        shader, _, _ = bound.ComputeSurfaceSource()
        if not shader or str(shader.GetIdAttr().Get()) != "UsdPreviewSurface":
            warn(f"{self._path}: {bound.GetPath()}: only UsdPreviewSurface is supported; left out")
            return None
        read = _Inputs(self, shader, laid, colored)
        values: dict[str, Any] = {
            "base_color": read.color("diffuseColor", (0.18,) * 3),
            "roughness": read.number("roughness", 0.5),
            "opacity": read.number("opacity", 1.0),
            "coat": read.number("clearcoat", 0.0),
            "coat_roughness": read.number("clearcoatRoughness", 0.01),
            "emission": read.color("emissiveColor", (0.0,) * 3),
            "ior": max(1.0, float(read.constant("ior", 1.5))),
        }
        if read.constant("useSpecularWorkflow", 0):
            # As its reflectance straight on, with an infinite index.
            values |= {"ior": 0.0, "specular_color": read.color("specularColor", (0.0,) * 3)}
        else:
            values["metallic"] = read.number("metallic", 0.0)
        cutoff = float(read.constant("opacityThreshold", 0.0))
        if cutoff > 0.0:
            opacity = values["opacity"]
            if isinstance(opacity, ImageTexture):
                values["opacity"] = read.number("opacity", 1.0, cutoff=cutoff)
            else:
                values["opacity"] = 1.0 if opacity >= cutoff else 0.0
        normal = read.texture("normal", "data")
        if normal is not None and laid:
            values["normal_map"] = NormalMap(normal, name=normal.name)
        return Principled(**values)

    def pixels(self, asset: Any, kind: str) -> Any:
        """Return the pixels of an image, or None with a warning."""
        name = _name(asset)
        return self._images.pixels(name, kind, f"image {_short(name)}", lambda: self._located(name))

    def _located(self, name: str) -> Source:
        """Return the file of an image, or its bytes within a USDZ archive."""
        archive, within, inner = name.partition("[")
        if not within:
            return self._path.parent / name
        inner = inner.removesuffix("]")
        if "[" in inner or Path(inner).suffix.lower() in FLOAT_SUFFIXES:
            raise InputError(f"{self._path}: {name}: archives and images of floats within an archive are not supported")
        try:
            with zipfile.ZipFile(io.BytesIO(read_file(self._path.parent / archive))) as opened:
                if opened.getinfo(inner).compress_type != zipfile.ZIP_STORED:
                    raise InputError(f"{self._path}: {name}: it is compressed, which USDZ forbids")
                return opened.read(inner)
        except (KeyError, zipfile.BadZipFile) as error:
            raise InputError(f"{self._path}: {name}: {first_line(error)}") from None


class _Inputs:
    """The inputs of one shader: constants, and textures that are connected."""

    def __init__(self, owner: UsdMaterials, shader: Any, laid: bool, colored: bool) -> None:
        self._owner, self._shader, self._laid, self._colored = owner, shader, laid, colored

    def constant(self, name: str, default: Any) -> Any:
        """Return the value of an input that does not vary."""
        return _constant(self._shader, name, default)

    def color(self, name: str, default: tuple[float, ...]) -> ColorSource:
        """Return a colour."""
        texture = self.texture(name, "color")
        if texture is not None:
            return texture if self._laid else vec3(_first(texture))
        reader = self._source(name)
        if reader is not None and str(reader.GetIdAttr().Get()) == "UsdPrimvarReader_float3":
            if self._colored and str(_constant(reader, "varname", "")) == "displayColor":
                return VertexColor()
            default = _constant(reader, "fallback", default)
        return vec3(np.maximum(np.array(self.constant(name, default), np.float64), 0.0))

    def number(self, name: str, default: float, **options: Any) -> ColorSource:
        """Return a number from 0 to 1."""
        texture = self.texture(name, "data", **options)
        if texture is not None and not self._laid:
            value = float(_first(texture)["rgb".index(texture.channel or "r")])
            return value if texture.cutoff is None else float(value >= texture.cutoff)
        return float(np.clip(self.constant(name, default), 0.0, 1.0)) if texture is None else texture

    def _source(self, name: str) -> Any:
        """Return the shader that is connected to an input, or None."""
        from pxr import UsdShade

        given = self._shader.GetInput(name)
        sources = given.GetConnectedSources()[0] if given else []
        return UsdShade.Shader(sources[0].source.GetPrim()) if sources else None

    def texture(self, name: str, kind: str, **options: Any) -> ImageTexture | None:
        """Return the texture that is connected to an input, or None."""
        from pxr import UsdShade

        given = self._shader.GetInput(name)
        sources = given.GetConnectedSources()[0] if given else []
        if not sources:
            return None
        image = UsdShade.Shader(sources[0].source.GetPrim())
        if str(image.GetIdAttr().Get()) != "UsdUVTexture":
            return None
        asset = _constant(image, "file", None)
        if asset is None:
            return None
        channel = str(sources[0].sourceName)
        space = str(_constant(image, "sourceColorSpace", "auto"))
        if kind == "data" and channel == "a":
            kind, channel = "alpha", "r"
        elif space in ("raw", "sRGB"):
            kind = "data" if space == "raw" else "color"
        pixels = self._owner.pixels(asset, kind)
        if pixels is None:
            return None
        scale, bias = (
            np.array(_constant(image, key, value), np.float64)[:3]
            for key, value in (("scale", (1.0,) * 4), ("bias", (0.0,) * 4))
        )
        if name == "normal":
            # To −1 to 1 in the file, from 0 to 1 here.
            scale, bias = 0.5 * scale, 0.5 * bias + 0.5
        if bias.any():
            pixels, scale = np.clip(pixels * scale + bias, 0.0, 1.0).astype(np.float32), np.ones(3)
        elif name == "normal":
            pixels, scale = np.clip(pixels * scale, 0.0, 1.0).astype(np.float32), np.ones(3)
        wraps = tuple(_WRAPS.get(str(_constant(image, key, "repeat")), "repeat") for key in ("wrapS", "wrapT"))
        if channel in _CHANNELS[:3]:
            options["channel"] = channel
            scale = scale[_CHANNELS.index(channel)] * np.ones(3)
        return ImageTexture(
            pixels, _short(_name(asset)), factor=vec3(scale), wrap=wraps, **_placement(image), **options
        )


def _first(texture: ImageTexture) -> Any:
    """Return (3,) the colour at (0, 0), which a mesh without coordinates has everywhere."""
    return np.clip(np.array(texture.pixels[-1, 0], np.float64) * np.array(texture.factor), 0.0, 1.0)


def _name(asset: Any) -> str:
    """Return the path of an asset; of one within a USDZ archive, that of the archive and in brackets the rest."""
    return str(asset.resolvedPath or asset.path).replace("\\", "/")


def _short(name: str) -> str:
    return Path(name.removesuffix("]")).name


def _constant(shader: Any, name: str, default: Any) -> Any:
    """Return an input's value, that of the material where it is connected to one, or the default."""
    from pxr import UsdShade

    given = shader.GetInput(name)
    if not given:
        return default
    for attribute in UsdShade.Utils.GetValueProducingAttributes(given):
        value = attribute.Get()
        if value is not None and UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Input:
            return value
    return default


def _placement(image: Any) -> dict[str, Any]:
    """Return how an image lies by its UsdTransform2d: scaled, turned, then moved."""
    from pxr import UsdShade

    given = image.GetInput("st")
    sources = given.GetConnectedSources()[0] if given else []
    if not sources:
        return {}
    node = UsdShade.Shader(sources[0].source.GetPrim())
    if not node or str(node.GetIdAttr().Get()) != "UsdTransform2d":
        return {}
    return {
        "scale": tuple(_constant(node, "scale", (1.0, 1.0))),
        "rotation_degrees": float(_constant(node, "rotation", 0.0)),
        "offset": tuple(_constant(node, "translation", (0.0, 0.0))),
    }
