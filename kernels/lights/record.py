"""The interface of light models: their samples, and the model itself."""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.ray_tree import Hit

NO_MEETING = wp.constant(-1.0)
"""Result of `LightModel.meet` for a ray that misses the light."""

BEFORE_LIGHT = wp.constant(1.0 - 2.0**-20)
"""A shadow ray ends this share before its light, which is ignored itself: something may lie just behind."""


@wp.struct
class LightSample:
    """A sample of a light, seen from a receiver.

    `wi` is the unit vector to the light, `distance` the length of the shadow ray, `radiance` the incident radiance
    divided by the probability of this sample: by `pdf` per solid angle for lights with an extent, by the probability
    of the light alone if `delta`. `point` is the point on a triangle, or the light shape; its triangle is NO_HIT for
    other lights.
    """

    wi: wp.vec3
    distance: float
    radiance: wp.vec3
    pdf: float
    delta: bool
    point: Hit


class LightModel(NamedTuple):
    """A kind of light: device functions in world space. `light` is its LightRecord and `shape` its LightShape.

    Attributes:
        sample: (light, shape, receiver, u: vec2) -> LightSample with the radiance from a point on it; `pdf` is per
            solid angle, and 0 if no light reaches the receiver. A light without extent returns `delta`, and irradiance
            instead of radiance. `point` is filled in by the caller.
        pdf: (shape, receiver, direction, distance) -> float: the density with which `sample` samples a direction that
            meets it; None for lights without extent.
        meet: (shape, ray) -> float: the distance at which a ray meets it, or NO_MEETING; None for lights that rays
            cannot meet.
        shines_back: (light, shape, ray) -> bool: whether it emits towards the origin of a ray that meets it.
        covers: (shape, direction) -> bool: whether a direction leads to it, for lights at infinity.
        textured: whether the light's texture multiplies the radiance, at the coordinates that `sample` returns as `u`
            and `v` of `point`.
        middle: the numbers u that sample its centre, for ray trees.
    """

    sample: wp.Function
    pdf: wp.Function | None = None
    meet: wp.Function | None = None
    shines_back: wp.Function | None = None
    covers: wp.Function | None = None
    middle: tuple[float, float] = (0.0, 0.0)
    textured: bool = False
