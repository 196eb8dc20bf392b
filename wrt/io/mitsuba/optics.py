"""Refractive indices of dielectrics and conductors, by Mitsuba's names.

They are Mitsuba's own values, so that its scenes look the same. `wrt.scene.materials.presets` has other spectra of
metals, weighted to give the right reflectance.
"""

from __future__ import annotations

from wrt.errors import InputError, did_you_mean
from wrt.io.mitsuba.plugin import Plugin
from wrt.scene.materials.presets import metal_ior
from wrt.values import Vec3

INDICES = {
    "vacuum": 1.0,
    "helium": 1.000036,
    "hydrogen": 1.000132,
    "air": 1.000277,
    "carbon dioxide": 1.00045,
    "water": 1.3330,
    "acetone": 1.36,
    "ethanol": 1.361,
    "carbon tetrachloride": 1.461,
    "glycerol": 1.4729,
    "benzene": 1.501,
    "silicone oil": 1.52045,
    "bromine": 1.661,
    "water ice": 1.31,
    "fused quartz": 1.458,
    "pyrex": 1.470,
    "acrylic glass": 1.49,
    "polypropylene": 1.49,
    "bk7": 1.5046,
    "sodium chloride": 1.544,
    "amber": 1.55,
    "pet": 1.5750,
    "diamond": 2.419,
}
"""At 589.3 nm, gases at 0 °C and 1 atm, liquids at 20 °C."""

METALS: dict[str, tuple[Vec3, Vec3]] = {
    "ag": ((0.1553, 0.1167, 0.1384), (4.828, 3.122, 2.147)),
    "al": ((1.658, 0.8804, 0.5212), (9.224, 6.27, 4.837)),
    "alas": ((3.605, 3.233, 2.216), (0.0006794, 0.0, 0.007513)),
    "au": ((0.143, 0.3753, 1.442), (3.983, 2.386, 1.603)),
    "be": ((4.185, 3.185, 2.784), (3.835, 3.01, 2.869)),
    "cr": ((4.37, 2.917, 1.655), (5.207, 4.231, 3.755)),
    "csi": ((2.145, 1.702, 1.662), (0.0, 0.0, 0.0)),
    "cu": ((0.201, 0.9237, 1.102), (3.913, 2.453, 2.142)),
    "cu2o": ((3.552, 2.95, 2.752), (0.1142, 0.1939, 0.6061)),
    "cuo": ((3.248, 2.448, 2.21), (0.5211, 0.57, 0.7222)),
    "cu_palik": ((0.2132, 0.9197, 1.102), (3.922, 2.457, 2.137)),
    "hg": ((2.399, 1.44, 0.9096), (6.328, 4.372, 3.422)),
    "hgte": ((4.779, 3.231, 2.66), (1.632, 1.581, 1.729)),
    "ir": ((3.086, 2.082, 1.618), (5.592, 4.067, 3.267)),
    "k": ((0.06404, 0.04641, 0.03818), (2.104, 1.349, 0.9131)),
    "li": ((0.2658, 0.1956, 0.2209), (3.54, 2.311, 1.669)),
    "mgo": ((2.09, 1.651, 1.595), (0.0, 0.0, 0.0)),
    "mo": ((4.484, 3.525, 2.776), (4.111, 3.421, 3.151)),
    "na_palik": ((0.06027, 0.05614, 0.06199), (3.179, 2.112, 1.579)),
    "nb": ((3.42, 2.79, 2.396), (3.441, 2.738, 2.58)),
    "ni_palik": ((2.367, 1.663, 1.467), (4.499, 3.05, 2.345)),
    "rh": ((2.586, 1.86, 1.554), (6.782, 4.703, 3.976)),
    "se": ((4.058, 2.843, 2.821), (0.754, 0.6384, 0.5218)),
    "se-e": ((5.723, 4.166, 4.081), (0.8711, 1.105, 1.565)),
    "sic": ((3.172, 2.526, 2.479), (7.538e-07, 0.0, 1.019e-05)),
    "snte": ((4.524, 1.982, 1.282), (0.0, 0.0, 0.0)),
    "ta": ((2.063, 2.393, 2.628), (2.408, 1.741, 1.947)),
    "te": ((7.39, 4.482, 2.637), (3.256, 3.527, 3.292)),
    "te-e": ((7.509, 4.296, 2.37), (5.584, 4.947, 3.998)),
    "thf4": ((1.831, 1.442, 1.388), (0.0, 0.0, 0.0)),
    "tic": ((3.701, 2.837, 2.582), (3.266, 2.352, 2.173)),
    "tin": ((1.648, 1.151, 1.38), (3.368, 1.943, 1.102)),
    "tio2": ((3.457, 2.802, 2.905), (0.0001053, 0.0, 0.0006529)),
    "tio2-e": ((3.107, 2.513, 2.582), (2.975e-05, 0.0, 0.0001827)),
    "vc": ((3.658, 2.753, 2.533), (3.068, 2.199, 1.963)),
    "vn": ((2.866, 2.119, 1.94), (3.032, 2.056, 1.616)),
    "v_palik": ((4.278, 3.513, 2.761), (3.491, 2.889, 3.112)),
    "w": ((4.371, 3.3, 2.998), (3.501, 2.605, 2.273)),
    "a-c": ((2.944, 2.227, 1.968), (0.8875, 0.7993, 0.8153)),
    "d-c": ((2.709, 2.319, 2.229), (0.0, 0.0, 0.0)),
}
"""η and k per channel, those of Mitsuba's RGB variants to four digits.

They come from measured spectra (Palik, "Handbook of Optical Constants of Solids", and others) by converting η(λ) and
k(λ) to RGB as if they were light, ∫ η r dλ / ∫ y dλ, which makes a constant spectrum a little red. AlSb is missing:
both are 0 in red, so it has no reflectance there.
"""


def refractive_index(plugin: Plugin, name: str, default: str) -> float:
    """Return a refractive index, given as a number above 0 or as one of the names in INDICES."""
    element = plugin.value(name, "float", "string")
    if element is None:
        return INDICES[default]
    if element.tag == "float":
        return plugin.number(name, 1.0, positive=True)
    key = element.get("value").strip().lower()
    if key not in INDICES:
        raise element.error(f"{plugin.label}: {name}: {key!r} is not known{did_you_mean(key, INDICES)}")
    return INDICES[key]


def named_conductor(name: str) -> tuple[Vec3, Vec3] | None:
    """Return η and k of a conductor by its name in Mitsuba or in `wrt.scene.materials.presets`; None if unknown.

    The source after the underscore of a name such as "Ni_palik" is optional.
    """
    key = name.strip().lower()
    symbol = key.partition("_")[0]
    for known_name in (key, symbol, f"{symbol}_palik"):
        if known_name in METALS:
            return METALS[known_name]
    try:
        return metal_ior(symbol)
    except InputError:
        return None
