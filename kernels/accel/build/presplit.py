"""Large triangles split into several boxes, which the builder sorts like triangles.

Karras and Aila, "Fast Parallel Construction of High-Quality Bounding Volume Hierarchies" (2013), section 4. A long,
slanted triangle fills little of its box, so rays often hit the box and miss the triangle. Before the tree is built,
triangles that waste most are cut by planes that halve the scene's box recursively; a piece is the box of the part on
one side. Leaves hold whole triangles, some of them in several leaves.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import Corners, box_around, corners_of, half_area, high_of, low_of, make_box, vec8

# Unrolled loops take Warp many times as long to compile and run no faster.
wp.set_module_options({"max_unroll": 1})

GRID_BITS = 24
"""The finest planes divide the scene by 2^24, the resolution of float32."""

LEAST_CUTS = wp.constant(2)
"""Triangles that deserve fewer cuts stay whole."""

_GRID = wp.constant(float(2**GRID_BITS))
_STEPS = wp.constant(2**GRID_BITS)
# Bound on the rounding error of a point between two corners: four operations on numbers as large as they are.
_ROUNDING = wp.constant(2.4e-7)


@wp.struct
class Cut:
    """The plane that cuts a box: its axis, its position, and how many halvings precede it, −1 for no plane."""

    axis: int
    place: float
    level: int


@wp.func
def find_cut(low: wp.vec3, high: wp.vec3, scene_low: wp.vec3, scene_size: wp.vec3) -> Cut:
    """Return the coarsest plane that crosses a box's longest axis."""
    cut = Cut()
    size = high - low
    cut.axis = wp.where(size[0] >= size[1] and size[0] >= size[2], 0, wp.where(size[1] >= size[2], 1, 2))
    a = cut.axis
    cut.place = 0.5 * (low[a] + high[a])
    cut.level = -1
    scale = _GRID / scene_size[a]
    first = wp.min(int((low[a] - scene_low[a]) * scale), _STEPS - 1)
    last = wp.min(int((high[a] - scene_low[a]) * scale), _STEPS - 1)
    # The highest bit in which the two ends differ gives the coarsest plane between them.
    differ = first ^ last
    if differ > 0:
        bit = int(0)
        while (differ >> (bit + 1)) != 0:
            bit += 1
        place = scene_low[a] + float((last >> bit) << bit) / scale
        if place > low[a] and place < high[a]:
            cut.place = place
            cut.level = wp.static(GRID_BITS - 1) - bit
    return cut


@wp.kernel(enable_backward=False)
def find_importance(
    first: int,
    points: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    scene_low: wp.vec3,
    scene_size: wp.vec3,
    importance_out: wp.array(dtype=float),
):
    """Rate triangles by the wasted area of their boxes and the plane that cuts them (Karras and Aila, section 4.2)."""
    i = first + wp.tid()
    corners = corners_of(points, indices, i)
    triangle_box = box_around(corners, i)
    low = low_of(triangle_box)
    high = high_of(triangle_box)
    # Work relative to the scene, or the areas of large ones overflow.
    unit = 1.0 / wp.max(wp.max(scene_size[0], scene_size[1]), scene_size[2])
    n = wp.cross((corners.b - corners.a) * unit, (corners.c - corners.a) * unit)
    # Half surface areas: of the box, and of ever smaller boxes along the triangle.
    box = half_area((high - low) * unit)
    least = 0.5 * (wp.abs(n[0]) + wp.abs(n[1]) + wp.abs(n[2]))
    cut = find_cut(low, high, scene_low, scene_size)
    importance = float(0.0)
    # Where the first corner is the last, a sphere is stored (kernels/native/exact/spheres.h).
    if cut.level >= 0 and wp.length_sq(corners.c - corners.a) > 0.0:
        importance = wp.pow(wp.max(box - least, 0.0) * (1.0 / float(1 << cut.level)), 1.0 / 3.0)
    importance_out[i] = importance


@wp.kernel(enable_backward=False)
def count_pieces(first: int, importance: wp.array(dtype=float), factor: float, count_out: wp.array(dtype=int)):
    """Write the number of pieces of each triangle."""
    i = first + wp.tid()
    cuts = int(factor * importance[i])
    count_out[i] = wp.where(cuts >= LEAST_CUTS, 1 + cuts, 1)


@wp.kernel(enable_backward=False)
def mark_cut(first: int, count: wp.array(dtype=int), is_cut_out: wp.array(dtype=int)):
    """Write 1 for each triangle of several pieces, 0 for others."""
    i = first + wp.tid()
    is_cut_out[i] = wp.where(count[i] > 1, 1, 0)


@wp.kernel(enable_backward=False)
def list_cut(
    first: int,
    count: wp.array(dtype=int),
    place: wp.array(dtype=int),
    triangles_out: wp.array(dtype=int),
    count_out: wp.array(dtype=int),
):
    """List the triangles of several pieces, and their numbers of pieces."""
    i = first + wp.tid()
    if count[i] > 1:
        triangles_out[place[i]] = i
        count_out[place[i]] = count[i]


@wp.kernel(enable_backward=False)
def pick_corners(
    first: int, indices: wp.array(dtype=int), triangles: wp.array(dtype=int), indices_out: wp.array(dtype=int)
):
    """Write the corners of the listed triangles."""
    i = first + wp.tid()
    for k in range(3):
        indices_out[3 * i + k] = indices[3 * triangles[i] + k]


@wp.func
def box_of_side(
    corners: Corners, low: wp.vec3, high: wp.vec3, axis: int, place: float, side: float, number: int
) -> vec8:
    """Return the box of the part of a triangle within a box and on one side of a plane."""
    least = wp.vec3(3.0e38)
    most = wp.vec3(-3.0e38)
    p = corners.a
    q = corners.b
    for k in range(3):
        if k == 1:
            p = corners.b
            q = corners.c
        if k == 2:
            p = corners.c
            q = corners.a
        if (p[axis] - place) * side >= 0.0:
            least = wp.min(least, p)
            most = wp.max(most, p)
        if (p[axis] < place) != (q[axis] < place):
            x = p + (q - p) * ((place - p[axis]) / (q[axis] - p[axis]))
            slack = _ROUNDING * wp.vec3(
                wp.max(wp.abs(p[0]), wp.abs(q[0])),
                wp.max(wp.abs(p[1]), wp.abs(q[1])),
                wp.max(wp.abs(p[2]), wp.abs(q[2])),
            )
            least = wp.min(least, x - slack)
            most = wp.max(most, x + slack)
    least = wp.max(least, low)
    most = wp.min(most, high)
    if side > 0.0:
        least[axis] = wp.max(least[axis], place)
    else:
        most[axis] = wp.min(most[axis], place)
    return make_box(least, most, number)


@wp.func
def is_empty(box: vec8) -> bool:
    """Return whether a box holds nothing."""
    return box[0] > -box[4] or box[1] > -box[5] or box[2] > -box[6]


@wp.func
def longest(box: vec8) -> float:
    """Return the longest side of a box."""
    return wp.max(high_of(box) - low_of(box))


@wp.kernel(enable_backward=False)
def write_pieces(
    first: int,
    points: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    scene_low: wp.vec3,
    scene_size: wp.vec3,
    start: wp.array(dtype=int),
    count: wp.array(dtype=int),
    boxes: wp.array(dtype=vec8),
):
    """Write the boxes of all pieces of each triangle.

    A box that needs further cuts lies at the first of its pieces' places, and its last number counts these cuts.
    """
    i = first + wp.tid()
    corners = corners_of(points, indices, i)
    triangle_box = box_around(corners, i)
    triangle_box[7] = wp.cast(count[i] - 1, wp.float32)
    boxes[start[i]] = triangle_box
    for place in range(start[i], start[i] + count[i]):
        cuts = wp.cast(boxes[place][7], wp.int32)
        while cuts > 0:
            box = boxes[place]
            low = low_of(box)
            high = high_of(box)
            cut = find_cut(low, high, scene_low, scene_size)
            left = box_of_side(corners, low, high, cut.axis, cut.place, -1.0, i)
            right = box_of_side(corners, low, high, cut.axis, cut.place, 1.0, i)
            if is_empty(left):
                left = right
            if is_empty(right):
                right = left
            # If neither side has an extent, either may take all.
            share = longest(left) / wp.max(longest(left) + longest(right), 1.0e-38)
            cuts_left = wp.clamp(int(share * float(cuts - 1) + 0.5), 0, cuts - 1)
            right[7] = wp.cast(cuts - 1 - cuts_left, wp.float32)
            boxes[place + 1 + cuts_left] = right
            left[7] = wp.cast(cuts_left, wp.float32)
            boxes[place] = left
            cuts = cuts_left
