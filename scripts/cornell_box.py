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

from pathlib import Path

import numpy as np

WAVELENGTHS = np.arange(400.0, 701.0, 4.0)
"""Wavelengths of the reflectances in data/cornell_box.txt, nm."""

EMISSION = ((400.0, 500.0, 600.0, 700.0), (0.0, 8.0, 15.6, 18.4))
"""Wavelengths in nm, and spectral radiance there."""

# Lobes of Wyman, Sloan and Shirley 2013, listing 1: weight, mean, and the inverse widths below and above.
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
                weight * np.exp(-0.5 * ((wavelength - mean) * np.where(wavelength < mean, lower, upper)) ** 2)
                for weight, mean, lower, upper in lobes
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
    text = (Path(__file__).resolve().parent / "data" / "cornell_box.txt").read_text(encoding="utf-8")
    for section in text.split("\n[")[1:]:
        name, _, values = section.partition("]\n")
        reflectance = np.interp(wavelength, WAVELENGTHS, np.array(values.split(), dtype=np.float64))
        result[name] = rec709(wavelength, reflectance * light) / result["light"]
    return result


if __name__ == "__main__":
    for name, value in colors().items():
        print(f"{name:6}", np.round(value, 4).tolist())
