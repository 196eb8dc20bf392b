"""Closed-form albedos of layers: the share of light from a direction that a layer itself reflects.

The rest is left for the layers below. The polynomials are fitted by `scripts/albedo_fits.py`, which explains their
variables; they are nowhere below the true albedo, so that no energy is gained.

Functions that reflection models call for each direction are not inlined: they were a third of a kernel for GPUs, which
waited for its code, and the scalar kernel of CPUs is a tenth faster, too.
"""

import warp as wp

LEAST_SHEEN_ROUGHNESS = wp.constant(0.07)
SHEEN_CUT = wp.constant(0.01)
"""Smaller cosines are clamped to this in the shadowing of sheen, whose fit by Estevez and Kulla has a pole at 0."""

_LOG_LEAST_SHEEN = wp.constant(-2.65926003693278)


@wp.func
def _quintic(y: float, a: float, b: float, c: float, d: float, e: float, f: float) -> float:
    """Return a + b y + c y² + d y³ + e y⁴ + f y⁵."""
    return a + y * (b + y * (c + y * (d + y * (e + y * f))))


@wp.func
def specular_albedo(mu: float, alpha: float) -> wp.vec2:
    """Return (W, G) of GGX with height-correlated masking, for light at a cosine mu to the normal.

    With Schlick's Fresnel f0 + (f90 − f0)(1 − wo·m)⁵ the albedo is f0 (W − G) + f90 G. W is at most 0.004 too large
    and G 0.009.
    """
    y = 2.0 * wp.sqrt(alpha) - 1.0
    x = 2.0 * mu / (mu + 0.5 * alpha) - 1.0
    w = _quintic(y, -0.2425968, -0.3047107, -0.3647025, -0.5327733, -0.2139124, 0.06181805)
    w = w * x + _quintic(y, -0.2046581, -0.1551467, -0.7860546, -1.170777, -0.6121565, -0.06915594)
    w = w * x + _quintic(y, 0.3026293, 0.4318248, -0.1890136, -0.7020795, -0.8440896, -0.4032993)
    w = w * x + _quintic(y, 0.323678, 0.260339, 0.5693153, 0.08577408, -0.6081619, -0.3619241)
    w = w * x + _quintic(y, 0.05377755, -0.1183093, 0.2365817, 0.1631142, -0.1025028, -0.07760382)
    w = w * x + _quintic(y, -0.008740595, -0.05440078, -0.1154171, 0.01941839, 0.1145004, 0.03973164)
    w = w * x + _quintic(y, -0.1271698, -0.1196863, -0.2356272, -0.1030197, 0.08665128, 0.06458507)
    w = w * x + _quintic(y, 0.8792693, -0.1594024, -0.2240994, -0.1108726, 0.03267117, 0.03625494)
    w = wp.clamp(w, 0.0, 1.0)

    x = 2.0 * wp.sqrt(0.5 * (mu + wp.sqrt(mu * mu + alpha * alpha * (1.0 - mu * mu)))) - 1.0
    g = _quintic(y, -0.8877045, -0.01937449, 7.109345, 8.710485, 2.114577, -0.3910584)
    g = g * x + _quintic(y, 0.8733367, 0.8590037, -7.422551, -17.16276, -11.43372, -1.790495)
    g = g * x + _quintic(y, 0.09533218, -1.410688, -0.7879859, 8.90379, 12.9999, 4.724339)
    g = g * x + _quintic(y, -0.2829705, 0.7017793, 2.078331, 0.1817001, -3.764114, -2.60408)
    g = g * x + _quintic(y, -0.2752381, 0.2094935, -0.7154239, -1.143, -0.3153553, 0.1393074)
    g = g * x + _quintic(y, 0.6591636, -0.1751672, 0.07195234, 0.3226518, 0.2261913, 0.05887351)
    g = wp.clamp(g, 0.0, 1.0)
    return wp.vec2(w, w * (g * g * g * g * g))


@wp.func
def average_specular_albedo(alpha: float) -> wp.vec2:
    """Return 2 ∫ (W, G) μ dμ of `specular_albedo`, at most 0.0007 too small."""
    y = 2.0 * wp.sqrt(alpha) - 1.0
    w = _quintic(y, 0.8843517, -0.3447776, -0.2754077, 0.05834608, 0.1273744, -0.001041783)
    g = _quintic(y, 0.02312837, -0.03421513, 0.01243841, 0.004638056, -0.01317152, 0.01677781)
    y6 = y * y * y * y * y * y
    return wp.vec2(w + y6 * (-0.03115746 - 0.006600589 * y), g + y6 * (0.004559138 - 0.009248789 * y))


@wp.func(inline=False)
def facet_albedo(w: wp.vec3, shape: wp.vec3) -> wp.vec2:
    """Return (W, G) of anisotropic GGX for light from w, of the shape (αu, αv, 0).

    The roughness towards w governs masking. Facets tilt across w as well: G is for an isotropic surface, smoother the
    more the smooth axis points towards w, and W is at most the one of the mean roughness. With these numbers the
    true albedo exceeds neither (tests/materials/test_principled.py); on average E is 0.02 too large.
    """
    rough = wp.max(shape[0], shape[1])
    smooth = wp.min(shape[0], shape[1])
    if rough == smooth:
        return specular_albedo(w[2], rough)
    along = wp.where(shape[0] < shape[1], w[0], w[1])
    smooth_share = along * along / wp.max(w[0] * w[0] + w[1] * w[1], 1.0e-12)
    toward = wp.sqrt(rough * rough * (1.0 - smooth_share) + smooth * smooth * smooth_share)
    contrast = 1.0 - smooth / rough
    tilt = 0.7 * wp.sqrt(wp.sqrt(rough)) * contrast * smooth_share * smooth_share * smooth_share
    first = specular_albedo(w[2], wp.max(toward * (1.0 - tilt), 1.0e-4))
    second = specular_albedo(w[2], wp.sqrt(rough * smooth))
    white = wp.min(wp.max(first[0], second[0]) + wp.min(0.03, 0.08 * contrast), 1.0)
    return wp.vec2(white, wp.min(first[1] + 0.008 * contrast, white))


@wp.func
def average_facet_albedo(shape: wp.vec3) -> wp.vec2:
    """Return a lower bound of 2 ∫ (W, G) μ dμ of `facet_albedo`, from the rougher axis."""
    return average_specular_albedo(wp.max(shape[0], shape[1]))


@wp.func(inline=False)
def sheen_albedo(mu: float, roughness: float) -> float:
    """Return the albedo of white sheen (`sheen.py`); above 1 for smooth sheen at grazing angles.

    It is at most 0.02 too large or, where it exceeds 1, a factor of 1.02.
    """
    y = 1.0 - 2.0 * wp.log(roughness) / _LOG_LEAST_SHEEN
    h = wp.sqrt(mu * mu + SHEEN_CUT * SHEEN_CUT)
    x = 2.0 * h / (h + roughness) - 1.0
    e = _quintic(y, -0.01948971, -0.0300098, 1.805088, -1.617464, -1.320467, 1.757951)
    e = e * x + _quintic(y, 0.01012219, -0.4027301, 1.7763, 0.727437, -0.7984348, 0.3816785)
    e = e * x + _quintic(y, -0.1189587, -0.5370287, -0.1783103, 3.303479, 0.9565765, -2.052479)
    e = e * x + _quintic(y, -0.2198051, -0.2402305, -0.3954714, 1.408769, 0.6505613, -0.9417745)
    e = e * x + _quintic(y, -0.6349569, 0.217616, -0.2948369, -0.07286848, 0.06922799, 0.1544168)
    e = e * x + _quintic(y, 0.4862899, -0.2005561, 0.2124176, -0.01874492, -0.05227765, 0.002400839)
    e = wp.max(e, 0.0)
    return e * e
