"""Refractive indices by Mitsuba's names."""

from __future__ import annotations

from wrt.errors import did_you_mean
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.mitsuba.transforms import numbers_of

NAMED = {
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
"""Mitsuba's own values, so that its scenes look the same: at 589.3 nm, gases at 0 °C and 1 atm, liquids at 20 °C."""


def refractive_index(plugin: Plugin, name: str, default: float | str) -> float:
    """Return a refractive index, given as a number or by name.

    Raises:
        InputError: when it is not above 0 or the name is unknown.
    """
    element = plugin.value(name, "float", "string")
    if element is None:
        return NAMED[default] if isinstance(default, str) else default
    text = element.get("value")
    if element.tag == "string":
        key = text.strip().lower()
        if key not in NAMED:
            raise element.error(f"{plugin.label}: {name}: {text!r} is not known{did_you_mean(key, NAMED)}")
        return NAMED[key]
    value = numbers_of(element, text, 1)[0]
    if value <= 0.0:
        raise element.error(f"{plugin.label}: {name!r} must be greater than 0, not {value:g}")
    return value
