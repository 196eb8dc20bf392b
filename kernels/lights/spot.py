"""A point light that shines in a cone."""

import warp as wp

from wrt.kernels.geometry.rays import Receiver
from wrt.kernels.lights.record import LightModel, LightSample
from wrt.kernels.scene.scene_data import LightRecord, LightShape

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
def sample_spot(light: LightRecord, shape: LightShape, receiver: Receiver, u: wp.vec2) -> LightSample:
    """Return a sample of a spot light."""
    sample = LightSample()
    way = light.place - receiver.position
    distance2 = wp.dot(way, way)
    sample.distance = wp.sqrt(distance2)
    sample.delta = True
    if distance2 > 0.0:
        sample.wi = way / sample.distance
        sample.radiance = light.value / distance2
        sample.radiance *= spot_factor(shape, -wp.dot(sample.wi, shape.normal))
    return sample


MODEL = LightModel(sample_spot)
