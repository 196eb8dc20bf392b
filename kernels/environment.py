"""Radiance from infinitely far away: constant, or an image sampled by its brightness.

Directions map to (u, v) in [0, 1]² by azimuth and polar angle; the convention is written in
`wrt/environment.py`.
"""

import warp as wp

from wrt.kernels.scene_data import WRAP_CLAMP, WRAP_REPEAT, EnvironmentData
from wrt.kernels.textures import bilinear, neighbors
from wrt.kernels.warps import PI, TWO_PI, sample_alias


@wp.struct
class EnvironmentSample:
    """A direction (world) and its density per solid angle."""

    wi: wp.vec3
    pdf: float


@wp.func
def direction_to_uv(environment: EnvironmentData, d: wp.vec3) -> wp.vec2:
    """Return where in the image direction d looks."""
    local = environment.rotation * d
    u = 0.5 + wp.atan2(local[0], -local[2]) / TWO_PI
    v = wp.acos(wp.clamp(local[1], -1.0, 1.0)) / PI
    return wp.vec2(u, v)


@wp.func
def uv_to_direction(environment: EnvironmentData, uv: wp.vec2) -> wp.vec3:
    """Return the direction that sees (u, v)."""
    azimuth = (uv[0] - 0.5) * TWO_PI
    polar = uv[1] * PI
    sine = wp.sin(polar)
    local = wp.vec3(sine * wp.sin(azimuth), wp.cos(polar), -sine * wp.cos(azimuth))
    return wp.transpose(environment.rotation) * local


@wp.func
def image_radiance(environment: EnvironmentData, d: wp.vec3) -> wp.vec3:
    """Return the bilinearly interpolated radiance; columns wrap around, rows end at the poles."""
    uv = direction_to_uv(environment, d)
    x = uv[0] * float(environment.width) - 0.5
    y = uv[1] * float(environment.height) - 0.5
    left = wp.floor(x)
    top = wp.floor(y)
    columns = neighbors(int(left), environment.width, WRAP_REPEAT)
    rows = neighbors(int(top), environment.height, WRAP_CLAMP)
    return bilinear(environment.texels, 0, environment.width, columns, rows, wp.vec2(x - left, y - top))


@wp.func
def image_pdf_at(environment: EnvironmentData, texel: int, polar: float) -> float:
    """Return the density per solid angle at a polar angle inside a texel."""
    texels = float(environment.width * environment.height)
    return environment.probabilities[texel] * texels / (2.0 * PI * PI * wp.max(wp.sin(polar), 1.0e-6))


@wp.func
def image_pdf(environment: EnvironmentData, d: wp.vec3) -> float:
    """Return the density of `sample_image` at direction d."""
    uv = direction_to_uv(environment, d)
    x = wp.min(int(uv[0] * float(environment.width)), environment.width - 1)
    y = wp.min(int(uv[1] * float(environment.height)), environment.height - 1)
    return image_pdf_at(environment, y * environment.width + x, uv[1] * PI)


@wp.func
def sample_image(environment: EnvironmentData, u: wp.vec4) -> EnvironmentSample:
    """Return a direction: a texel by its share of the light, then uniform in (u, v) inside it."""
    texel = sample_alias(environment.thresholds, environment.aliases, u[0], u[1]).index
    y = texel // environment.width
    x = texel - y * environment.width
    uv = wp.vec2((float(x) + u[2]) / float(environment.width), (float(y) + u[3]) / float(environment.height))
    s = EnvironmentSample()
    s.wi = uv_to_direction(environment, uv)
    s.pdf = image_pdf_at(environment, texel, uv[1] * PI)
    return s
