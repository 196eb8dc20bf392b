#pragma once
// What needs intrinsics elsewhere (`avx512.h`, `avx2.h`), for any processor that clang knows.
#include "lanes/avx2.h"
#include "lanes/avx512.h"

#if !LANES_BIT_MASKS && !defined(LANES_AVX2)
namespace lanes {
// The number at an offset in bytes from `base`, for each lane of `exec`.
LANES_INLINE floats gathered(const char* base, ints offsets, Mask exec) {
    const ints safe = choose(exec, offsets, (ints)0);
    floats found;
    LANES_UNROLL for (int l = 0; l < WIDTH; ++l) found[l] = *(const float*)(base + safe[l]);
    return found;
}
// Each lane reads the lane with a given number.
LANES_INLINE floats permuted(floats x, ints lanes) {
    floats r;
    for (int k = 0; k < WIDTH; ++k) r[k] = x[lanes[k]];
    return r;
}
// The lanes at the set bits, side by side.
LANES_INLINE ints packed(ints x, unsigned lanes) {
    ints r = 0;
    for (int k = 0; lanes; lanes &= lanes - 1) r[k++] = x[__builtin_ctz(lanes)];
    return r;
}
// The inverse of `packed`: the lanes at the set bits, and those of `to` elsewhere.
LANES_INLINE ints spread(ints packed, ints to, unsigned lanes) {
    for (int k = 0; lanes; lanes &= lanes - 1) to[__builtin_ctz(lanes)] = packed[k++];
    return to;
}
// The lanes of x at the set bits of `from`, in order, in place of those of `to` at the set bits of `lanes`.
LANES_INLINE ints moved(ints x, unsigned from, ints to, unsigned lanes) {
    for (; from; from &= from - 1, lanes &= lanes - 1) to[__builtin_ctz(lanes)] = x[__builtin_ctz(from)];
    return to;
}
} // namespace lanes
#endif
