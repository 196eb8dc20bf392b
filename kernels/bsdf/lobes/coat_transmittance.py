"""The transmittance of transparent coats: of smooth ones by Fresnel's equations, of rough ones from a table.

A table is made for one refractive index and one distribution of normals (`wrt/upload/tables/coat.py`):

    0, 1            ROWS and COLUMNS of the values
    2 ...           per column, the coat's reflectance for diffuse light from below
    2 + COLUMNS ... (ROWS, COLUMNS) transmittance T for light from above, by cosine

Rows are uniform in √cosθ, as T changes fastest near the horizon. Columns are ROUGHNESSES uniform in √α; a table for one
roughness has one column.
"""

import warp as wp

from wrt.kernels.bsdf.lobes.fresnel import refracted_by
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import LEAST_ALPHA, make_microfacet
from wrt.kernels.sampling.warps import lattice_point

HEADER = wp.constant(2)
ROUGHNESSES = wp.constant(32)


@wp.func
def transmitted(cos_i: float, eta: float) -> float:
    """Return 1 − F for cosθi > 0 and eta = n_t / n_i, precise at grazing angles and for eta near 1."""
    cos2_t = ((eta - 1.0) * (eta + 1.0) + cos_i * cos_i) / (eta * eta)
    if cos2_t <= 0.0:
        return 0.0
    cos_t = wp.sqrt(cos2_t)
    s = cos_i + eta * cos_t
    p = eta * cos_i + cos_t
    return wp.min(2.0 * eta * ((cos_i / s) * (cos_t / s) + (cos_i / p) * (cos_t / p)), 1.0)


@wp.func
def coat_column(tables: wp.array(dtype=float), table: int, alpha: float) -> float:
    """Return the column of a roughness in a table."""
    if tables[table + 1] < float(ROUGHNESSES):
        return 0.0
    least = wp.sqrt(LEAST_ALPHA)
    return (wp.sqrt(wp.clamp(alpha, LEAST_ALPHA, 1.0)) - least) / (1.0 - least) * float(ROUGHNESSES - 1)


@wp.func
def coat_internal_reflectance(tables: wp.array(dtype=float), table: int, column: float) -> float:
    """Return the coat's reflectance for diffuse light from below."""
    last = int(tables[table + 1]) - 1
    j = wp.min(int(column), last)
    low = tables[table + HEADER + j]
    return low + (tables[table + HEADER + wp.min(j + 1, last)] - low) * (column - float(j))


@wp.func
def coat_transmittance(tables: wp.array(dtype=float), table: int, cos_theta: float, column: float) -> float:
    """Return the coat's transmittance for light at an angle."""
    rows = int(tables[table])
    columns = int(tables[table + 1])
    row = wp.sqrt(wp.min(cos_theta, 1.0)) * float(rows - 1)
    i = wp.min(int(row), rows - 2)
    j = wp.min(int(column), columns - 1)
    k = table + HEADER + columns * (i + 1) + j
    right = wp.where(j + 1 < columns, 1, 0)
    x = column - float(j)
    near = wp.lerp(tables[k], tables[k + right], x)
    far = wp.lerp(tables[k + columns], tables[k + columns + right], x)
    return wp.lerp(near, far, row - float(i))


@specialised()
def make_coat_kernel(distribution: str, masking: str) -> wp.Kernel:
    """Return the kernel that computes the reflectance and transmittance of a rough boundary, one thread per direction.

    They are means over normals of a Fibonacci lattice. Each reflects a share F of the light and refracts the rest;
    masking reduces both.
    """
    facet = make_microfacet(distribution, masking)

    @wp.kernel(module=wp.get_module(make_coat_kernel.module_name(distribution, masking)), enable_backward=False)
    def coat_kernel(
        first: int,
        points: int,
        eta: float,
        directions: wp.array(dtype=wp.vec3),
        alphas: wp.array(dtype=float),
        reflected_out: wp.array(dtype=float),
        refracted_out: wp.array(dtype=float),
    ):
        n = first + wp.tid()
        wo = directions[n]
        shape = wp.vec3(alphas[n], alphas[n], 0.0)
        reflected = wp.float64(0.0)
        refracted = wp.float64(0.0)
        for k in range(points):
            m = facet.sample_normal(wo, shape, lattice_point(k, points))
            cos_m = wp.dot(wo, m)
            density = facet.normal_pdf(wo, m, shape)
            if cos_m > 0.0 and density > 0.0:
                weight = facet.d(m, shape) / density * (cos_m / wo[2])
                let_in = transmitted(cos_m, eta)
                wi = m * (2.0 * cos_m) - wo
                if wi[2] > 0.0:
                    reflected += wp.float64(weight * (1.0 - let_in) * facet.g(wo, wi, m, shape))
                wt = refracted_by(m, wo, cos_m, eta)
                if wt[2] < 0.0:
                    refracted += wp.float64(weight * let_in * facet.g(wo, wt, m, shape))
        reflected_out[n] = float(reflected / wp.float64(points))
        refracted_out[n] = float(refracted / wp.float64(points))

    return coat_kernel
