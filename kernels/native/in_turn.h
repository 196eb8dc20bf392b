#pragma once
// Interleaved rays in one thread, a step of each in turn.
//
// A ray's next step waits for the last one: for memory, and for a chain of dependent instructions. The steps of other
// rays are independent, so an out-of-order processor works on all of them at once. A mispredicted branch would discard
// the work of every ray: hence children are pushed without branches (`push_children`), and rays at nodes and rays at
// leaves are stepped in separate loops. The data for a ray's next step are prefetched while the other rays take theirs.
#include "traversal.h"

namespace wrt {
#if WRT_VECTORS
// A ray in flight; `number` is negative for none.
struct Traveller {
    Nearest nearest;
    int current, top, number;
    int begins[STACK_SIZE + 8], waiting[STACK_SIZE + 8];
};

// Trace the rays of `source`, MOST_IN_TURN or fewer at a time.
//   source.start(t)   put the next ray into a traveller, or a negative number
//   source.branch(t)  send a ray without waiting nodes to another node; false if it is done
//   source.finish(t)  store the result of a ray that is done
//   source.ray(t)     the ray
//   source.tree(t)    the tree that it goes through
template<bool any_hit, int MOST_IN_TURN, class Traveller, class Source>
WRT_INLINE void follow_in_turn(const float t_min, const int in_turn, const int lines, Source& source) {
    Traveller travellers[MOST_IN_TURN];
    // Rays at nodes, and rays at leaves.
    int at[2][MOST_IN_TURN + 1], counts[2] = {0, 0};
    const auto wait = [&](const int i) WRT_INLINE_LAMBDA {
        const int current = travellers[i].current, is_leaf = current < 0, is_live = travellers[i].number >= 0;
        source.tree(travellers[i]).prefetch(current, lines);
        at[0][counts[0]] = i;
        counts[0] += is_live & !is_leaf;
        at[1][counts[1]] = i;
        counts[1] += is_live & is_leaf;
    };
    const auto step_each = [&](const int kind, const auto step) WRT_INLINE_LAMBDA {
        const int count = counts[kind];
        counts[kind] = 0;
        WRT_NO_UNROLLING for (int p = 0; p < count; ++p) {
            const int i = at[kind][p];
            Traveller& t = travellers[i];
            step(t);
            if (!pop_child(t.current, t.nearest.t, {t.begins, t.waiting, t.top}) && !source.branch(t)) {
                source.finish(t);
                source.start(t);
            }
            wait(i);
        }
    };
    for (int i = 0; i < in_turn; ++i) {
        travellers[i].current = 0;
        source.start(travellers[i]);
        wait(i);
    }
    while (counts[0] + counts[1] > 0) {
        step_each(0, [&](Traveller& t) WRT_INLINE_LAMBDA {
            const Stack stack = {t.begins, t.waiting, t.top};
            const Tree& tree = source.tree(t);
            push_children(tree.node(t.current), tree.children(t.current), source.ray(t), t_min, t.nearest.t, stack);
        });
        step_each(1, [&](Traveller& t) WRT_INLINE_LAMBDA {
            test_leaf(source.tree(t).leaf(t.current), source.ray(t), t_min, t.nearest);
            if (any_hit && t.nearest.id != NOTHING_HIT) {
                t.top = 0;
                t.nearest.t = -1.0f;  // a ray that is done hits nothing more
            }
        });
    }
}
#endif
} // namespace wrt
