"""Materials and textures as glTF has them, for writing.

Formats: Khronos Group 2021, "glTF 2.0 Specification", section 3.9, and the extensions that `materials.py` reads. Images
are PNG of eight bits; those of the scene that came from such files keep their values.
"""

from __future__ import annotations

import io
import json
import math

import numpy as np
from numpy.typing import NDArray

from wrt.io.gltf.buffers import Tree
from wrt.io.gltf.images import NEAREST, WRAPS
from wrt.io.gltf.materials import BLACK, TEXTURED, WHITE
from wrt.io.gltf.nearest import color_of
from wrt.io.images import codes_of
from wrt.scene.materials import Principled
from wrt.scene.srgb import srgb_from_linear
from wrt.scene.textures import CHANNELS, ColorSource, ImageTexture, NormalMap, VertexColor, shines

Pixels = NDArray[np.float32]

_WRAP_CODES = {name: code for code, name in WRAPS.items()}
_FILTERS = {"nearest": (NEAREST, NEAREST), "bilinear": (9729, 9729), "trilinear": (9729, 9987)}


class Store:
    """The JSON and the binary data of a file, and what glTF cannot hold, in words."""

    def __init__(self) -> None:
        self.tree: Tree = {"asset": {"version": "2.0", "generator": "wrt"}, "scene": 0}
        self.data = bytearray()
        self.notes: dict[str, None] = {}
        self._numbers: dict[str, int] = {}

    def note(self, words: str) -> None:
        """Remember what glTF cannot hold."""
        self.notes[words] = None

    def view(self, data: bytes) -> int:
        """Append bytes, and return the number of their buffer view."""
        self.data += b"\0" * (-len(self.data) % 4)
        start = len(self.data)
        self.data += data
        return self.append("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data)})

    def append(self, kind: str, entry: Tree) -> int:
        """Append an entry to a list of the JSON, and return its number."""
        entries = self.tree.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def once(self, kind: str, entry: Tree) -> int:
        """Return the number of an entry of a list of the JSON, which is appended if new."""
        key = f"{kind}:{json.dumps(entry, sort_keys=True)}"
        if key not in self._numbers:
            self._numbers[key] = self.append(kind, entry)
        return self._numbers[key]


class WrittenMaterials:
    """Turns materials into glTF's."""

    def __init__(self, store: Store) -> None:
        self._store, self._note = store, store.note
        self._images: dict[bytes, int] = {}

    def described(self, material: Principled, emission: ColorSource, *, two_sided: bool) -> Tree:
        """Return the JSON of a material with the emission of a shape."""
        result: Tree = {"pbrMetallicRoughness": {}}
        self._base(result, material)
        self._metallic_roughness(result["pbrMetallicRoughness"], material)
        self._emission(result, emission)
        if material.normal_map is not None and material.normal_map.heights:
            self._note("bump maps of heights")
        elif material.normal_map is not None:
            result["normalTexture"] = self._normals(material.normal_map)
        if two_sided:
            result["doubleSided"] = True
        extensions = {f"KHR_materials_{name}": found for name, found in self._extensions(material).items()}
        if extensions := {**result.get("extensions", {}), **extensions}:
            result["extensions"] = extensions
        return result

    # --- Parts --------------------------------------------------------------------------------------

    def _base(self, result: Tree, material: Principled) -> None:
        """Add base colour and opacity, which share a texture."""
        base, opacity, pbr = material.base_color, material.opacity, result["pbrMetallicRoughness"]
        factor = np.clip(color_of(base), 0.0, 1.0)
        image = base if isinstance(base, ImageTexture) else None
        pixels = None if image is None else _colors(image)
        if pixels is not None and pixels.max() > 1.0:
            self._note("reflectances above 1")
        alpha, coverage, mode = 1.0, None, "BLEND"
        if isinstance(opacity, ImageTexture):
            coverage = _plane(opacity) * color_of(opacity)[0]
            if image is not None and not _mapped_alike(image, opacity):
                self._note("opacities that lie otherwise than the colour")
                coverage, mode = None, ""
            elif pixels is None:
                image, pixels = opacity, np.ones((*coverage.shape, 3), np.float32)
        elif isinstance(opacity, VertexColor):
            alpha = color_of(opacity)[0]
        else:
            alpha = float(opacity)  # type: ignore[arg-type]
            mode = "BLEND" if alpha != 1.0 else ""
        if mode:
            cutoff = getattr(opacity, "cutoff", None)
            result |= {"alphaMode": mode} if cutoff is None else {"alphaMode": "MASK", "alphaCutoff": float(cutoff)}
        if image is not None and pixels is not None:
            pbr["baseColorTexture"] = self._texture(image, pixels, linear=False, alpha=coverage)
        pbr["baseColorFactor"] = [*factor.tolist(), alpha]

    def _metallic_roughness(self, pbr: Tree, material: Principled) -> None:
        """Add metallic and roughness, which share a texture."""
        numbers = {"b": material.metallic, "g": material.roughness}
        images = {channel: value for channel, value in numbers.items() if isinstance(value, ImageTexture)}
        factors = {channel: self._factor(value) for channel, value in numbers.items()}
        if len(images) == 2 and not _mapped_alike(*images.values()):
            self._note("metallic and roughness that lie differently: the mean of the first is written")
            factors["b"] *= float(_plane(images.pop("b")).mean())
        if images:
            planes = {channel: _plane(image) for channel, image in images.items()}
            pbr["metallicRoughnessTexture"] = self._texture(next(iter(images.values())), _packed(planes), linear=True)
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

    def _normals(self, normal_map: NormalMap) -> Tree:
        if normal_map.convention != "gltf":
            self._note("normal maps by other conventions")
        if normal_map.uv_rotation_degrees != 0.0 or np.min(normal_map.uv_scale) < 0.0:
            self._note("normal maps that are turned without their normals")
        mapping = ImageTexture(
            np.zeros((1, 1, 3), np.float32),
            scale=normal_map.uv_scale,
            rotation_degrees=normal_map.uv_rotation_degrees,
            offset=normal_map.uv_offset,
            wrap=normal_map.wrap,
            uv_set=normal_map.uv_set,
        )
        info = self._texture(mapping, np.asarray(normal_map.pixels, np.float32), linear=True)
        return {**info, "scale": float(normal_map.scale)}

    def _extensions(self, material: Principled) -> Tree:
        """Return the extensions KHR_materials_... by the end of their names."""
        extensions: Tree = {}
        if material.ior != 1.5:
            extensions["ior"] = {"ior": float(material.ior)}
        is_used = {
            "specular": material.specular != 1.0 or material.specular_color != WHITE,
            "transmission": material.transmission != 0.0,
            "iridescence": material.has_film,
            "clearcoat": material.coat != 0.0,
            "sheen": material.sheen_color != BLACK,
        }
        found: Tree
        for name in filter(is_used.__getitem__, TEXTURED):
            extensions[name] = found = {}
            for attribute, key, channels, _ in TEXTURED[name]:
                self._add_value(found, key, getattr(material, attribute), channels)
        if material.has_film:
            extensions["iridescence"] |= {"iridescenceIor": float(material.film_ior)}
            self._add_film_thickness(extensions["iridescence"], material.film_thickness)
        if "clearcoat" in extensions:
            normals = material.coat_normal_map or material.normal_map
            if normals is not None and normals.heights:
                self._note("bump maps of heights")
            elif normals is not None and (np.asarray(normals.pixels)[..., :2] != 0.5).any():
                extensions["clearcoat"]["clearcoatNormalTexture"] = self._normals(normals)
        if "transmission" in extensions:
            if not material.thin_walled:
                extensions["volume"] = self._volume(material)
                if material.dispersion:
                    extensions["dispersion"] = {"dispersion": float(material.dispersion)}
            if material.priority:
                self._note("priorities of bodies")
        if material.anisotropy != 0.0:
            found = extensions["anisotropy"] = {"anisotropyRotation": float(material.anisotropy_rotation)}
            if isinstance(material.anisotropy, ImageTexture):
                found["anisotropyStrength"] = color_of(material.anisotropy)[2]
                found["anisotropyTexture"] = self._texture(material.anisotropy, material.anisotropy.pixels, linear=True)
            else:
                found["anisotropyStrength"] = float(material.anisotropy)  # type: ignore[arg-type]
        return extensions

    def _volume(self, material: Principled) -> Tree:
        """Return what fills a body; a path tracer takes its thickness from the mesh."""
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

    def _add_film_thickness(self, film: Tree, thickness: ColorSource) -> None:
        """Add the thickness of a film; an image is the range of its values in green."""
        most = color_of(thickness)[0]
        if isinstance(thickness, VertexColor):
            self._note("numbers by vertex colours")
        if isinstance(thickness, ImageTexture):
            plane = _plane(thickness)
            low, high = float(plane.min()), float(plane.max())
            film["iridescenceThicknessMinimum"], most = low * most, high * most
            if high > low:
                packed = _packed({"g": (plane - low) / (high - low)})
                film["iridescenceThicknessTexture"] = self._texture(thickness, packed, linear=True)
        film["iridescenceThicknessMaximum"] = most

    # --- Values -------------------------------------------------------------------------------------

    def _factor(self, value: ColorSource) -> float:
        """Return a number from 0 to 1, or the factor of one that varies."""
        if isinstance(value, VertexColor):
            self._note("numbers by vertex colours")
        return min(color_of(value)[0], 1.0)

    def _add_value(self, found: Tree, key: str, value: ColorSource, channels: str) -> None:
        """Add a factor and, if the value is an image, a texture in some channels, "a" for alpha."""
        is_color = channels == "rgb"
        found[f"{key}Factor"] = list(color_of(value)) if is_color else self._factor(value)
        if is_color and isinstance(value, VertexColor):
            self._note("vertex colours other than of the base")
        if isinstance(value, ImageTexture):
            plane = None if is_color else _plane(value)
            pixels = _colors(value) if plane is None else _packed({channels: plane})
            alpha = plane if channels == "a" else None
            found[f"{key}Texture"] = self._texture(value, pixels, linear=channels in CHANNELS, alpha=alpha)

    def _texture(self, mapping: ImageTexture, pixels: Pixels, *, linear: bool, alpha: Pixels | None = None) -> Tree:
        """Return the reference to a texture of (H, W, 3) pixels, mapped like another one; `alpha` is (H, W)."""
        png = _png(self._codes(pixels, linear), alpha)
        if png not in self._images:
            view = self._store.view(png)
            self._images[png] = self._store.append("images", {"bufferView": view, "mimeType": "image/png"})
        near, far = _FILTERS[mapping.filter]
        wrap_u, wrap_v = (_WRAP_CODES[name] for name in mapping.wrap)
        sampler = self._store.once("samplers", {"magFilter": near, "minFilter": far, "wrapS": wrap_u, "wrapT": wrap_v})
        info: Tree = {"index": self._store.once("textures", {"source": self._images[png], "sampler": sampler})}
        if mapping.uv_set:
            info["texCoord"] = mapping.uv_set
        if not np.allclose(mapping.placement, np.eye(2, 3), atol=1e-12):
            info["extensions"] = {"KHR_texture_transform": _transform(mapping)}
        return info

    def _codes(self, pixels: Pixels, linear: bool) -> NDArray[np.uint8]:
        """Return the codes of an image, rounded where it has more than eight bits."""
        codes = codes_of(pixels, linear=linear)
        if codes is None:
            self._note("more than 8 bits of a texture")
            values = np.clip(pixels, 0.0, 1.0)
            encoded = values if linear else srgb_from_linear(values)
            codes = np.rint(np.asarray(encoded, np.float64) * 255.0).astype(np.uint8)
        return codes


def _transform(mapping: ImageTexture) -> Tree:
    """Return a texture's transform where v points down; `images.placement_of` is the inverse."""
    turn = math.radians(mapping.rotation_degrees)
    (su, sv), (ou, ov) = np.array([mapping.scale, mapping.offset], np.float64).tolist()
    offset = [ou - math.sin(turn) * sv, 1.0 - ov - math.cos(turn) * sv]
    return {"scale": [su, sv], "rotation": turn, "offset": offset}


def _mapped_alike(a: ImageTexture, b: ImageTexture) -> bool:
    """Return whether two images of one size are mapped alike to a mesh."""
    names = ("scale", "rotation_degrees", "offset", "wrap", "filter", "uv_set")
    return a.pixels.shape == b.pixels.shape and all(getattr(a, name) == getattr(b, name) for name in names)


def _colors(image: ImageTexture) -> Pixels:
    """Return the (H, W, 3) pixels that an image shows, without its factor."""
    return image.pixels if image.channel is None else np.repeat(_plane(image)[..., None], 3, axis=2)


def _plane(image: ImageTexture) -> Pixels:
    """Return the (H, W) channel of an image of numbers."""
    return image.pixels[..., CHANNELS.index(image.channel or "r")]


def _packed(planes: dict[str, Pixels]) -> Pixels:
    """Return (H, W, 3) pixels with planes in some channels, and 1 in the others; "a" is none of them."""
    packed = np.ones((*next(iter(planes.values())).shape, 3), np.float32)
    for channel in set(planes) & set(CHANNELS):
        packed[..., CHANNELS.index(channel)] = planes[channel]
    return packed


def _png(codes: NDArray[np.uint8], alpha: Pixels | None) -> bytes:
    from PIL import Image

    if alpha is not None:
        plane = np.rint(np.clip(alpha, 0.0, 1.0) * 255.0).astype(np.uint8)
        codes = np.concatenate([codes, plane[..., None]], axis=2)
    elif (codes == codes[..., :1]).all():
        codes = codes[..., 0]
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(codes)).save(buffer, format="PNG")
    return buffer.getvalue()
