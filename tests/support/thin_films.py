"""Reflectances of thin films by brute force: transfer matrices at each wavelength, and the CIE observer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrt.io.measured.observer import D65, OBSERVER, WAVELENGTHS

XYZ_TO_RGB = np.linalg.inv(
    [[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]]
)
_SEEN = (OBSERVER @ XYZ_TO_RGB.T) * D65[:, None]
SEEN = _SEEN / _SEEN.sum(axis=0)
"""(N, 3) weight of each wavelength in a channel of linear Rec. 709 under D65."""


def spectrum(cos_i: float, index: float, thickness: float, below: complex) -> NDArray[np.float64]:
    """Return (N,) the reflectance at each wavelength, unpolarised; thickness in nm, indices over that outside.

    A layer turns the tangential fields by its characteristic matrix (Born and Wolf, section 1.6.2).
    """
    sine = np.sqrt(1.0 - cos_i**2)
    cos_film = np.sqrt(1.0 - (sine / index) ** 2 + 0j)
    cos_below = np.sqrt(1.0 - (sine / below) ** 2 + 0j)
    # Time as e^{+iωt}, with indices n − ik: waves decay into what absorbs.
    below, cos_below = np.conj(below), np.conj(cos_below)
    delta = 2.0 * np.pi * index * thickness * cos_film / WAVELENGTHS
    result = np.zeros(len(WAVELENGTHS))
    for admittance in (lambda n, c: n * c, lambda n, c: n / c):  # s, p
        outside, film, base = admittance(1.0, cos_i), admittance(index, cos_film), admittance(below, cos_below)
        electric = np.cos(delta) + 1j * np.sin(delta) / film * base
        magnetic = 1j * film * np.sin(delta) + np.cos(delta) * base
        r = (outside * electric - magnetic) / (outside * electric + magnetic)
        result += 0.5 * np.abs(r) ** 2
    return result


def film_rgb(cos_i: float, index: float, thickness: float, below: complex) -> NDArray[np.float64]:
    """Return (3,) what linear Rec. 709 sees of it, before it is clipped to what can be shown."""
    return np.asarray(spectrum(cos_i, index, thickness, below) @ SEEN)
