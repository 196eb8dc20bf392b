"""A disk at infinity."""

import warp as wp

from wrt.kernels.accel.intersect import INFINITE_DISTANCE
from wrt.kernels.geometry.rays import Receiver
from wrt.kernels.lights.record import LightModel, LightSample
from wrt.kernels.sampling.solid_angle import cone_pdf, sample_cone
from wrt.kernels.scene.scene_data import LightRecord, LightShape


@wp.func
def _sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    sample.wi = sample_cone(shape.normal, shape.size[0], u)
    sample.distance = INFINITE_DISTANCE
    sample.pdf = cone_pdf(shape.size[0])
    sample.radiance = light.value
    return sample


@wp.func
def _pdf(shape: LightShape, receiver: Receiver, direction: wp.vec3, distance: float) -> float:
    return cone_pdf(shape.size[0])


@wp.func
def sun_covers(shape: LightShape, direction: wp.vec3) -> bool:
    """Return whether a direction lies within a sun's disk, by the sine: the cosine cannot resolve so small an angle."""
    across = wp.cross(shape.normal, direction)
    return wp.dot(across, across) < shape.size[1] and wp.dot(shape.normal, direction) > 0.0


MODEL = LightModel(_sample, _pdf, covers=sun_covers)
