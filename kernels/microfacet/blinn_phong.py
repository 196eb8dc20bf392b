"""Blinn's distribution (1977), a power of the cosine, normalised as in Walter et al. 2007.

shape = (α, α, 0). The exponent n = 2/α² − 2 gives the same peak and about the same width as Beckmann's distribution of
this α (Walter 2007, section 5.2): cosⁿθ = (1 + tan²θ)^(−n/2) → exp(−tan²θ / α²).
"""

import warp as wp

from wrt.kernels.core.elementary import expm1, exponential, log1p, logarithm, normal_of, tan2_theta
from wrt.kernels.microfacet import beckmann
from wrt.kernels.sampling.warps import INV_PI

smith_lambda = beckmann.smith_lambda
"""Beckmann's Λ as an approximation: Walter 2007, section 5.2, has a = √(n/2 + 1) / tanθ = 1 / (α tanθ)."""

stretched_cotangent = beckmann.stretched_cotangent


@wp.func
def d(m: wp.vec3, shape: wp.vec3) -> float:
    """Return D(m) = (n + 2) / 2π cosⁿθ (Walter 2007, eq. 30), computed from tan²θ."""
    if m[2] <= 0.0:
        return 0.0
    inv_alpha2 = 1.0 / (shape[0] * shape[0])
    return INV_PI * inv_alpha2 * exponential((1.0 - inv_alpha2) * log1p(tan2_theta(m)))


@wp.func
def normal_pdf(wo: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return D(m) cosθm."""
    return d(m, shape) * wp.max(m[2], 0.0)


@wp.func
def sample_normal(wo: wp.vec3, shape: wp.vec3, u: wp.vec2) -> wp.vec3:
    """Return a normal with density D cosθ: cosθ = u^(1/(n + 2)) (Walter 2007)."""
    return normal_of(expm1(-shape[0] * shape[0] * logarithm(1.0 - u[0])), u[1])
