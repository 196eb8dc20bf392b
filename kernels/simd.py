"""Vector code for the few places that are worth it: clang's vector types on the CPU, loops on CUDA.

Each function states in its docstring what both branches compute; they agree bit for bit but for
the contraction of products and sums, which is switched off where results must be exact.
"""

import warp as wp

vec8 = wp.types.vector(length=8, dtype=float)


@wp.func_native("""
#if defined(__clang__) && !defined(__CUDA_ARCH__)
    return mask == 0 ? 32 : __builtin_ctz((unsigned)mask);
#else
    return __ffs(mask) - 1;
#endif
""")
def lowest_bit(mask: int) -> int:
    """Return the number of the lowest bit set; mask must not be zero."""
    ...


@wp.func_native("""
    // Slab test (Kay and Kajiya 1986) with the bounds on rounding of Ize (2013): the far side is
    // pushed out by 2 gamma(3), the near side pulled in alike so that ties in t are never culled.
    const float* b = (const float*)nodes.data + (size_t)node * 56;
    const float far_pad = 1.0000005f, near_pad = 0.9999995f;
    const int nx = inverse[0] < 0.0f ? 24 : 0, ny = inverse[1] < 0.0f ? 32 : 8, nz = inverse[2] < 0.0f ? 40 : 16;
    const float *near_x = b + nx, *near_y = b + ny, *near_z = b + nz;
    const float *far_x = b + 24 - nx, *far_y = b + 40 - ny, *far_z = b + 56 - nz;
    wp::vec_t<8, float> result;
#if defined(__clang__) && !defined(__CUDA_ARCH__)
    typedef float f8 __attribute__((ext_vector_type(8), aligned(4)));
    typedef int i8 __attribute__((ext_vector_type(8)));
    const f8 ix = inverse[0], iy = inverse[1], iz = inverse[2];
    const f8 ox = origin[0], oy = origin[1], oz = origin[2];
    f8 tn = __builtin_elementwise_max((*(const f8*)near_x - ox) * ix, (*(const f8*)near_y - oy) * iy);
    tn = __builtin_elementwise_max(tn, (*(const f8*)near_z - oz) * iz);
    tn = __builtin_elementwise_max(tn, (f8)0.0f) * near_pad;
    f8 tf = __builtin_elementwise_min((*(const f8*)far_x - ox) * ix, (*(const f8*)far_y - oy) * iy);
    tf = __builtin_elementwise_min(tf, (*(const f8*)far_z - oz) * iz) * far_pad;
    tf = __builtin_elementwise_min(tf, (f8)t_max);
    const i8 hit = tn <= tf;
    const f8 infinite = __builtin_inff();
    tn = hit ? tn : infinite;
    __builtin_memcpy(&result, &tn, 32);
#else
    for (int k = 0; k < 8; ++k) {
        float tn = fmaxf((near_x[k] - origin[0]) * inverse[0], (near_y[k] - origin[1]) * inverse[1]);
        tn = fmaxf(fmaxf(tn, (near_z[k] - origin[2]) * inverse[2]), 0.0f) * near_pad;
        float tf = fminf((far_x[k] - origin[0]) * inverse[0], (far_y[k] - origin[1]) * inverse[1]);
        tf = fminf(fminf(tf, (far_z[k] - origin[2]) * inverse[2]) * far_pad, t_max);
        result[k] = tn <= tf ? tn : INFINITY;
    }
#endif
    return result;
""")
def box_distances(
    nodes: wp.array(dtype=float), node: int, origin: wp.vec3, inverse: wp.vec3, t_max: float
) -> vec8:
    """Return how far along the ray each of a node's eight boxes begins, infinity where it misses.

    A box counts as hit where it begins at most `t_max` away; empty slots have boxes nothing hits.
    """
    ...


@wp.func_native("""
#if defined(__clang__) && !defined(__CUDA_ARCH__)
    typedef float f8 __attribute__((ext_vector_type(8)));
    typedef bool b8 __attribute__((ext_vector_type(8)));
    f8 x;
    __builtin_memcpy(&x, &v, 32);
    return __builtin_bit_cast(unsigned char, __builtin_convertvector(x < (f8)__builtin_inff(), b8));
#else
    int mask = 0;
    for (int k = 0; k < 8; ++k) mask |= (v[k] < INFINITY) << k;
    return mask;
#endif
""")
def finite_mask(v: vec8) -> int:
    """Return a bit for each element that is below infinity, the first in bit 0."""
    ...


@wp.func_native("""
    // Woop, Benthin and Wald (2013). Every vertex is moved and sheared by arithmetic of its own, so
    // triangles that share an edge see the same numbers; products are rounded before they are
    // subtracted (no contraction), so the sign of an edge function can vanish but never be wrong.
    const float* b = (const float*)leaves.data + (size_t)leaf * 40;
    const int kx = axes & 3, ky = (axes >> 2) & 3, kz = axes >> 4;
    wp::vec_t<4, float> result(INFINITY, 0.0f, 0.0f, 0.0f);
    const int* ids = (const int*)(b + 36);
    float ts[4], us[4], vs[4];
    int mask = 0;
#if defined(__clang__) && !defined(__CUDA_ARCH__)
    {
    #pragma clang fp contract(off)
    typedef float f4 __attribute__((ext_vector_type(4), aligned(4)));
    typedef int i4 __attribute__((ext_vector_type(4)));
    const f4 sx = shear[0], sy = shear[1], sz = shear[2];
    const f4 ox = origin[kx], oy = origin[ky], oz = origin[kz];
    #define WRT_ROW(v, k) (*(const f4*)(b + 12 * (v) + 4 * (k)))
    const f4 az = WRT_ROW(0, kz) - oz, bz = WRT_ROW(1, kz) - oz, cz = WRT_ROW(2, kz) - oz;
    const f4 ax = (WRT_ROW(0, kx) - ox) - sx * az, ay = (WRT_ROW(0, ky) - oy) - sy * az;
    const f4 bx = (WRT_ROW(1, kx) - ox) - sx * bz, by = (WRT_ROW(1, ky) - oy) - sy * bz;
    const f4 cx = (WRT_ROW(2, kx) - ox) - sx * cz, cy = (WRT_ROW(2, ky) - oy) - sy * cz;
    #undef WRT_ROW
    const f4 u = cx * by - cy * bx, v = ax * cy - ay * cx, w = bx * ay - by * ax;
    const f4 low = __builtin_elementwise_min(__builtin_elementwise_min(u, v), w);
    const f4 high = __builtin_elementwise_max(__builtin_elementwise_max(u, v), w);
    const f4 det = u + v + w;
    const i4 inside = ((low >= 0.0f) | (high <= 0.0f)) & (det != 0.0f);
    const f4 inverse = 1.0f / det;
    const f4 t = (u * az + v * bz + w * cz) * sz * inverse;
    const i4 hit = inside & (t >= t_min) & (t <= t_max);
    typedef bool b4 __attribute__((ext_vector_type(4)));
    for (int k = 0; k < 4; ++k) mask |= (hit[k] & 1) << k;
    if (mask == 0) return result;
    const f4 tu = v * inverse, tv = w * inverse;
    __builtin_memcpy(ts, &t, 16);
    __builtin_memcpy(us, &tu, 16);
    __builtin_memcpy(vs, &tv, 16);
    }
#else
    for (int k = 0; k < 4; ++k) {
        const float* p = b + k;
        const float az = __fsub_rn(p[4 * kz], origin[kz]), bz = __fsub_rn(p[12 + 4 * kz], origin[kz]),
                    cz = __fsub_rn(p[24 + 4 * kz], origin[kz]);
        #define WRT_SHEAR(v, a, s, z) __fsub_rn(__fsub_rn(p[12 * (v) + 4 * (a)], origin[a]), __fmul_rn(s, z))
        const float ax = WRT_SHEAR(0, kx, shear[0], az), ay = WRT_SHEAR(0, ky, shear[1], az);
        const float bx = WRT_SHEAR(1, kx, shear[0], bz), by = WRT_SHEAR(1, ky, shear[1], bz);
        const float cx = WRT_SHEAR(2, kx, shear[0], cz), cy = WRT_SHEAR(2, ky, shear[1], cz);
        #undef WRT_SHEAR
        const float u = __fsub_rn(__fmul_rn(cx, by), __fmul_rn(cy, bx));
        const float v = __fsub_rn(__fmul_rn(ax, cy), __fmul_rn(ay, cx));
        const float w = __fsub_rn(__fmul_rn(bx, ay), __fmul_rn(by, ax));
        const bool inside = (fminf(fminf(u, v), w) >= 0.0f) || (fmaxf(fmaxf(u, v), w) <= 0.0f);
        const float det = __fadd_rn(__fadd_rn(u, v), w);
        const float inverse = 1.0f / det;
        const float sum = __fadd_rn(__fadd_rn(__fmul_rn(u, az), __fmul_rn(v, bz)), __fmul_rn(w, cz));
        ts[k] = __fmul_rn(__fmul_rn(sum, shear[2]), inverse);
        us[k] = v * inverse;
        vs[k] = w * inverse;
        mask |= (inside && det != 0.0f && ts[k] >= t_min && ts[k] <= t_max) << k;
    }
#endif
    int best = -1;
    for (int k = 0; k < 4; ++k) {
        if (!((mask >> k) & 1)) continue;
        if (ts[k] == t_max && ids[k] > id_max) continue;
        if (best < 0 || ts[k] < ts[best] || (ts[k] == ts[best] && ids[k] < ids[best])) best = k;
    }
    if (best >= 0) result = wp::vec_t<4, float>(ts[best], us[best], vs[best], (float)best);
    return result;
""")
def nearest_triangle(
    leaves: wp.array(dtype=float),
    leaf: int,
    origin: wp.vec3,
    shear: wp.vec3,
    axes: int,
    t_min: float,
    t_max: float,
    id_max: int,
) -> wp.vec4:
    """Return (t, u, v, lane) of the nearest of a leaf's four triangles, t infinite where none is hit.

    Hits lie in [t_min, t_max]; of triangles at one distance the lowest number wins, and at exactly
    `t_max` only a number of at most `id_max` does.
    """
    ...
