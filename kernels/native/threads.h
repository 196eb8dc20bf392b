#pragma once
// How threads of a GPU work together: votes among the lanes of a warp, which run together, and the order of memory. On
// the CPU a thread has no others beside it.
#include "vectors.h"

namespace wrt {
// Lanes are bits. Lanes that vote together name the same lanes and wait for all of them. So between two votes, loops must
// continue or end by a value that is the same in all lanes, such as a vote.
WRT_INLINE unsigned lanes_beside() {
#if defined(__CUDA_ARCH__)
    return __activemask();
#else
    return 1u;
#endif
}
// The lanes that vote yes.
WRT_INLINE unsigned votes(const unsigned lanes, const bool vote) {
#if defined(__CUDA_ARCH__)
    return __ballot_sync(lanes, vote);
#else
    return vote ? lanes : 0u;
#endif
}
WRT_INLINE int number_of(const unsigned lanes) {
#if defined(__CUDA_ARCH__)
    return __popc(lanes);
#else
    return __builtin_popcount(lanes);
#endif
}
// Writes before the fence are seen by every thread that sees a later one, and reads after it see what is current.
WRT_INLINE void fence() {
#if defined(__CUDA_ARCH__)
    __threadfence();
#endif
}
} // namespace wrt
