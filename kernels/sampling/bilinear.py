"""Densities on the unit square that are bilinear between the nodes of a grid, and depend on two parameters.

There is a slice for each pair of nodes of the parameters, and between those slices are blended linearly. A density is
sampled by inverting its integral along y, then along x, in the manner of Dupuy and Jakob (2018, section 4.2). Both
inversions are of parabolas, so `invert` is the exact inverse of `sample`. `wrt/upload/tables/measured.py` makes the
integrals.
"""

import warp as wp


@wp.struct
class Blend:
    """The slices around a pair of parameters: the first, how many further the next one is for either, and its weight.

    A distance is 0 where the parameter has one node only, and its weight is 0 then.
    """

    slice: int
    next_first: int
    next_second: int
    first_weight: float
    second_weight: float


@wp.struct
class Grid:
    """A density in an array: slices of `height` rows of `width` nodes from `values` on.

    `columns` begins as many integrals along the rows, each from the row's first node on; `rows` begins the integrals
    over whole rows, `height` a slice. Each sequence begins with 0, and the last one of a slice ends with 1.
    """

    values: int
    columns: int
    rows: int
    width: int
    height: int


@wp.struct
class Cell:
    """The cell of a grid that a point lies in, and the point's position in it, in [0, 1]²."""

    column: int
    row: int
    x: float
    y: float


@wp.func
def find_interval(values: wp.array(dtype=float), first: int, count: int, x: float) -> int:
    """Return the last interval between `count` ascending nodes that begins at or before x; the first, where none."""
    low = int(0)
    high = count - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if values[first + middle] <= x:
            low = middle
        else:
            high = middle
    return low


@wp.func
def position_between(values: wp.array(dtype=float), first: int, count: int, interval: int, x: float) -> float:
    """Return where x lies in an interval of `find_interval`, in [0, 1]; 0 if there is one node only."""
    if count < 2:
        return 0.0
    start = values[first + interval]
    return wp.clamp((x - start) / (values[first + interval + 1] - start), 0.0, 1.0)


@wp.func
def mixed(a: float, b: float, t: float) -> float:
    """Return the value between a and b at t."""
    return a + (b - a) * t


@wp.func
def blended(values: wp.array(dtype=float), first: int, size: int, place: int, blend: Blend) -> float:
    """Return the number at `place` in slices of `size` from `first` on, blended."""
    at = first + blend.slice * size + place
    found = mixed(values[at], values[at + blend.next_second * size], blend.second_weight)
    if blend.next_first > 0:
        at += blend.next_first * size
        next_value = mixed(values[at], values[at + blend.next_second * size], blend.second_weight)
        found = mixed(found, next_value, blend.first_weight)
    return found


@wp.func
def cell_at(width: int, height: int, point: wp.vec2) -> Cell:
    """Return the cell of a point in the unit square."""
    x = wp.clamp(point[0], 0.0, 1.0) * float(width - 1)
    y = wp.clamp(point[1], 0.0, 1.0) * float(height - 1)
    cell = Cell()
    cell.column = wp.min(int(x), width - 2)
    cell.row = wp.min(int(y), height - 2)
    cell.x = x - float(cell.column)
    cell.y = y - float(cell.row)
    return cell


@wp.func
def bilinear(values: wp.array(dtype=float), first: int, width: int, height: int, point: wp.vec2) -> float:
    """Return the value of a grid without slices at a point."""
    cell = cell_at(width, height, point)
    lower = first + cell.row * width + cell.column
    upper = lower + width
    low = mixed(values[lower], values[lower + 1], cell.x)
    return mixed(low, mixed(values[upper], values[upper + 1], cell.x), cell.y)


@wp.func
def density_at(values: wp.array(dtype=float), grid: Grid, blend: Blend, point: wp.vec2) -> float:
    """Return a density at a point."""
    cell = cell_at(grid.width, grid.height, point)
    ends = _column_ends(values, grid, blend, cell.row, cell.column, cell.y)
    return mixed(ends[0], ends[1], cell.x)


@wp.func
def _column_ends(values: wp.array(dtype=float), grid: Grid, blend: Blend, row: int, column: int, y: float) -> wp.vec2:
    """Return the density at both ends of a cell's columns, y up in it."""
    size = grid.width * grid.height
    place = row * grid.width + column
    left = mixed(
        blended(values, grid.values, size, place, blend),
        blended(values, grid.values, size, place + grid.width, blend),
        y,
    )
    right = mixed(
        blended(values, grid.values, size, place + 1, blend),
        blended(values, grid.values, size, place + grid.width + 1, blend),
        y,
    )
    return wp.vec2(left, right)


@wp.func
def _integral_along(values: wp.array(dtype=float), grid: Grid, blend: Blend, row: int, column: int, y: float) -> float:
    """Return the integral along x up to a column, y up between a row and the next."""
    size = grid.width * grid.height
    place = row * grid.width + column
    below = blended(values, grid.columns, size, place, blend)
    return mixed(below, blended(values, grid.columns, size, place + grid.width, blend), y)


@wp.func
def _area(t: float, start: float, end: float) -> float:
    """Return the integral from 0 to t of a density that goes from `start` to `end` in a unit length."""
    return t * (start + 0.5 * t * (end - start))


@wp.func
def _of_area(area: float, start: float, end: float) -> float:
    """Return the t of an `_area`, by the form of the root that does not cancel."""
    root = wp.sqrt(wp.max(start * start + 2.0 * area * (end - start), 0.0))
    return wp.clamp(2.0 * area / wp.max(start + root, 1.0e-30), 0.0, 1.0)


@wp.func
def sample_grid(values: wp.array(dtype=float), grid: Grid, blend: Blend, u: wp.vec2) -> wp.vec3:
    """Return a point drawn from a density by a point of the unit square, and the density there."""
    row = int(0)
    high = grid.height - 1
    while high - row > 1:
        middle = (row + high) >> 1
        if blended(values, grid.rows, grid.height, middle, blend) <= u[1]:
            row = middle
        else:
            high = middle
    remainder = (u[1] - blended(values, grid.rows, grid.height, row, blend)) * float(grid.height - 1)
    last = grid.width - 1
    lower = _integral_along(values, grid, blend, row, last, 0.0)
    upper = _integral_along(values, grid, blend, row, last, 1.0)
    y = _of_area(remainder, lower, upper)

    along = u[0] * mixed(lower, upper, y)
    column = int(0)
    high = last
    while high - column > 1:
        middle = (column + high) >> 1
        if _integral_along(values, grid, blend, row, middle, y) <= along:
            column = middle
        else:
            high = middle
    remainder = (along - _integral_along(values, grid, blend, row, column, y)) * float(last)
    ends = _column_ends(values, grid, blend, row, column, y)
    x = _of_area(remainder, ends[0], ends[1])
    return wp.vec3(
        (float(column) + x) / float(last), (float(row) + y) / float(grid.height - 1), mixed(ends[0], ends[1], x)
    )


@wp.func
def invert_grid(values: wp.array(dtype=float), grid: Grid, blend: Blend, point: wp.vec2) -> wp.vec3:
    """Return the point of the unit square that `sample_grid` takes to `point`, and the density there."""
    cell = cell_at(grid.width, grid.height, point)
    last = grid.width - 1
    lower = _integral_along(values, grid, blend, cell.row, last, 0.0)
    upper = _integral_along(values, grid, blend, cell.row, last, 1.0)
    y = _area(cell.y, lower, upper) / float(grid.height - 1)
    y += blended(values, grid.rows, grid.height, cell.row, blend)

    ends = _column_ends(values, grid, blend, cell.row, cell.column, cell.y)
    x = _area(cell.x, ends[0], ends[1]) / float(last)
    x += _integral_along(values, grid, blend, cell.row, cell.column, cell.y)
    row_integral = mixed(lower, upper, cell.y)
    # A row without any density has no inverse: nothing is drawn there.
    x = wp.where(row_integral > 0.0, x / wp.max(row_integral, 1.0e-30), 0.0)
    return wp.vec3(wp.clamp(x, 0.0, 1.0), wp.clamp(y, 0.0, 1.0), mixed(ends[0], ends[1], cell.x))
