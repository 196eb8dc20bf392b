"""A disk light, sampled by solid angle."""

import warp as wp

from wrt.kernels.geometry.rays import Ray, Receiver
from wrt.kernels.lights.plane import front_shines_back, meet_plane
from wrt.kernels.lights.record import BEFORE_LIGHT, NO_MEETING, LightModel, LightSample
from wrt.kernels.sampling.solid_angle import disk_cone, disk_pdf, sample_disk
from wrt.kernels.scene.scene_data import LightRecord, LightShape


@wp.func
def _sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    ahead = wp.dot(shape.place - receiver.position, shape.normal)
    if ahead >= 0.0 and light.two_sided == 0:
        return sample
    way = sample_disk(disk_cone(shape.place, shape.normal, shape.size[0], receiver.position), u)
    sample.wi = way.wi
    sample.pdf = way.pdf
    if way.pdf > 0.0:
        # Towards the rim, rounding may make a direction parallel to the plane: the distance is clamped.
        reach = wp.length(shape.place - receiver.position) + shape.size[0]
        sample.distance = wp.min(ahead / wp.dot(way.wi, shape.normal), reach) * BEFORE_LIGHT
        if not (sample.distance > 0.0):
            sample.distance = reach * BEFORE_LIGHT
    sample.radiance = light.value
    return sample


@wp.func
def _pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    return disk_pdf(disk_cone(shape.place, shape.normal, shape.size[0], receiver.position), direction)


@wp.func
def _meet(shape: LightShape, ray: Ray) -> float:
    t = meet_plane(shape, ray)
    p = ray.origin - shape.place + ray.direction * t
    return wp.where(wp.dot(p, p) <= shape.size[0] * shape.size[0], t, NO_MEETING)


MODEL = LightModel(_sample, _pdf, _meet, front_shines_back)
