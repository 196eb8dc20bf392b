// Threads of a warp that wait for one another (PTX ISA, NVIDIA, sections 9.7.13 and 9.7.14).
enum : u32 { ACTIVE_MASK, BALLOT, BARRIER };
constexpr u32 ENDED = ~0u;

// A thread: its place, the kind of stop, the threads it waits for, its vote, and the answer.
struct Lane {
    u32 at, kind, mask, value, result;
};

extern "C" {
u64 stuck;  // whether threads waited for others that never came
u64 divided;  // whether threads with odd and even numbers are never active together
}

// The lanes that go on with lane k, none if it has to wait. No lane waits for one that has ended.
template<class T> static u32 group_of(const T* lanes, const u32 k, const u32 ended) {
    const Lane& one = lanes[k];
    u32 group = 0;
    for (u32 j = 0; j < 32; ++j) {
        const Lane& other = lanes[j];
        if (ended >> j & 1 || other.kind != one.kind) continue;
        if (one.kind == ACTIVE_MASK ? other.at == one.at && !(divided && (j ^ k) & 1) : other.mask == one.mask)
            group |= 1u << j;
    }
    if (one.kind == ACTIVE_MASK) return group;
    const u32 named = one.mask & ~ended;
    return (group & named) == named && one.mask >> k & 1 ? named : 0;
}
// Run the threads of a warp that are `there`. Each runs to its next stop; then all that can go on do.
template<class T, class Run> static void run_warp(T* lanes, const u32 there, Run run) {
    u32 ended = ~there, ready = there;
    for (u32 k = 0; k < 32; ++k) lanes[k].at = 0;
    while (ready) {
        for (u32 k = 0; k < 32; ++k)
            if (ready >> k & 1) {
                run(lanes[k], k);
                if (lanes[k].at == ENDED) ended |= 1u << k;
            }
        ready = 0;
        for (u32 k = 0; k < 32; ++k) {
            if ((ended | ready) >> k & 1) continue;
            const u32 group = group_of(lanes, k, ended);
            u32 votes = 0;
            for (u32 j = 0; j < 32; ++j) votes |= (group >> j & 1 && lanes[j].value) << j;
            for (u32 j = 0; j < 32; ++j)
                if (group >> j & 1) lanes[j].result = lanes[j].kind == ACTIVE_MASK ? group : votes;
            ready |= group;
        }
    }
    if (~ended) stuck = 1;
}
