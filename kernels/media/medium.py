"""Homogeneous media: absorption, emission and scattering along a ray segment, and the phase function.

The phase function is that of Henyey and Greenstein,

p(cosθ) = (1 − g²) / (4π (1 + g² − 2 g cosθ)^(3/2)), where θ is the angle between the directions of propagation and g
its mean cosine (Henyey and Greenstein, "Diffuse radiation in the galaxy", 1941, eq. 2). g = 0 is isotropic.
"""

import warp as wp

from wrt.kernels.core.elementary import expm1_ratio, exponential, logarithm, sine_cosine
from wrt.kernels.core.rays import make_frame, to_world
from wrt.kernels.core.scene_data import BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.media.bodies import innermost
from wrt.kernels.sampling.warps import INV_PI, TWO_PI


@wp.func
def medium_of(scene: SceneData, inside: BodyStack) -> int:
    """Return the medium at a point in these bodies; −1 for none."""
    body = innermost(scene, inside)
    if body < 0:
        return scene.medium
    return scene.bodies[body].medium


@wp.func
def transmittance(extinction: wp.vec3, distance: float) -> wp.vec3:
    """Return the share of light that goes straight on for a distance: exp(−extinction · distance), Beer's law."""
    return wp.vec3(
        exponential(-extinction[0] * distance),
        exponential(-extinction[1] * distance),
        exponential(-extinction[2] * distance),
    )


@wp.func
def mean_free_length(extinction: float, distance: float) -> float:
    """Return ∫ exp(−extinction s) ds from 0 to distance, the mean free path truncated at the distance."""
    x = extinction * distance
    if x < 1.0:
        return distance * expm1_ratio(-x)
    return (1.0 - exponential(-x)) / extinction


@wp.func
def emitted(emission: wp.vec3, extinction: wp.vec3, distance: float) -> wp.vec3:
    """Return the emitted radiance that arrives along a segment: ∫ emission exp(−extinction s) ds.

    Chandrasekhar, "Radiative Transfer" (1950), section 7. Channels without emission give 0 at any distance.
    """
    light = wp.vec3(0.0)
    for c in range(3):
        if emission[c] > 0.0:
            light[c] = emission[c] * mean_free_length(extinction[c], distance)
    return light


@specialised()
def make_extinction(media: str) -> wp.Function:
    """Return the device function (scene, inside) -> vec3, the extinction per metre in these bodies.

    See `Features` for `media`: if media only absorb, scattering is left out.
    """

    @wp.func
    def extinction_of(scene: SceneData, inside: BodyStack) -> wp.vec3:
        extinction = wp.vec3(0.0)
        medium = medium_of(scene, inside)
        if medium >= 0:
            extinction = scene.media[medium].absorption
            if wp.static(media == "scattering"):
                extinction += scene.media[medium].scattering
        return extinction

    return extinction_of


@wp.struct
class Flight:
    """A free flight in a medium: `distance` to a scattering event, or to the end of the segment if there is none.

    `weight` is the transmittance over the density, times the scattering coefficient at a scattering event.
    """

    distance: float
    scattered: bool
    weight: wp.vec3


@wp.func
def fly(
    extinction: wp.vec3, scattering: wp.vec3, throughput: wp.vec3, reach: float, u_channel: float, u_distance: float
) -> Flight:
    """Return a flight of at most `reach`, sampled by the extinction of one channel and weighted for all of them.

    The probability of a channel is proportional to its throughput, and the weight is by the balance heuristic over the
    channels (Wilkie, Nawaz, Droske, Weidlich and Hanika, "Hero wavelength spectral sampling", 2014; Veach 1997,
    section 9.2.2). With these probabilities the sum of the throughput's channels never grows from flight to flight.
    """
    total = throughput[0] + throughput[1] + throughput[2]
    share = throughput / total
    channel = wp.where(u_channel < share[0], 0, wp.where(u_channel < share[0] + share[1], 1, 2))
    # Rounding must not select a channel of zero probability.
    if share[channel] == 0.0:
        channel = wp.where(share[0] > 0.0, 0, 1)
    flight = Flight()
    flight.distance = reach
    if extinction[channel] > 0.0:
        flight.distance = wp.min(reach, -logarithm(1.0 - u_distance) / extinction[channel])
    flight.scattered = flight.distance < reach
    passed = transmittance(extinction, flight.distance)
    if flight.scattered:
        flight.weight = wp.cw_mul(passed, scattering) / wp.dot(share, wp.cw_mul(passed, extinction))
    else:
        flight.weight = passed / wp.dot(share, passed)
    return flight


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
