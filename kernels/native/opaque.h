#pragma once
// A number of which the compiler knows nothing from here on, on CUDA: it cannot tell apart the ways that lead here.
#include "vectors.h"

namespace wrt {
WRT_INLINE int opaque(int value) {
#if defined(__CUDA_ARCH__)
    asm volatile("// opaque" : "+r"(value));
#endif
    return value;
}
} // namespace wrt
