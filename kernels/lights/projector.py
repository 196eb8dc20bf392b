"""A pinhole that throws an image, and a spot light behind one."""

import warp as wp

from wrt.kernels.geometry.rays import Receiver
from wrt.kernels.lights.record import LightModel, LightSample
from wrt.kernels.lights.spot import sample_spot
from wrt.kernels.scene.scene_data import LightRecord, LightShape


@wp.func
def frame_coordinates(shape: LightShape, way: wp.vec3, half_sizes: wp.vec2) -> wp.vec2:
    """Return texture coordinates in the frame of a light, [0, 1]² inside, for the way from a receiver before it.

    `half_sizes` are those of the frame at unit distance along the axis.
    """
    depth = -wp.dot(way, shape.normal)
    return wp.vec2(
        0.5 - 0.5 * wp.dot(way, shape.x) / (depth * half_sizes[0]),
        0.5 - 0.5 * wp.dot(way, shape.y) / (depth * half_sizes[1]),
    )


@wp.func
def _sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    way = light.place - receiver.position
    sample.delta = True
    depth = -wp.dot(way, shape.normal)
    if depth > 0.0:
        sample.distance = wp.length(way)
        sample.wi = way / sample.distance
        uv = frame_coordinates(shape, way, shape.size)
        if wp.max(wp.abs(uv[0] - 0.5), wp.abs(uv[1] - 0.5)) <= 0.5:
            sample.point.u = uv[0]
            sample.point.v = uv[1]
            # The intensity E / cos³ of the irradiance E at unit depth, over the squared distance.
            sample.radiance = light.value * (sample.distance / (depth * depth * depth))
    return sample


@wp.func
def _sample_spot(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = sample_spot(light, shape, receiver, u)
    way = light.place - receiver.position
    cosine = shape.size[1]  # of the outer cone
    if -wp.dot(way, shape.normal) > cosine * sample.distance:
        tangent = wp.sqrt(1.0 - cosine * cosine) / cosine
        uv = frame_coordinates(shape, way, wp.vec2(tangent))
        sample.point.u = uv[0]
        sample.point.v = uv[1]
    return sample


def make_projector(kind: str = "frame") -> LightModel:
    """Return the model of a projector, or, for the kind "spot", that of a spot light with a texture."""
    return LightModel(_sample_spot if kind == "spot" else _sample, textured=True)
