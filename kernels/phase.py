"""In which direction a medium scatters light: the phase function of Henyey and Greenstein.

p(cosθ) = (1 − g²) / (4π (1 + g² − 2 g cosθ)^(3/2)), by the angle between the ways before and after, whose cosine is g
on average (Henyey and Greenstein, "Diffuse radiation in the galaxy", 1941, eq. 2). With g = 0 all directions are alike.
"""

import warp as wp

from wrt.kernels.geometry import make_frame, to_world
from wrt.kernels.trigonometry import sine_cosine
from wrt.kernels.warps import INV_PI, TWO_PI


@wp.func
def phase(cosine: float, g: float) -> float:
    """Return p(cosθ), which is its own density, per solid angle."""
    d = 1.0 + g * g - 2.0 * g * cosine
    return 0.25 * INV_PI * (1.0 - g * g) / (d * wp.sqrt(d))


@wp.func
def sample_phase(forward: wp.vec3, g: float, u: wp.vec2) -> wp.vec3:
    """Return a direction after scattering, drawn by the phase function.

    With s = 2 u − 1 the inverse of its distribution is (1 + g² − ((1 − g²) / (1 + g s))²) / (2 g); here with g divided
    out, so that it holds for g = 0 as well.
    """
    s = 2.0 * u[0] - 1.0
    d = 1.0 + g * s
    cosine = (s + g * (1.5 + 0.5 * s * s) + g * g * s + 0.5 * g * g * g * (s * s - 1.0)) / (d * d)
    cosine = wp.clamp(cosine, -1.0, 1.0)
    sine = wp.sqrt(1.0 - cosine * cosine)
    turned = sine_cosine(TWO_PI * u[1])
    frame = make_frame(forward)
    return wp.normalize(to_world(frame, wp.vec3(sine * turned[1], sine * turned[0], cosine)))
