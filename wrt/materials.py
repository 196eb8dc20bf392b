"""Materials: how a surface reflects and transmits light.

Each class is a plain description. Its `model` names the file in `kernels/bsdf/` that holds its
`evaluate`, `sample` and `pdf`; `slot_names` are the colours those functions read, in their order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from wrt.errors import InputError
from wrt.textures import ColorSource, ImageTexture, VertexColor
from wrt.values import ColorLike, color, number


def _reflectance(value: ColorSource, name: str) -> ColorSource:
    if isinstance(value, (ImageTexture, VertexColor)):
        return value
    return color(value, name, maximum=1.0)


@dataclass(frozen=True)
class Material:
    """Base of all materials; not used by itself."""

    model: ClassVar[str] = ""
    slot_names: ClassVar[tuple[str, ...]] = ()

    @property
    def slots(self) -> tuple[ColorSource, ...]:
        """The colours that the model's device functions read, at most two: the attributes of `slot_names`."""
        return tuple(getattr(self, name) for name in self.slot_names)


@dataclass(frozen=True)
class Diffuse(Material):
    """Lambertian reflection, f = reflectance / π (Lambert 1760), on both sides.

    Attributes:
        reflectance: fraction of light reflected per channel, 0 to 1; 0.18 is photographers' middle grey.
    """

    reflectance: ColorSource = 0.18
    model: ClassVar[str] = "diffuse"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "reflectance", _reflectance(self.reflectance, "reflectance"))


@dataclass(frozen=True)
class Mirror(Material):
    """An ideal mirror with the same reflectance at every angle, on both sides.

    Attributes:
        reflectance: fraction of light reflected per channel, 0 to 1.
    """

    reflectance: ColorSource = 1.0
    model: ClassVar[str] = "mirror"
    slot_names: ClassVar[tuple[str, ...]] = ("reflectance",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "reflectance", _reflectance(self.reflectance, "reflectance"))


@dataclass(frozen=True)
class Conductor(Material):
    """A perfectly smooth metal: mirror reflection weighted by the exact Fresnel equations.

    The default is copper, η and k at 630, 532 and 465 nm.

    Attributes:
        eta: real part of the refractive index per channel, relative to the air around it.
        k: extinction coefficient per channel.
    """

    eta: ColorLike = (0.200, 0.924, 1.102)
    k: ColorLike = (3.912, 2.452, 2.142)
    model: ClassVar[str] = "conductor"
    slot_names: ClassVar[tuple[str, ...]] = ("eta", "k")

    def __post_init__(self) -> None:
        eta = color(self.eta, "eta")
        if min(eta) <= 0.0:
            raise InputError(f"eta must be greater than 0 in each channel, not {eta}")
        object.__setattr__(self, "eta", eta)
        object.__setattr__(self, "k", color(self.k, "k"))


@dataclass(frozen=True)
class Dielectric(Material):
    """A perfectly smooth boundary of a transparent body: exact Fresnel reflection and refraction.

    Triangles wind counter-clockwise seen from outside the body; outside is `exterior_ior`.

    Attributes:
        ior: refractive index inside; 1.5 is common glass.
        exterior_ior: refractive index outside; 1 is vacuum, and air to three digits.
    """

    ior: float = 1.5
    exterior_ior: float = 1.0
    model: ClassVar[str] = "dielectric"
    slot_names: ClassVar[tuple[str, ...]] = ("relative_ior",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "ior", number(self.ior, "ior", above=0.0))
        object.__setattr__(self, "exterior_ior", number(self.exterior_ior, "exterior_ior", above=0.0))

    @property
    def relative_ior(self) -> float:
        """Refractive index inside over outside."""
        return self.ior / self.exterior_ior
