"""Energy that single scattering loses, in tables, and the lobe that gives it back.

Light that a microfacet blocks does not vanish: it bounces on. What a microfacet model of one bounce misses of a white
surface, 1 − E(w), is tabulated (`wrt/build/albedo_tables.py`), E(w) being the albedo for light from w, and is given
back by a smooth reciprocal lobe: Kulla and Conty, "Revisiting physically based shading at Imageworks", SIGGRAPH 2017
course; Jakob et al., "A comprehensive framework for rendering layered materials" (2014), section 5.6, had it for
another model. It is chosen such that a white surface reflects all light, whatever its roughness.

A table is TABLE_SIZE floats:

    0, 1            roughness along x and y of the surface that it was made for; 0 where its columns are roughnesses
    2 ...           per column, the mean of 1 − E over the hemisphere, weighted by 2 cosθ
    2 + COLUMNS ... (ROWS, COLUMNS) values of 1 − E, by cosine

Rows are even in √(μ (1 + a) / (μ + a)), μ = cosθ and a the roughness towards w: losses happen where μ is about a, so
that smooth surfaces need their rows near the horizon. Columns are even in √α; or, in a table for one anisotropic
surface, in the azimuth stretched by √(αv/αu).
"""

import functools

import warp as wp

from wrt.kernels.microfacet import LEAST_ALPHA, make_microfacet
from wrt.kernels.warps import INV_PI, PI

ROWS = wp.constant(32)
COLUMNS = wp.constant(32)
AVERAGES = wp.constant(2)
VALUES = wp.constant(2 + 32)
TABLE_SIZE = 2 + 32 + 32 * 32

GOLDEN = wp.constant(wp.uint32(2654435769))
"""The golden ratio's fraction in units of 2^-32: its multiples fill [0, 1) evenly (Fibonacci lattice)."""


@wp.func
def table_column_of_alpha(alpha: float) -> float:
    """Return the place of a roughness among the columns of a table by roughness."""
    least = wp.sqrt(LEAST_ALPHA)
    return (wp.sqrt(wp.clamp(alpha, LEAST_ALPHA, 1.0)) - least) / (1.0 - least) * float(COLUMNS - 1)


@wp.func
def table_row(mu: float, alpha: float) -> float:
    """Return the place of a cosine among the rows, for the roughness in its direction."""
    return wp.sqrt(wp.clamp(mu * (1.0 + alpha) / (mu + alpha), 0.0, 1.0)) * float(ROWS - 1)


@wp.func
def read_table(tables: wp.array(dtype=float), first: int, row: float, column: float) -> float:
    """Return the bilinearly interpolated value of (ROWS, COLUMNS) floats from `first` on."""
    i = wp.min(int(row), ROWS - 2)
    j = wp.min(int(column), COLUMNS - 2)
    x = column - float(j)
    y = row - float(i)
    k = first + i * COLUMNS + j
    near = tables[k] + (tables[k + 1] - tables[k]) * x
    far = tables[k + COLUMNS] + (tables[k + COLUMNS + 1] - tables[k + COLUMNS]) * x
    return near + (far - near) * y


@wp.func
def missing_energy(tables: wp.array(dtype=float), table: int, w: wp.vec3, alpha: float) -> float:
    """Return 1 − E(w), for the roughness `alpha` where the table is not for one surface alone."""
    along_x = tables[table]
    along_y = tables[table + 1]
    toward = float(alpha)
    column = float(0.0)
    if along_x > 0.0:
        x = along_x * w[0]
        y = along_y * w[1]
        toward = wp.sqrt((x * x + y * y) / wp.max(w[0] * w[0] + w[1] * w[1], 1.0e-12))
        toward = wp.max(toward, wp.min(along_x, along_y))
        stretched = wp.atan2(wp.sqrt(along_y) * wp.abs(w[1]), wp.sqrt(along_x) * wp.abs(w[0]))
        column = stretched * (2.0 / PI) * float(COLUMNS - 1)
    else:
        column = table_column_of_alpha(alpha)
    return read_table(tables, table + VALUES, table_row(wp.abs(w[2]), toward), column)


@wp.func
def average_missing_energy(tables: wp.array(dtype=float), table: int, alpha: float) -> float:
    """Return the mean of 1 − E over the hemisphere, weighted by 2 cosθ; greater than 0."""
    column = float(0.0)
    if tables[table] == 0.0:
        column = table_column_of_alpha(alpha)
    j = wp.min(int(column), COLUMNS - 2)
    low = tables[table + AVERAGES + j]
    high = tables[table + AVERAGES + j + 1]
    return wp.max(low + (high - low) * (column - float(j)), 1.0e-9)


@wp.func
def multiple_bounce_lobe(missing_o: float, missing_i: float, average: float) -> float:
    """Return the value (1 − E(wo)) (1 − E(wi)) / (π (1 − E_avg)) of the lobe of a white surface (Kulla and Conty)."""
    return INV_PI * missing_o * (missing_i / average)


@wp.func
def multiple_bounce_fresnel(reflectance: wp.vec3, average: float) -> wp.vec3:
    """Return what a lobe is multiplied by where each bounce reflects the mean share F of the light.

    A share 1 − E_avg of what a bounce reflects is blocked and bounces again, the rest E_avg gets out. The second bounce
    and all further ones: F E_avg Σ (F (1 − E_avg))^k, k ≥ 1, over the 1 − E_avg that the lobe has for F = 1, is
    F² E_avg / (1 − F (1 − E_avg)): Kulla and Conty 2017, with one F more, as Hill explains ("A multi-faceted
    exploration", part 2, 2018).
    """
    escapes = 1.0 - average
    return wp.cw_div(
        wp.cw_mul(reflectance, reflectance) * escapes, wp.vec3(1.0) - wp.min(reflectance, wp.vec3(1.0)) * average
    )


@functools.cache
def make_missing_kernel(distribution: str, masking: str) -> wp.Kernel:
    """Return the kernel that computes 1 − E for white microfacets, one thread a direction and shape.

    The mean of 1 − f |cosθi| / pdf over directions that mirror the normals of a Fibonacci lattice: no random numbers.
    """
    parts = make_microfacet(distribution, masking)
    d, g, sample_normal, normal_pdf = parts.d, parts.g, parts.sample_normal, parts.normal_pdf
    name = f"{distribution}_{masking}".replace("-", "_")

    @wp.kernel(module=wp.get_module(f"wrt.albedo.{name}"), enable_backward=False)
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
            # 24 bits: the nearest float to a 32-bit fraction may be 1.
            across = float(int((wp.uint32(k) * GOLDEN) >> wp.uint32(8))) * 5.9604644775390625e-08
            m = sample_normal(wo, shape, wp.vec2((float(k) + 0.5) / float(points), across))
            cos_m = wp.dot(wo, m)
            wi = m * (2.0 * cos_m) - wo
            weight = float(0.0)
            density = normal_pdf(wo, m, shape)
            if wi[2] > 0.0 and cos_m > 0.0 and density > 0.0:
                weight = d(m, shape) / density * g(wo, wi, m, shape) * (cos_m / wo[2])
            total += wp.float64(1.0 - weight)
        missing_out[n] = float(total / wp.float64(points))

    return missing_energy_kernel
