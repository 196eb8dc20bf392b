"""Lights with an area: rectangles, disks and spheres, and suns, which are disks at infinity."""

import warp as wp

from wrt.kernels.core.ray_tree import INFINITE_DISTANCE
from wrt.kernels.core.rays import Ray, Receiver
from wrt.kernels.core.scene_data import LightRecord, LightShape
from wrt.kernels.lights.record import BEFORE_LIGHT, NO_MEETING, LightModel, LightSample
from wrt.kernels.sampling.solid_angle import (
    cone_pdf,
    disk_cone,
    disk_pdf,
    rectangle_from,
    rectangle_pdf,
    sample_cone,
    sample_disk,
    sample_rectangle,
    sample_sphere,
    sphere_one_minus_cos,
)


@wp.func
def meet_plane(shape: LightShape, ray: Ray) -> float:
    """Return the positive distance at which a ray meets the plane of a flat light, or NO_MEETING."""
    toward = wp.dot(ray.direction, shape.normal)
    if toward == 0.0:
        return NO_MEETING
    t = wp.dot(shape.place - ray.origin, shape.normal) / toward
    if not (t > 0.0):
        return NO_MEETING
    return t


@wp.func
def front_shines_back(light: LightRecord, shape: LightShape, ray: Ray) -> bool:
    """Return whether a ray meets a flat light from an emitting side."""
    return wp.dot(ray.direction, shape.normal) < 0.0 or light.two_sided != 0


# --- A rectangle, sampled by solid angle -----------------------------------------------------------


@wp.func
def _rectangle_sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    ahead = wp.dot(shape.place - receiver.position, shape.normal)
    if ahead >= 0.0 and light.two_sided == 0:
        return sample
    r = rectangle_from(shape.place, shape.x, shape.y, shape.size, receiver.position)
    xy = sample_rectangle(r, u)
    to_light = shape.x * xy[0] + shape.y * xy[1] + shape.normal * ahead
    distance = wp.length(to_light)
    if distance > 0.0:
        sample.wi = to_light / distance
        sample.pdf = rectangle_pdf(r, distance)
        sample.distance = distance * BEFORE_LIGHT
    sample.radiance = light.value
    return sample


@wp.func
def _rectangle_pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    return rectangle_pdf(rectangle_from(shape.place, shape.x, shape.y, shape.size, receiver.position), distance)


@wp.func
def _rectangle_meet(shape: LightShape, ray: Ray) -> float:
    t = meet_plane(shape, ray)
    p = ray.origin - shape.place + ray.direction * t
    x = wp.dot(p, shape.x)
    y = wp.dot(p, shape.y)
    inside = x >= 0.0 and x <= shape.size[0] and y >= 0.0 and y <= shape.size[1]
    return wp.where(inside, t, NO_MEETING)


RECTANGLE = LightModel(_rectangle_sample, _rectangle_pdf, _rectangle_meet, front_shines_back, middle=(0.5, 0.5))


# --- A disk, sampled by solid angle ----------------------------------------------------------------


@wp.func
def _disk_sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    ahead = wp.dot(shape.place - receiver.position, shape.normal)
    if ahead >= 0.0 and light.two_sided == 0:
        return sample
    found = sample_disk(disk_cone(shape.place, shape.normal, shape.size[0], receiver.position), u)
    sample.wi = found.wi
    sample.pdf = found.pdf
    if found.pdf > 0.0:
        # Towards the rim, rounding may make a direction parallel to the plane: the distance is clamped.
        reach = wp.length(shape.place - receiver.position) + shape.size[0]
        sample.distance = wp.min(ahead / wp.dot(found.wi, shape.normal), reach) * BEFORE_LIGHT
        if not (sample.distance > 0.0):
            sample.distance = reach * BEFORE_LIGHT
    sample.radiance = light.value
    return sample


@wp.func
def _disk_pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    return disk_pdf(disk_cone(shape.place, shape.normal, shape.size[0], receiver.position), direction)


@wp.func
def _disk_meet(shape: LightShape, ray: Ray) -> float:
    t = meet_plane(shape, ray)
    p = ray.origin - shape.place + ray.direction * t
    return wp.where(wp.dot(p, p) <= shape.size[0] * shape.size[0], t, NO_MEETING)


DISK = LightModel(_disk_sample, _disk_pdf, _disk_meet, front_shines_back)


# --- A sphere that emits outwards, sampled by solid angle ------------------------------------------


@wp.func
def _sphere_sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    found = sample_sphere(shape.place, shape.size[0], receiver.position, u)
    sample.wi = found.wi
    sample.distance = found.distance * BEFORE_LIGHT
    sample.pdf = found.pdf
    sample.radiance = light.value
    return sample


@wp.func
def _sphere_pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
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
def _sphere_meet(shape: LightShape, ray: Ray) -> float:
    return meet_sphere(shape.place, shape.size[0], ray)


@wp.func
def _sphere_shines_back(light: LightRecord, shape: LightShape, ray: Ray) -> bool:
    return wp.length(ray.origin - shape.place) > shape.size[0]


SPHERE = LightModel(_sphere_sample, _sphere_pdf, _sphere_meet, _sphere_shines_back)


# --- A disk at infinity ----------------------------------------------------------------------------


@wp.func
def _sun_sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    sample.wi = sample_cone(shape.normal, shape.size[0], u)
    sample.distance = INFINITE_DISTANCE
    sample.pdf = cone_pdf(shape.size[0])
    sample.radiance = light.value
    return sample


@wp.func
def _sun_pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    return cone_pdf(shape.size[0])


@wp.func
def sun_covers(shape: LightShape, direction: wp.vec3) -> bool:
    """Return whether a direction lies within a sun's disk, by the sine: the cosine cannot resolve so small an angle."""
    across = wp.cross(shape.normal, direction)
    return wp.dot(across, across) < shape.size[1] and wp.dot(shape.normal, direction) > 0.0


SUN = LightModel(_sun_sample, _sun_pdf, covers=sun_covers)
