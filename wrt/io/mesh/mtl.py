"""Materials of Wavefront MTL files as wrt's.

Format: Wavefront, "Advanced Visualizer Manual", appendix B2, and the statements for physically based materials that
Exocortex proposed in 2015 (Pr, Pm, Pc, Pcr, Ps, aniso, norm). What the format leaves open is taken as Blender's
importer takes it, since most files are written for such programs: Ks 0.5 is the reflection of a usual dielectric (4 %
straight on), and Ns from 0 to 1000 is a roughness from 1 to 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.io.texture_images import Source, TextureImages
from wrt.scene.materials import Diffuse, Material, Principled
from wrt.scene.textures import CHANNELS, ColorSource, ImageTexture, NormalMap, VertexColor
from wrt.values import Vec3

Statements: TypeAlias = Mapping[str, Any]
"""The statements of one material: their names in small letters, with their words or numbers."""

_ARGUMENTS = {"-mm": 2, "-o": 3, "-s": 3, "-t": 3}
"""Words that may follow an option of a map; one for all others."""

_MIRRORS, _GLASSES = (3, 5, 8), (4, 6, 7, 9)
"""Illumination models that reflect all around, and those of transparent bodies."""

_BUMP_TEXELS = 2.0
"""Texels that a bump map is high from black to white at -bm 1: the format leaves it open."""

_HIGHEST = 1e6
"""Of a bump map in floating point: slopes of higher ones would overflow."""

_BLACK, _WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


def statements_of(text: str) -> dict[str, Statements]:
    """Return the statements of each material of an MTL file; those without a word are left out."""
    materials: dict[str, dict[str, list[str]]] = {}
    statements: dict[str, list[str]] = {}  # those before the first material belong to none
    for line in text.splitlines():
        match line.split():
            case [key, *words] if words and key.lower() == "newmtl":
                statements = materials[" ".join(words)] = {}
            case [key, *words] if words:
                statements[key.lower()] = words
    return {**materials}


class MtlMaterials:
    """The materials of one OBJ file, each made once for each kind of mesh."""

    def __init__(self, path: Path, find: Callable[[str], Source]) -> None:
        """Take the path of the OBJ file, and a function that finds images by name."""
        self._images, self._find = TextureImages(path), find
        self._made: dict[tuple[str, bool, bool], Material] = {}

    def material(self, name: str, statements: Statements, *, has_uvs: bool, has_colors: bool) -> Material:
        """Return the material of a name, for meshes with or without texture coordinates and colours."""
        key = name, has_uvs, has_colors
        if key not in self._made:
            self._made[key] = _Reader(self._images, self._find, statements, has_uvs).material(has_colors)
        return self._made[key]


class _Reader:
    """Reads one material; a malformed number counts as if it were missing."""

    def __init__(
        self, images: TextureImages, find: Callable[[str], Source], statements: Statements, has_uvs: bool
    ) -> None:
        self._images, self._find, self._has_uvs = images, find, has_uvs
        self._words: dict[str, list[str]] = {}
        for key, value in statements.items():
            if isinstance(value, (int, float, list, tuple)):
                self._words[key] = [str(word) for word in (value if isinstance(value, (list, tuple)) else [value])]

    def material(self, has_colors: bool) -> Material:
        base, opacity, transmission = self._base(has_colors), self._opacity(), 0.0
        illumination = self._number("illum", -1.0)
        if illumination in _GLASSES and isinstance(opacity, float) and opacity < 1.0 and self._number("ni", 1.0) > 1.0:
            transmission, opacity = 1.0 - opacity, 1.0
            base = self._color("tf", maximum=1.0) or base
        emission = self._color("ke") or _BLACK
        if "map_ke" in self._words:
            emission = self._map("map_ke", emission if any(emission) else _WHITE, most=math.inf)
        common: dict[str, Any] = {"opacity": opacity, "normal_map": self._normal_map()}
        is_physical = not self._words.keys().isdisjoint(("pr", "pm", "pc", "ps", "map_pr", "map_pm"))
        specular = self._color("ks") or _BLACK
        is_shiny = (any(specular) or "map_ks" in self._words) and not 0.0 <= illumination < 2.0
        if not (is_physical or is_shiny or transmission or emission != _BLACK):
            return Diffuse(base, **common)
        shine = min(max(self._number("ns", 0.0), 0.0), 1000.0)
        values: dict[str, Any] = {"roughness": 1.0 - math.sqrt(shine / 1000.0)}
        if illumination in _MIRRORS:
            values["specular_color"] = tuple(x / 0.04 for x in specular)
        elif is_shiny or not is_physical:
            r, g, b = specular
            values["specular_color"] = self._map("map_ks", (2.0 * r, 2.0 * g, 2.0 * b))
        if is_physical:
            for name, key, default in (
                ("roughness", "pr", 0.5),
                ("metallic", "pm", 0.0),
                ("coat", "pc", 0.0),
                ("coat_roughness", "pcr", 0.0),
            ):
                values[name] = self._map(f"map_{key}", self._share(key, default))
            values["sheen_color"] = (self._share("ps", 0.0),) * 3
            values["anisotropy"] = self._share("aniso", 0.0)
        ior = self._number("ni", 1.5)
        values["ior"] = ior if 1.0 < ior < 10.0 else 1.5
        return Principled(base, transmission=transmission, emission=emission, **values, **common)

    def _base(self, has_colors: bool) -> ColorSource:
        """Return the first that the file has: an image, the mesh's colours, a constant; otherwise a default."""
        color = self._color("kd", maximum=1.0)
        if "map_kd" in self._words:
            # Many exporters write Kd 0 0 0 beside an image; black would hide it.
            color = color if color is not None and any(color) else None
            texture = self._texture("map_kd", "color", factor=color or _WHITE)
            if texture is not None and self._has_uvs:
                return texture
            if texture is not None:
                # Without coordinates the image's average is the best constant.
                mean = texture.pixels.mean(axis=(0, 1), dtype=np.float64) * texture.factor
                return tuple(np.clip(mean, 0.0, 1.0).tolist())
        if has_colors:
            return VertexColor()
        return DEFAULT_REFLECTANCE if color is None else color

    def _opacity(self) -> ColorSource:
        """Return the opacity. Files disagree on Tr: most of those with Tr 1 mean opaque."""
        opacity = self._number("d", math.nan)
        if math.isnan(opacity):
            transparency = self._number("tr", 0.0)
            opacity = 1.0 if transparency >= 1.0 else 1.0 - transparency
        opacity = min(max(opacity, 0.0), 1.0)
        if "map_d" not in self._words or not self._has_uvs:
            return opacity
        options, _ = _options(self._words["map_d"])
        channel = options.get("-imfchan", ["m"])[0]  # m is the matte, which is alpha
        kind, channel = "alpha" if channel == "m" else "data", channel if channel in CHANNELS else "r"
        # Files with a mask may have d 0.
        return self._texture("map_d", kind, channel=channel, factor=opacity or 1.0) or opacity

    def _normal_map(self) -> NormalMap | None:
        for key in ("norm", "map_norm", "map_kn", "map_bump", "bump") if self._has_uvs else ():
            if key not in self._words or (texture := self._texture(key, "data")) is None:
                continue
            pixels = texture.pixels
            if key.endswith("bump") and not _holds_normals(pixels):
                options, file = _options(self._words[key])
                heights = self._pixels(file, "data", least=-_HIGHEST, most=_HIGHEST)
                assert heights is not None  # as before
                scale = options.get("-bm", ["1"])[0]
                pixels = _normals_of_heights(heights[:, :, 0], float(scale) if _is_number(scale) else 1.0)
            return NormalMap(pixels, name=texture.name, wrap=texture.wrap)
        return None

    # --- Statements ---------------------------------------------------------------------------------

    def _number(self, key: str, default: float) -> float:
        try:
            value = float(self._words[key][-1])  # "d -halo 0.5" has a word before it
        except (KeyError, IndexError, ValueError):
            return default
        return value if math.isfinite(value) else default

    def _share(self, key: str, default: float) -> float:
        """Return a number from 0 to 1."""
        return min(max(self._number(key, default), 0.0), 1.0)

    def _color(self, key: str, maximum: float = 1e30) -> Vec3 | None:
        try:
            values = [float(word) for word in self._words[key][:3]]
        except (KeyError, ValueError):
            return None
        if len(values) not in (1, 3) or not np.isfinite(values).all():
            return None
        r, g, b = (float(x) for x in np.clip(np.broadcast_to(values, 3), 0.0, maximum))
        return r, g, b

    def _map(self, key: str, value: Any, most: float = 1.0) -> Any:
        """Return the image of a map: of colours times a colour, or of numbers instead of a number; or the value."""
        if not self._has_uvs or key not in self._words:
            return value
        is_color = isinstance(value, tuple)
        options = {"factor": value, "most": most} if is_color else {"channel": "r"}
        return self._texture(key, "color" if is_color else "data", **options) or value

    def _texture(self, key: str, kind: str, most: float = 1.0, **attributes: Any) -> ImageTexture | None:
        """Return the image of a map with further attributes, or None if there is none."""
        options, file = _options(self._words[key])
        pixels = self._pixels(file, kind, most=most)
        return None if pixels is None else ImageTexture(pixels, file, **attributes, **_placement(options))

    def _pixels(self, file: str, kind: str, **limits: float) -> NDArray[np.float32] | None:
        return self._images.pixels(file, kind, f"texture {file}", lambda: self._find(file), **limits)


def _options(words: list[str]) -> tuple[dict[str, list[str]], str]:
    """Return the options of a map statement, and the file name after them, which may have spaces."""
    options: dict[str, list[str]] = {}
    i = 0
    while i < len(words) - 1 and words[i].startswith("-"):
        option = words[i].lower()
        options[option] = [words[i + 1]]
        i += 2
        while len(options[option]) < _ARGUMENTS.get(option, 1) and i < len(words) - 1 and _is_number(words[i]):
            options[option].append(words[i])
            i += 1
    return options, " ".join(words[i:]).strip('"')


def _is_number(word: str) -> bool:
    """Return whether it is a number that can place a texture or scale a bump map."""
    try:
        return abs(float(word)) < 1e6
    except ValueError:
        return False


def _placement(options: dict[str, list[str]]) -> dict[str, Any]:
    """Return the placement of an image by the options of its map."""
    result: dict[str, Any] = {}
    for option, name, default in (("-s", "scale", "1"), ("-o", "offset", "0")):
        if option in options and all(_is_number(word) for word in options[option]):
            u, v = (*options[option], default)[:2]
            result[name] = (float(u), float(v))
    if options.get("-clamp", ["off"])[0].lower() == "on":
        result["wrap"] = "clamp"
    return result


def _holds_normals(pixels: NDArray[np.float32]) -> bool:
    """Return whether a bump map really is a normal map, as in many files: blue, and mostly so."""
    red, _, blue = pixels.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    return bool(blue > 0.7 and blue > 1.2 * red)


def _normals_of_heights(heights: NDArray[np.float32], scale: float) -> NDArray[np.float32]:
    """Return (H, W, 3) colours of the normals of a relief that repeats."""
    slope_u = 0.5 * (np.roll(heights, -1, axis=1) - np.roll(heights, 1, axis=1))
    slope_v = 0.5 * (np.roll(heights, 1, axis=0) - np.roll(heights, -1, axis=0))  # v points up, rows down
    k = _BUMP_TEXELS * scale
    normals = np.stack([-k * slope_u, -k * slope_v, np.ones_like(heights)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return np.asarray(0.5 * normals + 0.5, np.float32)
