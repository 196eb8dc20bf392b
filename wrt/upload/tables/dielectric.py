"""Tables of the energy that rough dielectrics lose by single scattering (`kernels/bsdf/lobes/albedo_dielectric.py`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.scene.materials.dielectrics import mean_transmittance
from wrt.upload.tables.albedo import missing_table

GRAZING = 0.15
"""See `missing_table`: towards the horizon, E outside falls as a small power of cosθ. With this value the table is
accurate to 8e-3 up to 89.9 degrees; beyond, it returns up to 15 % too little, but at most 8e-3 too much."""


def dielectric_table(
    distribution: str,
    masking: str,
    shape: tuple[float, float, float] | None,
    relative_ior: float,
    device: Device,
) -> NDArray[np.float32]:
    """Return the tables of 1 − E outside and inside, and the mean transmittances of a smooth boundary.

    Args:
        distribution: a name in `kernels.microfacet.DISTRIBUTIONS`.
        masking: a name in `kernels.microfacet.MASKINGS` that goes with it.
        shape: shape parameters of one surface, whose columns are azimuths; or None, for all roughnesses.
        relative_ior: refractive index inside over outside.
        device: the device that computes it.
    """
    kernel = current_backend().call(
        "wrt.kernels.bsdf.lobes.albedo_dielectric", "make_missing_dielectric_kernel", distribution, masking
    )
    indices = (relative_ior, 1.0 / relative_ior)
    sides = [missing_table(distribution, shape, device, kernel, eta, grazing=GRAZING) for eta in indices]
    transmittances = [mean_transmittance(eta) for eta in indices]
    return np.concatenate([*sides, transmittances]).astype(np.float32)


def dispersive_table(
    distribution: str,
    masking: str,
    shape: tuple[float, float, float] | None,
    red: float,
    green: float,
    blue: float,
    device: Device,
) -> NDArray[np.float32]:
    """Return the tables for the indices of the three channels, one after the other."""
    return np.concatenate(
        [dielectric_table(distribution, masking, shape, index, device) for index in (red, green, blue)]
    )
