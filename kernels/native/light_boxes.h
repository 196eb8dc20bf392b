#pragma once
// The tree of boxes around the lights that have a shape and no mesh (`kernels/lights/shapes.py`).
//
// Its boxes lie in depth-first order, each with the place behind its subtree. So a ray goes through the tree by a single
// number, without a stack; and rays that part at a box meet again behind it, which suits rays side by side.
#include "boxes.h"

namespace wrt {
// `LightBox` of `kernels/core/scene_data.py`.
struct LightBox {
    float middle[3], half[3];
    int behind, shape;
};

// Whether lines meet a box before `reach`. The host pads boxes for errors that grow with their coordinates. Here they are
// padded for errors that grow with the ray's: by more than the test of any light is wrong, as that test decides.
template<class V> struct LineToBoxes {
    V inverse[3], shift[3], error[3];
};
template<class V> WRT_INLINE LineToBoxes<V> line_to_boxes(const V* origin, const V* direction) {
    LineToBoxes<V> line;
    WRT_UNROLL for (int k = 0; k < 3; ++k) {
        const Slab<V> slab = slab_of(direction[k], origin[k]);
        line.inverse[k] = slab.inverse;
        line.shift[k] = slab.shift;
        line.error[k] = product((V)8.0f, slab.error);
    }
    return line;
}
template<class V> WRT_INLINE auto meets(const LineToBoxes<V>& line, const LightBox& box, const V reach) {
    V begin = 0.0f, end = reach;
    WRT_UNROLL for (int k = 0; k < 3; ++k) {
        const V middle = product_less((V)box.middle[k], line.inverse[k], line.shift[k]);
        const V half = product((V)box.half[k], size(line.inverse[k])) + line.error[k];
        begin = most(begin, middle - half);
        end = least(end, middle + half);
    }
    return begin <= end * (V)(float)BOX_PAD;
}

// The next box of a light, from `place` on, that a ray meets before `reach`; −1 if there is none. The light `skipped`
// does not count. The second number is 1.
template<class Boxes, class Vector>
WRT_INLINE wp::vec_t<2, int> next_light_box(
    const Boxes& boxes, const Vector& origin_, const Vector& direction_, const float reach, const int skipped, int place) {
    const float origin[3] = {origin_[0], origin_[1], origin_[2]};
    const float direction[3] = {direction_[0], direction_[1], direction_[2]};
    const LineToBoxes<float> line = line_to_boxes(origin, direction);
    while (place < boxes.shape[0]) {
        const LightBox& box = ((const LightBox*)boxes.data)[place];
        const bool met = meets(line, box, reach);
        if (met && box.shape >= 0 && box.shape != skipped) return wp::vec_t<2, int>(place, 1);
        place = met ? place + 1 : box.behind;
    }
    return wp::vec_t<2, int>(-1, 1);
}
} // namespace wrt
