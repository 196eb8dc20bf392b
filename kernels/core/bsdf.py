"""The interface of reflection models: their input, their samples, and the model itself."""

from typing import NamedTuple

import warp as wp

MAX_SLOTS = 16
"""The most values (colours or numbers) that a model may read."""

slot_values = wp.types.matrix(shape=(MAX_SLOTS, 3), dtype=float)


@wp.struct
class Bsdf:
    """A material at one point: its model and the values there.

    Row k of `slots` is a colour, or a number repeated three times; each model's file names its rows. The frame's z is
    the shading normal and faces the viewer; `front` is true on the front of the surface. A model's table begins at
    `table` in `tables`. `normal_variance` is the variance of slopes along the frame's x and y that a
    filtered normal map has averaged away; a rough model adds it to its roughness (`kernels/microfacet/widening.py`).
    """

    model: int
    front: bool
    slots: slot_values
    tables: wp.array(dtype=float)
    table: int
    normal_variance: wp.vec2


@wp.struct
class BsdfSample:
    """A direction sampled from a BSDF.

    `weight` is f |cosθi| / pdf, zero for no direction; `pdf` is per solid angle, and 0 for a `delta` direction; `eta`
    is n_t / n_i, and 1 except on refraction.
    """

    wi: wp.vec3
    weight: wp.vec3
    pdf: float
    delta: bool
    eta: float


@wp.struct
class SpecularLobes:
    """The mirrored direction and the direction `through` a smooth surface.

    Weights are f |cosθi| without its delta; `eta` is n_t / n_i for `through`.
    """

    reflected: wp.vec3
    transmitted: wp.vec3
    through: wp.vec3
    eta: float


class Model(NamedTuple):
    """A reflection model: three device functions in the local frame whose z faces the viewer.

    Attributes:
        evaluate: (bsdf, wo, wi) -> vec3, f |cosθi| without delta lobes.
        pdf: (bsdf, wo, wi) -> float, the density of `sample` per solid angle, without delta lobes.
        sample: (bsdf, wo, u: vec2, u_lobe: float) -> BsdfSample.
        slots: the number of values that it reads, at most MAX_SLOTS.
        delta: whether it has delta lobes only, so that `evaluate` is zero and sampling lights useless.
        transmits: whether light can come through the surface.
        matt: whether no lobe is centred on the mirror direction: normal maps may then be steeper.
        widens: whether it adds `Bsdf.normal_variance` to its roughness; only then can normal maps be filtered.
        specular: (bsdf, wo) -> SpecularLobes, the delta directions for ray trees; None for models without.
        jitters: whether ray trees send rays of its `sample` on from it.
        straight: (bsdf, wo) -> vec3, the share of light that comes straight through from −wo, for models that transmit
            in no other way and sample this as delta; None for all others. Shadow rays then pass.
        reflects: (bsdf, wo) -> float, for models that reflect or refract: `sample` reflects if u_lobe is less than it.
        index_slot: the row of the refractive index inside over outside, for nested bodies; −1 for none.
        channels_slot: the row of the probabilities of the channels, if that index is one for each channel
            (`kernels/bsdf/lobes/dispersion.py`); −1 without dispersion.
        is_caster: whether all its lobes are so narrow that photons leave it as they leave smooth glass (`caster_name`).
        coat_slot: the row of a coat that has normals of its own (`kernels/bsdf/lobes/coats.py`); −1 for none.
        at: (bsdf, surface) -> Bsdf, with slots made from position, normals and texture coordinates; None if none are.
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
    jitters: bool = False
    straight: wp.Function | None = None
    reflects: wp.Function | None = None
    index_slot: int = -1
    channels_slot: int = -1
    coat_slot: int = -1
    is_caster: bool = False
    at: wp.Function | None = None


@wp.func
def no_sample() -> BsdfSample:
    """Return a sample without a direction."""
    s = BsdfSample()
    s.wi = wp.vec3(0.0, 0.0, 1.0)
    s.eta = 1.0
    return s


@wp.func
def delta_sample(wi: wp.vec3, weight: wp.vec3) -> BsdfSample:
    """Return a direction that is the only one possible, with this weight."""
    s = no_sample()
    s.wi = wi
    s.weight = weight
    s.delta = True
    return s


@wp.func
def mirror_sample(wo: wp.vec3, reflectance: wp.vec3) -> BsdfSample:
    """Return the ideal mirror direction with this weight."""
    return delta_sample(wp.vec3(-wo[0], -wo[1], wo[2]), reflectance)


@wp.func
def mirror_lobe(reflectance: wp.vec3) -> SpecularLobes:
    """Return the ideal mirror direction as the only lobe."""
    lobes = SpecularLobes()
    lobes.reflected = reflectance
    lobes.through = wp.vec3(0.0, 0.0, -1.0)
    lobes.eta = 1.0
    return lobes


@wp.func
def no_lobes(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return no delta directions."""
    return mirror_lobe(wp.vec3(0.0))


@wp.func
def zero_evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return zero, the value of a model with delta lobes only."""
    return wp.vec3(0.0)


@wp.func
def zero_pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return zero, the density of a model with delta lobes only."""
    return 0.0
