#pragma once
// Which boxes of distance functions a ray enters.
//
// A box hides nothing: whether a ray meets the surface in it is not known before all hits on other shapes are. So
// traversal keeps the first box apart from the hit, and where the ray enters the second (`kernels/accel/distances.py`).
// Modules that define WRT_BOXES do so.
#include "vectors.h"

namespace wrt {
#if defined(WRT_BOXES)
// The first box by the distance at which a ray enters it, its instance and its number; and where the ray enters the
// second, or before. Of one ray, or of many. LONGEST stands for none.
template<class Float, class Int> struct EntriesOf {
    Float first, second;
    Int instance, id;

    WRT_MEMBER void clear() {
        first = second = (Float)(float)LONGEST;
        instance = (Int)0;
        id = (Int)NOTHING_HIT;
    }
    // A box that lies in several leaves is met several times.
    WRT_MEMBER void add(const Float t, const Float next, const Int of, const Int number) {
        const auto is_same = (of == instance) & (number == id);
        const auto is_lower = (of < instance) | ((of == instance) & (number < id));
        const auto is_first = (t < (Float)(float)LONGEST) & ((t < first) | ((t == first) & is_lower));
        const Float other = is_first ? first : (is_same ? next : t);
        second = least(is_first ? next : second, other);
        first = is_first ? t : first;
        instance = is_first ? of : instance;
        id = is_first ? number : id;
    }
    WRT_MEMBER void add(const EntriesOf& others) { add(others.first, others.second, others.instance, others.id); }
};
typedef EntriesOf<float, int> Entries;
#else
struct Entries {
    WRT_MEMBER void clear() {}
    WRT_MEMBER void add(const Entries&) {}
};
#endif

// Which hits a ray skips, by their distance and number: none.
struct NoneSkipped {
    WRT_MEMBER bool operator()(float, int) const { return false; }
    WRT_MEMBER bool box(float, int) const { return false; }
};
// Those up to the one with this number, of those at this distance.
struct SkippedUpTo {
    float t;
    int id;
    WRT_MEMBER bool operator()(const float at, const int number) const { return at == t && number <= id; }
    WRT_MEMBER bool box(float, int) const { return false; }
};
// All but boxes that are entered later.
struct AllButLaterBoxes {
    float t;
    int id;
    WRT_MEMBER bool operator()(float, int) const { return true; }
    WRT_MEMBER bool box(const float at, const int number) const { return at < t || (at == t && number <= id); }
};
} // namespace wrt
