"""The CIE 1931 2 degree observer and the illuminant D65, from 380 to 780 nm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wrt.linalg import product

_TABLE = np.loadtxt(Path(__file__).parent / "cie_1931.csv", delimiter=",")

WAVELENGTHS = 380.0 + np.arange(401.0)
"""Every nanometre, because spectra may be given at any wavelength and end abruptly."""

_FINE = np.stack([np.interp(WAVELENGTHS, _TABLE[:, 0], column) for column in _TABLE[:, 1:].T], axis=1)

OBSERVER = _FINE[:, :3]
"""(N, 3) colour matching functions."""

D65 = _FINE[:, 3]
"""(N,) relative power of average daylight, the white of Rec. 709."""

# CIE XYZ (D65) to linear Rec. 709, the inverse of ITU-R BT.709's primaries (IEC 61966-2-1).
RGB_FROM_XYZ = np.array(
    [(3.240479, -1.537150, -0.498535), (-0.969256, 1.875991, 0.041556), (0.055648, -0.204043, 1.057311)]
)
RESPONSE = product(OBSERVER, RGB_FROM_XYZ.T)
"""(N, 3) what each wavelength adds to linear Rec. 709."""

REFLECTANCE_RESPONSE = D65[:, None] * RESPONSE / product(D65, RESPONSE)
"""(N, 3) linear Rec. 709 under D65 of a reflectance of 1 at each of WAVELENGTHS alone."""
