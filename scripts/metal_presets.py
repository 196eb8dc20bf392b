"""Compute METAL_IOR of wrt/scene/materials/presets.py from measured spectra, and print it.

A renderer that works in RGB needs three pairs (η, k) for a metal whose n(λ) and k(λ) were measured. The colour of a
spectrum s(λ) is its mean under the response of each channel,

    s_c = ∫ s(λ) D65(λ) r_c(λ) dλ / ∫ D65(λ) r_c(λ) dλ,

with r_c the Rec. 709 combination of the CIE 1931 2° colour matching functions. The illuminant is D65 because that is
the white of Rec. 709: light of radiance (1, 1, 1) is D65, a perfect mirror is (1, 1, 1), and no chromatic adaptation is
needed.

- F0, the reflectance at normal incidence, is the colour of R(λ) = ((n − 1)² + k²) / ((n + 1)² + k²) (Born and Wolf
  1999, section 14.2), clipped to [0, MAX_F0]. Only gold's red needs it: gold lies outside the Rec. 709 gamut.
- η is the colour of n(λ), and k gives exactly F0 with that η. The response has negative lobes, and η takes
  them too: to first order in the variation of the spectra, F(θ) of mean indices is the mean of F(θ), at every angle θ
  and with weights of either sign. Tests hold it to 0.01.
- Where F0 was clipped from above, k is the colour of k(λ) instead, and η gives F0: a reflectance near 1 needs a small
  η, and with the original η no metal's k would reach it.

Spectra are interpolated linearly in wavelength and summed at 380, 385 ... 780 nm.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rgb = tuple[float, float, float]

DATA = Path(__file__).resolve().parent / "data"

MAX_F0 = 0.999
"""Limit of F0, since a channel that reflects everything would need η = 0."""

DIGITS = 4
"""Decimals of the printed table; the measurements have two or three."""

REC_709 = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
"""Chromaticities x, y of the primaries (ITU-R BT.709-6)."""


def lines(name: str) -> list[str]:
    """Return the lines of a file in data/ without comments and blank lines."""
    text = (DATA / name).read_text(encoding="utf-8")
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def channel_response() -> tuple[Array, Array]:
    """Return wavelengths in nm, (81,), and the weights of a spectrum there in each channel, (81, 3), of sum 1."""
    table = np.array([line.split() for line in lines("cie_1931.txt")], dtype=np.float64)
    wavelengths, matching, power = table[:, 0], table[:, 1:4], table[:, 4]
    primaries = np.column_stack([REC_709, 1.0 - REC_709.sum(axis=1)])
    # The rows of the inverse are correct up to a factor, which the division by the white cancels.
    response = matching @ np.linalg.inv(primaries) * power[:, None]
    return wavelengths, response / response.sum(axis=0)


def measured() -> dict[str, tuple[str, Array]]:
    """Return source and rows of wavelength in nm, n, k for each metal."""
    metals: dict[str, tuple[str, list[list[float]]]] = {}
    rows: list[list[float]] = []
    for line in lines("metals.txt"):
        if line.startswith("["):
            name, source = line[1:].split("] ", 1)
            rows = []
            metals[name] = source, rows
        else:
            rows.append([float(word) for word in line.split()])
    return {name: (source, np.array(rows)) for name, (source, rows) in metals.items()}


def reflectance(eta: Array, k: Array) -> Array:
    """Return the reflectance at normal incidence."""
    return ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)


def k_of(f0: float, eta: float) -> float:
    """Return the k that reflects `f0` at normal incidence with `eta`: `reflectance` solved for k."""
    return math.sqrt((f0 * (eta + 1.0) ** 2 - (eta - 1.0) ** 2) / (1.0 - f0))


def eta_of(f0: float, k: float) -> float:
    """Return the smaller η that reflects `f0` at normal incidence with `k`: `reflectance` solved for η."""
    middle = (1.0 + f0) / (1.0 - f0)
    return (1.0 + k**2) / (middle + math.sqrt(middle**2 - 1.0 - k**2))


def colors(table: Array) -> tuple[Array, Array, Array]:
    """Return the colours, (3,) each, of the reflectance at normal incidence, of n and of k."""
    wavelengths, response = channel_response()
    n, k = (np.interp(wavelengths, table[:, 0], table[:, i]) for i in (1, 2))
    return reflectance(n, k) @ response, n @ response, k @ response


def index(table: Array) -> tuple[Rgb, Rgb]:
    """Return the η and k of each channel for rows of wavelength, n, k."""
    pairs = []
    for f0, eta, k in zip(*(color.tolist() for color in colors(table)), strict=True):
        if f0 > MAX_F0:
            pairs.append((eta_of(MAX_F0, k), k))
        else:
            pairs.append((eta, k_of(max(f0, 0.0), eta)))
    (a, d), (b, e), (c, f) = [(round(eta, DIGITS), round(k, DIGITS)) for eta, k in pairs]
    return (a, b, c), (d, e, f)


def metal_ior() -> dict[str, tuple[Rgb, Rgb]]:
    """Return η and k of each metal in data/metals.txt: what METAL_IOR of wrt/scene/materials/presets.py holds."""
    return {name: index(table) for name, (_, table) in measured().items()}


def main() -> None:
    """Print the table as Python."""
    print("METAL_IOR: dict[str, tuple[Vec3, Vec3]] = {")
    for name, (eta, k) in metal_ior().items():
        print(f'    "{name}": ({eta}, {k}),')
    print("}")


if __name__ == "__main__":
    main()
