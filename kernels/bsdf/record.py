"""What a reflection model is given, what it answers, and what a model is."""

from typing import NamedTuple

import warp as wp

MAX_SLOTS = 16
"""The most values (colours or numbers) that one model may read."""

slot_values = wp.types.matrix(shape=(MAX_SLOTS, 3), dtype=float)


@wp.struct
class Bsdf:
    """A material at one point: its model and the values there.

    Row k of `slots` is a colour, or a number repeated three times; each model's file names its rows.
    The frame's z is the shading normal and faces the viewer; `front` tells whether that is the front
    of the surface. A model that reads a table finds it in `tables` from `table` on. `normal_variance` is
    that of the slopes along the frame's x and y which a filtered normal map has averaged away: a rough model
    adds it to its roughness (`kernels/microfacet/widening.py`).
    """

    model: int
    front: bool
    slots: slot_values
    tables: wp.array(dtype=float)
    table: int
    normal_variance: wp.vec2


@wp.struct
class BsdfSample:
    """A direction drawn from a BSDF.

    `weight` is f |cosθi| / pdf and zero where there is none; `pdf` is per solid angle and 0 where
    `delta` says that the direction was the only one possible; `eta` is n_t / n_i, 1 but on refraction.
    """

    wi: wp.vec3
    weight: wp.vec3
    pdf: float
    delta: bool
    eta: float


@wp.struct
class SpecularLobes:
    """The single directions that light goes in at a smooth surface: mirrored, and `through`.

    Weights are f |cosθi| without its delta; `eta` is n_t / n_i for `through`.
    """

    reflected: wp.vec3
    transmitted: wp.vec3
    through: wp.vec3
    eta: float


class Model(NamedTuple):
    """A reflection model: three device functions in the local frame whose z faces the viewer.

    Attributes:
        evaluate: (bsdf, wo, wi) -> vec3, f |cosθi| without what goes in single directions only.
        pdf: (bsdf, wo, wi) -> float, the density per solid angle of what `sample` draws of that.
        sample: (bsdf, wo, u: vec2, u_lobe: float) -> BsdfSample.
        slots: how many values it reads, at most MAX_SLOTS.
        delta: whether `evaluate` is zero everywhere, so that sampling lights for it is useless.
        transmits: whether light may come through the surface.
        matt: whether nothing in it goes mainly in the mirror direction: normal maps may then be steeper.
        widens: whether it adds `Bsdf.normal_variance` to its roughness; only then normal maps may be filtered.
        specular: (bsdf, wo) -> SpecularLobes, the single directions for ray trees; None where it has none.
        straight: (bsdf, wo) -> vec3, the share of light that comes straight through from −wo, for models that let
            none through in any other way, and `sample` as delta; None for all others. Shadow rays then pass.
        index_slot: which value is the refractive index inside over outside, for bodies within one another; −1: none.
    """

    evaluate: wp.Function
    pdf: wp.Function
    sample: wp.Function
    slots: int
    delta: bool = False
    transmits: bool = False
    matt: bool = False
    widens: bool = False
    specular: wp.Function | None = None
    straight: wp.Function | None = None
    index_slot: int = -1


@wp.func
def no_sample() -> BsdfSample:
    """Return that there is no direction to go in."""
    s = BsdfSample()
    s.wi = wp.vec3(0.0, 0.0, 1.0)
    s.weight = wp.vec3(0.0)
    s.pdf = 0.0
    s.delta = False
    s.eta = 1.0
    return s


@wp.func
def mirror_sample(wo: wp.vec3, reflectance: wp.vec3) -> BsdfSample:
    """Return the ideal mirror direction."""
    s = BsdfSample()
    s.wi = wp.vec3(-wo[0], -wo[1], wo[2])
    s.weight = reflectance
    s.pdf = 0.0
    s.delta = True
    s.eta = 1.0
    return s


@wp.func
def mirror_lobe(reflectance: wp.vec3) -> SpecularLobes:
    """Return the ideal mirror direction alone."""
    lobes = SpecularLobes()
    lobes.reflected = reflectance
    lobes.transmitted = wp.vec3(0.0)
    lobes.through = wp.vec3(0.0, 0.0, -1.0)
    lobes.eta = 1.0
    return lobes


@wp.func
def no_lobes(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return that nothing goes in single directions."""
    return mirror_lobe(wp.vec3(0.0))


@wp.func
def zero_evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return the value of a BSDF that is not zero in single directions only, in any other."""
    return wp.vec3(0.0)


@wp.func
def zero_pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of a BSDF that samples single directions only, in any other."""
    return 0.0
