"""Ranges of boxes during the build: their bounds, their bins, and their partition.

Boxes are stored as in `kernels/accel/build/boxes.py`. Twice the centre of a box suffices, lower minus negated upper;
stored beside its negation it can be joined like a box.

The functions are C++ (`kernels/native/ranges.h`): in Warp's Python the three loops took three times as long, and they
dominate a build.
"""

import warp as wp

from wrt.kernels.accel.build.boxes import vec8
from wrt.kernels.native import include

ranges_h = include("ranges.h")


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
