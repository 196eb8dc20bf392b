"""Sheen: light reflected by fibres that stand on a surface, as on velvet and felt.

Estevez and Kulla, "Production friendly microfacet sheen BRDF", SIGGRAPH 2017 course: microfacets with normals near the
horizon, f = D G / (4 cosθi cosθo). KHR_materials_sheen uses it, with its roughness squared for their r, and without
their softer terminator, which is not reciprocal.

Smooth sheen reflects more light at grazing angles than it receives: twice as much at a roughness of 0.1. If either
direction's albedo exceeds 1, f is divided by the larger one, which is reciprocal and changes nothing else.
"""

import warp as wp

from wrt.kernels.bsdf.lobes.albedo_fits import SHEEN_CUT
from wrt.kernels.math.exponential import exponential
from wrt.kernels.sampling.warps import TWO_PI


@wp.func
def _curve(x: float, k: float) -> float:
    """Return ln Λ for cosθ = x ≤ 1/2 and k = (1 − r)²: a fit by Estevez and Kulla."""
    a = wp.lerp(21.5473, 25.3245, k)
    b = wp.lerp(3.82987, 3.32435, k)
    c = wp.lerp(0.19823, 0.16801, k)
    d = wp.lerp(-1.97760, -1.27393, k)
    e = wp.lerp(-4.32054, -4.85967, k)
    return a / (1.0 + b * wp.pow(x, c)) + d * x + e


@wp.func
def sheen_lambda(mu: float, roughness: float) -> float:
    """Return Λ at a cosine: their L(x), whose logarithm is point-mirrored above 1/2."""
    r = 1.0 - roughness * roughness
    k = r * r
    if mu < 0.5:
        return exponential(_curve(mu, k))
    return exponential(2.0 * _curve(0.5, k) - _curve(1.0 - wp.min(mu, 1.0), k))


@wp.func
def sheen(wo: wp.vec3, wi: wp.vec3, roughness: float, most_albedo: float) -> float:
    """Return f cosθi of white sheen for directions above the surface.

    Args:
        wo: towards the viewer.
        wi: towards the light.
        roughness: LEAST_SHEEN_ROUGHNESS to 1.
        most_albedo: the larger `sheen_albedo` of both directions.
    """
    h = wp.normalize(wo + wi)
    inverse = 1.0 / (roughness * roughness)
    sine2 = wp.min(h[0] * h[0] + h[1] * h[1], 1.0)
    d = (2.0 + inverse) * wp.pow(sine2, 0.5 * inverse) / TWO_PI
    mu_o = wp.max(wo[2], SHEEN_CUT)
    mu_i = wp.max(wi[2], SHEEN_CUT)
    hidden = sheen_lambda(mu_o, roughness) + sheen_lambda(mu_i, roughness)
    return d * wi[2] / (4.0 * mu_o * mu_i * (1.0 + hidden) * wp.max(most_albedo, 1.0))
