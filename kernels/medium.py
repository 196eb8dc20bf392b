"""Homogeneous media: what a stretch of the way through them does to light."""

import functools

import warp as wp

from wrt.kernels.bodies import innermost
from wrt.kernels.exponential import exponential, logarithm
from wrt.kernels.microfacet.numerics import expm1_ratio
from wrt.kernels.scene_data import BodyStack, SceneData


@wp.func
def medium_of(scene: SceneData, inside: BodyStack) -> int:
    """Return the medium at a point that is in these bodies; −1 where there is none."""
    body = innermost(scene, inside)
    if body < 0:
        return scene.medium
    return scene.bodies[body].medium


@wp.func
def transmittance(extinction: wp.vec3, distance: float) -> wp.vec3:
    """Return the share of light that goes on straight after a distance: exp(−extinction · distance), Beer's law."""
    return wp.vec3(
        exponential(-extinction[0] * distance),
        exponential(-extinction[1] * distance),
        exponential(-extinction[2] * distance),
    )


@wp.func
def mean_free_length(extinction: float, distance: float) -> float:
    """Return ∫ exp(−extinction s) ds from 0 to distance: how far light comes on average, at most so far."""
    x = extinction * distance
    if x < 1.0:
        return distance * expm1_ratio(-x)
    return (1.0 - exponential(-x)) / extinction


@wp.func
def emitted(emission: wp.vec3, extinction: wp.vec3, distance: float) -> wp.vec3:
    """Return what arrives of the light that a medium gives off along a stretch: ∫ emission exp(−extinction s) ds.

    Chandrasekhar, "Radiative Transfer" (1950), section 7; of a channel without emission nothing, however far.
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


@functools.cache
def make_extinction(media: str) -> wp.Function:
    """Return the device function (scene, inside) -> vec3: how much light is lost per metre in these bodies.

    `media` is as in `Features`: where it says that media absorb alone, their scattering is left out.
    """
    return _extinction if media == "scattering" else _absorption


@wp.struct
class Flight:
    """How far light flies in a medium: `distance` to where it is scattered, or to the end of the way where it is not.

    `weight` is the transmittance, times the scattering where it is scattered, over the density.
    """

    distance: float
    scattered: bool
    weight: wp.vec3


@wp.func
def fly(
    extinction: wp.vec3, scattering: wp.vec3, throughput: wp.vec3, reach: float, u_channel: float, u_distance: float
) -> Flight:
    """Return a flight of at most `reach`, drawn by the extinction of one channel, and weighed against all of them.

    The channel is drawn in proportion to the throughput, and the weight is that of the balance heuristic over the
    channels (Wilkie, Nawaz, Droske, Weidlich and Hanika, "Hero wavelength spectral sampling", 2014; Veach 1997, section
    9.2.2). With these proportions the sum of the throughput's channels never grows from flight to flight.
    """
    total = throughput[0] + throughput[1] + throughput[2]
    share = throughput / total
    channel = wp.where(u_channel < share[0], 0, wp.where(u_channel < share[0] + share[1], 1, 2))
    # Rounding must not draw a channel that has no share.
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
