"""Tables of the energy that rough dielectrics of one bounce lose (kernels/albedo_dielectric.py says how they lie)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.build.albedo_tables import missing_table
from wrt.device import Device
from wrt.materials.dielectrics import mean_transmittance

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
    indices = (relative_ior, 1.0 / relative_ior)
    sides = [missing_table(distribution, shape, device, kernel, eta, grazing=GRAZING) for eta in indices]
    transmittances = [mean_transmittance(eta) for eta in indices]
    return np.concatenate([*sides, transmittances]).astype(np.float32)
