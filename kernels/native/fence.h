#pragma once
// The order in which threads of a GPU see each other's writes.
#include "vectors.h"

namespace wrt {
// Writes before the fence are seen by every thread that sees a later one, and reads after it see what is current.
WRT_INLINE void fence() {
#if defined(__CUDA_ARCH__)
    __threadfence();
#endif
}
} // namespace wrt
