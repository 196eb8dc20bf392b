#pragma once
// Digits of low-discrepancy points (`kernels/sampling/low_discrepancy.py`).
#include "constants.h"

namespace wrt {
static CUDA_CALLABLE inline unsigned reverse_bits(unsigned bits) {
#if defined(__CUDA_ARCH__)
    return __brev(bits);
#else
    return __builtin_bitreverse32(bits);
#endif
}
#if defined(__CUDA_ARCH__)
// A table within the function would be copied to the stack of each thread.
static __device__ const unsigned columns[3][32] = {WRT_SOBOL_COLUMNS};
#endif
static CUDA_CALLABLE inline unsigned further_dimension(const unsigned index, const int dimension) {
#if !defined(__CUDA_ARCH__)
    const unsigned columns[3][32] = {WRT_SOBOL_COLUMNS};
#endif
    unsigned digits = 0;
    for (unsigned rest = index; rest; rest &= rest - 1) {
#if defined(__CUDA_ARCH__)
        digits ^= columns[dimension - 2][__ffs(rest) - 1];
#else
        digits ^= columns[dimension - 2][__builtin_ctz(rest)];
#endif
    }
    return digits;
}
} // namespace wrt
