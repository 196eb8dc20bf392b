"""Rays, local frames, luminance."""

import warp as wp

from wrt.kernels.native import constants


@wp.struct
class Ray:
    """A half-line at a time, in seconds; `direction` is a unit vector."""

    origin: wp.vec3
    direction: wp.vec3
    time: float


# The directions from which a point receives light.
RECEIVES_ANYWHERE = wp.constant(constants.RECEIVES_ANYWHERE)  # a point in a medium, which has no normal
RECEIVES_FRONT = wp.constant(constants.RECEIVES_FRONT)  # the side of the normal only
RECEIVES_BOTH = wp.constant(constants.RECEIVES_BOTH)  # both sides


@wp.struct
class Receiver:
    """A point that receives light, with its shading normal and time.

    `receives` says on which sides of the normal light arrives; a point in a medium has no normal.
    """

    position: wp.vec3
    normal: wp.vec3
    receives: int  # one of the constants above
    time: float


@wp.struct
class Frame:
    """Orthonormal axes; `n` is the local z."""

    s: wp.vec3
    t: wp.vec3
    n: wp.vec3


TURNS = wp.constant(-1e-4)
"""z of the normals at which frames turn, and with them all that is sampled in them. Rounding makes z of upright walls 0
on one device and -1e-10 on another, so frames do not turn at 0."""


@wp.func
def make_frame(n: wp.vec3) -> Frame:
    """Return a frame around the unit vector n (Duff et al. 2017, listing 3)."""
    sign = wp.where(n[2] >= TURNS, 1.0, -1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    frame = Frame()
    frame.s = wp.vec3(1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0])
    frame.t = wp.vec3(b, sign + n[1] * n[1] * a, -n[1])
    frame.n = n
    return frame


@wp.func
def to_local(frame: Frame, v: wp.vec3) -> wp.vec3:
    """Return world vector v in the frame's coordinates."""
    return wp.vec3(wp.dot(v, frame.s), wp.dot(v, frame.t), wp.dot(v, frame.n))


@wp.func
def to_world(frame: Frame, v: wp.vec3) -> wp.vec3:
    """Return a local vector in world coordinates."""
    return frame.s * v[0] + frame.t * v[1] + frame.n * v[2]


@wp.func
def luminance(c: wp.vec3) -> float:
    """Return the luminance Y of linear Rec. 709 RGB."""
    return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
