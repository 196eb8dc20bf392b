"""Materials by a short text, such as "gold", "glass" or "plastic:0.8,0.1,0.1"."""

from __future__ import annotations

import dataclasses
import inspect
import typing
from typing import Any

from wrt.errors import InputError, did_you_mean
from wrt.scene.materials import MATERIALS
from wrt.scene.materials.dielectrics import Dielectric, RoughDielectric
from wrt.scene.materials.material import Material
from wrt.scene.materials.metals import RoughConductor
from wrt.scene.materials.plastics import RoughPlastic
from wrt.scene.materials.presets import ALIASES, METAL_F0, METAL_IOR, SEMICONDUCTOR_F0
from wrt.scene.materials.simple import Diffuse, OrenNayar
from wrt.values import color_names, color_of_text, is_color

LOOKS: dict[str, tuple[type[Material], dict[str, Any]]] = {
    "plaster": (OrenNayar, {"reflectance": 0.75}),
    "clay": (OrenNayar, {"reflectance": (0.52, 0.27, 0.18)}),
    "porcelain": (RoughPlastic, {"reflectance": 0.8, "alpha": 0.03}),
    "glass": (Dielectric, {"ior": "glass"}),
    "frosted-glass": (RoughDielectric, {"ior": "glass", "alpha": 0.3}),
    "water": (Dielectric, {"ior": "water"}),
    "diamond": (Dielectric, {"ior": "diamond"}),
    **{
        name.replace(" ", "-"): (RoughConductor, {"metal": name, "alpha": 0.15})
        for name in sorted({*METAL_IOR, *METAL_F0, *SEMICONDUCTOR_F0})
    },
}
"""Names of ready-made materials: class and parameters. Metals are slightly rough, as brushed or cast ones are."""

_COLORS = ("reflectance", "base_color", "radiance", "specular_transmittance")
"""Parameters that a value without a name sets: the first that the material has."""


def named_material(text: str) -> Material:
    """Return the material that a text describes.

    The text is NAME, or NAME:VALUE, or NAME:KEY=VALUE;KEY=VALUE, or a colour as in CSS, which is matt. NAME is one of
    LOOKS, the chemical symbol of a metal, or a type of `wrt materials`. A VALUE is a number, a colour "R,G,B", true,
    false or a word; without a key it is the material's colour.

    Raises:
        InputError: if the name is unknown, or a parameter cannot be used.
    """
    word, _, assignments = text.strip().partition(":")
    key = word.strip().lower().replace(" ", "-")
    if key not in LOOKS and key not in MATERIALS:
        key = ALIASES.get(key, key)
    if key in LOOKS:
        cls, values = LOOKS[key]
    elif key in MATERIALS:
        cls, values = MATERIALS[key], {}
    elif not assignments and is_color(key):
        return Diffuse(color_of_text(key, "material"))
    else:
        names = [*LOOKS, *MATERIALS]
        hint = did_you_mean(key, names) or did_you_mean(key, color_names())
        raise InputError(f"there is no material {word!r}{hint}; known are colours and {', '.join(names)}")
    parameters = _parameters(cls, assignments, text)
    if parameters.keys() & {"eta", "k", "f0", "metal"}:  # a metal is given in one way only
        values = {name: value for name, value in values.items() if name != "metal"}
    required = [each.name for each in inspect.signature(cls).parameters.values() if each.default is each.empty]
    if missing := [name for name in required if name not in parameters]:
        raise InputError(f"material {text!r} needs a {missing[0]}, which only scene files and Python can give")
    try:
        return cls(**{**values, **parameters}).named(text.strip())
    except InputError as error:
        raise InputError(f"material {text!r}: {error}") from None


def _parameters(cls: type[Material], assignments: str, text: str) -> dict[str, Any]:
    """Return the parameters that the part of a text after the colon assigns."""
    types = typing.get_type_hints(cls)
    fields = [field.name for field in dataclasses.fields(cls)]
    plain = [
        name
        for name in fields
        if types[name] is not Material and name not in ("interior", "normal_map", "coat_normal_map")
    ]
    parameters: dict[str, Any] = {}
    for part in filter(None, (part.strip() for part in assignments.split(";"))):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals:
            color = next((each for each in _COLORS if each in plain), None)
            if color is None:
                raise InputError(f"material {text!r}: {name!r} needs a name, such as {plain[0]}={name}")
            name, value = color, name
        name = name.replace("-", "_")
        if name not in plain:
            hint = did_you_mean(name, plain)
            raise InputError(f"material {text!r}: there is no parameter {name!r}{hint}; there are {', '.join(plain)}")
        if name in parameters:
            raise InputError(f"material {text!r}: {name} is given twice")
        parameters[name] = _value(value)
    return parameters


def _value(text: str) -> Any:
    """Return a number, a colour, a truth value, or the text itself."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return text
    if len(numbers) > 1:
        return tuple(numbers)
    return int(numbers[0]) if text.lstrip("+-").isdecimal() else numbers[0]
