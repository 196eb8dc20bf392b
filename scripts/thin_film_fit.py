"""Fit the colours of interference that kernels/bsdf/lobes/thin_film.py evaluates, and print the coefficients.

Two waves whose paths differ by D interfere with the phase 2π D ν at the wavenumber ν. What a channel sees of it is the
Fourier transform S(D) = ∫ w(ν) exp(2πi D ν) dν of its weight w: the colour matching function of linear Rec. 709 times
the spectrum of its white, D65, with S(0) = 1. Belcour and Barla ("A practical extension to microfacet theory for the
modeling of varying iridescence", 2017, section 4) fit Gaussians to the functions of CIE XYZ, because the transform of
a Gaussian is one. Here the same is done with the weights of the three channels, which share their Gaussians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from wrt.io.measured.observer import D65, OBSERVER, WAVELENGTHS

Array = NDArray[np.float64]

GAUSSIANS = 5
FARTHEST = 10.0
"""Path differences up to here are fitted, µm; beyond, all channels see the mean."""
XYZ_TO_RGB = np.linalg.inv(
    [[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]]
)
STARTS = 8
DIGITS = 4


def weights() -> Array:
    """Return (wavelengths, 3) what the channels see of each wavelength, with the sum 1."""
    seen = (OBSERVER @ XYZ_TO_RGB.T) * D65[:, None]
    return np.asarray(seen / seen.sum(axis=0))


def transform(differences: Array) -> NDArray[np.complex128]:
    """Return (N, 3) S of path differences in µm."""
    turns = np.exp(2j * np.pi * differences[:, None] / (WAVELENGTHS / 1000.0))
    return np.asarray(turns @ weights())


def gaussians(differences: Array, centers: Array, widths: Array) -> NDArray[np.complex128]:
    """Return (N, Gaussians) the transforms of normal densities of wavenumber, in 1/µm."""
    d = differences[:, None]
    return np.asarray(np.exp(2j * np.pi * d * centers - 2.0 * (np.pi * d * widths) ** 2))


def amplitudes(differences: Array, goal: NDArray[np.complex128], centers: Array, widths: Array) -> tuple[Array, Array]:
    """Return (Gaussians, 3) the amplitudes that fit S best, with the sum 1, and what is left."""
    basis = gaussians(differences, centers, widths)
    # The last amplitude follows from the sum.
    last = basis[:, -1:]
    rows, left = basis[:, :-1] - last, goal - last
    found = np.linalg.lstsq(np.concatenate([rows.real, rows.imag]), np.concatenate([left.real, left.imag]), rcond=None)[
        0
    ]
    found = np.concatenate([found, 1.0 - found.sum(axis=0, keepdims=True)])
    rest = basis @ found - goal
    return found, np.concatenate([rest.real, rest.imag])


def main() -> None:
    """Fit from several starts, and print the best."""
    differences = np.linspace(0.0, FARTHEST, 800)
    goal = transform(differences)

    def residuals(parameters: Array) -> Array:
        centers, widths = parameters[:GAUSSIANS], np.exp(parameters[GAUSSIANS:])
        return amplitudes(differences, goal, centers, widths)[1].ravel()

    fits = []
    for seed in range(STARTS):
        centers = np.sort(1.0 / np.random.default_rng(seed).uniform(0.42, 0.66, GAUSSIANS))
        start = np.concatenate([centers, np.full(GAUSSIANS, np.log(0.08))])
        fits.append(least_squares(residuals, start, max_nfev=300))
    best = min(fits, key=lambda fit: float(fit.cost)).x
    order = np.argsort(best[:GAUSSIANS])
    centers, widths = best[:GAUSSIANS][order].round(DIGITS), np.exp(best[GAUSSIANS:])[order].round(DIGITS)
    found, rest = amplitudes(differences, goal, centers, widths)
    print("largest error per channel:", np.abs(rest[: len(differences)] + 1j * rest[len(differences) :]).max(axis=0))
    for center, width, row in zip(centers, widths, found, strict=True):
        print(f"wavenumber {center} width {width} amplitudes {', '.join(f'{value:.5f}' for value in row)}")


if __name__ == "__main__":
    main()
