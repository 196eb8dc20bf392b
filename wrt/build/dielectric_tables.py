"""Tables of the energy that rough dielectrics of one bounce lose (kernels/albedo_dielectric.py says how they lie)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.build.albedo_tables import missing_table
from wrt.device import Device

GRAZING = 0.15
"""Towards the horizon E outside falls as a small power of cosθ. With this the table is right to 8e-3 up to 89.9
degrees, and beyond gives back up to 15 % too little, but never more than 8e-3 too much."""


def dielectric_table(
    distribution: str,
    masking: str,
    shape: tuple[float, float, float] | None,
    relative_ior: float,
    device: Device,
) -> NDArray[np.float32]:
    """Return the table of 1 − E outside, that inside, and the mean transmittances of a smooth boundary.

    Args:
        distribution: a name in `kernels.microfacet.DISTRIBUTIONS`.
        masking: a name in `kernels.microfacet.MASKINGS` that goes with it.
        shape: of the distribution, for one surface whose columns are azimuths; or None, for all roughnesses.
        relative_ior: refractive index inside over outside.
        device: where it is computed.
    """
    from wrt.kernels.albedo_dielectric import make_missing_dielectric_kernel

    kernel = make_missing_dielectric_kernel(distribution, masking)
    sides = [
        missing_table(distribution, shape, device, kernel, eta, grazing=GRAZING)
        for eta in (relative_ior, 1.0 / relative_ior)
    ]
    return np.concatenate([*sides, average_transmittances(relative_ior)]).astype(np.float32)


def average_transmittances(relative_ior: float) -> tuple[float, float]:
    """Return 2 ∫ (1 − F(μ)) μ dμ of a smooth boundary, for light from outside and for light from inside."""
    denser = max(relative_ior, 1.0 / relative_ior)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    # Into the denser medium, where there is no critical angle; 1 − F has an infinite slope at μ = 0 but in √μ.
    cos_i = (0.5 * (nodes + 1.0)) ** 2
    cos_t = np.sqrt(1.0 - (1.0 - cos_i**2) / denser**2)
    r_s = (cos_i - denser * cos_t) / (cos_i + denser * cos_t)
    r_p = (denser * cos_i - cos_t) / (denser * cos_i + cos_t)
    transmittance = 1.0 - 0.5 * (r_s**2 + r_p**2)
    into = float((weights * transmittance * cos_i * 2.0 * np.sqrt(cos_i)).sum())
    # The same light backwards fills a smaller cone: n_o² τ_o = n_i² τ_i.
    out_of = into / denser**2
    return (into, out_of) if relative_ior >= 1.0 else (out_of, into)
