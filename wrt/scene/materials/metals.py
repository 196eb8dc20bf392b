"""Metals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wrt.errors import InputError
from wrt.linalg import gauss_legendre
from wrt.scene.description import Flag
from wrt.scene.materials.material import Filmed, Reflectance, color_source
from wrt.scene.materials.microfacet import Microfacets
from wrt.scene.materials.presets import by_name, has_reflectance_only, metal_f0, metal_ior, reflectance_f0
from wrt.scene.textures import ColorSource
from wrt.values import ColorLike, Vec3, color

COPPER_ETA: Vec3 = (0.200, 0.924, 1.102)
COPPER_K: Vec3 = (3.912, 2.452, 2.142)
"""η and k at 630, 532 and 465 nm."""


class _Metal(Filmed):
    """Base of metals, which are given in at most one of three ways; the default is copper."""

    eta: ColorLike | None
    k: ColorLike | None
    f0: ColorSource | str | None
    metal: str | None

    def __post_init__(self) -> None:
        super().__post_init__()
        eta, k, f0, metal = self.eta, self.k, self.f0, self.metal
        if (eta is not None or k is not None) + (f0 is not None) + (metal is not None) > 1:
            raise InputError("a metal is given by eta and k, by f0 or by metal: choose one of them")
        if isinstance(f0, str):
            f0 = by_name(reflectance_f0, f0, "f0")
        elif f0 is not None:
            f0 = color_source(f0, "f0")
        elif metal is not None and has_reflectance_only(metal):
            f0 = metal_f0(metal)
        elif metal is not None:
            eta, k = by_name(metal_ior, metal, "metal")
        else:
            eta = color(COPPER_ETA if eta is None else eta, "eta")
            if min(eta) <= 0.0:
                raise InputError(f"eta must be greater than 0 in each channel, not {eta}")
            k = color(COPPER_K if k is None else k, "k")
        self._set(eta=eta, k=k, f0=f0, metal=None)

    @property
    def _index_or_f0(self) -> tuple[ColorSource, ...]:
        return (self.eta, self.k) if self.f0 is None else (self.f0,)  # type: ignore[return-value]


def average_reflectance(eta: Vec3, k: Vec3) -> Vec3:
    """Return the hemispherical mean of the reflectance of a metal of index η + ik, 2 ∫ F(μ) μ dμ, per channel."""
    nodes, weights = gauss_legendre(64)
    mu = 0.5 * (nodes[:, None] + 1.0)
    index = np.asarray(eta, np.float64) + 1j * np.asarray(k, np.float64)
    # Snell's law and Fresnel's amplitudes for a complex index (Born and Wolf, 1.5 and 14.2).
    cos_t = np.sqrt(1.0 - (1.0 - mu**2) / index**2 + 0j)
    r_s = (mu - index * cos_t) / (mu + index * cos_t)
    r_p = (index * mu - cos_t) / (index * mu + cos_t)
    reflectance = 0.5 * (np.abs(r_s) ** 2 + np.abs(r_p) ** 2)
    red, green, blue = (weights[:, None] * mu * reflectance).sum(axis=0).tolist()
    return red, green, blue


@dataclass(frozen=True)
class Conductor(_Metal):
    """A perfectly smooth metal: mirror reflection weighted by Fresnel's equations.

    Give its complex refractive index, for the exact equations; its reflectance at normal incidence, for Schlick's
    approximation (1994); or its name. The default is copper.

    Attributes:
        eta: real part of the refractive index per channel, relative to the air around it; copper's by default.
        k: extinction coefficient per channel; copper's by default.
        f0: reflectance at normal incidence per channel, 0 to 1, instead of eta and k; or a name such as
            "gold", "silicon" or "gems" (wrt materials --presets).
        metal: a name or chemical symbol instead, such as "gold" (wrt materials --presets): its eta and k, or its f0.
    """

    eta: ColorLike | None = None
    k: ColorLike | None = None
    f0: ColorSource | str | None = None
    metal: str | None = None

    type_name: ClassVar[str] = "conductor"

    @property
    def model(self) -> str:
        options = ("schlick",) * (self.f0 is not None) + ("film",) * self.has_film
        return ":".join(("conductor", *options))

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """η and k, or F0; then those of a film."""
        return *self._index_or_f0, *self.film_slots


@dataclass(frozen=True)
class RoughConductor(_Metal, Microfacets):
    """A rough metal: microfacets that are perfect mirrors.

    f = F D G / (4 cosθi cosθo) (Torrance and Sparrow 1967; Cook and Torrance 1982; Walter et al. 2007). The metal is
    given as for `Conductor`.

    Attributes:
        alpha: roughness, 1e-4 to 1: about √2 times the root-mean-square slope of the facets. Two numbers, along u and
            v, for brushed surfaces; an image has them in red and green. For "abc" B, from 0.1, and C, 0 to 100 (Löw et
            al. 2012); for "sgd" α, 1e-5 to 10, and p, 0 to 10 (Bagher et al. 2012).
        eta, k, f0, metal: as for `Conductor`.
        distribution: of normals: "ggx" (Trowbridge and Reitz 1975), "beckmann", "blinn-phong", "abc" or "sgd".
        masking: shadowing and masking of facets: "smith" (height-correlated) for "ggx" and "beckmann",
            "smith-separable" for these and "blinn-phong", "walter" (2007) for the last two, the others for all. The
            default is "smith", else "cook-torrance". "blinn-phong" has "smith-separable" and "walter" of "beckmann", up
            to an alpha of 0.3.
        multiple_bounces: whether light scatters between facets more than once (Kulla and Conty 2017); otherwise it is
            lost.
        reflectance: multiplies reflected light per channel, 0 to 1, at each bounce; 1 in nature.
    """

    alpha: ColorSource = 0.1
    eta: ColorLike | None = None
    k: ColorLike | None = None
    f0: ColorSource | str | None = None
    metal: str | None = None
    distribution: str = "ggx"
    masking: str | None = None
    multiple_bounces: Flag = False
    reflectance: Reflectance = 1.0

    type_name: ClassVar[str] = "rough-conductor"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.multiple_bounces:
            self._refuse_film()

    @property
    def model(self) -> str:
        fresnel = "conductor" if self.f0 is None else "schlick"
        options = ("multiple",) * self.multiple_bounces + ("film",) * self.has_film
        return ":".join(("rough_conductor", self.distribution, str(self.masking), fresnel, *options))

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """The shape of the distribution, `reflectance`, η and k or F0; then a film, or the mean reflectance."""
        values = (self._shape, self.reflectance, *self._index_or_f0, *self.film_slots)
        if self.multiple_bounces and self.f0 is None:
            return *values, average_reflectance(self.eta, self.k)  # type: ignore[arg-type]
        return values
