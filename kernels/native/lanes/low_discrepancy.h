#pragma once
// The functions of low_discrepancy.h for several lanes.
#include "constants.h"
#include "lanes/memory.h"

namespace lanes {
LANES_INLINE Uints reverse_bits(const Uints bits, Mask) { return Uints(__builtin_elementwise_bitreverse(bits.v)); }
// All lanes use the same dimension, which kernels name as a constant.
LANES_INLINE Uints further_dimension(const Uints index, const Ints dimension, const Mask exec) {
    if (!any(exec)) return Uints(0u);
    static const unsigned columns[3][32] = {WRT_SOBOL_COLUMNS};
    const unsigned* const column = columns[lane(dimension, __builtin_ctz(bits(exec))) - 2];
    uints digits = 0u, rest = choose(exec, index.v, (uints)0u);
    for (int k = 0; any(Uints(rest) != Uints(0u)); rest >>= 1, ++k) digits ^= -(rest & 1u) & column[k];
    return Uints(digits);
}
} // namespace lanes
