"""Sampling disks and open cylinders that shine, uniformly by area."""

import warp as wp

from wrt.kernels.geometry.quadrics import (
    DISK,
    Quadric,
    area_of,
    front_of,
    in_unit_shape,
    point_of,
    quadric_coordinates,
    sizes_of,
)
from wrt.kernels.geometry.rays import Receiver
from wrt.kernels.lights.record import LightSample
from wrt.kernels.math.trigonometry import arc_tangent, sine_cosine
from wrt.kernels.sampling.warps import TWO_PI
from wrt.kernels.scene.scene_data import LightRecord

_OFF = wp.constant(2.0**-19)
_BEFORE = wp.constant(1.0 - 2.0**-18)
"""A shadow ray ends this far off the light, relative to the sizes of the terms of its points, and this share of its
length before it: more than the error of a hit's distance, or it would hit the light."""


@wp.func
def place_on_quadric(quadric: Quadric, receiver: Receiver, u: wp.vec2) -> wp.vec3:
    """Return a place on the unit shape, uniform by area; u = 0 is the middle, or of a cylinder the nearest to it."""
    if quadric.kind == DISK:
        around = sine_cosine(TWO_PI * u[1])
        r = wp.sqrt(u[0])
        return wp.vec3(r * around[1], r * around[0], 0.0)
    towards = in_unit_shape(quadric, receiver.position - quadric.center)
    around = sine_cosine(arc_tangent(towards[1], towards[0]) + TWO_PI * u[0])
    return wp.vec3(around[1], around[0], wp.where(u[1] < 0.5, u[1], u[1] - 1.0))


@wp.func
def quadric_pdf(quadric: Quadric, distance: float, cos_light: float) -> float:
    """Return the density per solid angle of a point that is uniform on a disk or cylinder."""
    return distance * distance / (area_of(quadric) * cos_light)


@wp.func
def sample_mesh_quadric(light: LightRecord, quadric: Quadric, receiver: Receiver, u: wp.vec2) -> LightSample:
    """Return a sample of a disk or cylinder with the light's mean radiance; of pdf 0 where its back is seen."""
    sample = LightSample()
    sample.point.triangle = light.triangle
    sample.point.instance = light.instance
    place = place_on_quadric(quadric, receiver, u)
    weights = quadric_coordinates(quadric, place)
    sample.point.u = weights[0]
    sample.point.v = weights[1]
    point = point_of(quadric, place)
    normal = front_of(quadric, place)
    if wp.dot(normal, receiver.position - point) < 0.0 and light.two_sided != 0:
        normal = -normal
    if wp.dot(normal, receiver.position - point) > 0.0:
        off = wp.dot(sizes_of(quadric), wp.vec3(_OFF)) + quadric.slack
        way = point + normal * off - receiver.position
        distance = wp.length(way)
        sample.wi = way / distance
        sample.distance = distance * _BEFORE
        cos_light = -wp.dot(sample.wi, normal)
        if cos_light > 0.0:
            sample.pdf = quadric_pdf(quadric, distance, cos_light)
            sample.radiance = light.value
    return sample
