"""The principled material of Burley, as Mitsuba has it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, ClassVar

from wrt.scene.description import Flag
from wrt.scene.materials.body import Entered
from wrt.scene.materials.material import Reflectance, Share
from wrt.scene.textures import ColorSource
from wrt.values import number


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
        diffuse_transmission: share of the diffuse light that goes through a thin sheet instead of back; without effect
            on bodies.
        thin_walled: whether the surface is a thin sheet, not the boundary of a body.
        ior: refractive index of the dielectric, from 1.
        specular_tint: how far its reflection takes the hue of the base colour.
        sheen: strength of the light that fibres add at grazing angles.
        sheen_tint: how far this takes the hue of the base colour.
        flatness: blends the diffuse base to one that looks like light scattered below the surface.
        coat: strength of a clear coat, which reflects a quarter as much as varnish; without effect on thin sheets.
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
