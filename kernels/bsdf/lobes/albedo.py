"""Tables of the energy that single scattering loses, and the lobe that restores it.

Light blocked by a microfacet does not vanish: it bounces on. The energy that a single-bounce microfacet model loses on
a white surface, 1 − E(w), where E(w) is the albedo for light from w, is tabulated (`wrt/upload/tables/albedo.py`), and
a smooth reciprocal lobe restores it: Kulla and Conty, "Revisiting physically based shading at Imageworks", SIGGRAPH
2017 course; Jakob et al., "A comprehensive framework for rendering layered materials" (2014), section 5.6, had it for
another model. With it a white surface reflects all light, whatever its roughness.

A table is TABLE_SIZE floats, those of (ROWS, COLUMNS) by cosine:

    0, 1        roughness along x and y of the surface that the table is for; 0 if its columns are roughnesses
    AVERAGES    mean of 1 − E over the hemisphere, weighted by 2 cosθ, STEPS per column; divided by α² for roughnesses
    VALUES      (ROWS, COLUMNS), 1 − E
    CUMULATIVE  (ROWS, COLUMNS), share of that mean below the row's cosine

Rows are uniform in ln(1 + μ / s), μ = cosθ, s = 0.1 a, a the roughness towards w: losses occur at μ around a, so smooth
surfaces need their rows near the horizon. Columns are uniform in ∜α; or, in a table for one anisotropic surface, in the
azimuth stretched by √(αv/αu).

What is called for each direction is not inlined, as in `albedo_fits.py`.
"""

import warp as wp

from wrt.kernels.core.elementary import exponential, logarithm
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import LEAST_ALPHA, make_microfacet
from wrt.kernels.sampling.warps import INV_PI, PI, TWO_PI, lattice_point

ROWS = wp.constant(32)
COLUMNS = wp.constant(32)
STEPS = wp.constant(8)
"""The lobe times the mean must be 1 to a fraction of a per cent, and 1 − E is not quite linear between columns."""

AVERAGES = wp.constant(2)
VALUES = wp.constant(2 + 31 * 8 + 1)
CUMULATIVE = wp.constant(2 + 31 * 8 + 1 + 32 * 32)
TABLE_SIZE = 2 + 31 * 8 + 1 + 2 * 32 * 32

ROW_SCALE = wp.constant(0.1)
"""Relative to the roughness; with it the interpolated 1 − E is right to 3e-3 at all angles and roughnesses."""


@wp.struct
class TablePlace:
    """A direction's place in a table: the column, the fraction to the next one, and the scale of the rows.

    Cosine μ is at row `rows_per_log` ln(1 + μ / `scale`).
    """

    column: int
    beyond: float
    scale: float
    rows_per_log: float


@wp.func
def table_column_of_alpha(alpha: float) -> float:
    """Return the column of a roughness in a table by roughness."""
    least = wp.sqrt(wp.sqrt(LEAST_ALPHA))
    return (wp.sqrt(wp.sqrt(wp.clamp(alpha, LEAST_ALPHA, 1.0))) - least) / (1.0 - least) * float(COLUMNS - 1)


@wp.func
def table_place(tables: wp.array(dtype=float), table: int, x: float, y: float, alpha: float) -> TablePlace:
    """Return the place of directions with azimuth (x, y), for the roughness `alpha` if columns are roughnesses."""
    along_x = tables[table]
    along_y = tables[table + 1]
    toward = float(alpha)
    column = float(0.0)
    if along_x > 0.0:
        length = wp.max(wp.sqrt(x * x + y * y), 1.0e-20)
        cos_phi = wp.abs(x) / length
        sin_phi = wp.abs(y) / length
        toward = wp.sqrt(along_x * along_x * cos_phi * cos_phi + along_y * along_y * sin_phi * sin_phi)
        toward = wp.max(toward, wp.min(along_x, along_y))
        stretched = wp.atan2(wp.sqrt(along_y) * sin_phi, wp.sqrt(along_x) * cos_phi)
        column = stretched * (2.0 / PI) * float(COLUMNS - 1)
    else:
        toward = wp.clamp(alpha, LEAST_ALPHA, 1.0)
        column = table_column_of_alpha(toward)
    place = TablePlace()
    place.column = wp.clamp(int(column), 0, COLUMNS - 2)
    place.beyond = wp.clamp(column - float(place.column), 0.0, 1.0)
    place.scale = ROW_SCALE * toward
    place.rows_per_log = float(ROWS - 1) / logarithm(1.0 + 1.0 / place.scale)
    return place


@wp.func
def read_row(tables: wp.array(dtype=float), first: int, row: int, place: TablePlace) -> float:
    """Return a value of a row of (ROWS, COLUMNS) floats from `first` on, interpolated between columns."""
    k = first + row * COLUMNS + place.column
    return tables[k] + (tables[k + 1] - tables[k]) * place.beyond


@wp.func
def row_of(mu: float, place: TablePlace) -> float:
    """Return the row of a cosine."""
    return wp.min(place.rows_per_log * logarithm(1.0 + mu / place.scale), float(ROWS - 1))


@wp.func(inline=False)
def missing_energy(tables: wp.array(dtype=float), table: int, w: wp.vec3, alpha: float) -> float:
    """Return 1 − E(w), w on either side, for the roughness `alpha` if the table's columns are roughnesses."""
    place = table_place(tables, table, w[0], w[1], alpha)
    row = row_of(wp.abs(w[2]), place)
    i = wp.min(int(row), ROWS - 2)
    low = read_row(tables, table + VALUES, i, place)
    return low + (read_row(tables, table + VALUES, i + 1, place) - low) * (row - float(i))


@wp.func(inline=False)
def average_missing_energy(tables: wp.array(dtype=float), table: int, alpha: float) -> float:
    """Return the mean of 1 − E over the hemisphere, weighted by 2 cosθ; greater than 0."""
    place = table_place(tables, table, 0.0, 0.0, alpha)
    step = (float(place.column) + place.beyond) * float(STEPS)
    i = wp.min(int(step), (COLUMNS - 1) * STEPS - 1)
    low = tables[table + AVERAGES + i]
    average = low + (tables[table + AVERAGES + i + 1] - low) * (step - float(i))
    if tables[table] == 0.0:
        toward = place.scale / ROW_SCALE
        average *= toward * toward
    return wp.max(average, 1.0e-12)


@wp.func
def multiple_bounce_lobe(missing_o: float, missing_i: float, average: float) -> float:
    """Return the value (1 − E(wo)) (1 − E(wi)) / (π (1 − E_avg)) of the lobe of a white surface (Kulla and Conty)."""
    return INV_PI * missing_o * (missing_i / average)


@wp.func
def multiple_bounce_fresnel(reflectance: wp.vec3, average: float) -> wp.vec3:
    """Return the factor of the lobe for facets with the mean Fresnel reflectance F.

    A share 1 − E_avg of the light that a bounce reflects is blocked and bounces again; the rest, E_avg, leaves. The
    second and all further bounces, F E_avg Σ (F (1 − E_avg))^k, k ≥ 1, over the 1 − E_avg of the lobe for F = 1, give
    F² E_avg / (1 − F (1 − E_avg)): Kulla and Conty 2017, with one more F, as Hill explains ("A multi-faceted
    exploration", part 2, 2018).
    """
    f = wp.vec3(wp.min(reflectance[0], 1.0), wp.min(reflectance[1], 1.0), wp.min(reflectance[2], 1.0))
    return wp.cw_div(wp.cw_mul(f, f) * (1.0 - average), wp.vec3(1.0) - f * wp.min(average, 0.999999))


@wp.func
def sample_multiple_bounces(tables: wp.array(dtype=float), table: int, alpha: float, u: wp.vec2) -> wp.vec3:
    """Return a direction roughly in proportion to the lobe, (1 − E(wi)) cosθi.

    A smooth surface has its lobe near the horizon only, where cosine-weighted sampling rarely goes.
    """
    phi = TWO_PI * u[0]
    cos_phi = wp.cos(phi)
    sin_phi = wp.sin(phi)
    place = table_place(tables, table, cos_phi, sin_phi, alpha)
    low = int(0)
    high = int(ROWS - 1)
    while high - low > 1:
        middle = (low + high) / 2
        if read_row(tables, table + CUMULATIVE, middle, place) <= u[1]:
            low = middle
        else:
            high = middle
    below = read_row(tables, table + CUMULATIVE, low, place)
    part = (u[1] - below) / wp.max(read_row(tables, table + CUMULATIVE, high, place) - below, 1.0e-20)
    row = float(low) + wp.clamp(part, 0.0, 1.0)
    z = wp.min(place.scale * (exponential(row / place.rows_per_log) - 1.0), 1.0)
    r = wp.sqrt((1.0 - z) * (1.0 + z))
    return wp.vec3(r * cos_phi, r * sin_phi, z)


@wp.func
def multiple_bounces_pdf(tables: wp.array(dtype=float), table: int, w: wp.vec3, alpha: float) -> float:
    """Return the density of `sample_multiple_bounces`: uniform in each row, and in azimuth."""
    place = table_place(tables, table, w[0], w[1], alpha)
    i = wp.min(int(row_of(w[2], place)), ROWS - 2)
    share = read_row(tables, table + CUMULATIVE, i + 1, place) - read_row(tables, table + CUMULATIVE, i, place)
    return share * place.rows_per_log / ((place.scale + w[2]) * TWO_PI)


@specialised()
def make_missing_kernel(distribution: str, masking: str) -> wp.Kernel:
    """Return the kernel that computes 1 − E for white microfacets, one thread per direction and shape.

    It is the mean of 1 − f |cosθi| / pdf over directions mirrored by normals from a Fibonacci lattice.
    """
    facet = make_microfacet(distribution, masking)

    @wp.kernel(module=wp.get_module(make_missing_kernel.module_name(distribution, masking)), enable_backward=False)
    def missing_energy_kernel(
        first: int,
        points: int,
        directions: wp.array(dtype=wp.vec3),
        shapes: wp.array(dtype=wp.vec3),
        missing_out: wp.array(dtype=float),
    ):
        n = first + wp.tid()
        wo = directions[n]
        shape = shapes[n]
        total = wp.float64(0.0)
        for k in range(points):
            m = facet.sample_normal(wo, shape, lattice_point(k, points))
            cos_m = wp.dot(wo, m)
            wi = m * (2.0 * cos_m) - wo
            weight = float(0.0)
            density = facet.normal_pdf(wo, m, shape)
            if wi[2] > 0.0 and cos_m > 0.0 and density > 0.0:
                weight = facet.d(m, shape) / density * facet.g(wo, wi, m, shape) * (cos_m / wo[2])
            total += wp.float64(1.0 - weight)
        missing_out[n] = float(total / wp.float64(points))

    return missing_energy_kernel
