"""Fit the mixture of kernels/microfacet/bumpy_ggx.py, and print its constants and errors.

The slopes of GGX facets on Gaussian bumps are, with α = 1 along both axes and X = 2σ² along either,

    ∫ exp(−t) exp(−x²/(1/t + X) − y²/(1/t + Y)) / (π √((1/t + X)(1/t + Y))) dt,

since GGX is Beckmann's distribution of a random roughness. The mixture is fitted to it in logarithms, up to 1.5 widths
√(1 + X) out with full weight and to five widths with little, for bumps up to three times as steep as the facets and of
any anisotropy. Weights move towards the largest errors, so that these become small.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]

LOBES = 3
OUT = np.array([0.0, 0.3, 0.6, 0.9, 1.2, 1.5, 2.0, 3.0, 5.0])
WEIGHTS = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.4, 0.1, 0.05])
START = (-0.754, 0.0, 1.83, -1.01, 0.2, 0.62, 0.06, 1.96, -0.68, -0.2, 2.44, 0.25, 0.87, -1.06, 0.48, -1.5, 0.36, -0.55)


class Grid:
    """Slopes (pairs, OUT, angles) and their exact densities, for pairs of X and Y."""

    def __init__(self, pairs: list[tuple[float, float]], angles: Array) -> None:
        self.x, self.y = (np.array(values)[:, None, None] for values in zip(*pairs, strict=True))
        self.along = OUT[None, :, None] * np.cos(angles) * np.sqrt(1.0 + self.x)
        self.across = OUT[None, :, None] * np.sin(angles) * np.sqrt(1.0 + self.y)
        log_t = np.linspace(-14.0, 3.4, 200)
        t = np.exp(log_t)
        a, b = 1.0 / t + self.x[..., None], 1.0 / t + self.y[..., None]
        each = np.exp(-(self.along[..., None] ** 2) / a - self.across[..., None] ** 2 / b) / (np.pi * np.sqrt(a * b))
        self.exact = each @ (np.exp(-t) * t * (log_t[1] - log_t[0]))

    def mixture(self, p: Array) -> Array:
        """Return the density of the mixture; five numbers of `p` for each Beckmann distribution, three for the GGX."""
        m, mean = np.sqrt((1.0 + self.x) * (1.0 + self.y)), 0.5 * (self.x + self.y)
        along = 1.0 - m / (1.0 + mean)
        total, density = np.ones_like(m), np.zeros_like(self.exact)
        for own, power, weight, fall, turn in p[: 5 * LOBES].reshape(LOBES, 5):
            share = np.exp(own + power * np.log(m))
            w = mean * np.exp(weight + fall * np.log(m) + turn * along)
            a, b = self.x + share, self.y + share
            density = density + w * np.exp(-(self.along**2) / a - self.across**2 / b) / (np.pi * np.sqrt(a * b))
            total = total + w
        own, bumps = 1.0 + (total - 1.0) * np.exp(p[-3]), np.exp(p[-2] + p[-1] / total)
        a, b = own + bumps * self.x, own + bumps * self.y
        density = density + 1.0 / (np.pi * np.sqrt(a * b) * (1.0 + self.along**2 / a + self.across**2 / b) ** 2)
        return np.asarray(density / total)

    def errors(self, p: Array) -> Array:
        """Return logarithms of the mixture over the exact density, weighted."""
        return np.asarray((np.log(self.mixture(p) / self.exact) * WEIGHTS[None, :, None]).ravel())


def fit(grid: Grid, start: Array) -> Array:
    """Return the constants with about the least largest error."""
    best = least_squares(grid.errors, start, max_nfev=150).x
    for power in (2, 4, 8):
        for _ in range(4):
            error = np.abs(grid.errors(best))
            weights = (error / error.max() + 0.02) ** (0.5 * (power - 1))
            found = least_squares(lambda p, w=weights: grid.errors(p) * w, best, max_nfev=25).x
            if np.abs(grid.errors(found)).max() < error.max():
                best = found
    return np.asarray(np.round(best, 3))


def main() -> None:
    """Fit, and print the constants and the errors at other places."""
    ratios = (0.0, 0.01, 0.05, 0.2, 0.6, 2.0, 6.0, 18.0)
    pairs = [(x, y) for x in ratios for y in ratios if y <= x and x > 0.0]
    found = fit(Grid(pairs, np.radians([0.0, 30.0, 60.0, 90.0])), np.array(START))
    print(found.tolist())
    rng = np.random.default_rng(1)
    x = 10.0 ** rng.uniform(-2.5, 1.3, 400)
    for name, least in (("alike along both axes", 0.99), ("variances 1 to 10", 0.1), ("any", 0.0)):
        y = x * rng.uniform(least, 1.0, len(x)) ** (1.0 if least else 3.0)
        grid = Grid(list(zip(x.tolist(), y.tolist(), strict=True)), np.radians([0.0, 20.0, 45.0, 70.0, 90.0]))
        error = np.abs(grid.mixture(found) / grid.exact - 1.0).max(axis=(0, 2))
        print(name, {f"{out:g} widths": round(float(error[out >= OUT].max()), 4) for out in (0.0, 0.9, 1.5, 2.0, 5.0)})


if __name__ == "__main__":
    main()
