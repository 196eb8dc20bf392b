"""A smooth metal: a mirror weighted by Fresnel reflectance."""

import warp as wp

from wrt.kernels.bsdf.lobes.fresnel import fresnel_conductor, fresnel_schlick
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


def make_conductor(fresnel: str = "conductor") -> Model:
    """Return the model with exact Fresnel equations ("conductor") or Schlick's approximation ("schlick").

    Raises:
        ValueError: for another name.
    """
    if fresnel == "conductor":
        return Model(zero_evaluate, zero_pdf, sample, slots=2, delta=True, specular=specular)
    if fresnel == "schlick":
        return Model(zero_evaluate, zero_pdf, sample_schlick, slots=1, delta=True, specular=specular_schlick)
    raise ValueError(f"no conductor of {fresnel!r}")
