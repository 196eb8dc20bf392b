"""Dispersion: how much more transparent materials refract blue than red.

Dispersion is 20 / V, as in glTF, where V = (n_d − 1) / (n_F − n_C) is the Abbe number: the index at 587.6 nm over its
change from 656.3 nm to 486.1 nm. By the first terms of Cauchy's equation, n(λ) = A + B / λ², the index at any other
wavelength follows (Khronos Group 2024, "KHR_materials_dispersion"). Each channel has the index at the dominant
wavelength of its primary.
"""

from __future__ import annotations

from typing import Annotated

from wrt.scene.materials.body import Body
from wrt.scene.materials.presets import by_name, dielectric_abbe_number
from wrt.values import Vec3, number

PRIMARIES: Vec3 = (611.5, 549.1, 464.3)
"""Dominant wavelengths of the primaries of Rec. 709 as seen from its white, nm: where lines from there through the
primaries meet the spectral locus of the CIE 1931 observer."""

LINE_C, LINE_D, LINE_F = 656.3, 587.6, 486.1
"""Fraunhofer's lines, nm."""

MOST = 1000.0
"""The greatest dispersion, an Abbe number of 0.02; indices stay finite."""


def channel_spread(ior: float, dispersion: float) -> Vec3:
    """Return the index of each channel minus that at 587.6 nm, `ior`; none falls below 1, or below a lower `ior`."""
    over_all = (ior - 1.0) * dispersion / 20.0  # n_F − n_C
    least = min(ior, 1.0)

    def spread(wavelength: float) -> float:
        share = (wavelength**-2 - LINE_D**-2) / (LINE_F**-2 - LINE_C**-2)
        return max(ior + over_all * share, least) - ior

    red, green, blue = PRIMARIES
    return spread(red), spread(green), spread(blue)


def channel_indices(ior: float, dispersion: float) -> Vec3:
    """Return the refractive index of each channel; see `channel_spread`."""
    red, green, blue = channel_spread(ior, dispersion)
    return ior + red, ior + green, ior + blue


def checked_dispersion(value: float | str, name: str) -> float:
    """Return a dispersion, given as a number or the name of a medium."""
    if isinstance(value, str):
        return 20.0 / by_name(dielectric_abbe_number, value, name)
    return number(value, name, minimum=0.0, maximum=MOST)


Dispersion = Annotated[float | str, checked_dispersion]


class Dispersive(Body):
    """Base of the bodies that may refract each channel by an index of its own; not used by itself."""

    ior: float | str
    dispersion: float | str

    @property
    def interior_ior(self) -> float:
        return float(self.ior)

    @property
    def interior_spread(self) -> Vec3:
        return channel_spread(float(self.ior), float(self.dispersion))


SHARES: Vec3 = (1.0 / 3.0,) * 3
"""Probabilities of the channels where no path says otherwise."""
