"""Point lights, spot lights, projectors of an image, and spot lights with a texture."""

import warp as wp

from wrt.kernels.core.rays import Receiver
from wrt.kernels.core.scene_data import LightRecord, LightShape
from wrt.kernels.lights.record import LightModel, LightSample

# Falloff from the inner to the outer cone: numbers of `wrt.scene.lights.FALLOFFS`.
FALLOFF_SMOOTH = wp.constant(0)
FALLOFF_LINEAR = wp.constant(1)
FALLOFF_GLTF = wp.constant(2)


@wp.func
def spot_factor(shape: LightShape, cosine: float) -> float:
    """Return a spot's relative intensity at the cosine of an angle to its axis (formulas: `SpotLight`)."""
    inner = shape.size[0]
    outer = shape.size[1]
    if cosine >= inner:
        return 1.0
    if cosine <= outer:
        return 0.0
    if shape.falloff == FALLOFF_LINEAR:
        return (wp.acos(outer) - wp.acos(cosine)) / (wp.acos(outer) - wp.acos(inner))
    x = (cosine - outer) / (inner - outer)
    if shape.falloff == FALLOFF_GLTF:
        return x * x
    return x * x * (3.0 - 2.0 * x)


@wp.func
def sample_point(light: LightRecord, receiver: Receiver) -> LightSample:
    """Return a sample of a point light."""
    sample = LightSample()
    to_light = light.place - receiver.position
    distance2 = wp.dot(to_light, to_light)
    sample.distance = wp.sqrt(distance2)
    sample.delta = True
    if distance2 > 0.0:
        sample.wi = to_light / sample.distance
        sample.radiance = light.value / distance2
    return sample


@wp.func
def sample_spot(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    """Return a sample of a spot light."""
    sample = sample_point(light, receiver)
    if sample.distance > 0.0:
        sample.radiance *= spot_factor(shape, -wp.dot(sample.wi, shape.normal))
    return sample


SPOT = LightModel(sample_spot)


@wp.func
def frame_coordinates(shape: LightShape, to_light: wp.vec3, half_sizes: wp.vec2) -> wp.vec2:
    """Return texture coordinates in the frame of a light, [0, 1]² inside, for the vector from a receiver before it.

    `half_sizes` are those of the frame at unit distance along the axis.
    """
    depth = -wp.dot(to_light, shape.normal)
    return wp.vec2(
        0.5 - 0.5 * wp.dot(to_light, shape.x) / (depth * half_sizes[0]),
        0.5 - 0.5 * wp.dot(to_light, shape.y) / (depth * half_sizes[1]),
    )


@wp.func
def _projector_sample(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = LightSample()
    to_light = light.place - receiver.position
    sample.delta = True
    depth = -wp.dot(to_light, shape.normal)
    if depth > 0.0:
        sample.distance = wp.length(to_light)
        sample.wi = to_light / sample.distance
        uv = frame_coordinates(shape, to_light, shape.size)
        if wp.max(wp.abs(uv[0] - 0.5), wp.abs(uv[1] - 0.5)) <= 0.5:
            sample.point.u = uv[0]
            sample.point.v = uv[1]
            # The intensity E / cos³ of the irradiance E at unit depth, over the squared distance.
            sample.radiance = light.value * (sample.distance / (depth * depth * depth))
    return sample


@wp.func
def _sample_spot(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    sample = sample_spot(light, shape, receiver, u)
    to_light = light.place - receiver.position
    cosine = shape.size[1]  # of the outer cone
    if -wp.dot(to_light, shape.normal) > cosine * sample.distance:
        tangent = wp.sqrt(1.0 - cosine * cosine) / cosine
        uv = frame_coordinates(shape, to_light, wp.vec2(tangent))
        sample.point.u = uv[0]
        sample.point.v = uv[1]
    return sample


def make_projector(kind: str = "frame") -> LightModel:
    """Return the model of a projector, or for the kind "spot" of a spot light with a texture."""
    return LightModel(_sample_spot if kind == "spot" else _projector_sample, textured=True)
