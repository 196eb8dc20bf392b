"""Named optical constants: reflectances and refractive indices of metals, dielectrics and semiconductors.

The tables hold published or measured values. The functions also accept chemical symbols ("Au") and the American
"aluminum". Colours are linear Rec. 709 RGB.

Samples of one metal differ in polish, oxide and grain. For some metals METAL_F0 and METAL_IOR come from different
samples, and their reflectances differ by up to 0.1 for titanium and iron, 0.06 for silver and gold, 0.04 for nickel,
and less for the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TypeVar

from wrt.errors import InputError, did_you_mean
from wrt.values import Vec3

METAL_F0: dict[str, Vec3] = {
    "titanium": (0.542, 0.497, 0.449),
    "chromium": (0.549, 0.556, 0.554),
    "iron": (0.562, 0.565, 0.578),
    "nickel": (0.660, 0.609, 0.526),
    "platinum": (0.673, 0.637, 0.585),
    "copper": (0.955, 0.638, 0.538),
    "palladium": (0.733, 0.697, 0.652),
    "zinc": (0.664, 0.824, 0.850),
    "gold": (1.022, 0.782, 0.344),
    "aluminium": (0.913, 0.922, 0.924),
    "silver": (0.972, 0.960, 0.915),
}
"""Reflectance of metals at normal incidence (Hoffman 2014, Physics and Math of Shading, SIGGRAPH course Physically
Based Shading in Theory and Practice), as printed: from dark to bright. Gold is so saturated that it lies outside
Rec. 709, with red above 1."""

DIELECTRIC_F0: dict[str, tuple[float, float]] = {
    "water": (0.020, 0.020),
    "plastic": (0.040, 0.045),
    "glass": (0.040, 0.045),
    "crystalware": (0.050, 0.080),
    "gems": (0.050, 0.080),
    "diamond-like": (0.100, 0.200),
}
"""Lowest and highest reflectance of dielectrics at normal incidence (Hoffman 2014). They are achromatic. Almost every
material but metals, crystals and gems reflects 0.04."""

SEMICONDUCTOR_F0: dict[str, Vec3] = {
    "silicon": (0.345, 0.369, 0.426),
}
"""Reflectance of crystalline semiconductors at normal incidence (Hoffman 2014)."""

DIELECTRIC_IOR: dict[str, tuple[float, float]] = {
    "air": (1.00, 1.00),
    "water": (1.33, 1.34),
    "window glass": (1.51, 1.51),
    "optical glass": (1.49, 1.92),
    "diamond": (2.42, 2.42),
}
"""Lowest and highest refractive index of dielectrics (Cornell University, CS 4620, Light Reflection and Advanced
Shading), as printed: that of water varies with wavelength, that of optical glass with its type."""

DIELECTRIC_ABBE: dict[str, float] = {
    "rutile": 9.8,
    "polycarbonate": 32.0,
    "diamond": 55.0,
    "water": 55.0,
    "crown glass": 59.0,
}
"""Abbe number of dielectrics (Khronos Group 2024, KHR_materials_dispersion), as printed. Dispersion is 20 over it."""

# Computed by scripts/metal_presets.py from the spectra in scripts/data/metals.txt.
METAL_IOR: dict[str, tuple[Vec3, Vec3]] = {
    "silver": ((0.0555, 0.0547, 0.0429), (4.4446, 3.5374, 2.5799)),
    "gold": ((0.0035, 0.5003, 1.459), (3.6131, 2.2617, 1.7715)),
    "copper": ((0.1734, 1.0436, 1.2899), (2.9639, 2.6242, 2.3576)),
    "aluminium": ((1.481, 0.9821, 0.598), (7.601, 6.5389, 5.3148)),
    "iron": ((2.9242, 2.9171, 2.5453), (3.0774, 2.9372, 2.7498)),
    "chromium": ((3.251, 3.1072, 2.2791), (3.2867, 3.3354, 3.1143)),
    "nickel": ((2.0223, 1.9011, 1.7243), (4.1919, 3.5686, 2.8932)),
    "cobalt": ((2.2502, 2.0327, 1.7093), (4.2228, 3.7927, 3.235)),
    "palladium": ((1.7878, 1.6197, 1.3921), (4.3563, 3.8096, 3.2088)),
    "platinum": ((2.3444, 2.0658, 1.8222), (4.2453, 3.6777, 3.0888)),
    "titanium": ((2.737, 2.5072, 2.2363), (3.8394, 3.3972, 3.0134)),
    "vanadium": ((3.476, 3.9586, 3.6165), (2.984, 3.0764, 3.475)),
    "tungsten": ((3.6345, 3.4936, 3.3123), (2.9243, 2.7477, 2.506)),
    "mercury": ((2.0281, 1.5153, 1.0162), (5.2864, 4.6001, 3.779)),
    "brass": ((0.4184, 0.5198, 1.123), (4.064, 2.6587, 1.8097)),
    "stainless steel": ((2.3974, 2.0183, 1.6467), (4.1788, 3.6396, 3.0655)),
}
"""Complex refractive index η + ik of metals: η per channel, then k per channel.

They reflect at normal incidence as the measured spectrum does under D65. Silver, gold and copper: Johnson and Christy
1972; titanium, vanadium, chromium, iron, cobalt, nickel and palladium: Johnson and Christy 1974; aluminium: Rakić 1995;
platinum: Rakić et al. 1998; tungsten: Weaver et al. 1975; mercury: Inagaki et al. 1981; brass (30 % zinc): Querry 1985;
stainless steel (austenitic): Karlsson and Ribbing 1982. Zinc is missing: no published index of
it was found that agrees with its measured visible reflectance."""

ALIASES: dict[str, str] = {
    "ag": "silver",
    "al": "aluminium",
    "aluminum": "aluminium",
    "au": "gold",
    "co": "cobalt",
    "cr": "chromium",
    "cu": "copper",
    "fe": "iron",
    "glass": "window glass",
    "hg": "mercury",
    "ni": "nickel",
    "pd": "palladium",
    "pt": "platinum",
    "si": "silicon",
    "ti": "titanium",
    "v": "vanadium",
    "w": "tungsten",
    "zn": "zinc",
}
"""Alternative names, in lower case."""


def metal_ior(name: str) -> tuple[Vec3, Vec3]:
    """Return η and k of a metal per channel of linear Rec. 709, relative to vacuum (and air, to three digits).

    Here and below, InputError is raised for an unknown name; upper and lower case are the same.
    """
    return METAL_IOR[_key(name, METAL_IOR, "metal with a refractive index")]


def reflectance_f0(name: str) -> Vec3:
    """Return the reflectance of a metal, semiconductor or dielectric at normal incidence, linear Rec. 709.

    Gold's red is clipped to 1, as a surface cannot reflect more than it receives. Dielectrics have the middle of their
    range.
    """
    colors = METAL_F0 | SEMICONDUCTOR_F0
    # "glass" is a name of DIELECTRIC_F0, and elsewhere an alias.
    key = name.strip().lower() if isinstance(name, str) and name.strip().lower() in DIELECTRIC_F0 else None
    key = key or _key(name, [*colors, *DIELECTRIC_F0], "metal, semiconductor or dielectric with a reflectance")
    red, green, blue = colors[key] if key in colors else (sum(DIELECTRIC_F0[key]) / 2.0,) * 3
    return min(red, 1.0), min(green, 1.0), min(blue, 1.0)


def has_reflectance_only(name: str) -> bool:
    """Return whether METAL_IOR lacks a metal, or semiconductor, whose reflectance is known."""
    word = str(name).strip().lower()
    return ALIASES.get(word, word) in (METAL_F0 | SEMICONDUCTOR_F0).keys() - METAL_IOR.keys()


def metal_f0(name: str) -> Vec3:
    """Return the reflectance of a metal or semiconductor at normal incidence, as `reflectance_f0`."""
    return reflectance_f0(_key(name, METAL_F0 | SEMICONDUCTOR_F0, "metal with a reflectance"))


def dielectric_ior(name: str) -> float:
    """Return the refractive index of a dielectric.

    It is the middle of the range in DIELECTRIC_IOR; where there is none, the index n with the reflectance
    ((n − 1) / (n + 1))² in the middle of the range in DIELECTRIC_F0.
    """
    key = _key(name, DIELECTRIC_F0 | DIELECTRIC_IOR, "dielectric")
    if key in DIELECTRIC_IOR:
        return sum(DIELECTRIC_IOR[key]) / 2.0
    amplitude = math.sqrt(sum(DIELECTRIC_F0[key]) / 2.0)
    return (1.0 + amplitude) / (1.0 - amplitude)


def dielectric_abbe_number(name: str) -> float:
    """Return the Abbe number of a dielectric in DIELECTRIC_ABBE."""
    return DIELECTRIC_ABBE[_key(name, DIELECTRIC_ABBE, "dielectric with an Abbe number")]


T = TypeVar("T")


def by_name(look_up: Callable[[str], T], name: str, field: str) -> T:
    """Return a preset for a field of a material, or raise InputError naming the field."""
    try:
        return look_up(name)
    except InputError as error:
        raise InputError(f"{field}: {error}") from None


def _key(name: object, keys: Iterable[str], what: str) -> str:
    """Return the key for a name or alias, or raise InputError."""
    names = sorted(keys)
    word = name.strip().lower() if isinstance(name, str) else ""
    key = ALIASES.get(word, word)
    if key in names:
        return key
    raise InputError(f"{name!r} is not a known {what}{did_you_mean(key, names)}; known are: {', '.join(names)}")
