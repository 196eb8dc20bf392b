"""Environments: images in latitude-longitude layout, and sampling them.

Directions map to (u, v) in [0, 1]² by azimuth and polar angle; `wrt/scene/environment.py` states the convention.
Sampling is by the radiance and by the cosine to the receiver's normal. The first step samples a cell of the image from
a table for normals near the receiver's, the second a bin of the cell: both preserve stratified points.
`wrt/upload/lights/environment_sampling.py` makes the tables and explains them.
"""

import warp as wp

from wrt.kernels.core.elementary import arc_tangent, sine_cosine
from wrt.kernels.core.rays import RECEIVES_FRONT, Receiver
from wrt.kernels.core.scene_data import WRAP_CLAMP, WRAP_REPEAT, EnvironmentData
from wrt.kernels.sampling.piecewise import sample_tile, tile_probability
from wrt.kernels.sampling.warps import PI, TWO_PI
from wrt.kernels.textures.textures import bilinear, neighbors


@wp.struct
class ImagePoint:
    """A point in the image, with sine and cosine of its polar angle."""

    uv: wp.vec2
    sine: float
    cosine: float


@wp.func
def point_towards(environment: EnvironmentData, d: wp.vec3) -> ImagePoint:
    """Return the point of the image in direction d."""
    local = environment.rotation * d
    point = ImagePoint()
    # The sine resolves small angles, unlike the cosine.
    point.sine = wp.sqrt(local[0] * local[0] + local[2] * local[2])
    point.cosine = local[1]
    u = 0.5 + arc_tangent(local[0], -local[2]) / TWO_PI
    point.uv = wp.vec2(u, arc_tangent(point.sine, local[1]) / PI)
    return point


@wp.func
def point_direction(environment: EnvironmentData, point: ImagePoint) -> wp.vec3:
    """Return the direction of a point."""
    azimuth = (point.uv[0] - 0.5) * TWO_PI
    turned = sine_cosine(azimuth)
    local = wp.vec3(point.sine * turned[0], point.cosine, -point.sine * turned[1])
    return wp.transpose(environment.rotation) * local


@wp.func
def radiance_at(environment: EnvironmentData, uv: wp.vec2) -> wp.vec3:
    """Return the bilinearly interpolated radiance; columns wrap around, rows end at the poles."""
    x = uv[0] * float(environment.width) - 0.5
    y = uv[1] * float(environment.height) - 0.5
    column = wp.floor(x)
    row = wp.floor(y)
    columns = neighbors(int(column), environment.width, WRAP_REPEAT)
    rows = neighbors(int(row), environment.height, WRAP_CLAMP)
    return bilinear(environment.texels, 0, environment.width, columns, rows, wp.vec2(x - column, y - row))


# As in wrt/upload/lights/environment_sampling.py.
ROWS = wp.constant(16)
COLUMNS = wp.constant(32)
STEPS = wp.constant(16)

_CELL_TILE = wp.constant(ROWS + ROWS * COLUMNS)
_WITHOUT_NORMAL = wp.constant((STEPS + 1) ** 2)


@wp.struct
class EnvironmentSample:
    """A direction (world), its point in the image, and its density per solid angle."""

    wi: wp.vec3
    point: ImagePoint
    pdf: float


@wp.func
def octahedral_node(n: wp.vec3) -> int:
    """Return the number of the node nearest to a unit normal in the octahedral grid."""
    s = 1.0 / (wp.abs(n[0]) + wp.abs(n[1]) + wp.abs(n[2]))
    x = n[0] * s
    z = n[2] * s
    if n[1] < 0.0:
        folded = (1.0 - wp.abs(z)) * wp.where(x < 0.0, -1.0, 1.0)
        z = (1.0 - wp.abs(x)) * wp.where(z < 0.0, -1.0, 1.0)
        x = folded
    half = 0.5 * float(STEPS)
    column = wp.clamp(int(x * half + half + 0.5), 0, STEPS)
    row = wp.clamp(int(z * half + half + 0.5), 0, STEPS)
    return row * (STEPS + 1) + column


@wp.func
def _cells_for(receiver: Receiver) -> int:
    table = int(_WITHOUT_NORMAL)
    if receiver.receives == RECEIVES_FRONT:
        table = octahedral_node(receiver.normal)
    return table * _CELL_TILE


@wp.func
def _per_solid_angle(environment: EnvironmentData, probability: float, sine: float) -> float:
    bins = float(ROWS * COLUMNS * environment.side * environment.side)
    return probability * bins / (2.0 * PI * PI * wp.max(sine, 1.0e-6))


@wp.func
def image_pdf(environment: EnvironmentData, receiver: Receiver, point: ImagePoint) -> float:
    """Return the density of `sample_image` for the direction of a point in the image."""
    side = environment.side
    x = wp.min(int(point.uv[0] * float(COLUMNS * side)), COLUMNS * side - 1)
    y = wp.min(int(point.uv[1] * float(ROWS * side)), ROWS * side - 1)
    column = x / side
    row = y / side
    cell = tile_probability(environment.cells, _cells_for(receiver), ROWS, COLUMNS, row, column)
    first = (row * COLUMNS + column) * (side + side * side)
    inner = tile_probability(environment.bins, first, side, side, y - row * side, x - column * side)
    return _per_solid_angle(environment, cell * inner, point.sine)


@wp.func
def sample_image(environment: EnvironmentData, receiver: Receiver, u: wp.vec2) -> EnvironmentSample:
    """Return a direction: a cell, a bin in it, and a uniform (u, v) within that."""
    side = environment.side
    cell = sample_tile(environment.cells, _cells_for(receiver), ROWS, COLUMNS, u)
    first = (cell.row * COLUMNS + cell.column) * (side + side * side)
    inner = sample_tile(environment.bins, first, side, side, cell.rest)
    x = float(cell.column * side + inner.column) + inner.rest[0]
    y = float(cell.row * side + inner.row) + inner.rest[1]
    s = EnvironmentSample()
    s.point.uv = wp.vec2(x / float(COLUMNS * side), y / float(ROWS * side))
    polar = sine_cosine(s.point.uv[1] * PI)
    s.point.sine = polar[0]
    s.point.cosine = polar[1]
    s.wi = point_direction(environment, s.point)
    s.pdf = _per_solid_angle(environment, cell.probability * inner.probability, s.point.sine)
    return s
