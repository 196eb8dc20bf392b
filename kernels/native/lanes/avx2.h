#pragma once
// What eight lanes do in a few instructions of AVX2; `portable.h` describes each function.
//
// There is no instruction that packs lanes, but one that permutes them, and tables of permutations for all masks.
#include "constants.h"
#include "lanes/masks.h"

#if LANES_WIDTH == 8 && defined(__AVX2__)
#define LANES_AVX2 1
namespace lanes {
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
} // namespace lanes
#endif
