"""A rough boundary between two transparent media: microfacets that each reflect and refract.

Walter, Marschner, Li and Torrance, "Microfacet Models for Refraction through Rough Surfaces" (2007). A normal m
is drawn for the viewer, Fresnel's equations at m choose between reflection and refraction there. Equations are
of that paper, with its i and o the other way round where it says so: here light comes from wi, in the medium of
index n_t where it is refracted, and radiance is wanted towards wo, in that of index n_i; eta = n_t / n_i.

Radiance is scaled by (n_i / n_t)² on refraction, as in `kernels/bsdf/dielectric.py`: eq. 21 has it, η_o = n_i.

Where the indices are equal nothing is refracted and every half vector is none. Within INDEX_MATCHED of that the
surface is one that light passes straight through.
"""

import functools

import warp as wp

from wrt.kernels.bsdf.dielectric import relative_ior
from wrt.kernels.bsdf.record import Bsdf, BsdfSample, Model, no_sample
from wrt.kernels.fresnel import cos_transmitted_squared, fresnel_dielectric
from wrt.kernels.microfacet import LEAST_ALPHA, make_microfacet

# Slot 0 is the relative index, as in kernels/bsdf/dielectric.py.
REFLECTANCE = wp.constant(1)  # what reflected light is multiplied by
TRANSMITTANCE = wp.constant(2)  # what refracted light is multiplied by
ALPHA = wp.constant(3)  # roughness along x and y

INDEX_MATCHED = wp.constant(1.0e-3)
"""|eta − 1| below which a boundary counts as none. Half vectors lose digits as 1 / |eta − 1|; what such a boundary
reflects is 2.5e-7 at normal incidence and 1 % at 86 degrees, and it bends light by less than a thousandth."""


@wp.func
def is_matched(eta: float) -> bool:
    """Return whether the two media are as good as one."""
    return wp.abs(eta - 1.0) < INDEX_MATCHED


@wp.func
def roughness(bsdf: Bsdf) -> wp.vec3:
    """Return the shape of the distribution of normals."""
    alpha = bsdf.slots[ALPHA]
    return wp.vec3(wp.max(alpha[0], LEAST_ALPHA), wp.max(alpha[1], LEAST_ALPHA), 0.0)


@wp.func
def microfacet_between(wo: wp.vec3, wi: wp.vec3, eta: float) -> wp.vec3:
    """Return the normal, above the surface, of microfacets that send light from wi to wo; zero where there is none.

    By reflection (eq. 13) or, where wi is below the surface, refraction (eq. 16). Both directions must see the side
    of the microfacet that they see of the surface.
    """
    m = wp.normalize(wo + wi * wp.where(wi[2] > 0.0, 1.0, eta))
    m = wp.where(m[2] < 0.0, -m, m)
    if wp.dot(wo, m) <= 0.0 or wp.dot(wi, m) * wi[2] <= 0.0:
        return wp.vec3(0.0)
    return m


@wp.func
def refracted_density(cos_o: float, cos_i: float, eta: float) -> float:
    """Return dω_m / dω_i of refraction, eta² cosθi / (cosθo − eta cosθi)² (eq. 17), both cosines to m and positive.

    The denominator's root is (1 − eta²) / (cosθo + eta cosθi) by Snell's law: no difference of near numbers.
    """
    root = eta * (cos_o + eta * cos_i) / ((1.0 - eta) * (1.0 + eta))
    return root * root * cos_i


@functools.cache
def make_rough_dielectric(distribution: str = "ggx", masking: str = "smith") -> Model:
    """Return the model for a distribution of normals and a masking (see `kernels/microfacet/`)."""
    microfacet = make_microfacet(distribution, masking)
    d, g, normal_pdf, sample_normal = microfacet.d, microfacet.g, microfacet.normal_pdf, microfacet.sample_normal
    suffix = f"rough_dielectric_{distribution}_{masking}".replace("-", "_")

    @wp.func(name=f"evaluate_{suffix}")
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        eta = relative_ior(bsdf)
        if is_matched(eta):
            return wp.vec3(0.0)
        m = microfacet_between(wo, wi, eta)
        cos_o = wp.dot(wo, m)
        if cos_o <= 0.0:
            return wp.vec3(0.0)
        shape = roughness(bsdf)
        reflected = fresnel_dielectric(cos_o, eta)
        value = d(m, shape) * g(wo, wi, m, shape) / wo[2]
        if wi[2] > 0.0:
            return bsdf.slots[REFLECTANCE] * (0.25 * reflected * value)  # eq. 20
        scale = cos_o * refracted_density(cos_o, -wp.dot(wi, m), eta) / (eta * eta)
        return bsdf.slots[TRANSMITTANCE] * ((1.0 - reflected) * value * scale)  # eq. 21

    @wp.func(name=f"pdf_{suffix}")
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        eta = relative_ior(bsdf)
        if is_matched(eta):
            return 0.0
        m = microfacet_between(wo, wi, eta)
        cos_o = wp.dot(wo, m)
        if cos_o <= 0.0:
            return 0.0
        reflected = fresnel_dielectric(cos_o, eta)
        density = normal_pdf(wo, m, roughness(bsdf))
        if wi[2] > 0.0:
            return reflected * density / (4.0 * cos_o)  # eq. 14 and 38
        return (1.0 - reflected) * density * refracted_density(cos_o, -wp.dot(wi, m), eta)  # eq. 17 and 38

    @wp.func(name=f"sample_{suffix}")
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        s = no_sample()
        eta = relative_ior(bsdf)
        if is_matched(eta):
            s.wi = -wo
            s.weight = bsdf.slots[TRANSMITTANCE]
            s.delta = True
            return s
        shape = roughness(bsdf)
        m = sample_normal(wo, shape, u)
        cos_o = wp.dot(wo, m)
        density = normal_pdf(wo, m, shape)
        if cos_o <= 0.0 or density <= 0.0:
            return s
        reflected = fresnel_dielectric(cos_o, eta)
        if u_lobe < reflected:
            wi = m * (2.0 * cos_o) - wo  # eq. 39
            if wi[2] <= 0.0:
                return s
            s.weight = bsdf.slots[REFLECTANCE]
            s.pdf = reflected * density / (4.0 * cos_o)
        else:
            cos_t = wp.sqrt(wp.max(cos_transmitted_squared(cos_o, eta), 0.0))
            wi = m * (cos_o / eta - cos_t) - wo / eta  # eq. 40
            if wi[2] >= 0.0:
                return s
            s.weight = bsdf.slots[TRANSMITTANCE] / (eta * eta)
            s.pdf = (1.0 - reflected) * density * refracted_density(cos_o, cos_t, eta)
            s.eta = eta
        s.wi = wp.normalize(wi)
        s.weight = s.weight * (d(m, shape) * g(wo, s.wi, m, shape) * cos_o / (wo[2] * density))  # eq. 41
        return s

    return Model(evaluate, pdf, sample, slots=4, transmits=True)
