"""Smooth boundaries between transparent media: refracting ones, thin panes, and ones that light passes unchanged.

Fresnel's exact equations, or Schlick's approximation of them, give the probabilities of reflection and refraction.
Refraction scales radiance by (n_i / n_t)², because the solid angle of a beam changes. With dispersion each channel has
an index of its own (`kernels/bsdf/lobes/dispersion.py`).

A pane has two parallel faces so close that light leaves at the point of entry. Light bounces between them any number of
times. With R the reflectance of one face and T = 1 − R, the pane reflects R + T²R + T²R³ + … = 2R / (1 + R) and
transmits the rest straight on (Stokes 1862, "On the intensity of the light reflected from or transmitted through a pile
of plates", without absorption).
"""

import warp as wp

from wrt.kernels.bsdf.lobes.dispersion import alone, channel_at, component, shares_of
from wrt.kernels.bsdf.lobes.fresnel import cos_transmitted_squared, fresnel_dielectric, fresnel_schlick
from wrt.kernels.core.bsdf import (
    Bsdf,
    BsdfSample,
    Model,
    SpecularLobes,
    delta_sample,
    mirror_lobe,
    mirror_sample,
    zero_evaluate,
    zero_pdf,
)
from wrt.kernels.core.specialise import specialised

IOR = wp.constant(0)  # n_inside / n_outside; of a pane, n over n around it
REFLECTANCE = wp.constant(1)  # factor of reflected light
TRANSMITTANCE = wp.constant(2)  # factor of refracted light, or of that which passes a pane
CHANNELS = wp.constant(3)  # of dispersion only: probabilities of the channels


@wp.func
def seen_from(inside_over_outside: float, front: bool) -> float:
    """Return n_t / n_i, the index on the far side over that on the viewer's; `front`: the viewer is in front."""
    return wp.where(front, inside_over_outside, 1.0 / inside_over_outside)


@wp.func
def refracted(wo: wp.vec3, eta: float) -> wp.vec3:
    """Return the refracted direction, unless there is total internal reflection; eta = n_t / n_i."""
    # Not 0, where the adjoint of the root is not finite.
    cos_t = wp.sqrt(wp.max(1.0e-12, cos_transmitted_squared(wo[2], eta)))
    scale = 1.0 / eta
    return wp.vec3(-wo[0] * scale, -wo[1] * scale, -cos_t)


@wp.func
def schlick(cos_i: float, eta: float) -> float:
    """Return R0 + (1 − R0)(1 − cosθ)⁵ for eta = n_t / n_i, with θ on the side of the lower index.

    Shirley and Marschner, "Fundamentals of Computer Graphics" (3rd edition, section 13.1), after Schlick (1994). Under
    total internal reflection it is 1.
    """
    cosine = cos_i
    if eta < 1.0:
        cos2_t = cos_transmitted_squared(cos_i, eta)
        if cos2_t <= 0.0:
            return 1.0
        cosine = wp.sqrt(cos2_t)
    r = (eta - 1.0) / (eta + 1.0)
    return fresnel_schlick(cosine, wp.vec3(r * r))[0]


@specialised()
def make_dielectric(*options: str) -> Model:
    """Return the model with Fresnel's equations, or Schlick's approximation ("schlick"), and "dispersive" or not.

    Raises:
        ValueError: for other options.
    """
    if options not in ((), ("schlick",), ("dispersive",), ("schlick", "dispersive")):
        raise ValueError(f"no dielectric of {options!r}")
    reflectance_of = schlick if "schlick" in options else fresnel_dielectric

    @wp.func
    def reflects(bsdf: Bsdf, wo: wp.vec3) -> float:
        return reflectance_of(wo[2], seen_from(bsdf.slots[IOR][0], bsdf.front))

    @wp.func
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
        s = mirror_sample(wo, bsdf.slots[REFLECTANCE])
        if u_lobe >= reflectance_of(wo[2], eta):
            scale = 1.0 / eta
            s.wi = refracted(wo, eta)
            s.weight = bsdf.slots[TRANSMITTANCE] * (scale * scale)
            s.eta = eta
        return s

    @wp.func
    def specular(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
        eta = seen_from(bsdf.slots[IOR][0], bsdf.front)
        reflectance = reflectance_of(wo[2], eta)
        lobes = mirror_lobe(bsdf.slots[REFLECTANCE] * reflectance)
        lobes.transmitted = bsdf.slots[TRANSMITTANCE] * ((1.0 - reflectance) / (eta * eta))
        lobes.through = refracted(wo, eta)
        lobes.eta = eta
        return lobes

    model = Model(
        zero_evaluate,
        zero_pdf,
        sample,
        slots=3,
        delta=True,
        transmits=True,
        specular=specular,
        reflects=reflects,
        index_slot=int(IOR),
    )
    return _dispersive(model, reflectance_of) if "dispersive" in options else model


def _dispersive(model: Model, reflectance_of: wp.Function) -> Model:
    """Return the model with an index for each channel: all are reflected together, but one alone is refracted.

    The probability of reflection is the mean over the channels. Ray trees, which choose nothing, bend all as green.
    """
    specular_one = model.specular

    @wp.func
    def by_channel(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
        index = bsdf.slots[IOR]
        return wp.vec3(
            reflectance_of(wo[2], seen_from(index[0], bsdf.front)),
            reflectance_of(wo[2], seen_from(index[1], bsdf.front)),
            reflectance_of(wo[2], seen_from(index[2], bsdf.front)),
        )

    @wp.func
    def reflects(bsdf: Bsdf, wo: wp.vec3) -> float:
        return wp.dot(bsdf.slots[CHANNELS], by_channel(bsdf, wo))

    @wp.func
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        shares = bsdf.slots[CHANNELS]
        index = bsdf.slots[IOR]
        reflected = by_channel(bsdf, wo)
        mean = wp.dot(shares, reflected)
        if u_lobe < mean:
            return mirror_sample(wo, wp.cw_mul(bsdf.slots[REFLECTANCE], reflected) / mean)
        through = shares_of(wp.cw_mul(shares, wp.vec3(1.0) - reflected))
        channel = channel_at(through, u[0])
        eta = seen_from(component(index, channel), bsdf.front)
        s = mirror_sample(wo, wp.vec3(0.0))
        if component(reflected, channel) < 1.0:
            # The probability is the channel's times its transmittance, which cancels.
            s.wi = refracted(wo, eta)
            s.weight = alone(
                channel, component(bsdf.slots[TRANSMITTANCE], channel) / (component(shares, channel) * eta * eta)
            )
            s.eta = eta
        return s

    @wp.func
    def specular(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
        bsdf.slots[IOR] = wp.vec3(bsdf.slots[IOR][1])
        return specular_one(bsdf, wo)

    return model._replace(sample=sample, specular=specular, reflects=reflects, slots=4, channels_slot=int(CHANNELS))


# --- Panes -----------------------------------------------------------------------------------------


@wp.func
def pane_reflectance(cos_i: float, eta: float) -> float:
    """Return a pane's reflectance at cosθi ≥ 0, for eta = n of the pane over n around it."""
    r = fresnel_dielectric(cos_i, eta)
    return 2.0 * r / (1.0 + r)


@wp.func
def _sample_pane(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    s = mirror_sample(wo, bsdf.slots[REFLECTANCE])
    if u_lobe >= pane_reflectance(wo[2], bsdf.slots[IOR][0]):
        s.wi = -wo
        s.weight = bsdf.slots[TRANSMITTANCE]
    return s


@wp.func
def _specular_pane(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
    reflectance = pane_reflectance(wo[2], bsdf.slots[IOR][0])
    lobes = mirror_lobe(bsdf.slots[REFLECTANCE] * reflectance)
    lobes.transmitted = bsdf.slots[TRANSMITTANCE] * (1.0 - reflectance)
    lobes.through = -wo
    return lobes


@wp.func
def _straight_through_pane(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
    return bsdf.slots[TRANSMITTANCE] * (1.0 - pane_reflectance(wo[2], bsdf.slots[IOR][0]))


THIN_DIELECTRIC = Model(
    zero_evaluate,
    zero_pdf,
    _sample_pane,
    slots=3,
    delta=True,
    transmits=True,
    specular=_specular_pane,
    straight=_straight_through_pane,
)


# --- Nothing ---------------------------------------------------------------------------------------


@wp.func
def _sample_null(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    return delta_sample(-wo, wp.vec3(1.0))


@wp.func
def _all_straight(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
    return wp.vec3(1.0)


NULL = Model(zero_evaluate, zero_pdf, _sample_null, slots=0, delta=True, transmits=True, straight=_all_straight)
