"""Materials and textures as glTF has them, for writing.

Formats: Khronos Group 2021, "glTF 2.0 Specification", section 3.9, and the extensions that `materials.py` reads. Images
are PNG of eight bits; those of the scene that came from such files keep their values.
"""

from __future__ import annotations

import dataclasses
import io
import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wrt.io.gltf.nearest import Note, color_of
from wrt.io.images import codes_of
from wrt.scene.materials import Principled
from wrt.scene.srgb import srgb_from_linear
from wrt.scene.textures import CHANNELS, ColorSource, ImageTexture, NormalMap, VertexColor, shines
from wrt.values import vec3

Tree = dict[str, Any]
Pixels = NDArray[np.float32]

_WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}
_FILTERS = {"nearest": (9728, 9728), "bilinear": (9729, 9729), "trilinear": (9729, 9987)}


class Store(Protocol):
    """Where images, samplers and textures go."""

    tree: Tree

    def view(self, data: bytes) -> int:
        """Append bytes, and return the number of their buffer view."""
        ...

    def once(self, kind: str, entry: Tree) -> int:
        """Return the number of an entry of a list of the tree, which is appended if new."""
        ...


class WrittenMaterials:
    """Turns materials into glTF's."""

    def __init__(self, store: Store, note: Note) -> None:
        self._store, self._note = store, note
        self._images: dict[bytes, int] = {}

    def described(self, material: Principled, emission: ColorSource, *, two_sided: bool) -> Tree:
        """Return the JSON of a material with the emission of a shape."""
        pbr: Tree = {}
        result: Tree = {"pbrMetallicRoughness": pbr}
        self._base(result, pbr, material)
        self._metallic_roughness(pbr, material)
        self._emission(result, emission)
        if material.normal_map is not None and material.normal_map.heights:
            self._note("bump maps of heights")
        elif material.normal_map is not None:
            if material.normal_map.convention != "gltf":
                self._note("normal maps by other conventions")
            result["normalTexture"] = self._normals(material.normal_map)
        if two_sided:
            result["doubleSided"] = True
        extensions = result.setdefault("extensions", {})
        self._reflection(extensions, material)
        self._layers(extensions, material)
        if not extensions:
            del result["extensions"]
        return result

    # --- Parts --------------------------------------------------------------------------------------

    def _base(self, result: Tree, pbr: Tree, material: Principled) -> None:
        """Add base colour and opacity, which share a texture."""
        base, opacity = material.base_color, material.opacity
        factor = np.clip(color_of(base), 0.0, 1.0)
        alpha, image = 1.0, base if isinstance(base, ImageTexture) else None
        pixels = None if image is None else _colors(image)
        if pixels is not None and pixels.max() > 1.0:
            self._note("reflectances above 1")
        if isinstance(opacity, ImageTexture):
            covers = opacity.pixels[..., CHANNELS.index(opacity.channel or "r")] * color_of(opacity)[0]
            if image is not None and (not _alike(image, opacity) or image.pixels.shape != opacity.pixels.shape):
                self._note("opacities that lie otherwise than the colour")
            else:
                pixels = np.ones((*covers.shape, 3), np.float32) if pixels is None else pixels
                info = self._texture(image or opacity, pixels, linear=False, alpha=covers)
                pbr["baseColorTexture"] = info
                image = None
                result["alphaMode"] = "BLEND" if opacity.cutoff is None else "MASK"
                if opacity.cutoff is not None:
                    result["alphaCutoff"] = float(opacity.cutoff)
        elif isinstance(opacity, VertexColor):
            result["alphaMode"] = "BLEND" if opacity.cutoff is None else "MASK"
            if opacity.cutoff is not None:
                result["alphaCutoff"] = float(opacity.cutoff)
            alpha = color_of(opacity)[0]
        elif opacity != 1.0:
            result["alphaMode"], alpha = "BLEND", float(opacity)  # type: ignore[arg-type]
        if image is not None and pixels is not None:
            pbr["baseColorTexture"] = self._texture(image, pixels, linear=False)
        pbr["baseColorFactor"] = [*factor.tolist(), alpha]

    def _metallic_roughness(self, pbr: Tree, material: Principled) -> None:
        """Add metallic and roughness, which share a texture."""
        numbers = {"b": material.metallic, "g": material.roughness}
        images = {channel: value for channel, value in numbers.items() if isinstance(value, ImageTexture)}
        factors = dict(zip(numbers, (self._factor(value) for value in numbers.values()), strict=True))
        if len(images) == 2:
            metallic, rough = images["b"], images["g"]
            if not _alike(metallic, rough) or metallic.pixels.shape != rough.pixels.shape:
                self._note("metallic and roughness that lie differently: the mean of the first is written")
                factors["b"] *= float(images.pop("b").pixels[..., CHANNELS.index(metallic.channel or "r")].mean())
        if images:
            first = next(iter(images.values()))
            packed = np.ones((*first.pixels.shape[:2], 3), np.float32)
            for channel, image in images.items():
                packed[..., CHANNELS.index(channel)] = image.pixels[..., CHANNELS.index(image.channel or "r")]
            pbr["metallicRoughnessTexture"] = self._texture(first, packed, linear=True)
        pbr["metallicFactor"], pbr["roughnessFactor"] = factors["b"], factors["g"]

    def _emission(self, result: Tree, emission: ColorSource) -> None:
        if not shines(emission):
            return
        factor = np.array(color_of(emission))
        if isinstance(emission, ImageTexture):
            pixels = _colors(emission)
            most = float(pixels.max())
            result["emissiveTexture"] = self._texture(emission, pixels / np.float32(most), linear=False)
            factor = factor * most
        elif isinstance(emission, VertexColor):
            self._note("emission by vertex colours: white stands for them")
        strength = float(factor.max())
        if strength > 1.0:
            result["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
            factor = factor / strength
        result["emissiveFactor"] = factor.tolist()

    def _reflection(self, extensions: Tree, material: Principled) -> None:
        """Add index, strength and tint of the reflection, what is transmitted, and anisotropy."""
        if material.ior != 1.5:
            extensions["KHR_materials_ior"] = {"ior": float(material.ior)}
        if material.specular != 1.0 or material.specular_color != (1.0, 1.0, 1.0):
            found: Tree = {}
            self._number(found, "specularFactor", "specularTexture", material.specular, "a")
            self._color(found, "specularColorFactor", "specularColorTexture", material.specular_color)
            extensions["KHR_materials_specular"] = found
        if material.transmission != 0.0:
            found = {}
            self._number(found, "transmissionFactor", "transmissionTexture", material.transmission, "r")
            extensions["KHR_materials_transmission"] = found
            if not material.thin_walled:
                extensions["KHR_materials_volume"] = self._volume(material)
                if material.dispersion:
                    extensions["KHR_materials_dispersion"] = {"dispersion": float(material.dispersion)}
            if material.priority:
                self._note("priorities of bodies")
        if material.anisotropy != 0.0:
            found = {"anisotropyRotation": float(material.anisotropy_rotation)}
            if isinstance(material.anisotropy, ImageTexture):
                found["anisotropyStrength"] = color_of(material.anisotropy)[2]
                found["anisotropyTexture"] = self._texture(material.anisotropy, material.anisotropy.pixels, linear=True)
            else:
                found["anisotropyStrength"] = float(material.anisotropy)  # type: ignore[arg-type]
            extensions["KHR_materials_anisotropy"] = found

    def _volume(self, material: Principled) -> Tree:
        """Return what fills a body; its thickness is that of the mesh in a path tracer."""
        volume: Tree = {"thicknessFactor": 1.0}
        medium = material.interior
        if medium is not None:
            if medium.density is not None or medium.scatters or any(medium.emission):  # type: ignore[arg-type]
                self._note("media within bodies that scatter, shine or vary")
            absorption = np.array(medium.absorption, np.float64)
            if absorption.any():
                distance = 1.0 / float(absorption.max())
                volume["attenuationDistance"] = distance
                volume["attenuationColor"] = np.exp(-absorption * distance).tolist()
        return volume

    def _layers(self, extensions: Tree, material: Principled) -> None:
        """Add film, coat and sheen."""
        if material.has_film:
            found: Tree = {"iridescenceIor": float(material.film_ior)}
            self._number(found, "iridescenceFactor", "iridescenceTexture", material.film, "r")
            self._film_thickness(found, material.film_thickness)
            extensions["KHR_materials_iridescence"] = found
        if material.coat != 0.0:
            found = {}
            self._number(found, "clearcoatFactor", "clearcoatTexture", material.coat, "r")
            self._number(found, "clearcoatRoughnessFactor", "clearcoatRoughnessTexture", material.coat_roughness, "g")
            extensions["KHR_materials_clearcoat"] = found
        if material.sheen_color != (0.0, 0.0, 0.0):
            found = {}
            self._color(found, "sheenColorFactor", "sheenColorTexture", material.sheen_color)
            self._number(found, "sheenRoughnessFactor", "sheenRoughnessTexture", material.sheen_roughness, "a")
            extensions["KHR_materials_sheen"] = found

    def _film_thickness(self, into: Tree, thickness: ColorSource) -> None:
        """Add the thickness of a film, in an image the range of its values in green."""
        most = color_of(thickness)[0]
        if isinstance(thickness, VertexColor):
            self._note("numbers by vertex colours")
        if isinstance(thickness, ImageTexture):
            plane = thickness.pixels[..., CHANNELS.index(thickness.channel or "r")]
            low, high = float(plane.min()), float(plane.max())
            into["iridescenceThicknessMinimum"], most = low * most, high * most
            if high > low:
                packed = np.ones((*plane.shape, 3), np.float32)
                packed[..., 1] = (plane - low) / (high - low)
                into["iridescenceThicknessTexture"] = self._texture(thickness, packed, linear=True)
        into["iridescenceThicknessMaximum"] = most

    # --- Values -------------------------------------------------------------------------------------

    def _factor(self, value: ColorSource) -> float:
        """Return a number from 0 to 1, or the factor of one that varies."""
        if isinstance(value, VertexColor):
            self._note("numbers by vertex colours")
        return min(color_of(value)[0], 1.0)

    def _number(self, into: Tree, factor: str, texture: str, value: ColorSource, channel: str) -> None:
        into[factor] = self._factor(value)
        if isinstance(value, ImageTexture):
            plane = value.pixels[..., CHANNELS.index(value.channel or "r")]
            packed = np.ones((*plane.shape, 3), np.float32)
            if channel == "a":
                into[texture] = self._texture(value, packed, linear=False, alpha=plane)
            else:
                packed[..., CHANNELS.index(channel)] = plane
                into[texture] = self._texture(value, packed, linear=True)

    def _color(self, into: Tree, factor: str, texture: str, value: ColorSource) -> None:
        into[factor] = list(color_of(value))
        if isinstance(value, ImageTexture):
            into[texture] = self._texture(value, _colors(value), linear=False)
        elif isinstance(value, VertexColor):
            self._note("vertex colours other than of the base")

    def _normals(self, normal_map: NormalMap) -> Tree:
        laid = ImageTexture(np.zeros((1, 1, 3), np.float32), wrap=normal_map.wrap)
        info = self._texture(laid, np.asarray(normal_map.pixels, np.float32), linear=True)
        return {**info, "scale": float(normal_map.scale)}

    def _texture(
        self, laid: ImageTexture, pixels: Pixels, *, linear: bool, alpha: NDArray[np.float32] | None = None
    ) -> Tree:
        """Return the reference to a texture of (H, W, 3) pixels that lies like another; `alpha` is (H, W)."""
        png = _png(_eight_bits(pixels, linear, self._note), alpha)
        if png not in self._images:
            images = self._store.tree.setdefault("images", [])
            images.append({"bufferView": self._store.view(png), "mimeType": "image/png"})
            self._images[png] = len(images) - 1
        wrap_u, wrap_v = laid.wrap
        near, far = _FILTERS[laid.filter]
        sampler = {"magFilter": near, "minFilter": far, "wrapS": _WRAPS[wrap_u], "wrapT": _WRAPS[wrap_v]}
        number = self._store.once("samplers", sampler)
        info: Tree = {"index": self._store.once("textures", {"source": self._images[png], "sampler": number})}
        if laid.uv_set:
            info["texCoord"] = laid.uv_set
        if not np.allclose(laid.placement, np.eye(2, 3), atol=1e-12):
            info["extensions"] = {"KHR_texture_transform": _transform(laid)}
        return info


def _transform(laid: ImageTexture) -> Tree:
    """Return a texture's transform where v points down; `images.placement_of` is the inverse."""
    turn = math.radians(laid.rotation_degrees)
    (su, sv), (ou, ov) = vec_pair(laid.scale), vec_pair(laid.offset)
    offset = [ou - math.sin(turn) * sv, 1.0 - ov - math.cos(turn) * sv]
    return {"scale": [su, sv], "rotation": turn, "offset": offset}


def vec_pair(values: Any) -> tuple[float, float]:
    """Return two numbers."""
    a, b = values
    return float(a), float(b)


def _alike(a: ImageTexture, b: ImageTexture) -> bool:
    """Return whether two images lie alike on a mesh."""
    names = ("scale", "rotation_degrees", "offset", "wrap", "filter", "uv_set")
    return all(getattr(a, name) == getattr(b, name) for name in names)


def _colors(image: ImageTexture) -> Pixels:
    """Return the (H, W, 3) pixels that an image shows, without its factor."""
    if image.channel is None:
        return image.pixels
    return np.repeat(image.pixels[..., [CHANNELS.index(image.channel)]], 3, axis=2)


def _eight_bits(pixels: Pixels, linear: bool, note: Note) -> NDArray[np.uint8]:
    """Return the codes of an image, rounded where it has more than eight bits."""
    codes = codes_of(pixels, linear=linear)
    if codes is None:
        note("more than 8 bits of a texture")
        values = np.clip(pixels, 0.0, 1.0)
        encoded = values if linear else srgb_from_linear(values)
        codes = np.rint(np.asarray(encoded, np.float64) * 255.0).astype(np.uint8)
    return codes


def _png(codes: NDArray[np.uint8], alpha: NDArray[np.float32] | None) -> bytes:
    from PIL import Image

    if alpha is not None:
        plane = np.rint(np.clip(alpha, 0.0, 1.0) * 255.0).astype(np.uint8)
        codes = np.concatenate([codes, plane[..., None]], axis=2)
    elif (codes == codes[..., :1]).all():
        codes = codes[..., 0]
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(codes)).save(buffer, format="PNG")
    return buffer.getvalue()


def is_colored(material: Principled) -> bool:
    """Return whether a material's base colour is multiplied by vertex colours."""
    base = material.base_color
    return isinstance(base, VertexColor) or (isinstance(base, ImageTexture) and base.vertex_colors)


def has_vertex_alpha(material: Principled) -> bool:
    """Return whether a material's opacity is multiplied by the alpha of vertex colours."""
    opacity = material.opacity
    return (isinstance(opacity, VertexColor) and opacity.alpha) or (
        isinstance(opacity, ImageTexture) and opacity.vertex_alpha
    )


def without_emission(material: Principled) -> Principled:
    """Return a material that does not shine; what a shape emits is written for each shape."""
    return dataclasses.replace(material, emission=vec3((0.0, 0.0, 0.0)))
