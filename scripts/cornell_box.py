"""The colours of meshes/cornell-box.toml, from the measured spectra: `python scripts/cornell_box.py`.

Measurements: Cornell University Program of Computer Graphics, "Cornell Box Data" (reflectances of the
three paints every 4 nm, the light's emission at four wavelengths, both linear in between). Colour
matching functions: the multi-lobe fit to CIE 1931 of C. Wyman, P.-P. Sloan and P. Shirley, "Simple
Analytic Approximations to the CIE XYZ Color Matching Functions", JCGT 2(2), 2013.

The emission is the light's linear Rec. 709 colour, scaled per channel so that a constant spectrum of 1 is (1, 1, 1). A
reflectance is, per channel, the colour of the paint under that light divided by the colour of the light, so that
the first bounce of a three-channel renderer has the colour of the spectral one.
"""

from __future__ import annotations

import numpy as np

WAVELENGTHS = np.arange(400.0, 701.0, 4.0)
"""Wavelengths of the reflectances below, nm."""

REFLECTANCES = {
    "white": """
0.343 0.445 0.551 0.624 0.665 0.687 0.708 0.723 0.715 0.710 0.745 0.758 0.739 0.767 0.777 0.765 0.751 0.745 0.748
0.729 0.745 0.757 0.753 0.750 0.746 0.747 0.735 0.732 0.739 0.734 0.725 0.721 0.733 0.725 0.732 0.743 0.744 0.748
0.728 0.716 0.733 0.726 0.713 0.740 0.754 0.764 0.752 0.736 0.734 0.741 0.740 0.732 0.745 0.755 0.751 0.744 0.731
0.733 0.744 0.731 0.712 0.708 0.729 0.730 0.727 0.707 0.703 0.729 0.750 0.760 0.751 0.739 0.724 0.730 0.740 0.737
""",
    "green": """
0.092 0.096 0.098 0.097 0.098 0.095 0.095 0.097 0.095 0.094 0.097 0.098 0.096 0.101 0.103 0.104 0.107 0.109 0.112
0.115 0.125 0.140 0.160 0.187 0.229 0.285 0.343 0.390 0.435 0.464 0.472 0.476 0.481 0.462 0.447 0.441 0.426 0.406
0.373 0.347 0.337 0.314 0.285 0.277 0.266 0.250 0.230 0.207 0.186 0.171 0.160 0.148 0.141 0.136 0.130 0.126 0.123
0.121 0.122 0.119 0.114 0.115 0.117 0.117 0.118 0.120 0.122 0.128 0.132 0.139 0.144 0.146 0.150 0.152 0.157 0.159
""",
    "red": """
0.040 0.046 0.048 0.053 0.049 0.050 0.053 0.055 0.057 0.056 0.059 0.057 0.061 0.061 0.060 0.062 0.062 0.062 0.061
0.062 0.060 0.059 0.057 0.058 0.058 0.058 0.056 0.055 0.056 0.059 0.057 0.055 0.059 0.059 0.058 0.059 0.061 0.061
0.063 0.063 0.067 0.068 0.072 0.080 0.090 0.099 0.124 0.154 0.192 0.255 0.287 0.349 0.402 0.443 0.487 0.513 0.558
0.584 0.620 0.606 0.609 0.651 0.612 0.610 0.650 0.638 0.627 0.620 0.630 0.628 0.642 0.639 0.657 0.639 0.635 0.642
""",
}

EMISSION = ((400.0, 500.0, 600.0, 700.0), (0.0, 8.0, 15.6, 18.4))
"""Wavelengths in nm, and spectral radiance there."""

# Lobes of Wyman, Sloan and Shirley 2013, listing 1: weight, mean, and the inverse widths to its left and right.
LOBES = (
    ((1.056, 599.8, 0.0264, 0.0323), (0.362, 442.0, 0.0624, 0.0374), (-0.065, 501.1, 0.0490, 0.0382)),
    ((0.821, 568.8, 0.0213, 0.0247), (0.286, 530.9, 0.0613, 0.0322)),
    ((1.217, 437.0, 0.0845, 0.0278), (0.681, 459.0, 0.0385, 0.0725)),
)

# XYZ to linear Rec. 709 (ITU-R BT.709 primaries and D65 white).
REC709 = np.array([[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]])


def matching_functions(wavelength: np.ndarray) -> np.ndarray:
    """Return the (3, N) CIE 1931 colour matching functions at N wavelengths, nm."""
    return np.stack(
        [
            sum(
                weight * np.exp(-0.5 * ((wavelength - mean) * np.where(wavelength < mean, left, right)) ** 2)
                for weight, mean, left, right in lobes
            )
            for lobes in LOBES
        ]
    )


def rec709(wavelength: np.ndarray, spectrum: np.ndarray) -> np.ndarray:
    """Return the (3,) linear Rec. 709 colour of a spectrum; equal energy is (1, 1, 1).

    Args:
        wavelength: (N,) evenly spaced and covering the visible range, nm.
        spectrum: (N,) values there.
    """
    to_rgb = REC709 @ matching_functions(wavelength)
    color: np.ndarray = (to_rgb @ spectrum) / to_rgb.sum(axis=1)
    return color


def colors() -> dict[str, np.ndarray]:
    """Return linear Rec. 709: "light" (radiance), and "white", "green" and "red" (reflectance)."""
    wavelength = np.arange(360.0, 831.0, 1.0)
    light = np.interp(wavelength, *EMISSION, left=0.0, right=0.0)
    result = {"light": rec709(wavelength, light)}
    for name, text in REFLECTANCES.items():
        reflectance = np.interp(wavelength, WAVELENGTHS, np.array(text.split(), dtype=np.float64))
        result[name] = rec709(wavelength, reflectance * light) / result["light"]
    return result


if __name__ == "__main__":
    for name, value in colors().items():
        print(f"{name:6}", np.round(value, 4).tolist())
