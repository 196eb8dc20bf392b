"""The clear daytime sky model of Preetham: the radiance of the sky and of the sun.

Preetham, Shirley and Smits, "A Practical Analytic Model for Daylight" (SIGGRAPH 1999): the sky's luminance and
chromaticity follow Perez's five-parameter function with coefficients linear in the turbidity (their appendix A.2);
sunlight is the solar spectrum attenuated by the atmosphere (appendix A.1).

Luminance in cd/m² is converted to W·sr⁻¹·m⁻² by 683 lm/W for both sky and sun, so that the two are consistent: the
luminance of a colour is 683 times its Y.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.linalg import dot, product

Array = NDArray[np.float64]

LUMINOUS_EFFICACY = 683.0
"""Lumens per watt at 555 nm, by the definition of the candela."""

# Perez's A to E for Y, x and y: slope over turbidity, and value at turbidity 0 (Preetham 1999, appendix A.2).
_PEREZ = np.array(
    [
        [(0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)],
        [(-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)],
        [(-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)],
    ]
)

# Chromaticity of the zenith: rows T², T, 1; columns θ³, θ², θ, 1 of the sun's angle from the zenith (ibid.).
_ZENITH_X = np.array(
    [
        (0.00166, -0.00375, 0.00209, 0.0),
        (-0.02903, 0.06377, -0.03202, 0.00394),
        (0.11693, -0.21196, 0.06052, 0.25886),
    ]
)
_ZENITH_Y = np.array(
    [
        (0.00275, -0.00610, 0.00317, 0.0),
        (-0.04214, 0.08970, -0.04153, 0.00516),
        (0.15346, -0.26756, 0.06670, 0.26688),
    ]
)

# The sun's spectral radiance outside the atmosphere, every 10 nm from 380 nm (ibid., table 2), W·cm⁻²·µm⁻¹·sr⁻¹.
_SUN = np.array(
    [1655.9, 1623.37, 2112.75, 2588.82, 2582.91, 2423.23, 2676.05, 2965.83, 3054.54, 3005.75]
    + [3066.37, 2883.04, 2871.21, 2782.5, 2710.06, 2723.36, 2636.13, 2550.38, 2506.02, 2531.16]
    + [2535.59, 2513.42, 2463.15, 2417.32, 2368.53, 2321.21, 2282.77, 2233.98, 2197.02, 2152.67]
    + [2109.79, 2072.83, 2024.04, 1987.08, 1942.72, 1907.24, 1862.89, 1825.92]
)
_WAVELENGTHS = 380.0 + 10.0 * np.arange(len(_SUN))

# Absorption (ibid.): ozone from 440 nm, cm⁻¹; water vapour at the few wavelengths where it absorbs.
_OZONE = np.array(
    [0.0, 0.003, 0.006, 0.009, 0.014, 0.021, 0.03, 0.04, 0.048, 0.063, 0.075, 0.085, 0.103, 0.12, 0.12, 0.115]
    + [0.125, 0.12, 0.105, 0.09, 0.079, 0.067, 0.057, 0.048, 0.036, 0.028, 0.023, 0.018, 0.014, 0.011, 0.01, 0.009]
)
_WATER = {690.0: 0.016, 700.0: 0.024, 710.0: 0.0125, 720.0: 1.0, 730.0: 0.87, 740.0: 0.061, 750.0: 0.001}

# CIE XYZ (D65) to linear Rec. 709, the inverse of ITU-R BT.709's primaries (IEC 61966-2-1).
_RGB_FROM_XYZ = np.array(
    [(3.2404542, -1.5371385, -0.4985314), (-0.9692660, 1.8760108, 0.0415560), (0.0556434, -0.2040259, 1.0572252)]
)


def zenith_luminance(sun_zenith: float, turbidity: float) -> float:
    """Return the luminance of the zenith, kcd/m² (Preetham 1999, appendix A.2)."""
    chi = (4.0 / 9.0 - turbidity / 120.0) * (math.pi - 2.0 * sun_zenith)
    return (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192


def sky_xyz(cos_zenith: ArrayLike, cos_sun: ArrayLike, sun_zenith: float, turbidity: float) -> Array:
    """Return the sky's radiance as CIE XYZ, (N, 3), W·sr⁻¹·m⁻².

    Args:
        cos_zenith: (N,) cosine of the angle to the zenith, above 0.
        cos_sun: (N,) cosine of the angle to the sun.
        sun_zenith: the sun's angle from the zenith, radians.
        turbidity: at least 2.
    """
    cosine, gamma = np.asarray(cos_zenith, np.float64), np.arccos(np.clip(np.asarray(cos_sun, np.float64), -1.0, 1.0))

    def perez(cosine: ArrayLike, gamma: ArrayLike, row: Array) -> Array:
        a, b, c, d, e = row
        result: Array = (1.0 + a * np.exp(b / cosine)) * (1.0 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2)
        return result

    t = np.array([turbidity**2, turbidity, 1.0])
    theta = np.array([sun_zenith**3, sun_zenith**2, sun_zenith, 1.0])
    zenith = (
        zenith_luminance(sun_zenith, turbidity),
        dot(product(t, _ZENITH_X), theta),
        dot(product(t, _ZENITH_Y), theta),
    )
    rows = product(_PEREZ, np.array([turbidity, 1.0]))
    luminance, x, y = (
        value * perez(cosine, gamma, row) / perez(1.0, sun_zenith, row) for value, row in zip(zenith, rows, strict=True)
    )
    big_y = 1000.0 / LUMINOUS_EFFICACY * np.maximum(luminance, 0.0)
    return np.stack([x / y * big_y, big_y, (1.0 - x - y) / y * big_y], axis=-1)


def sun_spectrum(sun_zenith: float, turbidity: float) -> tuple[Array, Array]:
    """Return wavelengths, nm, and the sun's mean spectral radiance seen from the ground, W·sr⁻¹·m⁻²·nm⁻¹.

    Preetham 1999, appendix A.1: the air mass is by Kasten's formula. Rayleigh scattering, aerosols (Ångström, with
    α = 1.3), ozone (0.35 cm) and water vapour (2 cm) attenuate. Mixed gases absorb only beyond 750 nm.
    """
    micrometres = _WAVELENGTHS / 1000.0
    mass = 1.0 / (math.cos(sun_zenith) + 0.15 * (93.885 - math.degrees(sun_zenith)) ** -1.253)
    beta = 0.04608365822050 * turbidity - 0.04586025928522
    ozone = np.zeros_like(_SUN)
    ozone[6:] = _OZONE
    water = np.array([_WATER.get(wavelength, 0.0) for wavelength in _WAVELENGTHS]) * 2.0 * mass
    through = np.exp(-0.008735 * micrometres**-4.08 * mass)
    through *= np.exp(-beta * micrometres**-1.3 * mass)
    through *= np.exp(-ozone * 0.35 * mass)
    through *= np.exp(-0.2385 * water / (1.0 + 20.07 * water) ** 0.45)
    radiance: Array = 10.0 * _SUN * through  # W·cm⁻²·µm⁻¹ is 10 W·m⁻²·nm⁻¹
    return np.asarray(_WAVELENGTHS, np.float64), radiance


def color_matching(wavelengths: ArrayLike) -> Array:
    """Return the CIE 1931 colour matching functions, (N, 3), at wavelengths in nm.

    The fit of Wyman, Sloan and Shirley, "Simple Analytic Approximations to the CIE XYZ Color Matching Functions"
    (JCGT 2013), equation 4, which is within the variation among measured observers.
    """
    w = np.asarray(wavelengths, np.float64)

    def lobe(mean: float, below: float, above: float) -> Array:
        result: Array = np.exp(-0.5 * ((w - mean) * np.where(w < mean, below, above)) ** 2)
        return result

    x = 0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323) - 0.065 * lobe(501.1, 0.0490, 0.0382)
    y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322)
    z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725)
    return np.stack([x, y, z], axis=-1)


def spectrum_xyz(wavelengths: ArrayLike, radiance: ArrayLike) -> Array:
    """Return spectral radiance as CIE XYZ, (3,), W·sr⁻¹·m⁻², interpolated linearly between wavelengths in nm."""
    at = np.asarray(wavelengths, np.float64)
    fine = np.arange(at[0], at[-1] + 1.0)
    return np.asarray(product(np.interp(fine, at, np.asarray(radiance, np.float64)), color_matching(fine)))


def sun_xyz(sun_zenith: float, turbidity: float) -> Array:
    """Return the mean radiance of the sun's disk seen from the ground as CIE XYZ, (3,), W·sr⁻¹·m⁻²."""
    return spectrum_xyz(*sun_spectrum(sun_zenith, turbidity))


def rgb_from_xyz(xyz: ArrayLike) -> Array:
    """Return linear Rec. 709 RGB, clipped at 0 outside the gamut."""
    result: Array = np.maximum(product(np.asarray(xyz, np.float64), _RGB_FROM_XYZ.T), 0.0)
    return result
