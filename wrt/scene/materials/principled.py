"""The principled materials: the metallic-roughness one of glTF, and the one of Burley that Mitsuba has."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.scene.description import Flag, Number, instance_of, optional
from wrt.scene.materials.body import Entered
from wrt.scene.materials.dielectrics import refractive_index
from wrt.scene.materials.dispersion import SHARES, Dispersion, Dispersive, channel_indices
from wrt.scene.materials.material import Filmed, Reflectance, Share, UnlimitedColor, share
from wrt.scene.materials.microfacet import LEAST_ALPHA, NEARLY_SMOOTH, largest
from wrt.scene.textures import VARYING, ColorSource, ImageTexture, NormalMap, Texture, VertexColor
from wrt.values import number


def _refractive_index(value: float | str, name: str) -> float:
    """Return a refractive index of at least 1, or 0."""
    if isinstance(value, str):
        return refractive_index(value, name)
    if not isinstance(value, bool) and np.ndim(value) == 0 and value == 0:
        return 0.0
    return number(value, name, minimum=1.0)


def _anisotropy(value: ColorSource, name: str) -> ColorSource:
    """Return a checked strength, or an image of directions and strengths."""
    if isinstance(value, (VertexColor, Texture)) or (isinstance(value, ImageTexture) and value.channel is not None):
        raise InputError(f"{name} must be a number, or an image with the direction in red and green")
    return share(value, name)


def _first_number(value: ColorSource) -> ColorSource:
    """Return a number as the first of a row whose others are 0, the place of a normal: by itself it is z."""
    if isinstance(value, VARYING):
        return replace(value, factor=(*value.factor[:1], 0.0, 0.0))  # type: ignore[index]
    return (value, 0.0, 0.0)  # type: ignore[return-value]


@dataclass(frozen=True)
class Principled(Filmed, Dispersive, Entered):
    """A material with few intuitive parameters: the metallic-roughness workflow of glTF 2.0.

    `metallic` blends between a dielectric (plastic, paint, wood, stone, glass) and a metal; sheen and a clear coat may
    lie on top. Some names are not glTF's: `coat` is its clearcoat, `transmission` with `thin_walled` is
    KHR_materials_transmission, and without it that is combined with KHR_materials_volume.

    Attributes:
        base_color: diffuse reflectance of a dielectric, or reflectance of a metal at normal incidence, per channel,
            0 to 1.
        metallic: 0 dielectric, 1 metal.
        roughness: 0 mirror to 1 matt; its square is the roughness α of GGX.
        ior: refractive index of the dielectric, from 1, or a name such as "water" (wrt materials --presets). 0 is
            infinite, as in glTF.
        specular: strength of the dielectric's reflection.
        specular_color: tint of that reflection at normal incidence; may exceed 1.
        anisotropy: elongation of highlights along one direction, 0 to 1. An image is as in KHR_materials_anisotropy.
        anisotropy_rotation: turns that direction counter-clockwise from u towards v, radians.
        transmission: fraction of the light entering the dielectric that is transmitted, as in glass.
        thin_walled: whether the surface is a thin sheet, which does not refract, not the boundary of a body.
        dispersion: 20 over the Abbe number, as in glTF, or a name such as "diamond" (wrt materials --presets); `ior` is
            then that at 587.6 nm.
        film: share of the surface under a thin film, whose colours come from interference.
        coat: coverage of a clear coat of index 1.5.
        coat_roughness: as `roughness`, of the coat.
        coat_normal_map: perturbs the coat's normal in place of `normal_map`; a flat map leaves the mesh's own. Neither
            map can then have a filter, or Mitsuba's convention.
        sheen_color: colour of fibres on the surface, as on velvet, per channel, 0 to 1.
        sheen_roughness: roughness of the fibres; below 0.07 it counts as 0.07.
        emission: emitted radiance, W·sr⁻¹·m⁻².
        multiple_bounces: whether light scatters between facets more than once (Kulla and Conty 2017); otherwise it is
            lost.
    """

    base_color: Reflectance = 0.8
    metallic: Share = 0.0
    roughness: Share = 0.5
    ior: Annotated[float | str, _refractive_index] = 1.5
    specular: Share = 1.0
    specular_color: UnlimitedColor = 1.0
    anisotropy: Annotated[ColorSource, _anisotropy] = 0.0
    anisotropy_rotation: Number = 0.0
    transmission: Share = 0.0
    thin_walled: Flag = False
    dispersion: Dispersion = field(default=0.0, kw_only=True)
    film: Share = field(default=1.0, kw_only=True)
    coat: Share = 0.0
    coat_roughness: Share = 0.0
    sheen_color: Reflectance = 0.0
    sheen_roughness: Share = 0.0
    emission: UnlimitedColor = 0.0
    multiple_bounces: Flag = False
    coat_normal_map: Annotated[NormalMap | None, optional(instance_of(NormalMap))] = field(default=None, kw_only=True)

    type_name: ClassVar[str] = "principled"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.ior == 0.0 and self.transmission != 0.0 and not self.thin_walled:
            raise InputError("ior 0 means infinite, which transmits no light; set transmission to 0, or give an ior")
        if self.multiple_bounces:
            _ = self.table_key
            self._refuse_film()
        if self.coat_normal_map is not None:
            for name, normals in (("normal_map", self.normal_map), ("coat_normal_map", self.coat_normal_map)):
                if normals is not None and (normals.filter or normals.convention == "mitsuba"):
                    what = "a filter" if normals.filter else "Mitsuba's convention"
                    raise InputError(f"{name} cannot have {what} where there is a coat_normal_map")

    @property
    def normal_maps(self) -> tuple[NormalMap, ...]:
        coat = (self.coat_normal_map,) if self.coat_normal_map is not None and self.coat != 0.0 else ()
        return (*super().normal_maps, *coat)

    @property
    def is_nearly_smooth(self) -> bool:
        is_clear = 1.0 in (self.metallic, self.transmission) and self.sheen_color == (0.0, 0.0, 0.0)
        coat = 0.0 if self.coat == 0.0 else largest(self.coat_roughness)
        return is_clear and not self.needs_tangents and max(largest(self.roughness), coat) ** 2 <= NEARLY_SMOOTH

    @property
    def has_film(self) -> bool:
        return self.film != 0.0 and super().has_film

    @property
    def features(self) -> tuple[str, ...]:
        """Features beyond the base material, in the order of the model's name."""
        through = "thin" if self.thin_walled else "transmission"
        present = {
            "anisotropic": self.needs_tangents,
            through: self.transmission != 0.0,
            "dispersion": self.dispersion != 0.0 and self.is_body,
            "film": self.has_film,
            "coat": self.coat != 0.0,
            "coat_normal": self.coat != 0.0 and self.coat_normal_map is not None,
            "sheen": self.sheen_color != (0.0, 0.0, 0.0),
            "bounces": self.multiple_bounces,
        }
        return tuple(name for name, is_present in present.items() if is_present)

    @property
    def model(self) -> str:
        """The model with only the features in use, so that plain materials have small kernels."""
        return ":".join(("principled", *self.features))

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        values: list[ColorSource] = [self.base_color, self.metallic, self.roughness]
        values += [self.specular, self.specular_color]
        features = self.features
        ior = float(self.ior)
        values += [channel_indices(ior, float(self.dispersion)) if "dispersion" in features else ior]
        if "anisotropic" in features:
            turn = self.anisotropy_rotation
            along_u = (1.0, 0.5, self.anisotropy) if isinstance(self.anisotropy, float) else self.anisotropy
            # A film's index lies where a row has place for it: with its own there could be more than sixteen.
            values += [along_u, (math.cos(turn), math.sin(turn), self.film_ior if "film" in features else 0.0)]
        if "transmission" in features or "thin" in features:
            values += [self.transmission]
        if "dispersion" in features:
            values += [SHARES]
        if "film" in features:
            values += [self.film, *(self.film_slots[:1] if "anisotropic" in features else self.film_slots)]
        if "coat" in features:
            coat = [self.coat, self.coat_roughness]
            values += [_first_number(value) for value in coat] if "coat_normal" in features else coat
        if "sheen" in features:
            values += [self.sheen_color, self.sheen_roughness]
        return tuple(values)

    @property
    def needs_tangents(self) -> bool:
        return self.anisotropy != 0.0

    @property
    def table_key(self) -> tuple[Hashable, ...] | None:
        if not self.multiple_bounces:
            return None
        if not self.needs_tangents:
            return ("reflection", "ggx", "smith", None)
        if not (isinstance(self.roughness, float) and isinstance(self.anisotropy, float)):
            raise InputError("multiple_bounces needs roughness and anisotropy to be numbers, or no anisotropy")
        alpha = max(self.roughness**2, LEAST_ALPHA)
        return ("reflection", "ggx", "smith", (alpha + (1.0 - alpha) * self.anisotropy**2, alpha, 0.0))


@dataclass(frozen=True)
class Burley(Entered):
    """The "Disney" material, as Mitsuba's `principled` and `principledthin` have it.

    It is for scenes that were made for it; Principled, the material of glTF, keeps energy better. (Burley,
    "Physically based shading at Disney" 2012 and "Extending the Disney BRDF to a BSDF" 2015.)

    Attributes:
        base_color: reflectance of the diffuse base, or of a metal at normal incidence, per channel, 0 to 1.
        metallic: 0 dielectric, 1 metal; without effect on thin sheets.
        roughness: 0 mirror to 1 matt; its square is the roughness α of GGX.
        anisotropy: elongation of highlights along u, 0 to 1.
        transmission: share of a dielectric that is clear instead of diffuse.
        diffuse_transmission: share of the diffuse light that goes through a thin sheet instead of back.
        thin_walled: whether the surface is a thin sheet, which does not refract, not the boundary of a body.
        ior: refractive index of the dielectric, from 1.
        specular_tint: how far its reflection takes the hue of the base colour.
        sheen: strength of the light that fibres add at grazing angles.
        sheen_tint: how far this takes the hue of the base colour.
        flatness: blends the diffuse base to a look of light scattered below the surface.
        coat: strength of a clear coat, which reflects a quarter as much as varnish; not on thin sheets.
        coat_gloss: 0 satin to 1 gloss, of the coat.
    """

    base_color: Reflectance = 0.5
    metallic: Share = 0.0
    roughness: Share = 0.5
    anisotropy: Share = 0.0
    transmission: Share = 0.0
    diffuse_transmission: Share = 0.0
    thin_walled: Flag = False
    ior: Annotated[float, partial(number, minimum=1.0)] = 1.5
    specular_tint: Share = 0.0
    sheen: Share = 0.0
    sheen_tint: Share = 0.0
    flatness: Share = 0.0
    coat: Share = 0.0
    coat_gloss: Share = 0.0

    type_name: ClassVar[str] = "burley"

    @property
    def interior_ior(self) -> float:
        return self.ior

    @property
    def model(self) -> str:
        return "burley:thin" if self.thin_walled else "burley:transmission" if self.is_body else "burley"

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        return (
            self.base_color,
            self.diffuse_transmission if self.thin_walled else self.metallic,
            *(self.roughness, self.anisotropy, self.transmission, self.ior, self.specular_tint),
            *(self.sheen, self.sheen_tint, self.flatness, self.coat, self.coat_gloss),
        )

    @property
    def needs_tangents(self) -> bool:
        return self.anisotropy != 0.0
