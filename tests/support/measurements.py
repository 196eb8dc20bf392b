"""Measurements made by code: arbitrary tables, and a rough metal tabulated as if it had been measured."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene.materials.measured import Measurement

Array = NDArray[np.float64]

ISOTROPIC = np.zeros(1, np.float32)
THETA = np.array([0.0, 0.4, 0.9, 1.5], np.float32)


def azimuths(share: int, count: int) -> NDArray[np.float32]:
    """Return nodes from −π on over the circle, or over one of `share` parts of it."""
    return np.linspace(-np.pi, -np.pi + 2.0 * np.pi / share, count).astype(np.float32)


def arbitrary(phi_i: NDArray[Any], *, seed: int = 0, steep: float = 2.0, side: int = 9, **given: Any) -> Measurement:
    """Return tables of random numbers that span `steep` e-folds; visible normals besides go by solid angle."""
    random = np.random.default_rng(seed)

    def numbers(*shape: int) -> NDArray[np.float32]:
        return np.exp(steep * (random.random(shape) - 0.5)).astype(np.float32)

    slices = len(phi_i), len(THETA)
    tables: dict[str, Any] = {
        "ndf": numbers(5, 7),
        "sigma": numbers(3, 6),
        "vndf": numbers(*slices, 11, 8),
        "luminance": numbers(*slices, side, side),
        "rgb": 0.1 * numbers(*slices, 3, side, side),
    }
    tables["vndf"] *= solid_angle(np.linspace(0.0, 1.0, 8)).astype(np.float32)
    if len(phi_i) < 3:
        tables["sigma"][:] = tables["sigma"][0]  # the area of facets is the same from all sides
    return Measurement(phi_i, THETA, **{**tables, **given})


def solid_angle(x: Array) -> Array:
    """Return the solid angle that a unit of the square's area stands for."""
    return np.asarray(2.0 * np.pi**2 * x * np.sin(0.5 * np.pi * x**2))


def polar(theta: Array, phi: Array) -> Array:
    """Return unit vectors."""
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def facets(x: Array, y: Array) -> Array:
    """Return the directions that points of the square stand for."""
    return polar(0.5 * np.pi * x**2, np.pi * (2.0 * y - 1.0))


def _up_to(values: Array) -> Array:
    """Return integrals along the last axis, from 0 to each node."""
    steps = 0.5 * (values[..., 1:] + values[..., :-1]) / (values.shape[-1] - 1)
    return np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(steps, axis=-1)], axis=-1)


def _position(area: Array, start: Array, end: Array) -> Array:
    """Return t of ∫ (start + (end − start) s) ds from 0 to t, by bisection: no formula is shared with the kernel."""
    low, high = np.zeros_like(area), np.ones_like(area)
    for _ in range(50):
        t = 0.5 * (low + high)
        short = t * start + 0.5 * t**2 * (end - start) < area
        low, high = np.where(short, t, low), np.where(short, high, t)
    return 0.5 * (low + high)


def warped(density: Array, u: Array) -> Array:
    """Return (N, 2) points drawn from a bilinear density on the square by (N, 2) even points: y first, then x."""
    rows, columns = density.shape
    along = _up_to(density)
    up = _up_to(along[:, -1])
    target = u[:, 1] * up[-1]
    row = np.clip(np.searchsorted(up, target, "right") - 1, 0, rows - 2)
    y = _position((target - up[row]) * (rows - 1), along[row, -1], along[row + 1, -1])

    def between(table: Array) -> Array:
        return np.asarray((1.0 - y[:, None]) * table[row] + y[:, None] * table[row + 1])

    sums, values = between(along), between(density)
    target = u[:, 0] * sums[:, -1]
    column = np.clip((sums <= target[:, None]).sum(axis=1) - 1, 0, columns - 2)
    each = np.arange(len(u))
    x = _position((target - sums[each, column]) * (columns - 1), values[each, column], values[each, column + 1])
    return np.stack([(column + x) / (columns - 1), (row + y) / (rows - 1)], axis=1)


def rough_metal(alpha: tuple[float, float], f0: float, *, fine: int, viewers: int) -> Measurement:
    """Return a metal of GGX facets, with Schlick's reflectance and Smith's separable masking, as a measurement of it.

    By section 4 of Dupuy and Jakob (2018): D, σ and the visible normals as tables, and what is left of f cosθ on the
    square that the tabulated visible normals warp.

    Args:
        alpha: roughness along x and y.
        f0: reflectance straight on.
        fine: nodes along each axis of the tables.
        viewers: nodes of the viewer's angle, and of the azimuth over a quarter of the circle, if anisotropic.
    """
    stretch = np.array([*alpha, 1.0])
    isotropic = alpha[0] == alpha[1]
    phi_i = ISOTROPIC if isotropic else azimuths(4, viewers)
    theta_i = (0.499 * np.pi * np.linspace(0.0, 1.0, viewers)).astype(np.float32)

    def area(w: Array) -> Array:
        """σ = cosθ / G1."""
        return np.asarray(0.5 * (w[..., 2] + np.linalg.norm(w * stretch, axis=-1)))

    nodes = np.linspace(0.0, 1.0, fine)
    x, y = np.meshgrid(nodes, nodes)
    m = facets(x, y)

    def normals(m: Array) -> Array:
        return np.asarray(1.0 / (np.pi * alpha[0] * alpha[1] * ((m / stretch) ** 2).sum(axis=-1) ** 2))

    shape = len(phi_i), len(theta_i)
    vndf = np.empty((*shape, fine, fine), np.float32)
    rest = np.empty((*shape, fine, fine), np.float32)
    for place in np.ndindex(shape):
        wo = polar(theta_i[place[1]].astype(np.float64), phi_i[place[0]].astype(np.float64))
        vndf[place] = normals(m) * solid_angle(x) * np.maximum(m @ wo, 0.0)
        u = np.stack([x, y], axis=-1).reshape(-1, 2)
        found = warped(vndf[place].astype(np.float64), u)
        facet = facets(found[:, 0], found[:, 1])
        cosine = np.clip(facet @ wo, 0.0, 1.0)
        wi = 2.0 * cosine[:, None] * facet - wo
        masking = np.maximum(wi[:, 2], 0.0) / np.maximum(area(wi), 1e-9)
        rest[place] = ((f0 + (1.0 - f0) * (1.0 - cosine) ** 5) * masking).reshape(fine, fine)
    rgb = np.repeat(rest[:, :, None], 3, axis=2)
    return Measurement(phi_i, theta_i, normals(m), area(m), vndf, rest, rgb)
