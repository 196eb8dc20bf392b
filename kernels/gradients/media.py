"""Derivatives by the absorption, the scattering coefficient and the emission of homogeneous media.

The sampling of flights stays as it is, so along a segment of length d only the measured factor depends on them: the
transmittance exp(−σt d), times σs if the path scatters there, with σt = σa + σs.
"""

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import INFINITE_DISTANCE, NO_HIT, Hit
from wrt.kernels.core.scene_data import BodyStack, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.gradients.bsdf import over
from wrt.kernels.gradients.sums import GradientSums, add_color, add_number
from wrt.kernels.media.medium import make_extinction, mean_free_length, medium_of, transmittance


@specialised()
def make_add_to_extinction(media: str) -> wp.Function:
    """Return the device function (sums, medium, gradient) that adds a derivative by the extinction.

    Segments without an end are left out: if any light comes through one, its channel has an extinction of 0, and any
    more would make that light vanish.
    """

    @wp.func
    def add_to_extinction(sums: GradientSums, medium: int, gradient: wp.vec3):
        add_color(sums.media_absorption, medium, gradient)
        if wp.static(media == "scattering"):
            add_color(sums.media_scattering, medium, gradient)

    return add_to_extinction


@wp.func
def mean_free_length_slope(extinction: float, distance: float) -> float:
    """Return the derivative of `mean_free_length` by the extinction."""
    x = extinction * distance
    if x < 0.02:
        return -distance * distance * (0.5 - x * (1.0 / 3.0 - 0.125 * x))
    return (
        distance * transmittance(wp.vec3(extinction), distance)[0] - mean_free_length(extinction, distance)
    ) / extinction


@specialised("media", "grid_media")
def make_add_to_medium(features: Features) -> wp.Function:
    """Return the device function that adds the derivatives by the medium in which a segment of a path lies.

    Its arguments are (sums, scene, stack, hit, length, throughput, scatters, distance, upstream, later). `throughput`
    is the path's before the segment, `length` the distance to the hit, and `later` the radiance that the path finds
    after the segment, without the medium's own emission.
    """
    extinction_of, add_to_extinction = make_extinction(features.media), make_add_to_extinction(features.media)

    @wp.func
    def add_to_medium(
        sums: GradientSums,
        scene: SceneData,
        stack: BodyStack,
        hit: Hit,
        length: float,
        throughput: wp.vec3,
        scatters: bool,
        distance: float,
        upstream: wp.vec3,
        later: wp.vec3,
    ):
        medium = medium_of(scene, stack)
        if medium >= 0:
            record = scene.media[medium]
            if record.grid < 0:
                gradient = wp.cw_mul(upstream, later)
                by_extinction = wp.vec3(0.0)
                if scatters:
                    by_extinction = gradient * -distance
                elif hit.triangle != NO_HIT:
                    by_extinction = gradient * -length
                extinction = extinction_of(scene, stack)
                if wp.max(record.emission) > 0.0:
                    for c in range(3):
                        # The emission of a channel without extinction grows with the length, which must be finite.
                        if extinction[c] > 0.0 or length < 0.5 * INFINITE_DISTANCE:
                            seen = upstream[c] * throughput[c]
                            slope = mean_free_length_slope(extinction[c], length)
                            by_extinction[c] = by_extinction[c] + seen * record.emission[c] * slope
                            free = mean_free_length(extinction[c], length)
                            add_number(sums.media_emission, 3 * medium + c, seen * free)
                add_to_extinction(sums, medium, by_extinction)
                if wp.static(features.media == "scattering"):
                    if scatters:
                        add_color(sums.media_scattering, medium, over(gradient, record.scattering))

    return add_to_medium
