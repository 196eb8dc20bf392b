"""Tables of the light that a rough transparent coat lets in (kernels/coat.py says how they lie)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.device import Device

ROWS = 128
"""For one roughness; between rows T is off by less than 1e-4."""

ROWS_OF_MANY = 64
"""For all roughnesses; between rows and columns T is off by less than 1e-3."""

POINTS = {"ggx": 4096, "beckmann": 4096}
"""Normals per value where visible ones are sampled: right to 2e-4. A quarter of them for all roughnesses: to 1e-3."""

MORE_POINTS = 32768
"""For distributions whose visible normals are not sampled: right to 1e-3, at most 3e-3 near the horizon."""

LEAST_COSINE = 1e-6


def coat_table(
    distribution: str, masking: str, eta: float, alpha: float | None, multiple_bounces: bool, device: Device
) -> NDArray[np.float32]:
    """Return the table of a rough coat.

    Args:
        distribution: a name in `kernels.microfacet.DISTRIBUTIONS`, one that has a roughness α.
        masking: a name in `kernels.microfacet.MASKINGS` that goes with it.
        eta: refractive index of the coat over that outside.
        alpha: the roughness of one surface; or None, for all roughnesses.
        multiple_bounces: whether the base gets all light that the coat does not reflect at once. Otherwise it gets
            what a single refraction brings down, and what microfacets block is lost.
        device: where it is computed.
    """
    import warp as wp

    from wrt.kernels.coat import ROUGHNESSES, make_coat_kernel
    from wrt.kernels.microfacet import LEAST_ALPHA

    points = POINTS.get(distribution, MORE_POINTS)
    rows, points = (ROWS, points) if alpha is not None else (ROWS_OF_MANY, points // 4)
    root = np.linspace(0.0, 1.0, rows)
    cosine = np.maximum(root**2, LEAST_COSINE)
    least = np.sqrt(float(LEAST_ALPHA))
    alphas = np.array([alpha]) if alpha is not None else np.linspace(least, 1.0, int(ROUGHNESSES)) ** 2
    shape = (rows, len(alphas))
    directions = np.stack([np.sqrt(1.0 - cosine**2), np.zeros(rows), cosine], axis=1)
    out = [wp.empty(rows * len(alphas), dtype=float, device=device.name) for _ in range(2)]
    inputs = [
        points,
        float(eta),
        wp.array(np.repeat(directions, len(alphas), axis=0).astype(np.float32), dtype=wp.vec3, device=device.name),
        wp.array(np.tile(alphas, rows).astype(np.float32), dtype=float, device=device.name),
        *out,
    ]
    device.launch(make_coat_kernel(distribution, masking), rows * len(alphas), inputs)
    reflected, refracted = (array.numpy().reshape(shape).astype(np.float64) for array in out)
    let_in = 1.0 - reflected if multiple_bounces else np.minimum(refracted, 1.0 - reflected)
    let_in = np.clip(let_in, 0.0, 1.0).astype(np.float32)

    # What is not sent back from below comes out, and radiance over index squared is the same both ways:
    # 1 − R = 2 ∫ T cosθ d cosθ / η². So a white base keeps nothing.
    internal = 1.0 - _weights(root) @ let_in.astype(np.float64) / eta**2
    header = np.array([rows, len(alphas)], np.float64)
    return np.concatenate([header, internal, let_in.ravel()]).astype(np.float32)


def _weights(root: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights by which values at even √cosθ, linear in between, give 2 ∫ T cosθ d cosθ = ∫ T 4 x³ dx."""
    # Three Gauss points a cell are exact for x³ times a linear function.
    node, weight = np.polynomial.legendre.leggauss(3)
    low, high = root[:-1, None], root[1:, None]
    share = 0.5 * (node + 1.0)
    mass = 0.5 * (high - low) * weight * 4.0 * (low + (high - low) * share) ** 3
    result = np.zeros(len(root))
    result[:-1] += (mass * (1.0 - share)).sum(axis=1)
    result[1:] += (mass * share).sum(axis=1)
    return result
