"""Piecewise constant densities on a grid, sampled by inverting their cumulative sums.

The inversion preserves the stratification of points (Pharr, Jakob and Humphreys 2023, section A.5.1), which an alias
table would destroy. `wrt/upload/lights/piecewise.py` makes the sums. A *tile* is a grid of 2^a rows of 2^b columns in
an array: first the sums over rows, then for each row those over its columns. Sums are in units of 2^-15, so a row of 32
fits a cache line, and probabilities are exact.
"""

import warp as wp

from wrt.kernels.sampling.warps import BELOW_ONE

UNITS = wp.constant(32768)
"""The sum over all parts."""

_SHARE = wp.constant(1.0 / UNITS)


@wp.struct
class Part:
    """One of several parts of [0, 1): its index, its length, and the position of a number in it, in [0, 1)."""

    index: int
    probability: float
    rest: float


@wp.struct
class TileSample:
    """A cell of a tile, its probability, and a position in it: (x, y) in [0, 1)²."""

    row: int
    column: int
    probability: float
    rest: wp.vec2


@wp.func
def _end_of_part(edges: wp.array(dtype=wp.uint16), first: int, count: int, index: int) -> int:
    if index + 1 < count:
        return int(edges[first + index + 1])
    return UNITS


@wp.func
def part_probability(edges: wp.array(dtype=wp.uint16), first: int, count: int, index: int) -> float:
    """Return the length of a part; `edges` has the starts of `count` parts from `first` on."""
    return float(_end_of_part(edges, first, count, index) - int(edges[first + index])) * _SHARE


@wp.func
def find_part(edges: wp.array(dtype=wp.uint16), first: int, count: int, u: float) -> Part:
    """Return the part that contains u: the last one that begins at or before u, so never an empty one."""
    index = int(0)
    place = u * float(UNITS)
    unit = int(place)
    step = count >> 1
    while step > 0:
        index += wp.where(int(edges[first + index + step]) <= unit, step, 0)
        step = step >> 1
    part = Part()
    part.index = index
    start = int(edges[first + index])
    length = float(_end_of_part(edges, first, count, index) - start)
    part.probability = length * _SHARE
    part.rest = wp.min((place - float(start)) / length, BELOW_ONE)
    return part


@wp.func
def sample_tile(edges: wp.array(dtype=wp.uint16), first: int, rows: int, columns: int, u: wp.vec2) -> TileSample:
    """Return a cell of the tile that begins at `first`: its row by u[1], its column by u[0]."""
    row = find_part(edges, first, rows, u[1])
    column = find_part(edges, first + rows + row.index * columns, columns, u[0])
    s = TileSample()
    s.row = row.index
    s.column = column.index
    s.probability = row.probability * column.probability
    s.rest = wp.vec2(column.rest, row.rest)
    return s


@wp.func
def tile_probability(
    edges: wp.array(dtype=wp.uint16), first: int, rows: int, columns: int, row: int, column: int
) -> float:
    """Return the probability of a cell, bit for bit that of `sample_tile`."""
    across = part_probability(edges, first + rows + row * columns, columns, column)
    return part_probability(edges, first, rows, row) * across
