"""Extra roughness for the slopes that a filtered normal map averages away (LEAN mapping, Olano and Baker 2010).

From afar, microfacets stand on bumps too small to resolve. Their slopes add, and so do the variances of independent
slopes; along each axis Beckmann's distribution of roughness α has the variance α²/2.
"""

import warp as wp


@wp.func
def widened_alpha(alpha: float, variance: float) -> float:
    """Return the roughness of slopes with `variance` added to those of `alpha`: √(α² + 2σ²), at most 1."""
    if variance <= 0.0:
        return alpha
    return wp.min(wp.sqrt(alpha * alpha + 2.0 * variance), wp.max(alpha, 1.0))


@wp.func
def widened(shape: wp.vec3, variance: wp.vec2) -> wp.vec3:
    """Return the shape (αu, αv, 0) with variance added along each axis: exact for Gaussian slopes.

    GGX has no finite variance; its α keeps about the width of Beckmann's distribution. Filtered normal maps make it
    another distribution (`bumpy_ggx.py`), so this is for regularisation and multiple bounces.
    """
    return wp.vec3(widened_alpha(shape[0], variance[0]), widened_alpha(shape[1], variance[1]), shape[2])


@wp.func
def widened_evenly(shape: wp.vec3, variance: wp.vec2) -> wp.vec3:
    """Return the isotropic shape (α, α, 0), widened by the mean of both variances."""
    alpha = widened_alpha(shape[0], 0.5 * (variance[0] + variance[1]))
    return wp.vec3(alpha, alpha, shape[2])


@wp.func
def widened_abc(shape: wp.vec3, variance: wp.vec2) -> wp.vec3:
    """Return the shape (B, C, 0) with a wider peak and the same tail.

    Near the normal (1 + B θ²/2)^−C falls like the Gaussian with variance 1/(BC), so 1/B' = 1/B + C σ².
    """
    return wp.vec3(shape[0] / (1.0 + 0.5 * shape[0] * shape[1] * (variance[0] + variance[1])), shape[1], shape[2])


@wp.func
def not_widened(shape: wp.vec3, variance: wp.vec2) -> wp.vec3:
    """Return the shape unchanged."""
    return shape


WIDENED: dict[str, wp.Function] = {
    "ggx": widened,
    "beckmann": widened,
    "blinn-phong": widened_evenly,
    "abc": widened_abc,
}
"""By distribution; the shifted gamma distribution cannot be widened, as the host computes its normalisation."""
