"""A measured reflectance, in the adaptive parameterisation of Dupuy and Jakob (2018).

f |cosθi| = M(u) D(m) / (4 σ(o)), with the facet normal m halfway between both directions. D is the distribution of
normals and σ the area that they show to the viewer, both found from measured retroreflection. M is the measured rest, a
smooth function of u: the point of the unit square that is warped to m by the density of visible normals. A second warp,
by the brightness of M, precedes that one where directions are drawn.

A material's table begins with its sizes; then follow the nodes of the viewer's azimuth and angle, D, σ, the density of
visible normals and the brightness, each with its integrals, and M as colours. `wrt/upload/tables/measured.py` writes
it.
"""

import warp as wp

from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, no_sample
from wrt.kernels.core.elementary import arc_tangent, sine_cosine
from wrt.kernels.sampling.bilinear import (
    Blend,
    Cell,
    Grid,
    bilinear,
    blended,
    cell_at,
    density_at,
    find_interval,
    invert_grid,
    mixed,
    position_between,
    sample_grid,
)
from wrt.kernels.sampling.warps import PI, TWO_PI

_HALF_PI = wp.constant(1.5707963267948966)
_TWO_OVER_PI = wp.constant(0.6366197723675814)
_LEAST_AREA = wp.constant(1.0e-12)
_LEAST_COSINE = wp.constant(1.0e-7)
# Mitsuba's bound on the solid angle of a point of the square near the pole.
_LEAST_ANGLE = wp.constant(1.0e-6)

_HEADER = wp.constant(12)
"""The number of sizes."""


@wp.struct
class Tables:
    """Where the parts of a material's table begin in `Bsdf.tables`, and their sizes."""

    azimuths: int
    azimuth_count: int
    angles: int
    angle_count: int
    normals: int
    normals_width: int
    normals_height: int
    area: int
    area_width: int
    area_height: int
    visible: Grid
    brightness: Grid
    colors: int
    isotropic: bool
    reduction: int
    jacobian: bool


@wp.struct
class Viewed:
    """The viewer in the tables: `signs` mirror directions into the measured part of the circle."""

    wo: wp.vec3
    signs: wp.vec2
    azimuth: float
    place: wp.vec2
    blend: Blend


@wp.func
def _count(bsdf: Bsdf, k: int) -> int:
    return int(bsdf.tables[bsdf.table + k])


@wp.func
def _grid_from(first: int, slices: int, width: int, height: int) -> Grid:
    grid = Grid()
    grid.values = first
    grid.columns = first + slices * width * height
    grid.rows = grid.columns + slices * width * height
    grid.width = width
    grid.height = height
    return grid


@wp.func
def tables_of(bsdf: Bsdf) -> Tables:
    """Return where the parts of a material's table are."""
    t = Tables()
    t.isotropic = _count(bsdf, 0) != 0
    t.reduction = _count(bsdf, 1)
    t.jacobian = _count(bsdf, 2) != 0
    t.azimuth_count = _count(bsdf, 3)
    t.angle_count = _count(bsdf, 4)
    t.normals_width = _count(bsdf, 5)
    t.normals_height = _count(bsdf, 6)
    t.area_width = _count(bsdf, 7)
    t.area_height = _count(bsdf, 8)
    side = _count(bsdf, 11)
    slices = t.azimuth_count * t.angle_count
    t.azimuths = bsdf.table + _HEADER
    t.angles = t.azimuths + t.azimuth_count
    t.normals = t.angles + t.angle_count
    t.area = t.normals + t.normals_width * t.normals_height
    t.visible = _grid_from(t.area + t.area_width * t.area_height, slices, _count(bsdf, 9), _count(bsdf, 10))
    t.brightness = _grid_from(t.visible.rows + slices * t.visible.height, slices, side, side)
    t.colors = t.brightness.rows + slices * side
    return t


@wp.func
def angle_of(w: wp.vec3) -> float:
    """Return the angle to the normal; the arc cosine would be inexact near it."""
    return arc_tangent(wp.sqrt(w[0] * w[0] + w[1] * w[1]), w[2])


@wp.func
def mirrored(w: wp.vec3, signs: wp.vec2) -> wp.vec3:
    """Return a direction with x and y multiplied by `signs`: into the measured part of the circle, or back."""
    return wp.vec3(w[0] * signs[0], w[1] * signs[1], w[2])


@wp.func
def view_of(bsdf: Bsdf, t: Tables, wo: wp.vec3) -> Viewed:
    """Return the viewing direction mirrored into the measured part of the circle, and its place in the tables."""
    v = Viewed()
    v.signs = wp.vec2(1.0, 1.0)
    # A half of the circle was measured where half a turn changes nothing, a quarter where both axes mirror the surface.
    if t.reduction == 2:
        sign = wp.where(wo[1] < 0.0, 1.0, -1.0)
        v.signs = wp.vec2(sign, sign)
    if t.reduction == 4:
        v.signs = wp.vec2(wp.where(wo[0] < 0.0, 1.0, -1.0), wp.where(wo[1] < 0.0, 1.0, -1.0))
    v.wo = mirrored(wo, v.signs)
    # −π, not π, where the viewer is at the end of a half.
    v.azimuth = -arc_tangent(-v.wo[1], v.wo[0])
    angle = angle_of(v.wo)
    turns = wp.where(t.isotropic, 0.5, (v.azimuth + PI) / TWO_PI)
    v.place = wp.vec2(wp.sqrt(angle * _TWO_OVER_PI), turns)
    across = find_interval(bsdf.tables, t.azimuths, t.azimuth_count, v.azimuth)
    up = find_interval(bsdf.tables, t.angles, t.angle_count, angle)
    blend = Blend()
    blend.slice = across * t.angle_count + up
    blend.next_first = wp.where(t.azimuth_count > 1, t.angle_count, 0)
    blend.next_second = wp.min(t.angle_count - 1, 1)
    blend.first_weight = position_between(bsdf.tables, t.azimuths, t.azimuth_count, across, v.azimuth)
    blend.second_weight = position_between(bsdf.tables, t.angles, t.angle_count, up, angle)
    v.blend = blend
    return v


@wp.func
def _channel_at(bsdf: Bsdf, t: Tables, v: Viewed, cell: Cell, channel: int) -> float:
    side = t.brightness.width
    size = 3 * side * side
    place = 3 * (cell.row * side + cell.column) + channel
    above = place + 3 * side
    lower = mixed(
        blended(bsdf.tables, t.colors, size, place, v.blend),
        blended(bsdf.tables, t.colors, size, place + 3, v.blend),
        cell.x,
    )
    upper = mixed(
        blended(bsdf.tables, t.colors, size, above, v.blend),
        blended(bsdf.tables, t.colors, size, above + 3, v.blend),
        cell.x,
    )
    return mixed(lower, upper, cell.y)


@wp.func
def color_at(bsdf: Bsdf, t: Tables, v: Viewed, u: wp.vec2) -> wp.vec3:
    """Return the measured rest M at the point `u` of the unit square (see above)."""
    cell = cell_at(t.brightness.width, t.brightness.width, u)
    return wp.vec3(_channel_at(bsdf, t, v, cell, 0), _channel_at(bsdf, t, v, cell, 1), _channel_at(bsdf, t, v, cell, 2))


@wp.func
def factor_at(bsdf: Bsdf, t: Tables, v: Viewed, facet: wp.vec2) -> float:
    """Return D / (4 σ), for a normal at a point of its square."""
    if not t.jacobian:
        return 1.0
    d = bilinear(bsdf.tables, t.normals, t.normals_width, t.normals_height, facet)
    area = bilinear(bsdf.tables, t.area, t.area_width, t.area_height, v.place)
    return d / (4.0 * wp.max(area, _LEAST_AREA))


@wp.func
def _place_of(t: Tables, v: Viewed, m: wp.vec3) -> wp.vec2:
    """Return the point of the square that stands for a normal."""
    azimuth = arc_tangent(m[1], m[0]) - wp.where(t.isotropic, v.azimuth, 0.0)
    turns = (azimuth + PI) / TWO_PI
    return wp.vec2(wp.sqrt(angle_of(m) * _TWO_OVER_PI), turns - wp.floor(turns))


@wp.func
def _solid_angle(v: Viewed, facet: wp.vec2, m: wp.vec3) -> float:
    """Return the ratio of the solid angle of reflected directions to the area of the square of normals.

    dω_m = sinθ dθ dφ with θ = π/2 x² and φ = π (2y − 1); dω_i = 4 (o·m) dω_m.
    """
    sine = wp.sqrt(m[0] * m[0] + m[1] * m[1])
    of_normals = wp.max(2.0 * PI * PI * facet[0] * sine, _LEAST_ANGLE)
    return of_normals * 4.0 * wp.max(wp.dot(v.wo, m), _LEAST_COSINE)


@wp.func
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return f |cosθi|."""
    if wi[2] <= 0.0 or wo[2] <= 0.0:
        return wp.vec3(0.0)
    t = tables_of(bsdf)
    v = view_of(bsdf, t, wo)
    facet = _place_of(t, v, wp.normalize(v.wo + mirrored(wi, v.signs)))
    u = invert_grid(bsdf.tables, t.visible, v.blend, facet)
    return color_at(bsdf, t, v, wp.vec2(u[0], u[1])) * factor_at(bsdf, t, v, facet)


@wp.func
def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
    """Return the density of `sample` per solid angle."""
    if wi[2] <= 0.0 or wo[2] <= 0.0:
        return 0.0
    t = tables_of(bsdf)
    v = view_of(bsdf, t, wo)
    m = wp.normalize(v.wo + mirrored(wi, v.signs))
    facet = _place_of(t, v, m)
    u = invert_grid(bsdf.tables, t.visible, v.blend, facet)
    brightness = density_at(bsdf.tables, t.brightness, v.blend, wp.vec2(u[0], u[1]))
    return u[2] * brightness / _solid_angle(v, facet, m)


@wp.func
def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    """Return `wo` reflected at a normal that both warps sample, or no sample if that points below the surface."""
    if wo[2] <= 0.0:
        return no_sample()
    t = tables_of(bsdf)
    v = view_of(bsdf, t, wo)
    bright = sample_grid(bsdf.tables, t.brightness, v.blend, u)
    warped = wp.vec2(bright[0], bright[1])
    visible = sample_grid(bsdf.tables, t.visible, v.blend, warped)
    facet = wp.vec2(visible[0], visible[1])
    across = sine_cosine(PI * (2.0 * facet[1] - 1.0) + wp.where(t.isotropic, v.azimuth, 0.0))
    up = sine_cosine(_HALF_PI * facet[0] * facet[0])
    m = wp.vec3(across[1] * up[0], across[0] * up[0], up[1])
    wi = m * (2.0 * wp.dot(v.wo, m)) - v.wo
    density = visible[2] * bright[2] / _solid_angle(v, facet, m)
    if wi[2] <= 0.0 or density <= 0.0:
        return no_sample()
    s = no_sample()
    s.wi = wp.normalize(mirrored(wi, v.signs))
    s.weight = color_at(bsdf, t, v, warped) * (factor_at(bsdf, t, v, facet) / density)
    s.pdf = density
    return s


MEASURED = Model(evaluate, pdf, sample, slots=0)
