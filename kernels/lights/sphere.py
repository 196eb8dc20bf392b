"""A sphere that emits outwards, sampled by solid angle."""

import warp as wp

from wrt.kernels.geometry.rays import Ray, Receiver
from wrt.kernels.lights.record import BEFORE_LIGHT, NO_MEETING, LightModel, LightSample
from wrt.kernels.sampling.solid_angle import cone_pdf, sample_sphere, sphere_one_minus_cos
from wrt.kernels.scene.scene_data import LightRecord, LightShape


@wp.func
def _sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    way = sample_sphere(shape.place, shape.size[0], receiver.position, u)
    sample.wi = way.wi
    sample.distance = way.distance * BEFORE_LIGHT
    sample.pdf = way.pdf
    sample.radiance = light.value
    return sample


@wp.func
def _pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    return cone_pdf(sphere_one_minus_cos(shape.place, shape.size[0], receiver.position))


@wp.func
def meet_sphere(center: wp.vec3, radius: float, ray: Ray) -> float:
    """Return the least positive distance at which a ray meets a sphere, or NO_MEETING.

    Haines, Günther and Akenine-Möller, Ray Tracing Gems (2019), chapter 7: the discriminant comes from the distance of
    the centre to the line, and the nearer root from the product of both.
    """
    to_origin = ray.origin - center
    b = -wp.dot(to_origin, ray.direction)
    from_center = to_origin + ray.direction * b
    discriminant = radius * radius - wp.dot(from_center, from_center)
    if discriminant < 0.0:
        return NO_MEETING
    length = wp.length(to_origin)
    c = (length - radius) * (length + radius)
    q = b + wp.where(b < 0.0, -1.0, 1.0) * wp.sqrt(discriminant)
    if q == 0.0:
        return NO_MEETING
    near = wp.min(q, c / q)
    far = wp.max(q, c / q)
    return wp.where(near > 0.0, near, wp.where(far > 0.0, far, NO_MEETING))


@wp.func
def _meet(shape: LightShape, ray: Ray) -> float:
    return meet_sphere(shape.place, shape.size[0], ray)


@wp.func
def _shines_back(light: LightRecord, shape: LightShape, ray: Ray) -> bool:
    return wp.length(ray.origin - shape.place) > shape.size[0]


MODEL = LightModel(_sample, _pdf, _meet, _shines_back)
