#pragma once
// The boxes around lights for several lanes, which go through the tree side by side.
#include "lanes/memory.h"
#include "light_boxes.h"

namespace lanes {
// The next box that the ray of any lane meets, in all lanes, and whether the lane's own ray does. All lanes of `exec`
// have the same place.
template<class Boxes>
LANES_CALLED Vector<2, Ints> next_light_box(
    const Boxes& boxes, const Vector<3, Floats>& origin_, const Vector<3, Floats>& direction_, const Floats& reach,
    const Ints& skipped, const Ints& place_, const Mask exec) {
    const floats origin[3] = {origin_.c[0].v, origin_.c[1].v, origin_.c[2].v};
    const floats direction[3] = {direction_.c[0].v, direction_.c[1].v, direction_.c[2].v};
    const wrt::LineToBoxes<floats> line = wrt::line_to_boxes(origin, direction);
    const floats end = choose(exec, reach.v, (floats)-1.0f);
    Vector<2, Ints> found;
    int place = lane(place_, __builtin_ctz(bits(exec) | 1u << (WIDTH - 1)));
    while (place < boxes.shape[0]) {
        const wrt::LightBox& box = ((const wrt::LightBox*)boxes.data)[place];
        const ints met = wrt::meets(line, box, end);
        const ints counts = met & (skipped.v != box.shape);
        if (box.shape >= 0 && wrt::mask_of(counts) != 0) {
            found.c[0] = Ints(place);
            found.c[1].v = -counts;
            return found;
        }
        place = wrt::mask_of(met) != 0 ? place + 1 : box.behind;
    }
    found.c[0] = Ints(-1);
    found.c[1] = Ints(0);
    return found;
}
} // namespace lanes
