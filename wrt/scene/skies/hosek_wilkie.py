"""The clear daytime sky model of Hošek and Wilkie: fits to simulated atmospheres.

- Sky: Hošek and Wilkie, "An Analytic Model for Full Spectral Sky-Dome Radiance" (SIGGRAPH 2012). A function of nine
  parameters (equations 8 and 9), tabulated for two ground albedos, ten turbidities and six elevations of the sun.
- Sun: Hošek and Wilkie, "Adding a Solar-Radiance Function to the Hošek-Wilkie Skylight Model" (IEEE CG&A 2013).
  Polynomials in the elevation, at eleven wavelengths, and in the cosine at the sun's surface.

The published tables are in `wrt/scene/skies/data/hosek_wilkie.npz`, in single precision, with their licence beside it:
those of the sky's radiance for linear Rec. 709, those of the sun's by wavelength.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.linalg import product

Array = NDArray[np.float64]

LUMINOUS_EFFICACY = 683.0
"""Lumens per watt at 555 nm, by the definition of the candela: the luminance of a colour is 683 times its Y."""

WAVELENGTHS = 320.0 + 40.0 * np.arange(11)
"""Wavelengths at which the sun's radiance is tabulated, nm."""

_BINOMIAL = np.array([1.0, 5.0, 10.0, 10.0, 5.0, 1.0])

_SEGMENTS = 45

_SUN_RADIUS = math.radians(0.5 * 0.5358)

# CIE XYZ (D65) to linear Rec. 709, the inverse of ITU-R BT.709's primaries (IEC 61966-2-1).
_RGB_FROM_XYZ = np.array(
    [(3.2404542, -1.5371385, -0.4985314), (-0.9692660, 1.8760108, 0.0415560), (0.0556434, -0.2040259, 1.0572252)]
)


@functools.cache
def _tables() -> dict[str, Array]:
    with np.load(Path(__file__).parent / "data" / "hosek_wilkie.npz") as file:
        return {name: file[name].astype(np.float64) for name in file.files}


def _at_turbidity(table: Array, turbidity: float) -> Array:
    """Return a table interpolated between two of its ten turbidities, 1 to 10."""
    low = min(max(int(turbidity) - 1, 0), 8)
    share = turbidity - 1.0 - low
    result: Array = (1.0 - share) * table[low] + share * table[low + 1]
    return result


def _parameters(table: Array, elevation: float, turbidity: float, albedo: Array) -> Array:
    """Interpolate a table of (turbidity, albedo, elevation, channel, ...), with an albedo per channel.

    The elevations are control points of a Bézier curve in the cube root of the angle (Hošek and Wilkie 2012, section
    4.4).
    """
    x = (elevation / (0.5 * math.pi)) ** (1.0 / 3.0)
    powers = np.arange(6.0)
    weights = _BINOMIAL * x**powers * (1.0 - x) ** (5.0 - powers)
    curve = np.einsum("ij...,j->i...", _at_turbidity(table, turbidity), weights)
    share = albedo.reshape(3, *(1,) * (curve.ndim - 2))
    result: Array = (1.0 - share) * curve[0] + share * curve[1]
    return result


def sky_rgb(
    cos_zenith: ArrayLike, cos_sun: ArrayLike, elevation: float, turbidity: float, albedo: tuple[float, float, float]
) -> Array:
    """Return the sky's radiance as non-negative linear Rec. 709, W·sr⁻¹·m⁻².

    Args:
        cos_zenith: (...) cosine of the angle to the zenith, at least 0.
        cos_sun: (...) cosine of the angle to the sun.
        elevation: elevation of the sun, radians, 0 to π/2.
        turbidity: 1 to 10.
        albedo: albedo of the ground per channel, 0 to 1.

    Returns:
        (..., 3).
    """
    height = np.asarray(cos_zenith, np.float64)[..., None]
    cosine = np.clip(np.asarray(cos_sun, np.float64), -1.0, 1.0)[..., None]
    tables, reflected = _tables(), np.asarray(albedo, np.float64)
    radiance = _parameters(tables["sky_radiance"], elevation, turbidity, reflected)
    a, b, c, d, e, f, g, i, h = _parameters(tables["sky_shape"], elevation, turbidity, reflected).T
    # Mie scattering's forward peak (ibid., equation 9).
    peak = (1.0 + cosine**2) / (1.0 + h**2 - 2.0 * h * cosine) ** 1.5
    result = 1.0 + a * np.exp(b / (height + 0.01))
    result *= c + d * np.exp(e * np.arccos(cosine)) + f * cosine**2 + g * peak + i * np.sqrt(np.maximum(height, 0.0))
    return np.asarray(np.maximum(result * radiance, 0.0))


def sun_spectrum(elevation: float, turbidity: float) -> Array:
    """Return the sun's mean spectral radiance at WAVELENGTHS, seen from the ground, W·sr⁻¹·m⁻²·nm⁻¹.

    It is the mean over the disk, which is slightly brighter at its upper edge and much darker at its limb.

    Args:
        elevation: elevation of the sun's centre, radians, 0 to π/2.
        turbidity: 1 to 10.
    """
    tables = _tables()
    polynomials = _at_turbidity(tables["sun_radiance"], turbidity)
    # The mean over the disk of the j-th power of the cosine at the sun's surface is 2 / (j + 2).
    limb = product(tables["sun_limb"], 2.0 / (np.arange(6.0) + 2.0))
    # The mean over the elevations in the disk, by Gauss-Chebyshev quadrature of the second kind.
    angles = math.pi * np.arange(1, 6) / 6.0
    heights = np.clip(elevation + _SUN_RADIUS * np.cos(angles), 0.0, 0.5 * math.pi)
    segment = np.minimum((np.cbrt(2.0 * heights / math.pi) * _SEGMENTS).astype(np.int64), _SEGMENTS - 1)
    beyond = heights - 0.5 * math.pi * (segment / _SEGMENTS) ** 3
    radiance = np.einsum("kwp,kp->kw", polynomials[segment], beyond[:, None] ** np.arange(4.0))
    result: Array = np.maximum(product(np.sin(angles) ** 2, radiance) / 3.0, 0.0) * limb
    return result


def sun_rgb(elevation: float, turbidity: float) -> Array:
    """Return the mean radiance of the sun's disk seen from the ground as linear Rec. 709, (3,), W·sr⁻¹·m⁻²."""
    return rgb_from_xyz(spectrum_xyz(WAVELENGTHS, sun_spectrum(elevation, turbidity)))


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


def rgb_from_xyz(xyz: ArrayLike) -> Array:
    """Return linear Rec. 709 RGB, clipped at 0 outside the gamut."""
    result: Array = np.maximum(product(np.asarray(xyz, np.float64), _RGB_FROM_XYZ.T), 0.0)
    return result
