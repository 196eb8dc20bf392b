"""Radiance of environments: images in latitude-longitude layout.

Directions map to (u, v) in [0, 1]² by azimuth and polar angle; `wrt/scene/environment.py` states the convention.
"""

import warp as wp

from wrt.kernels.math.trigonometry import arc_tangent, sine_cosine
from wrt.kernels.sampling.warps import PI, TWO_PI
from wrt.kernels.scene.scene_data import WRAP_CLAMP, WRAP_REPEAT, EnvironmentData
from wrt.kernels.textures.textures import bilinear, neighbors


@wp.struct
class ImagePoint:
    """A point in the image, with sine and cosine of its polar angle."""

    uv: wp.vec2
    sine: float
    cosine: float


@wp.func
def image_point(uv: wp.vec2) -> ImagePoint:
    """Return the point at (u, v)."""
    point = ImagePoint()
    point.uv = uv
    polar = sine_cosine(uv[1] * PI)
    point.sine = polar[0]
    point.cosine = polar[1]
    return point


@wp.func
def point_towards(environment: EnvironmentData, d: wp.vec3) -> ImagePoint:
    """Return the point of the image in direction d."""
    local = environment.rotation * d
    point = ImagePoint()
    # The sine resolves small angles, unlike the cosine.
    point.sine = wp.sqrt(local[0] * local[0] + local[2] * local[2])
    point.cosine = local[1]
    u = 0.5 + arc_tangent(local[0], -local[2]) / TWO_PI
    point.uv = wp.vec2(u, arc_tangent(point.sine, local[1]) / PI)
    return point


@wp.func
def point_direction(environment: EnvironmentData, point: ImagePoint) -> wp.vec3:
    """Return the direction of a point."""
    azimuth = (point.uv[0] - 0.5) * TWO_PI
    turned = sine_cosine(azimuth)
    local = wp.vec3(point.sine * turned[0], point.cosine, -point.sine * turned[1])
    return wp.transpose(environment.rotation) * local


@wp.func
def radiance_at(environment: EnvironmentData, uv: wp.vec2) -> wp.vec3:
    """Return the bilinearly interpolated radiance; columns wrap around, rows end at the poles."""
    x = uv[0] * float(environment.width) - 0.5
    y = uv[1] * float(environment.height) - 0.5
    left = wp.floor(x)
    top = wp.floor(y)
    columns = neighbors(int(left), environment.width, WRAP_REPEAT)
    rows = neighbors(int(top), environment.height, WRAP_CLAMP)
    return bilinear(environment.texels, 0, environment.width, columns, rows, wp.vec2(x - left, y - top))


@wp.func
def image_radiance(environment: EnvironmentData, d: wp.vec3) -> wp.vec3:
    """Return the radiance from direction d."""
    return radiance_at(environment, point_towards(environment, d).uv)
