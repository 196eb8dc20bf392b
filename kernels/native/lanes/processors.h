#pragma once
// What differs between processors, by intrinsics of AVX-512 or AVX2, or for any processor that clang knows:
//
//   gathered(base, offsets, exec)  the number at an offset in bytes from `base`, for each lane of `exec`
//   permuted(x, lanes)             each lane reads the lane with a given number
//   packed(x, lanes)               the lanes at the set bits, side by side
//   spread(packed, to, lanes)      the inverse of `packed`: the lanes at the set bits, and those of `to` elsewhere
//   moved(x, from, to, lanes)      the lanes of x at the set bits of `from`, in order, at those of `lanes` in `to`
//   three(p)                       three numbers, without reading a fourth, which may be outside the array
#include "constants.h"
#include "lanes/masks.h"

namespace lanes {
typedef double double_anywhere __attribute__((aligned(4)));
typedef double d2 __attribute__((ext_vector_type(2)));

#if LANES_BIT_MASKS
LANES_INLINE floats gathered(const char* base, ints offsets, Mask exec) {
    return __builtin_ia32_gathersiv16sf((floats)0.0f, base, offsets, bits(exec), 1);
}
LANES_INLINE floats permuted(floats x, ints lanes) { return __builtin_ia32_permvarsf512(x, lanes); }
LANES_INLINE ints packed(ints x, unsigned lanes) {
    return __builtin_ia32_compresssi512_mask(x, (ints)0, (unsigned short)lanes);
}
LANES_INLINE ints spread(ints packed, ints to, unsigned lanes) {
    return __builtin_ia32_expandsi512_mask(packed, to, (unsigned short)lanes);
}
LANES_INLINE ints moved(ints x, unsigned from, ints to, unsigned lanes) { return spread(packed(x, from), to, lanes); }
LANES_INLINE f4 three(const char* p) { return __builtin_ia32_loadups128_mask((const f4*)p, (f4)0.0f, 7); }
#else
LANES_INLINE f4 three(const char* p) {
    f4 v = __builtin_bit_cast(f4, (d2){*(const double_anywhere*)p, 0.0});
    v[2] = *(const float*)(p + 8);
    return v;
}
#if LANES_WIDTH == 8 && defined(__AVX2__)
// There is no instruction that packs lanes, but one that permutes them, and tables of permutations for all masks.
typedef unsigned char Permutations[256][8];
LANES_INLINE ints permutation(const Permutations& of, unsigned lanes) {
    typedef unsigned char bytes __attribute__((ext_vector_type(8), aligned(1)));
    return __builtin_convertvector(*(const bytes*)of[(unsigned char)lanes], ints);
}
static const Permutations set_bits = {WRT_SET_BITS}, ranks_of_bits = {WRT_RANKS_OF_BITS};

LANES_INLINE floats gathered(const char* base, ints offsets, Mask exec) {
    return __builtin_ia32_gatherd_ps256((floats)0.0f, (const float*)base, offsets, __builtin_bit_cast(floats, exec.v), 1);
}
LANES_INLINE ints permuted(ints x, ints lanes) { return __builtin_ia32_permvarsi256(x, lanes); }
LANES_INLINE floats permuted(floats x, ints lanes) { return __builtin_ia32_permvarsf256(x, lanes); }
LANES_INLINE ints packed(ints x, unsigned lanes) { return permuted(x, permutation(set_bits, lanes)); }
LANES_INLINE ints spread(ints packed, ints to, unsigned lanes) {
    return choose(of_bits(lanes), permuted(packed, permutation(ranks_of_bits, lanes)), to);
}
LANES_INLINE ints moved(ints x, unsigned from, ints to, unsigned lanes) {
    const ints whence = permuted(permutation(set_bits, from), permutation(ranks_of_bits, lanes));
    return choose(of_bits(lanes), permuted(x, whence), to);
}
#else
LANES_INLINE floats gathered(const char* base, ints offsets, Mask exec) {
    const ints safe = choose(exec, offsets, (ints)0);
    floats found;
    LANES_UNROLL for (int l = 0; l < WIDTH; ++l) found[l] = *(const float*)(base + safe[l]);
    return found;
}
LANES_INLINE floats permuted(floats x, ints lanes) {
    floats r;
    for (int k = 0; k < WIDTH; ++k) r[k] = x[lanes[k]];
    return r;
}
LANES_INLINE ints packed(ints x, unsigned lanes) {
    ints r = 0;
    for (int k = 0; lanes; lanes &= lanes - 1) r[k++] = x[__builtin_ctz(lanes)];
    return r;
}
LANES_INLINE ints spread(ints packed, ints to, unsigned lanes) {
    for (int k = 0; lanes; lanes &= lanes - 1) to[__builtin_ctz(lanes)] = packed[k++];
    return to;
}
LANES_INLINE ints moved(ints x, unsigned from, ints to, unsigned lanes) {
    for (; from; from &= from - 1, lanes &= lanes - 1) to[__builtin_ctz(lanes)] = x[__builtin_ctz(from)];
    return to;
}
#endif
#endif
} // namespace lanes
