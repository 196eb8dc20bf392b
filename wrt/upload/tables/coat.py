"""Tables of the transmittance of rough coats; for the layout see `kernels/bsdf/lobes/coat_transmittance.py`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.linalg import gauss_legendre, product

ROWS = 128
"""Rows for one roughness; the interpolation error of T is below 1e-4."""

ROWS_OF_MANY = 64
"""Rows for all roughnesses; the interpolation error of T is below 1e-3."""

POINTS = {"ggx": 4096, "beckmann": 4096}
"""Normals per value if visible ones are sampled: accurate to 2e-4. Tables for all roughnesses use a quarter: 1e-3."""

MORE_POINTS = 32768
"""Normals per value for other distributions: accurate to 1e-3, near the horizon to 3e-3."""

LEAST_COSINE = 1e-6


def coat_table(
    distribution: str, masking: str, eta: float, alpha: float | None, multiple_bounces: bool, device: Device
) -> NDArray[np.float32]:
    """Return the table of a rough coat of relative index `eta`, for one roughness `alpha` or, without it, for all.

    With `multiple_bounces` the base receives all light that the coat does not reflect in one bounce. Otherwise it
    receives singly refracted light, and masked light is lost.
    """
    backend = current_backend()
    coat = backend.kernels("wrt.kernels.bsdf.lobes.coat_transmittance")
    microfacet = backend.kernels("wrt.kernels.microfacet")
    points = POINTS.get(distribution, MORE_POINTS)
    rows, points = (ROWS, points) if alpha is not None else (ROWS_OF_MANY, points // 4)
    root = np.linspace(0.0, 1.0, rows)
    cosine = np.maximum(root**2, LEAST_COSINE)
    least = np.sqrt(float(microfacet.LEAST_ALPHA))
    alphas = np.array([alpha]) if alpha is not None else np.linspace(least, 1.0, int(coat.ROUGHNESSES)) ** 2
    shape = (rows, len(alphas))
    directions = np.stack([np.sqrt(1.0 - cosine**2), np.zeros(rows), cosine], axis=1)
    out = [backend.empty(rows * len(alphas), float, device.name) for _ in range(2)]
    inputs = [
        points,
        float(eta),
        backend.array(np.repeat(directions, len(alphas), axis=0).astype(np.float32), "vec3", device.name),
        backend.array(np.tile(alphas, rows).astype(np.float32), float, device.name),
        *out,
    ]
    device.launch(
        backend.call("wrt.kernels.bsdf.lobes.coat_transmittance", "make_coat_kernel", distribution, masking),
        rows * len(alphas),
        inputs,
    )
    reflected, refracted = (array.numpy().reshape(shape).astype(np.float64) for array in out)
    let_in = 1.0 - reflected if multiple_bounces else np.minimum(refracted, 1.0 - reflected)
    let_in = np.clip(let_in, 0.0, 1.0).astype(np.float32)

    # Light from below leaves unless it is reflected, and radiance over the squared index is reciprocal:
    # 1 − R = 2 ∫ T cosθ d cosθ / η². A white base then absorbs nothing.
    internal = 1.0 - product(_weights(root), let_in.astype(np.float64)) / eta**2
    header = np.array([rows, len(alphas)], np.float64)
    return np.concatenate([header, internal, let_in.ravel()]).astype(np.float32)


def _weights(root: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quadrature weights of 2 ∫ T cosθ d cosθ = ∫ T 4 x³ dx for values at even √cosθ, linear in between."""
    # Three Gauss points per cell are exact for x³ times a linear function.
    node, weight = gauss_legendre(3)
    low, high = root[:-1, None], root[1:, None]
    share = 0.5 * (node + 1.0)
    mass = 0.5 * (high - low) * weight * 4.0 * (low + (high - low) * share) ** 3
    result = np.zeros(len(root))
    result[:-1] += (mass * (1.0 - share)).sum(axis=1)
    result[1:] += (mass * share).sum(axis=1)
    return result
