"""The energy that a single-bounce rough dielectric loses, and the lobes that restore it on both sides.

This is `kernels/bsdf/lobes/albedo.py` for a surface that also refracts. Glass absorbs nothing, so E(w), reflected and
refracted together, should be 1. Two smooth lobes restore the rest (Kulla and Conty, "Revisiting physically based
shading at Imageworks", SIGGRAPH 2017 course, "Dielectrics"). With L = 1 − E, its mean L_avg weighted by 2 cosθ, and a,
b the sides of wo and wi, the lobes are, as energy,

    f cosθi = share_ab L_a(wo) L_b(wi) / (π L_b,avg) cosθi,    share_aa = 1 − share_ab.

A white furnace is white for any share. Both directions along a path lose the same energy if
n_a² share_ab / L_b,avg = n_b² share_ba / L_a,avg. Kulla and Conty leave the share open; here, with τ the mean
transmittance by Fresnel's equations,

    share_ab = τ_a min(1, L_b,avg / L_a,avg),

since n_a² τ_a = n_b² τ_b (which makes a smooth boundary reciprocal). It is at most τ_a, so at most 1.

A table consists of one for the outside and one for the inside, each as in `kernels/bsdf/lobes/albedo.py`, then τ
outside and τ inside.
"""

import warp as wp

from wrt.kernels.bsdf.lobes.albedo import (
    TABLE_SIZE,
    average_missing_energy,
    missing_energy,
    multiple_bounce_lobe,
    multiple_bounces_pdf,
    sample_multiple_bounces,
)
from wrt.kernels.bsdf.lobes.fresnel import fresnel_dielectric, refracted_by
from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import make_microfacet
from wrt.kernels.sampling.warps import lattice_point

SIDE_SIZE = wp.constant(TABLE_SIZE)
DIELECTRIC_TABLE_SIZE = 2 * TABLE_SIZE + 2


@wp.func
def side_table(table: int, front: bool) -> int:
    """Return the start of the table for the outside (the front) or the inside."""
    return table + wp.where(front, 0, SIDE_SIZE)


@wp.func
def transmitted_share(tables: wp.array(dtype=float), table: int, front: bool, alpha: float) -> float:
    """Return the share of the restored energy that goes through the surface, seen from the front or the back."""
    missing_near = average_missing_energy(tables, side_table(table, front), alpha)
    missing_far = average_missing_energy(tables, side_table(table, not front), alpha)
    return tables[table + 2 * SIDE_SIZE + wp.where(front, 0, 1)] * wp.min(1.0, missing_far / missing_near)


@wp.func
def dielectric_lobes(
    tables: wp.array(dtype=float), table: int, front: bool, wo: wp.vec3, wi: wp.vec3, alpha: float
) -> float:
    """Return f |cosθi| of light after more than one bounce, as energy: without the scaling of radiance."""
    share = transmitted_share(tables, table, front, alpha)
    above = wi[2] > 0.0
    side_i = side_table(table, front == above)
    missing_o = missing_energy(tables, side_table(table, front), wo, alpha)
    missing_i = missing_energy(tables, side_i, wi, alpha)
    average = average_missing_energy(tables, side_i, alpha)
    return wp.where(above, 1.0 - share, share) * multiple_bounce_lobe(missing_o, missing_i, average) * wp.abs(wi[2])


@wp.func
def sample_dielectric_lobes(
    tables: wp.array(dtype=float), table: int, front: bool, alpha: float, u: wp.vec2, u_side: float
) -> wp.vec3:
    """Return a direction on either side, roughly in proportion to the lobes."""
    above = u_side >= transmitted_share(tables, table, front, alpha)
    wi = sample_multiple_bounces(tables, side_table(table, front == above), alpha, u)
    return wp.vec3(wi[0], wi[1], wp.where(above, wi[2], -wi[2]))


@wp.func
def dielectric_lobes_pdf(tables: wp.array(dtype=float), table: int, front: bool, wi: wp.vec3, alpha: float) -> float:
    """Return the density of `sample_dielectric_lobes`."""
    share = transmitted_share(tables, table, front, alpha)
    above = wi[2] > 0.0
    upwards = wp.vec3(wi[0], wi[1], wp.abs(wi[2]))
    density = multiple_bounces_pdf(tables, side_table(table, front == above), upwards, alpha)
    return wp.where(above, 1.0 - share, share) * density


@specialised()
def make_missing_dielectric_kernel(distribution: str, masking: str) -> wp.Kernel:
    """Return the kernel that computes 1 − E, one thread per direction and shape.

    Like `make_missing_kernel`, with reflection and refraction at every normal. eta = n_t / n_i for light from wo.
    """
    facet = make_microfacet(distribution, masking)
    module = wp.get_module(make_missing_dielectric_kernel.module_name(distribution, masking))

    @wp.kernel(module=module, enable_backward=False)
    def missing_energy_dielectric_kernel(
        first: int,
        points: int,
        eta: float,
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
            cos_o = wp.dot(wo, m)
            density = facet.normal_pdf(wo, m, shape)
            weight = float(0.0)
            if cos_o > 0.0 and density > 0.0:
                reflected = fresnel_dielectric(cos_o, eta)
                wr = m * (2.0 * cos_o) - wo
                if wr[2] > 0.0:
                    weight += reflected * facet.g(wo, wr, m, shape)
                wt = refracted_by(m, wo, cos_o, eta)
                if wt[2] < 0.0 and reflected < 1.0:
                    weight += (1.0 - reflected) * facet.g(wo, wt, m, shape)
                weight *= facet.d(m, shape) / density * (cos_o / wo[2])
            total += wp.float64(1.0 - weight)
        missing_out[n] = float(total / wp.float64(points))

    return missing_energy_dielectric_kernel
