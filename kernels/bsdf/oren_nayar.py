"""Rough diffuse reflection: the energy-preserving Oren-Nayar model.

Oren and Nayar, "Generalization of Lambert's reflectance model" (1994), model a surface of V-shaped grooves with
Lambertian facets. Their qualitative model, ρ/π (A + B max(0, cos Δφ) sin α tan β), gains energy where σ is small (a
white surface of σ = 0.2 reflects 1.5 % too much at grazing angles) and loses nearly half of it where σ is large. This
is the form of Portsmouth, Kutz and Hill, "EON: a practical energy-preserving rough diffuse BRDF", JCGT 14(1) (2025):
one bounce after Fujii (2012, "A tiny improvement of Oren-Nayar reflectance model"), whose albedo is known exactly, and
a term for all further bounces that returns the missing energy. White stays white; colours saturate with σ.

The first bounce is ρ/π A' (1 + r s/t), with s = sinθo sinθi cos Δφ, and t = max(cosθo, cosθi) where s > 0, else 1.
For s > 0 s/t is cos Δφ sin α tan β, so the roughness r = B/A gives the published model up to its scale.
"""

import warp as wp

from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, no_sample
from wrt.kernels.core.elementary import sine_cosine
from wrt.kernels.sampling.warps import INV_PI, TWO_PI

REFLECTANCE = wp.constant(0)
SIGMA = wp.constant(1)  # standard deviation of the facets' slope angle, radians

# The albedo of one bounce is A' (1 + r G(μ)/π) where ρ is 1. A' = 1 / (1 + C1 r) makes it 1 at grazing angles;
# its average over the hemisphere is A' (1 + C2 r).
_C1 = wp.constant(0.287793409210806)  # 1/2 − 2/(3π)
_C2 = wp.constant(0.0724882124569225)  # 2/3 − 28/(15π)


@wp.struct
class _Cosine:
    """A clamped cosine, transformed by (x, y, z) -> (a x + b z, c y, d x + z); the viewer is at y = 0, x > 0.

    `axis` is that x axis in the local frame, `uniform` the share of uniform samples, and `clipped` the share of the
    projected hemisphere that stays above the horizon.
    """

    axis: wp.vec2
    a: float
    b: float
    c: float
    d: float
    clipped: float
    uniform: float


@wp.func
def roughness_of(sigma: float) -> float:
    """Return r = B/A, A = 1 − σ²/2 / (σ² + 0.33) and B = 0.45 σ² / (σ² + 0.09) (Oren and Nayar 1994)."""
    s2 = sigma * sigma
    return (0.45 * s2 / (s2 + 0.09)) / (1.0 - 0.5 * s2 / (s2 + 0.33))


@wp.func
def missing_albedo(mu: float) -> float:
    """Return 1 − the albedo of one bounce at ρ = 1, over r A': C1 − G(μ)/π, from 0.287793 down to 0."""
    s = wp.sqrt(wp.max(0.0, 1.0 - mu * mu))
    # The paper's (1 − s³)/μ equals μ (1 + s + s²)/(1 + s), which does not cancel at grazing angles.
    g = s * (wp.acos(wp.min(mu, 1.0)) - s * mu) + (s * mu * (1.0 + s + s * s) / (1.0 + s) - s) * (2.0 / 3.0)
    return wp.max(0.0, _C1 - INV_PI * g)


@wp.func
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return f |cosθi|."""
    if wi[2] <= 0.0:
        return wp.vec3(0.0)
    rho = bsdf.slots[REFLECTANCE]
    r = roughness_of(bsdf.slots[SIGMA][0])
    a = 1.0 / (1.0 + _C1 * r)
    # One bounce: the cosine is multiplied into s/t, which is unbounded at grazing angles.
    s = wo[0] * wi[0] + wo[1] * wi[1]
    slope = s * wi[2]
    if s > 0.0:
        slope = s * (wi[2] / wp.max(wo[2], wi[2]))
    single = a * (wi[2] + r * slope)
    # All others, as Kulla and Conty (2017) for metals, with 1 − albedo written as r A' times `missing_albedo`.
    average = a * (1.0 + _C2 * r)
    share = wi[2] * a * r * missing_albedo(wo[2]) * missing_albedo(wi[2]) / (_C1 - _C2)
    one = wp.vec3(1.0)
    multiple = wp.cw_div(rho * average, one - rho * (1.0 - average)) * share
    return wp.cw_mul(rho, wp.vec3(single) + multiple) * INV_PI


@wp.func
def _cosine_of(wo: wp.vec3, r: float) -> _Cosine:
    """Return the lobe fitted to the model for a viewer; the numbers are from the paper's listing."""
    mu = wo[2]
    lobe = _Cosine()
    lobe.axis = wp.vec2(1.0, 0.0)
    if wo[0] != 0.0 or wo[1] != 0.0:
        lobe.axis = wp.normalize(wp.vec2(wo[0], wo[1]))
    lobe.a = 1.0 + r * (0.303392 + (-0.518982 + 0.111709 * mu) * mu + (-0.276266 + 0.335918 * mu) * r)
    lobe.b = r * (-1.16407 + 1.15859 * mu + (0.150815 - 0.150105 * mu) * r) / (mu * mu * mu - 1.43545)
    lobe.c = 1.0 + (0.20013 + (-0.506373 + 0.261777 * mu) * mu) * r
    lobe.d = r * (0.540852 + (-1.01625 + 0.475392 * mu) * mu) / (-1.0743 + (0.0725628 + mu) * mu)
    lobe.clipped = 0.5 + 0.5 / wp.sqrt(lobe.d * lobe.d + 1.0)
    lobe.uniform = wp.pow(r, 0.1) * (0.162925 + mu * (-0.372058 + (0.538233 - 0.290822 * mu) * mu))
    return lobe


@wp.func
def _density(lobe: _Cosine, wi: wp.vec3) -> float:
    """Return the density of the mixture of the transformed cosine and uniform directions."""
    x = lobe.axis[0] * wi[0] + lobe.axis[1] * wi[1]
    y = lobe.axis[0] * wi[1] - lobe.axis[1] * wi[0]
    # The adjugate of the transform is its inverse up to the determinant.
    minor = lobe.a - lobe.b * lobe.d
    h = wp.vec3(lobe.c * (x - lobe.b * wi[2]), minor * y, lobe.c * (lobe.a * wi[2] - lobe.d * x))
    k = lobe.c * minor / wp.dot(h, h)
    cosine = k * k * wp.max(h[2], 0.0) * (INV_PI / lobe.clipped)
    return lobe.uniform / TWO_PI + (1.0 - lobe.uniform) * cosine


@wp.func
def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of `sample` per solid angle."""
    if wi[2] <= 0.0:
        return 0.0
    return _density(_cosine_of(wo, roughness_of(bsdf.slots[SIGMA][0])), wi)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return a direction by clipped linearly transformed cosine sampling, or a uniform one."""
    lobe = _cosine_of(wo, roughness_of(bsdf.slots[SIGMA][0]))
    turned = sine_cosine(TWO_PI * u[1])
    x = float(0.0)
    y = float(0.0)
    z = float(0.0)
    if u_lobe < lobe.uniform:
        z = 1.0 - u[0]
        radius = wp.sqrt(wp.max(0.0, 1.0 - z * z))
        x = radius * turned[1]
        y = radius * turned[0]
    else:
        # Move a point of the disk into the part that the horizon's preimage leaves.
        radius = wp.sqrt(u[0])
        v = radius * turned[0]
        t = -wp.lerp(wp.sqrt(wp.max(0.0, 1.0 - v * v)), radius * turned[1], lobe.clipped)
        h = wp.sqrt(wp.max(0.0, 1.0 - t * t - v * v))
        x = lobe.a * t + lobe.b * h
        y = lobe.c * v
        z = lobe.d * t + h
    s = no_sample()
    s.wi = wp.normalize(wp.vec3(lobe.axis[0] * x - lobe.axis[1] * y, lobe.axis[1] * x + lobe.axis[0] * y, z))
    if s.wi[2] > 0.0:
        s.pdf = _density(lobe, s.wi)
        s.weight = evaluate(bsdf, wo, s.wi) / s.pdf
    return s


OREN_NAYAR = Model(evaluate, pdf, sample, slots=2, matt=True)
