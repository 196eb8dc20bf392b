#pragma once
// A ray against the eight boxes of a node, and many rays against one of them.
#include "exact/shape_axes.h"

namespace wrt {
// Slab test (Kay and Kajiya 1986) as t = b * (1 / d) - o * (1 / d) for a coordinate d of the direction and o of the
// origin. The product o * (1 / d) is rounded; `error` bounds that. All is finite for d = 0, where a ray in the plane of
// a box side would give 0 times infinity. Such a ray meets the boxes on both sides of the plane, hence the larger error.
template<class V> struct Slab {
    V inverse, shift, error;
};
template<class V> WRT_INLINE Slab<V> slab_of(V d, V o) {
    const V smallest = 1e-20f;
    Slab<V> slab;
    slab.inverse = 1.0f / ((size(d) >= smallest) ? d : ((d < 0.0f) ? -smallest : smallest));
    slab.shift = o * slab.inverse;
    slab.error = size(slab.shift) * 2.4e-7f + ((size(d) >= smallest) ? (V)0.0f : (V)1e9f);
    return slab;
}

// A ray prepared for the tests of boxes and triangles. The error moves the shifts outwards; the rows tell where a node
// stores the near and the far sides of its boxes. kx, ky and kz are the axes of the triangle test; the origin is in
// their order.
struct Ray {
    float inverse[4], near_shift[4], far_shift[4];
    int near_row[4], far_row[4], flip;
    float origin[3], shear[3];
    int kx, ky, kz;
    [[no_unique_address]] Axes axes;
};

// Prepare a ray and return whether it can hit anything.
template<class Vector> WRT_INLINE bool set_up(Ray& ray, const Vector& origin, const Vector& direction) {
    float inverse[4];
#if WRT_VECTORS
    {
        const f4 d = {direction[0], direction[1], direction[2], 1.0f}, o = {origin[0], origin[1], origin[2], 0.0f};
        const Slab<f4> slab = slab_of(d, o);
        const i4 backwards = slab.inverse < 0.0f, rows = {0, 8, 16, 0};
        *(f4*)inverse = slab.inverse;
        *(f4*)ray.inverse = slab.inverse;
        *(f4*)ray.near_shift = slab.shift + slab.error;
        *(f4*)ray.far_shift = slab.shift - slab.error;
        *(i4*)ray.near_row = rows + (backwards & 24);
        *(i4*)ray.far_row = rows + (~backwards & 24);
        ray.flip = 7 + backwards[0] + 2 * backwards[1] + 4 * backwards[2];
    }
#else
    ray.flip = 7;
    for (int k = 0; k < 3; ++k) {
        const Slab<float> slab = slab_of((float)direction[k], (float)origin[k]);
        inverse[k] = ray.inverse[k] = slab.inverse;
        ray.near_shift[k] = slab.shift + slab.error;
        ray.far_shift[k] = slab.shift - slab.error;
        ray.flip ^= slab.inverse < 0.0f ? 1 << k : 0;
        ray.near_row[k] = (slab.inverse < 0.0f ? 24 : 0) + 8 * k;
        ray.far_row[k] = (slab.inverse < 0.0f ? 0 : 24) + 8 * k;
    }
#endif
    // The dominant axis of the direction becomes z (Woop et al. 2013, section 3.1).
    const float dx = fabsf(direction[0]), dy = fabsf(direction[1]), dz = fabsf(direction[2]);
    const int kz = dx > dy ? (dx > dz ? 0 : 2) : (dy > dz ? 1 : 2);
    const int kx = kz == 2 ? 0 : kz + 1, ky = kx == 2 ? 0 : kx + 1;
    ray.kx = kx;
    ray.ky = ky;
    ray.kz = kz;
    ray.origin[0] = element(origin, kx);
    ray.origin[1] = element(origin, ky);
    ray.origin[2] = element(origin, kz);
    ray.shear[0] = element(direction, kx) * element(inverse, kz);
    ray.shear[1] = element(direction, ky) * element(inverse, kz);
    ray.shear[2] = element(inverse, kz);
    // A ray with NaN or infinity would meet all boxes, unused ones too; multiplied by 0 these give NaN.
    const float length = dx + dy + dz;
    return length + 0.0f * (length + ray.near_shift[0] + ray.near_shift[1] + ray.near_shift[2]) > 0.0f;
}

#if WRT_VECTORS
// Nodes that wait to be visited, and the bits of the distances to their boxes. Floats that are not negative sort like
// their bits.
struct Stack {
    int *begins, *waiting;
    int& top;
};

// Test the eight boxes of a node, and push the children that the ray meets, the nearest on top. The builder orders the
// children of a node by octant (Ylitie et al. 2017, section 3.2): child p lies towards the corner of the node that the
// bits of p name. So the signs of the ray's direction give an approximate order from near to far without sorting: `flip`
// permutes the children into that order, and a compression drops boxes that the ray misses. Processors without that
// instruction sort the children by distance. (CUDA: `gpu.h`.)
WRT_INLINE void push_children(
    const float* node, const int* children, const Ray& ray, const float t_min, const float t_max, const Stack& stack) {
    const float pad = (float)BOX_PAD;
    const auto distance = [&](int row, int axis, const float* shift) {
        return product_less(*(const f8*)(node + row), ray.inverse[axis], shift[axis]);
    };
    const f8 near_x = distance(ray.near_row[0], 0, ray.near_shift), far_x = distance(ray.far_row[0], 0, ray.far_shift);
    const f8 near_y = distance(ray.near_row[1], 1, ray.near_shift), far_y = distance(ray.far_row[1], 1, ray.far_shift);
    const f8 near_z = distance(ray.near_row[2], 2, ray.near_shift), far_z = distance(ray.far_row[2], 2, ray.far_shift);
    const f8 tn = most(most(near_x, near_y), most(near_z, (f8)t_min));
    const f8 tf = least(least(far_x, far_y), least(far_z, (f8)t_max)) * pad;
#if defined(__AVX2__)
    const i8 order = (i8){0, 1, 2, 3, 4, 5, 6, 7} ^ ray.flip;
    const i8 begins = permuted(__builtin_bit_cast(i8, tn), order), ends = permuted(__builtin_bit_cast(i8, tf), order);
    const unsigned char met = mask_of(__builtin_bit_cast(f8, begins) <= __builtin_bit_cast(f8, ends));
    *(i8*)(stack.begins + stack.top) = compressed(begins, met);
    *(i8*)(stack.waiting + stack.top) = compressed(permuted(*(const i8*)children, order), met);
    stack.top += __builtin_popcount(met);
#else
    unsigned mask = mask_of(tn <= tf);
    alignas(32) float begin[8];
    *(f8*)begin = tn;
    const int bottom = stack.top;
    for (; mask; mask &= mask - 1) {
        const int k = lowest_bit(mask), bits = bits_of(begin[k]);
        int place = stack.top++;
        for (; place > bottom && stack.begins[place - 1] < bits; --place) {
            stack.begins[place] = stack.begins[place - 1];
            stack.waiting[place] = stack.waiting[place - 1];
        }
        stack.begins[place] = bits;
        stack.waiting[place] = children[k];
    }
#endif
}

// Pop the nearest child that begins before t_max; return whether there is one.
WRT_INLINE bool pop_child(int& current, const float t_max, const Stack& stack) {
    const int limit = bits_of(t_max * (float)BOX_PAD);
    while (stack.top > 0) {
        --stack.top;
        if (stack.begins[stack.top] <= limit) {
            current = stack.waiting[stack.top];
            return true;
        }
    }
    return false;
}
#endif
} // namespace wrt
