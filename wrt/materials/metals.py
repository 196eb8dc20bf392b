"""Mirrors and metals."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.materials.material import Material, color_source, positive_color
from wrt.materials.microfacet import albedo_table_key, is_anisotropic, masking_for, roughness, shape_of
from wrt.presets import METAL_F0, metal_f0, metal_ior
from wrt.textures import ColorSource
from wrt.values import ColorLike, Vec3, boolean, color

COPPER_ETA: Vec3 = (0.200, 0.924, 1.102)
COPPER_K: Vec3 = (3.912, 2.452, 2.142)
"""η and k at 630, 532 and 465 nm."""


def _optics(
    eta: ColorLike | None, k: ColorLike | None, f0: ColorSource | None, metal: str | None
) -> tuple[Vec3 | None, Vec3 | None, ColorSource | None]:
    """Return η and k, or F0, of a metal that is given in one of three ways; by none of them it is copper.

    Raises:
        InputError: where it is given in two ways, or a value is out of range.
    """
    by_index = eta is not None or k is not None
    if by_index + (f0 is not None) + (metal is not None) > 1:
        raise InputError("a metal is given by eta and k, by f0 or by metal: choose one of them")
    if f0 is not None:
        return None, None, color_source(f0, "f0")
    if metal is not None:
        try:
            return *metal_ior(metal), None
        except InputError as error:
            # Of some, the reflectance alone is known.
            if str(metal).strip().lower() in METAL_F0:
                return None, None, metal_f0(metal)
            raise InputError(f"metal: {error}") from None
    return (
        positive_color(COPPER_ETA if eta is None else eta, "eta"),
        color(COPPER_K if k is None else k, "k"),
        None,
    )


def average_reflectance(eta: Vec3, k: Vec3) -> Vec3:
    """Return 2 ∫ F(μ) μ dμ of a metal per channel, the mean of its Fresnel reflectance over the hemisphere.

    Args:
        eta: real part of the refractive index.
        k: extinction coefficient.
    """
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu = 0.5 * (nodes[:, None] + 1.0)
    index = np.asarray(eta, np.float64) + 1j * np.asarray(k, np.float64)
    # Snell's law and the amplitudes with a complex index (Born and Wolf, 1.5 and 14.2).
    cos_t = np.sqrt(1.0 - (1.0 - mu**2) / index**2 + 0j)
    r_s = (mu - index * cos_t) / (mu + index * cos_t)
    r_p = (index * mu - cos_t) / (index * mu + cos_t)
    reflectance = 0.5 * (np.abs(r_s) ** 2 + np.abs(r_p) ** 2)
    red, green, blue = (weights[:, None] * mu * reflectance).sum(axis=0).tolist()
    return red, green, blue


@dataclass(frozen=True)
class Mirror(Material):
    """An ideal mirror with the same reflectance at every angle, on both sides.

    Attributes:
        reflectance: fraction of light reflected per channel, 0 to 1.
    """

    reflectance: ColorSource = 1.0

    type_name: ClassVar[str] = "mirror"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance",)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(reflectance=color_source(self.reflectance, "reflectance"))


@dataclass(frozen=True)
class Conductor(Material):
    """A perfectly smooth metal: mirror reflection weighted by Fresnel's equations.

    It is given by its complex refractive index, and reflects by the exact equations; or by its colour seen straight
    on, and reflects by Schlick's approximation to them (1994); or by name. The default is copper.

    Attributes:
        eta: real part of the refractive index per channel, relative to the air around it; copper's by default.
        k: extinction coefficient per channel; copper's by default.
        f0: reflectance at normal incidence per channel, 0 to 1, instead of eta and k.
        metal: a name in `wrt.presets.METAL_IOR` or a chemical symbol, instead of the others; it becomes eta and k,
            or f0 where only that is known.
    """

    eta: ColorLike | None = None
    k: ColorLike | None = None
    f0: ColorSource | None = None
    metal: str | None = None

    type_name: ClassVar[str] = "conductor"

    def __post_init__(self) -> None:
        super().__post_init__()
        eta, k, f0 = _optics(self.eta, self.k, self.f0, self.metal)
        self._set(eta=eta, k=k, f0=f0, metal=None)

    @property
    def model(self) -> str:
        """Exact, or by Schlick's approximation."""
        return "conductor" if self.f0 is None else "conductor:schlick"

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """η and k, or F0."""
        return _index_or_f0(self)


def _index_or_f0(metal: Conductor | RoughConductor) -> tuple[ColorSource, ...]:
    if metal.f0 is not None:
        return (metal.f0,)
    assert metal.eta is not None
    assert metal.k is not None
    return metal.eta, metal.k


@dataclass(frozen=True)
class RoughConductor(Material):
    """A rough metal: mirrors too small to see, whose normals follow a distribution.

    f = F D G / (4 cosθi cosθo) (Torrance and Sparrow 1967; Cook and Torrance 1982; Walter et al. 2007). What metal it
    is of is given as for `Conductor`.

    Attributes:
        alpha: roughness, 1e-4 to 1: about the root-mean-square slope of the facets times √2. A number; two, for
            brushed surfaces, along the directions of growing u and of growing v; or an image, whose red is the first
            and green the second. Some distributions have parameters of their own instead, always two numbers: "abc"
            B, from 0.1 on, and C, from 0 to 100 (Löw et al. 2012); "sgd" α, from 1e-5 to 10, and p, from 0 to 10
            (Bagher et al. 2012).
        eta, k, f0, metal: as for `Conductor`.
        distribution: of normals: "ggx" (Trowbridge and Reitz 1975), "beckmann", "blinn-phong", "abc" or "sgd".
        masking: how facets hide one another: "smith" (height-correlated) for "ggx" and "beckmann", "smith-separable"
            for these and "blinn-phong", "walter" (the rational fit of 2007) for the last two, "cook-torrance",
            "kelemen" or "implicit" for all. None is "smith" where it is known, else "cook-torrance". For
            "blinn-phong" what is not for all is borrowed from "beckmann", and good up to an alpha of 0.3.
        multiple_bounces: whether light that facets block bounces on (Kulla and Conty 2017), which makes rough metals
            brighter and more saturated. Otherwise it is lost, as in most renderers.
        reflectance: what reflected light is multiplied by per channel, 0 to 1, at each bounce; 1 in nature.
    """

    alpha: ColorSource = 0.1
    eta: ColorLike | None = None
    k: ColorLike | None = None
    f0: ColorSource | None = None
    metal: str | None = None
    distribution: str = "ggx"
    masking: str | None = None
    multiple_bounces: bool = False
    reflectance: ColorSource = 1.0

    type_name: ClassVar[str] = "rough-conductor"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(masking=masking_for(self.distribution, self.masking, self.alpha))
        eta, k, f0 = _optics(self.eta, self.k, self.f0, self.metal)
        self._set(
            alpha=roughness(self.alpha, self.distribution),
            eta=eta,
            k=k,
            f0=f0,
            metal=None,
            reflectance=color_source(self.reflectance, "reflectance"),
        )
        if boolean(self.multiple_bounces, "multiple_bounces"):
            albedo_table_key(self.alpha, self.distribution, self.masking)

    @property
    def model(self) -> str:
        """The combination of distribution, masking, Fresnel's equations and number of bounces."""
        fresnel = "conductor" if self.f0 is None else "schlick"
        name = f"rough_conductor:{self.distribution}:{self.masking}:{fresnel}"
        return f"{name}:multiple" if self.multiple_bounces else name

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """The shape of the distribution, the factor, η and k or F0; for multiple bounces the average reflectance."""
        values = (shape_of(self.alpha, self.distribution), self.reflectance, *_index_or_f0(self))
        if self.multiple_bounces and self.f0 is None:
            return *values, average_reflectance(self.eta, self.k)  # type: ignore[arg-type]
        return values

    @property
    def table_key(self) -> tuple[Hashable, ...] | None:
        """For multiple bounces, the table of what one bounce loses."""
        return albedo_table_key(self.alpha, self.distribution, self.masking) if self.multiple_bounces else None

    @property
    def needs_tangents(self) -> bool:
        """Whether its roughness along x and y differs."""
        return is_anisotropic(self.alpha, self.distribution)
