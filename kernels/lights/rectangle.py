"""A rectangle light, sampled by solid angle."""

import warp as wp

from wrt.kernels.geometry.rays import Ray, Receiver
from wrt.kernels.lights.plane import front_shines_back, meet_plane
from wrt.kernels.lights.record import BEFORE_LIGHT, NO_MEETING, LightModel, LightSample
from wrt.kernels.sampling.solid_angle import rectangle_from, rectangle_pdf, sample_rectangle
from wrt.kernels.scene.scene_data import LightRecord, LightShape


@wp.func
def _sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    ahead = wp.dot(shape.place - receiver.position, shape.normal)
    if ahead >= 0.0 and light.two_sided == 0:
        return sample
    r = rectangle_from(shape.place, shape.x, shape.y, shape.size, receiver.position)
    xy = sample_rectangle(r, u)
    way = shape.x * xy[0] + shape.y * xy[1] + shape.normal * ahead
    distance = wp.length(way)
    if distance > 0.0:
        sample.wi = way / distance
        sample.pdf = rectangle_pdf(r, distance)
        sample.distance = distance * BEFORE_LIGHT
    sample.radiance = light.value
    return sample


@wp.func
def _pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    return rectangle_pdf(rectangle_from(shape.place, shape.x, shape.y, shape.size, receiver.position), distance)


@wp.func
def _meet(shape: LightShape, ray: Ray) -> float:
    t = meet_plane(shape, ray)
    p = ray.origin - shape.place + ray.direction * t
    x = wp.dot(p, shape.x)
    y = wp.dot(p, shape.y)
    inside = x >= 0.0 and x <= shape.size[0] and y >= 0.0 and y <= shape.size[1]
    return wp.where(inside, t, NO_MEETING)


MODEL = LightModel(_sample, _pdf, _meet, front_shines_back, middle=(0.5, 0.5))
