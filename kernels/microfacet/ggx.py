"""GGX, the distribution of Trowbridge and Reitz (1975), after Walter, Marschner, Li and Torrance (2007).

Anisotropic: shape = (αu, αv, 0), slopes scaled by αu along x and by αv along y. Smith's functions and the sampling
of visible normals are exact.
"""

import warp as wp

from wrt.kernels.core.elementary import sine_cosine
from wrt.kernels.sampling.warps import PI, TWO_PI


@wp.func
def d(m: wp.vec3, shape: wp.vec3) -> float:
    """Return D(m): Walter 2007, eq. 33, stretched along x and y (Heitz 2014, section 5)."""
    if m[2] <= 0.0:
        return 0.0
    x = m[0] / shape[0]
    y = m[1] / shape[1]
    s = x * x + y * y + m[2] * m[2]
    return 1.0 / (PI * shape[0] * shape[1] * s * s)


@wp.func
def smith_lambda(w: wp.vec3, shape: wp.vec3) -> float:
    """Return Λ(w), the ratio of masked to visible area (Heitz 2014, eq. 72).

    (√(1 + t) − 1) / 2, written without cancellation.
    """
    x = shape[0] * w[0]
    y = shape[1] * w[1]
    t = (x * x + y * y) / wp.max(w[2] * w[2], 1.0e-30)
    return 0.5 * t / (1.0 + wp.sqrt(1.0 + t))


@wp.func
def projected_area(w: wp.vec3, shape: wp.vec3) -> float:
    """Return the area of visible and masked facets projected along w, cosθ (1 + Λ(w)), finite at grazing angles."""
    x = shape[0] * w[0]
    y = shape[1] * w[1]
    return 0.5 * (w[2] + wp.sqrt(x * x + y * y + w[2] * w[2]))


@wp.func
def normal_pdf(wo: wp.vec3, m: wp.vec3, shape: wp.vec3) -> float:
    """Return the density of visible normals, G1(wo) max(0, wo·m) D(m) / cosθo (Heitz 2018, eq. 3)."""
    return d(m, shape) * wp.max(wp.dot(wo, m), 0.0) / projected_area(wo, shape)


@wp.func
def sample_normal(wo: wp.vec3, shape: wp.vec3, u: wp.vec2) -> wp.vec3:
    """Return a visible normal (Dupuy and Benyoub 2023, "Sampling visible GGX normals with spherical caps").

    Stretched to a roughness of 1 the surface is a hemisphere; it mirrors light from w uniformly into a spherical cap.
    A direction c in the cap gives the normal along w + c.
    """
    w = wp.normalize(wp.vec3(shape[0] * wo[0], shape[1] * wo[1], wo[2]))
    # c.z = (1 − u1)(1 + w.z) − w.z, which is 1 − below and above − 1; each form is precise where it is small.
    below = u[1] * (1.0 + w[2])
    above = (1.0 - w[2]) + (1.0 - u[1]) * (1.0 + w[2])
    r = wp.sqrt(wp.max(below * above, 0.0))
    turned = sine_cosine(TWO_PI * u[0])
    x = shape[0] * (w[0] + r * turned[1])
    y = shape[1] * (w[1] + r * turned[0])
    return wp.normalize(wp.vec3(x, y, (1.0 - u[1]) * (1.0 + w[2])))
