"""Materials of Wavefront MTL files as wrt's.

Format: Wavefront, "Advanced Visualizer Manual", appendix B2, and the statements for physically based materials that
Exocortex proposed in 2015 (Pr, Pm, Pc, Pcr, Ps, aniso, norm). What the format leaves open is taken as Blender's
importer takes it, since most files are written for such programs: Ks 0.5 is the reflection of a usual dielectric (4 %
straight on), and Ns from 0 to 1000 is a roughness from 1 to 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.io.mesh.sidecars import COLOR_MAP
from wrt.io.texture_images import Source, TextureImages
from wrt.scene.materials import Diffuse, Material, Principled
from wrt.scene.textures import ColorSource, ImageTexture, NormalMap, VertexColor
from wrt.values import Vec3

_ARGUMENTS = {"-mm": 2, "-o": 3, "-s": 3, "-t": 3}
"""Words that may follow an option of a map; one for all others."""

_MIRRORS, _GLASSES = (3, 5, 8), (4, 6, 7, 9)
"""Illumination models that reflect all around, and those of transparent bodies."""

_BUMP_TEXELS = 2.0
"""Texels that a bump map is high from black to white at -bm 1: the format leaves it open."""


_HIGHEST = 1e6
"""Of a bump map in floating point: slopes of higher ones would overflow."""


class MtlMaterials:
    """The materials of one OBJ file, each made once for each way of using it."""

    def __init__(self, path: Path, find: Callable[[str], Source]) -> None:
        """Take the path of the OBJ file, and a function that finds images by name."""
        self._find = find
        self._images = TextureImages(path)
        self._made: dict[tuple[str, bool, bool], Material] = {}

    def material(self, name: str, described: dict[str, Any], *, laid: bool, colored: bool) -> Material:
        """Return a material.

        Args:
            name: the material's.
            described: its statements in small letters, with their words or numbers.
            laid: whether the mesh has texture coordinates.
            colored: whether the mesh has colours of its own.
        """
        key = name, laid, colored
        if key not in self._made:
            self._made[key] = self._make(_Statements(described), laid, colored)
        return self._made[key]

    def _make(self, said: _Statements, laid: bool, colored: bool) -> Material:
        base = self._base(said, laid, colored)
        opacity, transmission = self._opacity(said, laid), 0.0
        illumination = said.number("illum", -1.0)
        if illumination in _GLASSES and isinstance(opacity, float) and opacity < 1.0 and said.number("ni", 1.0) > 1.0:
            transmission, opacity = 1.0 - opacity, 1.0
            base = said.color("tf", maximum=1.0) or base
        emission = self._emission(said, laid)
        common: dict[str, Any] = {"opacity": opacity, "normal_map": self._normal_map(said, laid)}
        physical = any(key in said.words for key in ("pr", "pm", "pc", "ps", "map_pr", "map_pm"))
        specular = said.color("ks") or (0.0, 0.0, 0.0)
        shiny = (any(specular) or "map_ks" in said.words) and not 0.0 <= illumination < 2.0
        if not (physical or shiny or transmission or emission != (0.0, 0.0, 0.0)):
            return Diffuse(base, **common)
        shine = min(max(said.number("ns", 0.0), 0.0), 1000.0)
        values: dict[str, Any] = {"roughness": 1.0 - math.sqrt(shine / 1000.0)}
        if illumination in _MIRRORS:
            values["specular_color"] = tuple(x / 0.04 for x in specular)
        elif shiny or not physical:
            r, g, b = specular
            values["specular_color"] = self._map(said, "map_ks", laid, factor=(2.0 * r, 2.0 * g, 2.0 * b))
        if physical:
            values["roughness"] = self._share(said, "pr", laid, 0.5)
            values["metallic"] = self._share(said, "pm", laid, 0.0)
            values["coat"] = self._share(said, "pc", laid, 0.0)
            values["coat_roughness"] = self._share(said, "pcr", laid, 0.0)
            sheen = min(max(said.number("ps", 0.0), 0.0), 1.0)
            values["sheen_color"] = (sheen, sheen, sheen)
            values["anisotropy"] = min(max(said.number("aniso", 0.0), 0.0), 1.0)
        ior = said.number("ni", 1.5)
        return Principled(
            base,
            ior=ior if 1.0 < ior < 10.0 else 1.5,
            transmission=transmission,
            emission=emission,
            **values,
            **common,
        )

    def _base(self, said: _Statements, laid: bool, colored: bool) -> ColorSource:
        """Return the image, the mesh's colours, the constant, or a default, whichever is there first."""
        color = said.color("kd", maximum=1.0)
        if COLOR_MAP in said.words:
            options, file = _options(said.words[COLOR_MAP])
            pixels = self._image(file, "color")
            # Many exporters write Kd 0 0 0 beside an image; black would hide it.
            factor = color if color is not None and any(color) else (1.0, 1.0, 1.0)
            if pixels is not None and laid:
                return ImageTexture(pixels, file, factor=factor, **_placement(options))
            if pixels is not None:
                # Without coordinates the image's average is the best constant.
                mean = np.clip(pixels.mean(axis=(0, 1), dtype=np.float64) * factor, 0.0, 1.0)
                return tuple(float(x) for x in mean)
            color = color if color is not None and any(color) else None
        if colored:
            return VertexColor()
        return DEFAULT_REFLECTANCE if color is None else color

    def _opacity(self, said: _Statements, laid: bool) -> ColorSource:
        """Return the share that is there. Files disagree on Tr: 1 is written for what is opaque everywhere else."""
        opacity = said.number("d", math.nan)
        if math.isnan(opacity):
            transparency = said.number("tr", 0.0)
            opacity = 1.0 if transparency >= 1.0 else 1.0 - transparency
        opacity = min(max(opacity, 0.0), 1.0)
        words = said.words.get("map_d")
        if not words or not laid:
            return opacity
        options, file = _options(words)
        pixels = self._image(file, "alpha" if options.get("-imfchan", ["m"])[0] == "m" else "data")
        if pixels is None:
            return opacity
        channel = options.get("-imfchan", ["r"])[0]
        # Files with a mask write d 0, meaning: see there.
        return ImageTexture(
            pixels,
            file,
            channel=channel if channel in ("r", "g", "b") else "r",
            factor=opacity or 1.0,
            **_placement(options),
        )

    def _emission(self, said: _Statements, laid: bool) -> ColorSource:
        color = said.color("ke") or (0.0, 0.0, 0.0)
        if "map_ke" not in said.words:
            return color
        return self._map(said, "map_ke", laid, factor=color if any(color) else (1.0, 1.0, 1.0), most=math.inf)

    def _normal_map(self, said: _Statements, laid: bool) -> NormalMap | None:
        for key in ("norm", "map_norm", "map_kn", "map_bump", "bump"):
            if key in said.words and laid:
                options, file = _options(said.words[key])
                pixels = self._image(file, "data")
                if pixels is None:
                    continue
                wrap = _placement(options).get("wrap", "repeat")
                if not key.endswith("bump") or _holds_normals(pixels):
                    return NormalMap(pixels, name=file, wrap=wrap)
                pixels = self._image(file, "data", least=-_HIGHEST, most=_HIGHEST)
                assert pixels is not None  # as before
                height = options.get("-bm", ["1"])[0]
                scale = float(height) if _is_number(height) else 1.0
                return NormalMap(_normals_of_heights(pixels[:, :, 0], scale), name=file, wrap=wrap)
        return None

    def _share(self, said: _Statements, key: str, laid: bool, default: float) -> ColorSource:
        """Return a number from 0 to 1, or the image of its map."""
        value = min(max(said.number(key, default), 0.0), 1.0)
        words = said.words.get(f"map_{key}")
        if not words or not laid:
            return value
        options, file = _options(words)
        pixels = self._image(file, "data")
        return value if pixels is None else ImageTexture(pixels, file, channel="r", **_placement(options))

    def _map(self, said: _Statements, key: str, laid: bool, *, factor: Vec3, most: float = 1.0) -> ColorSource:
        words = said.words.get(key)
        if not words or not laid:
            return factor
        options, file = _options(words)
        pixels = self._image(file, "color", most=most)
        if pixels is None:
            return factor
        return ImageTexture(pixels, file, factor=factor, **_placement(options))

    def _image(self, file: str, kind: str, **limits: float) -> NDArray[np.float32] | None:
        """Return an image beside the OBJ, see TextureImages.pixels."""
        return self._images.pixels(file, kind, f"texture {file}", lambda: self._find(file), **limits)


class _Statements:
    """What an MTL file says of one material; numbers that are none are as if they were not there."""

    def __init__(self, described: dict[str, Any]) -> None:
        self.words: dict[str, list[str]] = {}
        for key, value in described.items():
            if isinstance(value, (int, float)):
                self.words[key] = [str(value)]
            elif isinstance(value, (list, tuple)):
                self.words[key] = [str(word) for word in value]

    def number(self, key: str, default: float) -> float:
        try:
            # "d -halo 0.5" has a word before it.
            value = float(self.words[key][-1])
        except (KeyError, IndexError, ValueError):
            return default
        return value if math.isfinite(value) else default

    def color(self, key: str, maximum: float = 1e30) -> Vec3 | None:
        try:
            values = [float(word) for word in self.words[key][:3]]
        except (KeyError, ValueError):
            return None
        if len(values) not in (1, 3) or not np.isfinite(values).all():
            return None
        r, g, b = (float(x) for x in np.clip(np.broadcast_to(values, 3), 0.0, maximum))
        return r, g, b


def _options(words: list[str]) -> tuple[dict[str, list[str]], str]:
    """Return the options of a map statement, and the file name, which is all the rest."""
    options: dict[str, list[str]] = {}
    i = 0
    while i < len(words) - 1 and words[i].startswith("-"):
        option, taken = words[i].lower(), [words[i + 1]]
        i += 2
        while len(taken) < _ARGUMENTS.get(option, 1) and i < len(words) - 1 and _is_number(words[i]):
            taken.append(words[i])
            i += 1
        options[option] = taken
    return options, " ".join(words[i:]).strip('"')


def _is_number(word: str) -> bool:
    """Whether it is one that a texture can be laid or a relief be made with."""
    try:
        return abs(float(word)) < 1e6
    except ValueError:
        return False


def _placement(options: dict[str, list[str]]) -> dict[str, Any]:
    """Return what options say of how an image is laid."""
    result: dict[str, Any] = {}
    for option, name, default in (("-s", "scale", "1"), ("-o", "offset", "0")):
        if option in options and all(_is_number(word) for word in options[option]):
            u, v = (*options[option], default)[:2]
            result[name] = (float(u), float(v))
    if options.get("-clamp", ["off"])[0].lower() == "on":
        result["wrap"] = "clamp"
    return result


def _holds_normals(pixels: NDArray[np.float32]) -> bool:
    """Whether an image given as a bump map is really one of normals, as many files have it: blue, and mostly so."""
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
