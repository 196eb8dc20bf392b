#pragma once
// Votes among the lanes of a warp, the threads that a GPU runs together. On the CPU a thread has no others beside it.
#include "vectors.h"

namespace wrt {
// Lanes are bits. All that vote with one another name the same lanes, and wait until all of these vote; so they go by
// what is true of them together, such as their votes, wherever a loop goes on or ends between two votes.
WRT_INLINE unsigned lanes_beside() {
#if defined(__CUDA_ARCH__)
    return __activemask();
#else
    return 1u;
#endif
}
// Those of the lanes that say yes.
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
} // namespace wrt
