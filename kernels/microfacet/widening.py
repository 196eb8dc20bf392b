"""Roughness that takes up what a filtered normal map has averaged away (LEAN mapping, Olano and Baker 2010).

Seen from afar, microfacets stand on bumps too small to tell apart. The slope of one is the sum of both slopes, and the
variances of independent slopes add; along each axis Beckmann's distribution of roughness α has the variance α²/2.
"""

import warp as wp


@wp.func
def widened_alpha(alpha: float, variance: float) -> float:
    """Return the roughness of slopes that have `variance` more than those of `alpha`: √(α² + 2σ²), at most 1."""
    if variance <= 0.0:
        return alpha
    return wp.min(wp.sqrt(alpha * alpha + 2.0 * variance), wp.max(alpha, 1.0))


@wp.func
def widened(shape: wp.vec3, variance: wp.vec2) -> wp.vec3:
    """Return the shape (αu, αv, 0) for more variance along each axis: exact for Gaussian slopes.

    GGX's have no variance; by its α it keeps about the width that Beckmann's distribution has.
    """
    return wp.vec3(widened_alpha(shape[0], variance[0]), widened_alpha(shape[1], variance[1]), shape[2])


@wp.func
def widened_evenly(shape: wp.vec3, variance: wp.vec2) -> wp.vec3:
    """Return the shape (α, α, 0) of a distribution that is the same along both axes, for the mean of both variances."""
    alpha = widened_alpha(shape[0], 0.5 * (variance[0] + variance[1]))
    return wp.vec3(alpha, alpha, shape[2])


@wp.func
def widened_abc(shape: wp.vec3, variance: wp.vec2) -> wp.vec3:
    """Return the shape (B, C, 0) whose peak is wider; the tail stays.

    Near the normal (1 + B θ²/2)^−C falls like the Gaussian of variance 1/(BC), so that 1/B' = 1/B + C σ².
    """
    return wp.vec3(shape[0] / (1.0 + 0.5 * shape[0] * shape[1] * (variance[0] + variance[1])), shape[1], shape[2])


@wp.func
def not_widened(shape: wp.vec3, variance: wp.vec2) -> wp.vec3:
    """Return the shape as it is."""
    return shape


WIDENED: dict[str, wp.Function] = {
    "ggx": widened,
    "beckmann": widened,
    "blinn-phong": widened_evenly,
    "abc": widened_abc,
}
"""By distribution; the shifted gamma distribution cannot be widened, as its normalisation comes from the host."""
