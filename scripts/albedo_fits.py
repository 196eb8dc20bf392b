"""Fit the albedos that kernels/bsdf/lobes/albedo_fits.py evaluates, and print the coefficients.

A coat must attenuate the layers below by no more than it reflects itself: its albedo E(w) for light from w. Microfacet
albedos have no closed form, but are smooth functions of the cosine μ and the roughness in suitable variables.

- GGX with Smith's height-correlated masking and Schlick's Fresnel, F = f0 + (f90 − f0)(1 − wo·m)⁵, has the albedo
  f0 (W − G) + f90 G: W is the albedo of a white surface, G the same with the weight (1 − wo·m)⁵. W is a polynomial in
  μ / (μ + α/2) and √α, as masking depends on μ/α where both are small. G/W is the fifth power of one in √α and the root
  of ½ (μ + √(μ² + α² (1 − μ²))), the mean cosine of the visible facets.
- Sheen, after Estevez and Kulla (2017): its albedo is the square of a polynomial in h / (h + r) and ln r, with r its
  roughness (the root of their r) and h = √(μ² + c²), c the cosine where its shadowing is cut.

Each fit is a linear program that minimises the maximum error while the fit is nowhere below the fitted values. So a
coat never transmits too much, and energy is conserved.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

Array = NDArray[np.float64]

LEAST_ALPHA = 1e-4
LEAST_SHEEN = 0.07
"""Least roughness of sheen; below it, the model gains energy almost everywhere it has sheen."""
SHEEN_CUT = 0.01
"""Lower clamp of cosines in the shadowing of sheen."""
SLACK = 1e-4
"""Offset added to the fits, so that they stay above the albedo between the fitted points too."""


def nodes(n: int) -> tuple[Array, Array]:
    """Return the points and weights of Gauss-Legendre quadrature on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(n)
    return 0.5 * (x + 1.0), 0.5 * w


def specular_albedos(mu: float, alpha: float, n: int = 192) -> tuple[float, float]:
    """Return W and G by quadrature over the random numbers of visible-normal sampling (Dupuy and Benyoub 2023)."""
    x, w = nodes(n)
    phi, z = np.meshgrid(np.pi * x, x, indexing="ij")
    sine = np.sqrt(1.0 - mu * mu)
    view = np.array([alpha * sine, 0.0, mu]) / np.hypot(alpha * sine, mu)
    cap = z * (1.0 + view[2]) - view[2]
    radius = np.sqrt(np.maximum(1.0 - cap * cap, 0.0))
    m = np.stack([alpha * (radius * np.cos(phi) + view[0]), alpha * radius * np.sin(phi), cap + view[2]])
    m /= np.sqrt((m * m).sum(axis=0))
    cos_m = sine * m[0] + mu * m[2]
    light = 2.0 * cos_m * m[2] - mu

    def hidden(cos: Array) -> Array:
        return 0.5 * (np.sqrt(1.0 + alpha**2 * (1.0 - cos**2) / cos**2) - 1.0)

    lambda_o, lambda_i = hidden(np.array(mu)), hidden(np.where(light > 0.0, light, 1.0))
    seen = np.where(light > 0.0, (1.0 + lambda_o) / (1.0 + lambda_o + lambda_i), 0.0) * np.outer(w, w)
    return float(seen.sum()), float((seen * (1.0 - np.minimum(cos_m, 1.0)) ** 5).sum())


def sheen_lambda(cos: Array, alpha: float) -> Array:
    """Return Λ of sheen by the fit of Estevez and Kulla (2017)."""
    k = (1.0 - alpha) ** 2
    rough = np.array([21.5473, 3.82987, 0.19823, -1.97760, -4.32054])
    smooth = np.array([25.3245, 3.32435, 0.16801, -1.27393, -4.85967])
    a, b, c, d, e = rough + (smooth - rough) * k

    def curve(x: Array) -> Array:
        return np.asarray(a / (1.0 + b * x**c) + d * x + e)

    low = curve(np.minimum(cos, 0.5))
    high = 2.0 * curve(np.array(0.5)) - curve(1.0 - np.maximum(cos, 0.5))
    return np.exp(np.where(cos < 0.5, low, high))


def sheen_albedo(mu: float, roughness: float, n: int = 160) -> float:
    """Return the albedo of white sheen by quadrature over directions, densest at the horizon and around the viewer."""
    alpha = roughness**2
    x, w = nodes(n)
    cos, phi = np.meshgrid(x**3, np.pi * x**2, indexing="ij")
    weights = 2.0 * np.outer(w * 3.0 * x**2, w * 2.0 * np.pi * x)
    sine = np.sqrt(1.0 - cos**2)
    h = np.stack([sine * np.cos(phi) + np.sqrt(1.0 - mu * mu), sine * np.sin(phi), cos + mu])
    sine2_h = 1.0 - h[2] ** 2 / (h * h).sum(axis=0)
    d = (2.0 + 1.0 / alpha) * np.maximum(sine2_h, 0.0) ** (0.5 / alpha) / (2.0 * np.pi)
    o, i = np.maximum(np.array(mu), SHEEN_CUT), np.maximum(cos, SHEEN_CUT)
    visible = 1.0 / (4.0 * o * i * (1.0 + sheen_lambda(o, alpha) + sheen_lambda(i, alpha)))
    return float((weights * d * visible * cos).sum())


def monomials(x: Array, y: Array, n: int, m: int) -> Array:
    """Return (points, (n + 1)(m + 1)) values of x^i y^j."""
    return np.stack([(x**i * y**j).ravel() for i in range(n + 1) for j in range(m + 1)], axis=1)


def fit_above(basis: Array, values: Array, weights: Array) -> tuple[Array, float]:
    """Return coefficients c with basis c ≥ values that minimise the maximum weighted error, and that error."""
    weighted = basis * weights[:, None]
    one = np.ones((len(values), 1))
    bounds = np.concatenate([-values * weights, values * weights])
    rows = np.vstack([np.hstack([-weighted, 0.0 * one]), np.hstack([weighted, -one])])
    cost = np.zeros(basis.shape[1] + 1)
    cost[-1] = 1.0
    found = linprog(cost, A_ub=rows, b_ub=bounds, bounds=[(None, None)] * len(cost), method="highs")
    return found.x[:-1], float(found.x[-1])


def chebyshev(n: int) -> Array:
    """Return n points from 0 to 1, dense at both ends."""
    return np.asarray(0.5 * (1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, n))))


def table(name: str, coefficients: Array, m: int) -> None:
    """Print the coefficients, with a row of those of y^j for each x^i."""
    print(name)
    for row in coefficients.reshape(-1, m + 1):
        print("   ", ", ".join(f"{c:.7g}" for c in row))


def fit_specular() -> None:
    """Fit W, G and their averages 2 ∫ μ dμ."""
    root = np.maximum(chebyshev(41), np.sqrt(LEAST_ALPHA))
    mu = np.maximum(chebyshev(49) ** 2, 1e-7)
    both = np.array([[specular_albedos(x, a * a) for a in root] for x in mu])
    u, s = np.meshgrid(mu, root, indexing="ij")
    white, grazing = both[..., 0].ravel(), both[..., 1].ravel()
    y = 2.0 * s - 1.0
    basis = monomials(masked_cosine(u, s * s), y, 7, 5)
    ones = np.ones(len(white))
    first, error = fit_above(basis, white + SLACK, ones)
    print(f"W to {error:.4f}")
    table("W: masked cosine, root of roughness", first, 5)

    fitted = np.minimum(basis @ first, 1.0)
    target = ((grazing + SLACK) / fitted) ** 0.2
    basis2 = monomials(facet_cosine(u, s * s), y, 5, 5)
    weights = 5.0 * np.maximum(target, 0.35) ** 4 * fitted
    second, error = fit_above(basis2, target, weights)
    print(f"G to {error:.4f}")
    table("root of G / W: facet cosine, root of roughness", second, 5)

    x, w = nodes(400)
    mu = x**3
    fine = np.linspace(np.sqrt(LEAST_ALPHA), 1.0, 201)
    u, s = np.meshgrid(mu, fine, indexing="ij")
    y = 2.0 * s - 1.0
    white = np.clip(monomials(masked_cosine(u, s * s), y, 7, 5) @ first, 0.0, 1.0).reshape(u.shape)
    q = np.clip(monomials(facet_cosine(u, s * s), y, 5, 5) @ second, 0.0, 1.0).reshape(u.shape)
    weights = (w * 3.0 * x**2 * 2.0 * mu)[:, None]
    for name, values in (("W", white), ("G", white * q**5)):
        average = (values * weights).sum(axis=0)
        # Fitted from below, since the divisor 1 − E must not become too small.
        found, error = fit_above(-monomials(2.0 * fine - 1.0, 0.0 * fine, 7, 0), -average + 1e-6, np.ones(len(fine)))
        print(f"average of {name} to {error:.5f}")
        table(f"average of {name}: root of roughness", found, 7)


def masked_cosine(mu: Array, alpha: Array) -> Array:
    """Return 2 μ / (μ + α/2) − 1."""
    return np.asarray(2.0 * mu / (mu + 0.5 * alpha) - 1.0)


def facet_cosine(mu: Array, alpha: Array) -> Array:
    """Return the root of the mean cosine of visible facets, from −1 to 1."""
    area = 0.5 * (mu + np.sqrt(mu * mu + alpha * alpha * (1.0 - mu * mu)))
    return np.asarray(2.0 * np.sqrt(area) - 1.0)


def fit_sheen() -> None:
    """Fit the albedo of sheen."""
    roughness = LEAST_SHEEN + (1.0 - LEAST_SHEEN) * chebyshev(41)
    mu = np.maximum(chebyshev(49) ** 2, 1e-7)
    albedo = np.array([[sheen_albedo(x, r) for r in roughness] for x in mu]).ravel()
    u, r = np.meshgrid(mu, roughness, indexing="ij")
    h = np.hypot(u, SHEEN_CUT)
    basis = monomials(2.0 * h / (h + r) - 1.0, 1.0 - 2.0 * np.log(r) / np.log(LEAST_SHEEN), 5, 5)
    target = np.sqrt(albedo + SLACK)
    weights = np.maximum(2.0 * target, 0.3) / np.maximum(albedo, 1.0)
    found, error = fit_above(basis, target, weights)
    print(f"sheen to {error:.4f}, of what exceeds 1 by that factor")
    table("root of sheen: h / (h + r), ln r", found, 5)


def main() -> None:
    """Run all fits and print them."""
    steps: tuple[Callable[[], None], ...] = (fit_specular, fit_sheen)
    for step in steps:
        step()


if __name__ == "__main__":
    main()
