"""Boxes as the builder of the ray tree stores them, ranges of boxes, and the corners of triangles.

A box is eight floats: lower corner, triangle number, negated upper corner, padding. The component-wise minimum of two
boxes is therefore the box around both. Twice the centre of a box suffices, lower minus negated upper; stored beside its
negation it can be joined like a box.

What is done with ranges is C++ (`kernels/native/ranges.h`): in Warp's Python the three loops took three times as long,
and they dominate a build.
"""

import warp as wp

from wrt.kernels.native import include

ranges_h = include("ranges.h")

vec8 = wp.types.vector(length=8, dtype=float)


@wp.struct
class Corners:
    """The corners of a triangle."""

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3


@wp.func
def corners_of(points: wp.array(dtype=wp.vec3), indices: wp.array(dtype=int), triangle: int) -> Corners:
    """Return the corners of a triangle of a mesh."""
    corners = Corners()
    corners.a = points[indices[3 * triangle]]
    corners.b = points[indices[3 * triangle + 1]]
    corners.c = points[indices[3 * triangle + 2]]
    return corners


@wp.func
def make_box(low: wp.vec3, high: wp.vec3, number: int) -> vec8:
    """Return the box between two corners."""
    return vec8(low[0], low[1], low[2], wp.cast(number, wp.float32), -high[0], -high[1], -high[2], 0.0)


@wp.func
def box_around(corners: Corners, number: int) -> vec8:
    """Return the box of a triangle."""
    low = wp.min(wp.min(corners.a, corners.b), corners.c)
    return make_box(low, wp.max(wp.max(corners.a, corners.b), corners.c), number)


@wp.func
def low_of(box: vec8) -> wp.vec3:
    """Return the lower corner of a box."""
    return wp.vec3(box[0], box[1], box[2])


@wp.func
def high_of(box: vec8) -> wp.vec3:
    """Return the upper corner of a box."""
    return wp.vec3(-box[4], -box[5], -box[6])


@wp.func
def number_of(box: vec8) -> int:
    """Return the number of the triangle or instance in a box."""
    return wp.cast(box[3], wp.int32)


@wp.func
def half_area(size: wp.vec3) -> float:
    """Return half the surface area of a box of this size."""
    return size[0] * size[1] + size[1] * size[2] + size[2] * size[0]


@wp.func_native("return wrt::bounds_of_range(boxes, first, count);")
def bounds_of_range(boxes: wp.array(dtype=vec8), first: int, count: int) -> vec8:
    """Return the box around `count` boxes from `first`."""
    ranges_h()


@wp.func_native("return wrt::centers_of_range(boxes, first, count);")
def centers_of_range(boxes: wp.array(dtype=vec8), first: int, count: int) -> vec8:
    """Return the bounds of twice the centres of `count` boxes from `first`, as a box."""
    ranges_h()


@wp.func_native("wrt::fill_bins(boxes, first, count, low, scale, bins, bin_boxes, bin_counts, scratch);")
def fill_bins(
    boxes: wp.array(dtype=vec8),
    first: int,
    count: int,
    low: wp.vec3,
    scale: wp.vec3,
    bins: int,
    bin_boxes: wp.array(dtype=vec8),
    bin_counts: wp.array(dtype=int),
    scratch: int,
):
    """Set bins `scratch` + BINS axis + 0 to `bins` − 1 to the bounds and number of the boxes centred in them."""
    ranges_h()


@wp.func_native("""
    return wrt::part_range(boxes, first, count, low, scale, bins, axis, last_left_bin, centers_out, centers_at);
""")
def part_range(
    boxes: wp.array(dtype=vec8),
    first: int,
    count: int,
    low: wp.vec3,
    scale: wp.vec3,
    bins: int,
    axis: int,
    last_left_bin: int,
    centers_out: wp.array(dtype=vec8),
    centers_at: int,
) -> int:
    """Partition boxes, those of bins up to `last_left_bin` first; return the number of these.

    The bounds of the centres on both sides go to `centers_out`.
    """
    ranges_h()


@wp.func_native("wrt::swap_ranges(boxes, first, second, count);")
def swap_ranges(boxes: wp.array(dtype=vec8), first: int, second: int, count: int):
    """Swap `count` boxes from `first` with those from `second`."""
    ranges_h()
