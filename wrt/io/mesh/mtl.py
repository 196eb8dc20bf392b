"""Materials of Wavefront MTL files as wrt's.

Format: Wavefront, "Advanced Visualizer Manual", appendix B2, and the statements for physically based materials that
Exocortex proposed in 2015 (Pr, Pm, Pc, Pcr, Ps, aniso, norm). What the format leaves open is taken as Blender's
importer takes it, since most files are written for such programs: Ks 0.5 is the reflection of a usual dielectric (4 %
straight on), and Ns from 0 to 1000 is a roughness from 1 to 0.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrt.errors import warn
from wrt.io.account import TrackedObject, warn_of_unused
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE, Part
from wrt.io.texture_images import Source, TextureImages
from wrt.scene.materials import Diffuse, Material, Principled
from wrt.scene.textures import CHANNELS, ColorSource, ImageTexture, NormalMap, VertexColor
from wrt.values import Vec3

Statements: TypeAlias = Mapping[str, Any]
"""The statements of one material: their names in small letters, with their words or numbers."""

_ARGUMENTS = {"-mm": 2, "-o": 3, "-s": 3, "-t": 3}
"""Words that may follow an option of a map; one for all others."""

WITHOUT_EFFECT = {
    "ka*": "light from all around is traced",
    "map_ka*": "the same",
    "sharpness*": "it is that of reflection maps",
    "map_aat*": "pixels are averages of samples anyway",
    "* -boost": "textures are averaged by samples, not by mip levels",
    "* -texres": "images keep their size",
    "* -blend[uv] on": "the default",
    "* -cc off": "the default",
}
"""Statements, and options of maps with words that are no numbers, that do not change a picture; with the reason."""

_MIRRORS, _GLASSES = (3, 5, 8), (4, 6, 7, 9)
"""Illumination models that reflect all around, and those of transparent bodies."""

_BUMP_TEXELS = 2.0
"""Texels that a bump map is high from black to white at -bm 1: the format leaves it open."""

_HIGHEST = 1e6
"""Of a bump map in floating point: slopes of higher ones would overflow."""

_NORMALS = ("norm", "map_norm", "map_kn", "map_bump", "bump")
"""Statements of normal and bump maps; of several the first is used."""

_LUMINANCE = np.array((0.2126, 0.7152, 0.0722), np.float32)
"""Weights of linear Rec. 709."""

_COMMENT = re.compile(r"(?:^|\s)#")

_PHYSICAL = ("pr", "pm", "pc", "ps", "map_pr", "map_pm", "map_pc", "map_ps")
"""Statements that make a material a physically based one."""

_BLACK, _WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


def plain_name(words: Sequence[str]) -> str:
    """Return the name of a material without the quotes that some programs write."""
    return " ".join(words).strip('"')


def statements_of(text: str) -> dict[str, Statements]:
    """Return the statements of each material of an MTL file; those without a word are left out.

    Statements before the first material belong to the name "".
    """
    statements: dict[str, list[str]] = {}
    materials = {"": statements}
    for line in text.replace("\\\n", " ").splitlines():
        match _COMMENT.split(line, 1)[0].split():
            case [key, *words] if words and key.lower() == "newmtl":
                statements = materials[plain_name(words)] = {}
            case [key, *words] if words:
                statements[key.lower()] = words
    return {**materials}


class MtlMaterials:
    """The materials of one OBJ file, each made once for each kind of mesh."""

    def __init__(self, path: Path, find: Callable[[str], Source]) -> None:
        """Take the path of the OBJ file, and a function that finds images by name."""
        self._path, self._images, self._find = path, TextureImages(path), find
        self._made: dict[tuple[str, int, bool, bool], tuple[Material, _Placement]] = {}
        self._unused: dict[tuple[str, int], list[str]] = {}

    def dressed(self, part: Part, name: str, statements: Statements, *, number: int = 0) -> Part:
        """Return a part with the material of a name, and texture coordinates as its normal map places them.

        Materials with the same name get different `number`s.
        """
        key = name, number, part.uvs is not None, part.colors is not None
        if key not in self._made:
            reader = _Reader(self._images, self._find, statements, has_uvs=key[2])
            self._made[key] = reader.material(has_colors=key[3]).named(name), reader.normals_at
            self._unused[name, number] = reader.unused()
            if part.uvs is None and (maps := reader.maps()):
                files = maps[0] if len(maps) == 1 else f"{maps[0]} and {len(maps) - 1} more"
                warn(f"{self._path}: texture {files} cannot be laid: faces of {part.name!r} lack texture coordinates")
        material, placement = self._made[key]
        uvs = part.uvs if part.uvs is None or placement == _UNPLACED else part.uvs * placement.scale + placement.offset
        return replace(part, material=material, uvs=uvs)

    def warn_of_unused(self) -> None:
        """Warn of the statements and options that the materials so far have and wrt does not use."""
        warn_of_unused(self._path, itertools.chain.from_iterable(self._unused.values()), WITHOUT_EFFECT)


@dataclass(frozen=True)
class _Placement:
    """Scale and offset of texture coordinates."""

    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


_UNPLACED = _Placement()


class _Reader:
    """Reads one material; a malformed number counts as if it were missing.

    Attributes:
        normals_at: the placement of the normal map. Materials have none; it is applied to the mesh's coordinates, and
            undone for the other textures.
    """

    def __init__(
        self, images: TextureImages, find: Callable[[str], Source], statements: Statements, has_uvs: bool
    ) -> None:
        self._images, self._find, self._has_uvs = images, find, has_uvs
        self.normals_at = _UNPLACED
        self._words = TrackedObject()
        self._options: dict[str, TrackedObject] = {}  # those of maps that are used
        self._lost: list[str] = []
        for key, value in statements.items():
            if isinstance(value, (int, float, list, tuple)):
                self._words[key] = [str(word) for word in (value if isinstance(value, (list, tuple)) else [value])]

    def maps(self) -> list[str]:
        """Return the files of the maps that `material` has looked at, each once."""
        keys = [key for key in self._words if key in self._words.asked and (key.startswith("map_") or key in _NORMALS)]
        return list(dict.fromkeys(self._map_words(key)[1] for key in keys))

    def unused(self) -> list[str]:
        """Return the statements and options that `material` has not used, except those whose values are all 0."""
        found = [(key, words) for key, words in self._words.items() if key not in self._words.asked]
        for key, options in self._options.items():
            found += [(f"{key} {name}", words) for name, words in options.items() if name not in options.asked]
        kinds = [
            kind if _is_number(words[0]) or " " not in kind else f"{kind} {words[0]}"
            for kind, words in found
            if not all(_is_number(word) and float(word) == 0.0 for word in words)
        ]
        return list(dict.fromkeys(self._lost + kinds))

    def material(self, has_colors: bool) -> Material:
        normal_map = self._normal_map()
        base, opacity, transmission = self._base(has_colors), self._opacity(), 0.0
        illumination, ior, filtered = self._number("illum", -1.0), self._number("ni", 1.5), self._color("tf", 1.0)
        if illumination not in range(-1, 10):
            self._lost.append(f"illum {illumination:g}")
        if illumination in _GLASSES and isinstance(opacity, float) and opacity < 1.0 and ior > 1.0:
            transmission, opacity = 1.0 - opacity, 1.0
            base = filtered or base
        emission = self._color("ke") or _BLACK
        if "map_ke" in self._words:
            emission = self._map("map_ke", emission if any(emission) else _WHITE, most=math.inf)
        common: dict[str, Any] = {"opacity": opacity, "normal_map": normal_map}
        physical: dict[str, Any] = {
            name: self._map(f"map_{key}", self._share(key, default))
            for name, key, default in (
                ("roughness", "pr", 0.5),
                ("metallic", "pm", 0.0),
                ("coat", "pc", 0.0),
                ("coat_roughness", "pcr", 0.0),
                ("sheen_color", "ps", 0.0),
            )
        }
        physical["anisotropy"] = self._share("aniso", 0.0)
        is_physical = not self._words.keys().isdisjoint(_PHYSICAL)
        specular = self._color("ks") or _BLACK
        shine = min(max(self._number("ns", 0.0), 0.0), 1000.0)
        is_shiny = (any(specular) or "map_ks" in self._words) and not 0.0 <= illumination < 2.0
        if not (is_physical or is_shiny or transmission or emission != _BLACK):
            return Diffuse(base, **common)
        values: dict[str, Any] = {"roughness": 1.0 - math.sqrt(shine / 1000.0)}
        if illumination in _MIRRORS:
            values["specular_color"] = tuple(x / 0.04 for x in specular)
        elif is_shiny or not is_physical:
            r, g, b = specular
            values["specular_color"] = self._map("map_ks", (2.0 * r, 2.0 * g, 2.0 * b))
        if is_physical:
            values |= physical
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
        opacity, transparency = self._number("d", math.nan), self._number("tr", 0.0)
        if math.isnan(opacity):
            opacity = 1.0 if transparency >= 1.0 else 1.0 - transparency
        opacity = min(max(opacity, 0.0), 1.0)
        if "map_d" not in self._words or not self._has_uvs:
            return opacity
        # Files with a mask may have d 0. Without an option its values are alpha (the channel m, "matte").
        return self._texture("map_d", "alpha", factor=opacity or 1.0) or opacity

    def _normal_map(self) -> NormalMap | None:
        given = [key for key in _NORMALS if key in self._words]
        for key in given:
            if not self._has_uvs or (texture := self._texture(key, "data")) is None:
                continue
            # Some programs write the same image as map_bump and as bump.
            files = {self._map_words(each)[1]: each for each in reversed(given)}
            self._lost += [each for file, each in files.items() if file != texture.name]
            options, _ = self._map_words(key)
            strength = options.get("-bm", ["1"])[0]
            scale = float(strength) if _is_number(strength) else 1.0
            pixels = texture.pixels
            if key.endswith("bump") and not _holds_normals(pixels):
                heights = self._texture(key, "heights")
                assert heights is not None  # as before
                pixels, scale = _normals_of_heights(heights.pixels[:, :, 0], scale), 1.0
            if all(texture.scale):  # type: ignore[arg-type]
                self.normals_at = _Placement(texture.scale, texture.offset)  # type: ignore[arg-type]
            else:
                self._lost.append(f"{key} -s 0")
            return NormalMap(pixels, scale=scale, name=texture.name, wrap=texture.wrap)
        return None

    # --- Statements ---------------------------------------------------------------------------------

    def _number(self, key: str, default: float) -> float:
        words = self._words.get(key)
        if not words:
            return default
        if words[0].startswith("-") and not _is_number(words[0]):
            self._lost.append(f"{key} {words[0]}")  # such as "d -halo 0.5"
        try:
            value = float(words[-1])
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            self._lost.append(f"{key} {words[-1]}")
        return value if math.isfinite(value) else default

    def _share(self, key: str, default: float) -> float:
        """Return a number from 0 to 1."""
        return min(max(self._number(key, default), 0.0), 1.0)

    def _color(self, key: str, maximum: float = 1e30) -> Vec3 | None:
        words = self._words.get(key)
        if words is None:
            return None
        try:
            values = [float(word) for word in words[:3]]
        except ValueError:
            values = []
        if len(values) not in (1, 3) or not np.isfinite(values).all():
            self._lost.append(" ".join([key, *words[:1]]))  # such as "Kd spectral"
            return None
        r, g, b = (float(x) for x in np.clip(np.broadcast_to(values, 3), 0.0, maximum))
        return r, g, b

    def _map(self, key: str, value: Any, most: float = 1.0) -> Any:
        """Return the image of a map: of colours times a colour, or of numbers instead of a number; or the value."""
        if key not in self._words or not self._has_uvs:
            return value
        is_color = isinstance(value, tuple)
        options = {"factor": value, "most": most} if is_color else {}
        return self._texture(key, "color" if is_color else "number", **options) or value

    def _texture(self, key: str, kind: str, most: float = 1.0, **attributes: Any) -> ImageTexture | None:
        """Return the image of a map with further attributes, or None if there is none.

        Args:
            key: the statement.
            kind: "color", "data" for normals; or numbers, from the red channel or the one that the statement names:
                "number", "alpha" or "heights".
            most: the largest value.
            attributes: those of the texture.
        """
        options, file = self._map_words(key)
        least, channel = 0.0, ""
        if kind == "heights":
            least, most = -_HIGHEST, _HIGHEST
        if kind not in ("color", "data"):
            channel = options.get("-imfchan", ["m" if kind == "alpha" else "r"])[0].lower()
            if channel not in (*"rgblm",):
                self._lost.append(f"{key} -imfchan {channel}")
            kind, attributes["channel"] = "alpha" if channel == "m" else "data", channel if channel in CHANNELS else "r"
        label = f"texture {file}"
        pixels = self._images.pixels(file, kind, label, lambda: self._find(file), least=least, most=most)
        if pixels is None:
            return None
        self._options[key] = options
        if channel == "l":
            pixels = np.repeat(pixels @ _LUMINANCE, 3).reshape(pixels.shape)
        base, gain = _two(options, "-mm", (0.0, 1.0))
        if (base, gain) != (0.0, 1.0):
            pixels = np.clip(np.float32(base) + np.float32(gain) * pixels, least, most)
        return ImageTexture(pixels, file, **attributes, **self._placement(options))

    def _map_words(self, key: str) -> tuple[TrackedObject, str]:
        """Return the options of a map statement, and the file name after them, which may have spaces."""
        words, options = self._words[key], self._options.get(key, TrackedObject())
        i = 0
        while i < len(words) - 1 and words[i].startswith("-"):
            name = words[i].lower()
            arguments = [words[i + 1]]
            i += 2
            while len(arguments) < _ARGUMENTS.get(name, 1) and i < len(words) - 1 and _is_number(words[i]):
                arguments.append(words[i])
                i += 1
            options[name] = arguments
        return options, " ".join(words[i:]).strip('"')

    def _placement(self, options: TrackedObject) -> dict[str, Any]:
        """Return the placement of an image by the options of its map, on coordinates as the normal map places them."""
        (su, sv), (ou, ov) = _two(options, "-s", (1.0, 1.0)), _two(options, "-o", (0.0, 0.0))
        (nu, nv), (mu, mv) = self.normals_at.scale, self.normals_at.offset
        clamped = options.get("-clamp", ["off"])[0]
        if clamped.lower() not in ("on", "off"):
            self._lost.append(f"-clamp {clamped}")
        wrap = "clamp" if clamped.lower() == "on" else "repeat"
        return {"scale": (su / nu, sv / nv), "offset": (ou - su * mu / nu, ov - sv * mv / nv), "wrap": wrap}


def _two(options: TrackedObject, name: str, default: tuple[float, float]) -> tuple[float, float]:
    """Return the first two numbers of an option, with the default for missing or malformed ones."""
    words = [*options.get(name, []), "", ""]
    first, second = (float(word) if _is_number(word) else value for word, value in zip(words, default, strict=False))
    return first, second


def _is_number(word: str) -> bool:
    """Return whether it is a number that can place a texture or scale a bump map."""
    try:
        return abs(float(word)) < 1e6
    except ValueError:
        return False


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
