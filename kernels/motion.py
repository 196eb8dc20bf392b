"""Keyframed motion on the device: where a moving thing is at a time.

The keys are those of `wrt.Motion`, taken apart: x goes to position + rotation · stretch · (x − center).
Between two keys position and stretch are interpolated linearly and the rotation by slerp (Shoemake 1985);
outside of them the thing stands still.
"""

import warp as wp


@wp.struct
class MotionKey:
    """A keyframe; `half_angle` is half the angle, radians, from its rotation to that of the next key."""

    time: float
    half_angle: float
    rotation: wp.vec4  # unit quaternion (x, y, z, w)
    position: wp.vec3
    stretch: wp.mat33


@wp.struct
class MotionRecord:
    """Which keys are a motion's, ascending by time, and the point about which it turns."""

    first_key: int
    keys: int
    center: wp.vec3


@wp.struct
class Placement:
    """An affine map: p goes to `linear` p + `offset`."""

    linear: wp.mat33
    offset: wp.vec3


# C++, as rays through moving instances need it too.
#   in:  keys: pointer to MotionKey; motion: MotionRecord; time
#   out: linear: float[3][3], offset: float[3]
PLACEMENT_AT = """
    {
        const auto* key = keys + motion.first_key;
        const auto* const last = key + motion.keys - 1;
        while (key < last && key[1].time <= time) ++key;
        const auto* const next = key < last ? key + 1 : key;
        const float length = next->time - key->time;
        const float since = time - key->time;
        const float share = since <= 0.0f || length <= 0.0f ? 0.0f : since < length ? since / length : 1.0f;
        const float rest = 1.0f - share;
        float weight = rest, next_weight = share;
        // Below, the two differ by less than rounding: by half_angle^2 / 6.
        if (key->half_angle > 5e-4f) {
            const float scale = 1.0f / wp::sin(key->half_angle);
            weight = wp::sin(rest * key->half_angle) * scale;
            next_weight = wp::sin(share * key->half_angle) * scale;
        }
        float q[4], norm = 0.0f;
        for (int k = 0; k < 4; ++k) {
            q[k] = weight * key->rotation[k] + next_weight * next->rotation[k];
            norm += q[k] * q[k];
        }
        const float s = 2.0f / norm;
        const float xx = s * q[0] * q[0], yy = s * q[1] * q[1], zz = s * q[2] * q[2];
        const float xy = s * q[0] * q[1], xz = s * q[0] * q[2], yz = s * q[1] * q[2];
        const float xw = s * q[0] * q[3], yw = s * q[1] * q[3], zw = s * q[2] * q[3];
        const float turn[3][3] = {{1.0f - yy - zz, xy - zw, xz + yw},
                                  {xy + zw, 1.0f - xx - zz, yz - xw},
                                  {xz - yw, yz + xw, 1.0f - xx - yy}};
        for (int i = 0; i < 3; ++i) {
            offset[i] = rest * key->position[i] + share * next->position[i];
            for (int j = 0; j < 3; ++j) {
                linear[i][j] = 0.0f;
                for (int k = 0; k < 3; ++k)
                    linear[i][j] += turn[i][k] * (rest * key->stretch.data[k][j] + share * next->stretch.data[k][j]);
            }
            for (int j = 0; j < 3; ++j) offset[i] -= linear[i][j] * motion.center[j];
        }
    }
"""

# Between which of a list of ascending times another one lies.
#   in:  times: pointer to float; count; time
#   out: key, share: how far it is from times[key] to the next one, 0 to 1
KEY_AT = """
    while (key < count - 1 && times[key + 1] <= time) ++key;
    if (key < count - 1 && time > times[key]) share = (time - times[key]) / (times[key + 1] - times[key]);
"""

_placement = wp.types.matrix(shape=(3, 4), dtype=float)


@wp.func_native(
    """
    const auto* const keys = all_keys.data;
    float linear[3][3], offset[3];
"""
    + PLACEMENT_AT
    + """
    wp::mat_t<3, 4, float> result;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) result.data[i][j] = linear[i][j];
        result.data[i][3] = offset[i];
    }
    return result;
"""
)
def _placement_at(all_keys: wp.array(dtype=MotionKey), motion: MotionRecord, time: float) -> _placement: ...


@wp.func_native(
    """
    const float* const times = all_times.data + first;
    int key = 0;
    float share = 0.0f;
"""
    + KEY_AT
    + """
    return wp::vec_t<2, float>((float)key, share);
"""
)
def key_at(all_times: wp.array(dtype=float), first: int, count: int, time: float) -> wp.vec2:
    """Return the last of `count` ascending times that is not after `time`, by number, and the share of the way on."""
    ...


@wp.func
def transform_at(keys: wp.array(dtype=MotionKey), motion: MotionRecord, time: float) -> Placement:
    """Return the map from the moving thing's own space to the world at a time, seconds."""
    m = _placement_at(keys, motion, time)
    placement = Placement()
    placement.linear = wp.mat33(m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2], m[2, 0], m[2, 1], m[2, 2])
    placement.offset = wp.vec3(m[0, 3], m[1, 3], m[2, 3])
    return placement
