"""Ranges of triangles' boxes while a tree is built: their bounds, their bins, their two sides.

Boxes lie as in `kernels/bvh_boxes.py`. Of a box's centre only twice its coordinates are needed, lower minus negated
upper; kept beside its negation it joins like a box.

C++ with clang's vector types and loops for CUDA: in Warp's Python the three loops took three times as
long, and they are most of a build.
"""

import warp as wp

from wrt.kernels.simd import VECTOR_CODE, VECTOR_TYPES, vec8

BINS = 16

_PRELUDE = (
    VECTOR_TYPES
    + """
#if VECTOR_CODE
    // target = the box around target and box
    #define JOIN(target, box) *(f8*)(target) = __builtin_elementwise_min(*(const f8*)(target), *(const f8*)(box))
    #define COPY(target, box) *(f8*)(target) = *(const f8*)(box)
    // center: float[8], twice the centre and its negation
    #define CENTER(center, box) \\
        const f4 twice = *(const f4*)(box) - *(const f4*)((box) + 4); \\
        *(f8*)center = __builtin_shufflevector(twice, -twice, 0, 1, 2, 3, 4, 5, 6, 7)
    // bin: int[4], the bin of the box's centre along each axis
    #define FIND_BINS(bin, box) \\
        const f4 low4 = {low[0], low[1], low[2], 0.0f}, scale4 = {scale[0], scale[1], scale[2], 0.0f}; \\
        const f4 place = (*(const f4*)(box) - *(const f4*)((box) + 4) - low4) * scale4; \\
        const i4 bin = __builtin_elementwise_max(__builtin_elementwise_min( \\
            __builtin_convertvector(place, i4), (i4)(bins - 1)), (i4)0)
#else
    #define JOIN(target, box) for (int q = 0; q < 8; ++q) (target)[q] = fminf((target)[q], (box)[q])
    #define COPY(target, box) for (int q = 0; q < 8; ++q) (target)[q] = (box)[q]
    #define CENTER(center, box) \\
        for (int q = 0; q < 4; ++q) center[4 + q] = -(center[q] = (box)[q] - (box)[4 + q])
    #define FIND_BINS(bin, box) \\
        int bin[3]; \\
        for (int q = 0; q < 3; ++q) { \\
            bin[q] = (int)(((box)[q] - (box)[4 + q] - low[q]) * scale[q]); \\
            bin[q] = bin[q] < 0 ? 0 : bin[q] < bins - 1 ? bin[q] : bins - 1; \\
        }
#endif
    #define JOIN_CENTER(target, box) float center[8]; CENTER(center, box); JOIN(target, center)
"""
)

_POSTLUDE = """
#undef JOIN
#undef COPY
#undef CENTER
#undef FIND_BINS
#undef JOIN_CENTER
"""


def _native(code: str) -> str:
    return (_PRELUDE + code + _POSTLUDE).replace("VECTOR_CODE", VECTOR_CODE).replace("BINS", str(BINS))


# JOIN_TO joins a box, or what it stands for, to the bounds.
_BOUNDS = """
    float bounds[8];
    for (int q = 0; q < 8; ++q) bounds[q] = 3.0e38f;
    const float* box = (const float*)boxes.data + (size_t)first * 8;
    for (int i = 0; i < count; ++i, box += 8) {
        JOIN_TO(bounds, box);
    }
    wp::vec_t<8, float> result;
    for (int q = 0; q < 8; ++q) result[q] = bounds[q];
    return result;
"""


@wp.func_native(_native(_BOUNDS.replace("JOIN_TO", "JOIN")))
def bounds_of_range(boxes: wp.array(dtype=vec8), first: int, count: int) -> vec8:
    """Return the box around `count` boxes from `first`."""
    ...


@wp.func_native(_native(_BOUNDS.replace("JOIN_TO", "JOIN_CENTER")))
def centers_of_range(boxes: wp.array(dtype=vec8), first: int, count: int) -> vec8:
    """Return the bounds of twice the centres of `count` boxes from `first`, as a box."""
    ...


_FILL_BINS = """
    float* const bounds = (float*)bin_boxes.data + (size_t)scratch * 8;
    int* const counts = (int*)bin_counts.data + scratch;
    for (int axis = 0; axis < 3; ++axis)
        for (int k = axis * BINS; k < axis * BINS + bins; ++k) {
            for (int q = 0; q < 8; ++q) bounds[8 * k + q] = 3.0e38f;
            counts[k] = 0;
        }
    // Neighbours fall into one bin, and each would wait for the last one's store; so two far apart in turn.
    const float* const box = (const float*)boxes.data + (size_t)first * 8;
    const int half = (count + 1) / 2;
    const auto add = [&](const float* box) {
        FIND_BINS(bin, box);
        for (int axis = 0; axis < 3; ++axis) {
            const int k = axis * BINS + bin[axis];
            JOIN(bounds + 8 * k, box);
            ++counts[k];
        }
    };
    for (int i = 0; i < half; ++i) {
        add(box + 8 * i);
        if (half + i < count) add(box + 8 * (half + i));
    }
"""


@wp.func_native(_native(_FILL_BINS))
def fill_bins(
    boxes: wp.array(dtype=vec8),
    first: int,
    count: int,
    low: wp.vec3,
    scale: wp.vec3,
    bins: int,
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    scratch: int,
):
    """Set bins `scratch` + BINS axis + 0 to `bins` − 1 to the bounds and number of the boxes with centres in them."""
    ...


# Which side a box goes to cannot be guessed, so the sides are chosen without a branch: by address, and
# by a bound that leaves the side's bounds as they are. Boxes that go right wait in a small buffer; whenever it
# is full, it changes places with the last boxes that were not looked at yet (after Edelkamp and Weiss,
# "BlockQuicksort", 2016). So no second array is needed, which would be as large as all boxes.
_PART = """
#if VECTOR_CODE
    const int HELD = 64;
#else
    const int HELD = 8;
#endif
    float buffer[8 * HELD];
    float* const start = (float*)boxes.data + (size_t)first * 8;
    float* left = start;  // where the next box that goes left is put
    float* box = start;  // the next one to look at
    float* end = start + (size_t)count * 8;  // of those to look at
    int held = 0;
    const float low_here = low[axis], scale_here = scale[axis];
#if VECTOR_CODE
    f8 left_bounds = 3.0e38f, right_bounds = 3.0e38f;
#else
    float left_bounds[8], right_bounds[8];
    for (int q = 0; q < 8; ++q) left_bounds[q] = right_bounds[q] = 3.0e38f;
#endif
    while (box < end) {
        for (; box < end && held < HELD; box += 8) {
            int bin = (int)((box[axis] - box[4 + axis] - low_here) * scale_here);
            bin = bin < bins - 1 ? bin : bins - 1;
            const bool goes_left = bin <= last_left_bin;
            float center[8];
            CENTER(center, box);
            const float least_left = goes_left ? -3.4e38f : 3.0e38f, least_right = goes_left ? 3.0e38f : -3.4e38f;
#if VECTOR_CODE
            const f8 here = *(const f8*)center;
            left_bounds = __builtin_elementwise_min(left_bounds, __builtin_elementwise_max(here, (f8)least_left));
            right_bounds = __builtin_elementwise_min(right_bounds, __builtin_elementwise_max(here, (f8)least_right));
#else
            for (int q = 0; q < 8; ++q) {
                left_bounds[q] = fminf(left_bounds[q], fmaxf(center[q], least_left));
                right_bounds[q] = fminf(right_bounds[q], fmaxf(center[q], least_right));
            }
#endif
            float* const target = goes_left ? left : buffer + 8 * held;
            left += goes_left ? 8 : 0;
            held += goes_left ? 0 : 1;
            COPY(target, box);
        }
        if (held < HELD) break;
        // Between left and box there is room for as many as the buffer holds.
        const int unseen = (int)((end - box) / 8), moved = unseen < HELD ? unseen : HELD;
        for (int i = 0; i < moved; ++i) COPY(left + 8 * i, end - 8 * (moved - i));
        end -= 8 * HELD;
        for (int i = 0; i < HELD; ++i) COPY(end + 8 * i, buffer + 8 * i);
        box = left;
        held = 0;
    }
    for (int i = 0; i < held; ++i) COPY(left + 8 * i, buffer + 8 * i);
    float* const out = (float*)centers_out.data + (size_t)centers_at * 8;
    for (int q = 0; q < 8; ++q) {
        out[q] = left_bounds[q];
        out[8 + q] = right_bounds[q];
    }
    return (int)((left - start) / 8);
"""


@wp.func_native(_native(_PART))
def part_range(
    boxes: wp.array(dtype=vec8),
    first: int,
    count: int,
    low: wp.vec3,
    scale: wp.vec3,
    bins: int,
    axis: int,
    last_left_bin: int,
    centers_out: wp.array(dtype=vec8),
    centers_at: int,
) -> int:
    """Put the boxes of bins up to `last_left_bin` before the others; return how many they are.

    The bounds of the centres of both sides go to `centers_out`.
    """
    ...


_SWAP = """
    float* one = (float*)boxes.data + (size_t)first * 8;
    float* two = (float*)boxes.data + (size_t)second * 8;
    for (int i = 0; i < count; ++i, one += 8, two += 8) {
        float kept[8];
        COPY(kept, one);
        COPY(one, two);
        COPY(two, kept);
    }
"""


@wp.func_native(_native(_SWAP))
def swap_ranges(boxes: wp.array(dtype=vec8), first: int, second: int, count: int):
    """Let `count` boxes from `first` and from `second` change places."""
    ...
