"""A smooth metal: a mirror weighted by Fresnel reflectance, or by that of a thin film on it."""

import warp as wp

from wrt.kernels.bsdf.lobes.fresnel import fresnel_conductor, fresnel_schlick
from wrt.kernels.bsdf.lobes.thin_film import filmed_conductor, filmed_schlick
from wrt.kernels.bsdf.record import (
    Bsdf,
    BsdfSample,
    Model,
    SpecularLobes,
    mirror_lobe,
    mirror_sample,
    zero_evaluate,
    zero_pdf,
)

ETA = wp.constant(0)
K = wp.constant(1)
F0 = wp.constant(0)  # of "schlick"
# After these, of a film: its thickness, nm, and its index.


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirror direction, weighted by the complex index of refraction."""
    return mirror_sample(wo, fresnel_conductor(wo[2], bsdf.slots[ETA], bsdf.slots[K]))


@wp.func
def sample_schlick(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirror direction, weighted by the reflectance at normal incidence."""
    return mirror_sample(wo, fresnel_schlick(wo[2], bsdf.slots[F0]))


@wp.func
def specular(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return the mirror direction, weighted by the complex index of refraction."""
    return mirror_lobe(fresnel_conductor(wo[2], bsdf.slots[ETA], bsdf.slots[K]))


@wp.func
def specular_schlick(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return the mirror direction, weighted by the reflectance at normal incidence."""
    return mirror_lobe(fresnel_schlick(wo[2], bsdf.slots[F0]))


@wp.func
def sample_filmed(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirror direction, weighted by the complex index under a film."""
    thickness = bsdf.slots[2][0]
    return mirror_sample(wo, filmed_conductor(wo[2], bsdf.slots[ETA], bsdf.slots[K], thickness, bsdf.slots[3][0]))


@wp.func
def sample_filmed_schlick(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return the mirror direction, weighted by the reflectance at normal incidence under a film."""
    return mirror_sample(wo, filmed_schlick(wo[2], bsdf.slots[F0], bsdf.slots[1][0], bsdf.slots[2][0]))


@wp.func
def specular_filmed(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return the mirror direction, weighted by the complex index under a film."""
    return mirror_lobe(sample_filmed(bsdf, wo, wp.vec2(0.0), 0.0).weight)


@wp.func
def specular_filmed_schlick(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    """Return the mirror direction, weighted by the reflectance at normal incidence under a film."""
    return mirror_lobe(sample_filmed_schlick(bsdf, wo, wp.vec2(0.0), 0.0).weight)


def make_conductor(*options: str) -> Model:
    """Return the model with exact Fresnel equations, or Schlick's approximation ("schlick"), and a "film" or none.

    Raises:
        ValueError: for other options.
    """
    if options == ():
        return Model(zero_evaluate, zero_pdf, sample, slots=2, delta=True, specular=specular)
    if options == ("schlick",):
        return Model(zero_evaluate, zero_pdf, sample_schlick, slots=1, delta=True, specular=specular_schlick)
    if options == ("film",):
        return Model(zero_evaluate, zero_pdf, sample_filmed, slots=4, delta=True, specular=specular_filmed)
    if options == ("schlick", "film"):
        lobes = specular_filmed_schlick
        return Model(zero_evaluate, zero_pdf, sample_filmed_schlick, slots=3, delta=True, specular=lobes)
    raise ValueError(f"no conductor of {options!r}")
