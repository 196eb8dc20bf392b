#pragma once
// Ranges of boxes during the build (`kernels/accel/build/boxes.py`). A box is eight floats; the component-wise minimum
// of several is the box around them.
#include "vectors.h"

namespace wrt {
constexpr float NO_BOUND = 3.0e38f;

#if WRT_VECTORS
typedef f8 Box;
typedef i4 Bins;
WRT_INLINE Box joined(Box a, Box b) { return __builtin_elementwise_min(a, b); }
WRT_INLINE Box at_least(Box a, float b) { return __builtin_elementwise_max(a, (Box)b); }
#else
typedef wp::vec_t<8, float> Box;
typedef wp::vec_t<3, int> Bins;
WRT_INLINE Box joined(Box a, const Box& b) {
    for (int q = 0; q < 8; ++q) a[q] = least(a[q], b[q]);
    return a;
}
WRT_INLINE Box at_least(Box a, const float b) {
    for (int q = 0; q < 8; ++q) a[q] = most(a[q], b);
    return a;
}
#endif
WRT_INLINE Box loaded(const float* box) { return *(const Box*)box; }
WRT_INLINE void store(float* target, const Box& box) { *(Box*)target = box; }

// Twice the centre of a box and its negation, as a box.
WRT_INLINE Box center_of(const float* box) {
#if WRT_VECTORS
    const f4 twice = *(const f4*)box - *(const f4*)(box + 4);
    return __builtin_shufflevector(twice, -twice, 0, 1, 2, 3, 4, 5, 6, 7);
#else
    Box center;
    for (int q = 0; q < 4; ++q) center[4 + q] = -(center[q] = box[q] - box[4 + q]);
    return center;
#endif
}

// The bin of a box's centre along each axis.
template<class Vector>
WRT_INLINE Bins bins_of(const float* box, const Vector& low, const Vector& scale, const int bins) {
#if WRT_VECTORS
    const f4 low4 = {low[0], low[1], low[2], 0.0f}, scale4 = {scale[0], scale[1], scale[2], 0.0f};
    const f4 place = (*(const f4*)box - *(const f4*)(box + 4) - low4) * scale4;
    return __builtin_elementwise_max(
        __builtin_elementwise_min(__builtin_convertvector(place, i4), (i4)(bins - 1)), (i4)0);
#else
    Bins r;
    for (int q = 0; q < 3; ++q) {
        const int bin = (int)((box[q] - box[4 + q] - low[q]) * scale[q]);
        r[q] = bin < 0 ? 0 : bin < bins - 1 ? bin : bins - 1;
    }
    return r;
#endif
}

template<class Boxes> WRT_INLINE float* boxes_from(const Boxes& boxes, const int first) {
    return (float*)boxes.data + (size_t)first * 8;
}

// The bounds of boxes, or of `of(box)` for each.
template<class Boxes, class Of>
WRT_INLINE wp::vec_t<8, float> bounds_of(const Boxes& boxes, const int first, const int count, Of of) {
    Box bounds = (Box)NO_BOUND;
    const float* box = boxes_from(boxes, first);
    for (int i = 0; i < count; ++i, box += 8) bounds = joined(bounds, of(box));
    wp::vec_t<8, float> result;
    store(&result[0], bounds);
    return result;
}
template<class Boxes> WRT_INLINE wp::vec_t<8, float> bounds_of_range(const Boxes& boxes, int first, int count) {
    return bounds_of(boxes, first, count, [](const float* box) { return loaded(box); });
}
template<class Boxes> WRT_INLINE wp::vec_t<8, float> centers_of_range(const Boxes& boxes, int first, int count) {
    return bounds_of(boxes, first, count, [](const float* box) { return center_of(box); });
}

// Set the bounds and the count of the boxes centred in each bin.
template<class Boxes, class Counts, class Vector>
WRT_INLINE void fill_bins(
    const Boxes& boxes, const int first, const int count, const Vector& low, const Vector& scale, const int bins,
    const Boxes& bin_boxes, const Counts& bin_counts, const int scratch) {
    float* const bounds = boxes_from(bin_boxes, scratch);
    int* const counts = (int*)bin_counts.data + scratch;
    for (int axis = 0; axis < 3; ++axis)
        for (int k = axis * BINS; k < axis * BINS + bins; ++k) {
            store(bounds + 8 * k, (Box)NO_BOUND);
            counts[k] = 0;
        }
    // Neighbours often share a bin, and each would wait for the last one's store; so two distant boxes alternate.
    const float* const box = boxes_from(boxes, first);
    const int half = (count + 1) / 2;
    const auto add = [&](const float* box) {
        const Bins bin = bins_of(box, low, scale, bins);
        for (int axis = 0; axis < 3; ++axis) {
            const int k = axis * BINS + bin[axis];
            store(bounds + 8 * k, joined(loaded(bounds + 8 * k), loaded(box)));
            ++counts[k];
        }
    };
    for (int i = 0; i < half; ++i) {
        add(box + 8 * i);
        if (half + i < count) add(box + 8 * (half + i));
    }
}

// Partition boxes, those of bins up to `last_left_bin` first, and return the number of these.
//
// The side of a box cannot be predicted, so the sides are selected without branches: by address, and by a bound that
// leaves the other side's bounds unchanged. Boxes that go right wait in a small buffer; whenever it is full, it is
// swapped with the last boxes that are not sorted yet (after Edelkamp and Weiss, "BlockQuicksort", 2016). This avoids a
// second array as large as all boxes.
template<class Boxes, class Vector>
WRT_INLINE int part_range(
    const Boxes& boxes, const int first, const int count, const Vector& low, const Vector& scale, const int bins,
    const int axis, const int last_left_bin, const Boxes& centers_out, const int centers_at) {
    constexpr int HELD = WRT_VECTORS ? 64 : 8;
    float buffer[8 * HELD];
    float* const start = boxes_from(boxes, first);
    float* left = start;  // destination of the next box that goes left
    float* box = start;  // the next box to sort
    float* end = start + (size_t)count * 8;  // the end of the boxes to sort
    int held = 0;
    const float low_here = low[axis], scale_here = scale[axis];
    Box left_bounds = (Box)NO_BOUND, right_bounds = (Box)NO_BOUND;
    while (box < end) {
        for (; box < end && held < HELD; box += 8) {
            int bin = (int)((box[axis] - box[4 + axis] - low_here) * scale_here);
            bin = bin < bins - 1 ? bin : bins - 1;
            const bool goes_left = bin <= last_left_bin;
            const Box center = center_of(box);
            const float least_left = goes_left ? -3.4e38f : NO_BOUND, least_right = goes_left ? NO_BOUND : -3.4e38f;
            left_bounds = joined(left_bounds, at_least(center, least_left));
            right_bounds = joined(right_bounds, at_least(center, least_right));
            float* const target = goes_left ? left : buffer + 8 * held;
            left += goes_left ? 8 : 0;
            held += goes_left ? 0 : 1;
            store(target, loaded(box));
        }
        if (held < HELD) break;
        // The gap between left and box has room for all boxes in the buffer.
        const int unseen = (int)((end - box) / 8), moved = unseen < HELD ? unseen : HELD;
        for (int i = 0; i < moved; ++i) store(left + 8 * i, loaded(end - 8 * (moved - i)));
        end -= 8 * HELD;
        for (int i = 0; i < HELD; ++i) store(end + 8 * i, loaded(buffer + 8 * i));
        box = left;
        held = 0;
    }
    for (int i = 0; i < held; ++i) store(left + 8 * i, loaded(buffer + 8 * i));
    float* const out = boxes_from(centers_out, centers_at);
    store(out, left_bounds);
    store(out + 8, right_bounds);
    return (int)((left - start) / 8);
}

template<class Boxes>
WRT_INLINE void swap_ranges(const Boxes& boxes, const int first, const int second, const int count) {
    float *one = boxes_from(boxes, first), *two = boxes_from(boxes, second);
    for (int i = 0; i < count; ++i, one += 8, two += 8) {
        const Box kept = loaded(one);
        store(one, loaded(two));
        store(two, kept);
    }
}
} // namespace wrt
