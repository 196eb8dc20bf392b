#pragma once
// Keyframed motion at a time (`kernels/core/motion.py`).

namespace wrt {
// (Warp makes `float (` a cast, hence the names.)
typedef float Vector3[3];
typedef float Matrix33[3][3];

// The placement at a time: a point p of the object is at `linear` p + `offset`.
template<class Key, class Motion>
static CUDA_CALLABLE inline void
placement_at(const Key* keys, const Motion& motion, const float time, Matrix33& linear, Vector3& offset) {
    const Key* key = keys + motion.first_key;
    const Key* const last = key + motion.keys - 1;
    while (key < last && key[1].time <= time) ++key;
    const Key* const next = key < last ? key + 1 : key;
    const float length = next->time - key->time;
    const float since = time - key->time;
    const float share = since <= 0.0f || length <= 0.0f ? 0.0f : since < length ? since / length : 1.0f;
    const float rest = 1.0f - share;
    float weight = rest, next_weight = share;
    // Below this, the two differ by less than rounding: by half_angle^2 / 6.
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
    const float turn[3][3] = {
        {1.0f - yy - zz, xy - zw, xz + yw}, {xy + zw, 1.0f - xx - zz, yz - xw}, {xz - yw, yz + xw, 1.0f - xx - yy}};
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

// The last of ascending times that is not after `time`, and the fraction to the next one, 0 to 1.
struct KeyAt {
    int key;
    float share;
};
static CUDA_CALLABLE inline KeyAt key_at(const float* times, const int count, const float time) {
    KeyAt at = {0, 0.0f};
    while (at.key < count - 1 && times[at.key + 1] <= time) ++at.key;
    if (at.key < count - 1 && time > times[at.key])
        at.share = (time - times[at.key]) / (times[at.key + 1] - times[at.key]);
    return at;
}
} // namespace wrt
