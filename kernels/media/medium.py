"""Homogeneous media: absorption, emission and scattering along a ray segment."""

import warp as wp

from wrt.kernels.math.exponential import exponential, logarithm
from wrt.kernels.media.bodies import innermost
from wrt.kernels.microfacet.numerics import expm1_ratio
from wrt.kernels.scene.scene_data import BodyStack, SceneData
from wrt.kernels.specialise import specialised


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


@wp.func
def _absorption(scene: SceneData, inside: BodyStack) -> wp.vec3:
    medium = medium_of(scene, inside)
    if medium < 0:
        return wp.vec3(0.0)
    return scene.media[medium].absorption


@wp.func
def _extinction(scene: SceneData, inside: BodyStack) -> wp.vec3:
    medium = medium_of(scene, inside)
    if medium < 0:
        return wp.vec3(0.0)
    return scene.media[medium].absorption + scene.media[medium].scattering


@specialised()
def make_extinction(media: str) -> wp.Function:
    """Return the device function (scene, inside) -> vec3, the extinction per metre in these bodies.

    See `Features` for `media`: if media only absorb, scattering is left out.
    """
    return _extinction if media == "scattering" else _absorption


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

    The probability of a channel is proportional to its throughput, and the weight is that of the balance heuristic over
    the channels (Wilkie, Nawaz, Droske, Weidlich and Hanika, "Hero wavelength spectral sampling", 2014; Veach 1997,
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
    left = transmittance(extinction, flight.distance)
    if flight.scattered:
        flight.weight = wp.cw_mul(left, scattering) / wp.dot(share, wp.cw_mul(left, extinction))
    else:
        flight.weight = left / wp.dot(share, left)
    return flight
