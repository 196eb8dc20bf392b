"""The phase function of Henyey and Greenstein.

p(cosθ) = (1 − g²) / (4π (1 + g² − 2 g cosθ)^(3/2)), where θ is the angle between the directions of propagation and g
its mean cosine (Henyey and Greenstein, "Diffuse radiation in the galaxy", 1941, eq. 2). g = 0 is isotropic.
"""

import warp as wp

from wrt.kernels.geometry.rays import make_frame, to_world
from wrt.kernels.math.trigonometry import sine_cosine
from wrt.kernels.sampling.warps import INV_PI, TWO_PI


@wp.func
def phase(cosine: float, g: float) -> float:
    """Return p(cosθ) per solid angle, which is also the density of `sample_phase`."""
    d = 1.0 + g * g - 2.0 * g * cosine
    return 0.25 * INV_PI * (1.0 - g * g) / (d * wp.sqrt(d))


@wp.func
def sample_phase(forward: wp.vec3, g: float, u: wp.vec2) -> wp.vec3:
    """Return a direction sampled by the phase function.

    With s = 2 u − 1 the inverted distribution is (1 + g² − ((1 − g²) / (1 + g s))²) / (2 g), here with g divided out,
    so g = 0 works as well.
    """
    s = 2.0 * u[0] - 1.0
    d = 1.0 + g * s
    cosine = (s + g * (1.5 + 0.5 * s * s) + g * g * s + 0.5 * g * g * g * (s * s - 1.0)) / (d * d)
    cosine = wp.clamp(cosine, -1.0, 1.0)
    sine = wp.sqrt(1.0 - cosine * cosine)
    turned = sine_cosine(TWO_PI * u[1])
    frame = make_frame(forward)
    return wp.normalize(to_world(frame, wp.vec3(sine * turned[1], sine * turned[0], cosine)))
