"""Keyframed motion on the device.

The keys are those of `wrt.Motion`, decomposed: x goes to position + rotation · stretch · (x − center). Between two keys
position and stretch are interpolated linearly and the rotation by slerp (Shoemake 1985); before the first and after the
last key nothing moves.
"""

import warp as wp

from wrt.kernels.native import include

motion_h = include("motion.h")


@wp.struct
class MotionKey:
    """A keyframe; `half_angle` is half the angle, radians, between its rotation and the next key's."""

    time: float
    half_angle: float
    rotation: wp.vec4  # unit quaternion (x, y, z, w)
    position: wp.vec3
    stretch: wp.mat33


@wp.struct
class MotionRecord:
    """A motion's keys, ascending by time, and its centre of rotation."""

    first_key: int
    keys: int
    center: wp.vec3


@wp.struct
class Placement:
    """An affine map: p goes to `linear` p + `offset`."""

    linear: wp.mat33
    offset: wp.vec3


_placement = wp.types.matrix(shape=(3, 4), dtype=float)


@wp.func_native("""
    float linear[3][3], offset[3];
    wrt::placement_at(keys.data, motion, time, linear, offset);
    wp::mat_t<3, 4, float> result;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) result.data[i][j] = linear[i][j];
        result.data[i][3] = offset[i];
    }
    return result;
""")
def _placement_at(keys: wp.array(dtype=MotionKey), motion: MotionRecord, time: float) -> _placement:
    motion_h()


@wp.func_native("""
    const wrt::KeyAt at = wrt::key_at(all_times.data + first, count, time);
    return wp::vec_t<2, float>((float)at.key, at.share);
""")
def key_at(all_times: wp.array(dtype=float), first: int, count: int, time: float) -> wp.vec2:
    """Return the index of the last of `count` ascending times not after `time`, and the fraction to the next."""
    motion_h()


@wp.func
def transform_at(keys: wp.array(dtype=MotionKey), motion: MotionRecord, time: float) -> Placement:
    """Return the map from object space to the world at a time, seconds."""
    m = _placement_at(keys, motion, time)
    placement = Placement()
    placement.linear = wp.mat33(m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2], m[2, 0], m[2, 1], m[2, 2])
    placement.offset = wp.vec3(m[0, 3], m[1, 3], m[2, 3])
    return placement
