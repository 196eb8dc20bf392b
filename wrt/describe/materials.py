"""Descriptions of the materials for `wrt materials`, from the docstrings of their classes, and of the presets."""

from __future__ import annotations

import dataclasses
import inspect
import re
import textwrap
import typing
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from wrt.describe.docstrings import meanings_of, plain, summary_of
from wrt.errors import InputError, did_you_mean
from wrt.scene.materials import MATERIALS, Material
from wrt.scene.materials.named import LOOKS
from wrt.scene.materials.presets import (
    ALIASES,
    DIELECTRIC_ABBE,
    DIELECTRIC_F0,
    DIELECTRIC_IOR,
    METAL_F0,
    METAL_IOR,
    SEMICONDUCTOR_F0,
    dielectric_ior,
)
from wrt.scene.textures import ImageTexture

WIDTH = 100
"""Maximum number of characters in a line."""

_VARIES = "*"
_FOOTNOTE = (
    f'{_VARIES} may vary over the surface. In scene files, write {{ texture = "FILE" }} or "vertex-colors"; for '
    'images of numbers, add linear = true, and channel = "r", "g" or "b" to choose a channel.'
)


class Parameter(NamedTuple):
    """One parameter of a material.

    Attributes:
        name: name in Python and in scene files.
        label: the name, marked if the value may be an image or the mesh's vertex colours.
        default: default value as in scene files, or "required" or "none".
        meaning: description, in one line.
    """

    name: str
    label: str
    default: str
    meaning: str


def parameters_of(cls: type[Material], *, inherited: bool = True) -> list[Parameter]:
    """Return a material's parameters, and then, if `inherited`, those of every material."""
    meanings = meanings_of(cls)
    hints = typing.get_type_hints(cls)
    common = {field.name for field in dataclasses.fields(Material)}
    fields = sorted(dataclasses.fields(cls), key=lambda field: field.name in common)
    return [
        Parameter(
            field.name,
            field.name + _VARIES * (ImageTexture in typing.get_args(hints[field.name])),
            _default(field),
            meanings.get(field.name, ""),
        )
        for field in fields
        if inherited or field.name not in common
    ]


def list_materials() -> str:
    """Return all materials and their parameters, one line each."""
    listed = {name: parameters_of(cls, inherited=False) for name, cls in MATERIALS.items()}
    listed["every material"] = parameters_of(Material)
    start_of = _starts([parameter for parameters in listed.values() for parameter in parameters])
    paragraphs = []
    for name, parameters in listed.items():
        summary = _first_clause(summary_of(MATERIALS.get(name)))
        lines = [f"{name}: {summary}" if summary else name]
        lines += [start_of(parameter) + _first_clause(parameter.meaning) for parameter in parameters]
        # Like textwrap.shorten, but the columns keep their spaces.
        cut = [line if len(line) <= WIDTH else line[: WIDTH - 2].rpartition(" ")[0] + " …" for line in lines]
        paragraphs.append("\n".join(line.rstrip() for line in cut))
    ending = f"{_fill(_FOOTNOTE)}\n'wrt materials NAME' describes one in full."
    return "\n\n".join([*paragraphs, ending])


def explain_material(name: str) -> str:
    """Return the full description of one material.

    Raises:
        InputError: if there is no material of that name.
    """
    if name in LOOKS:
        cls, values = LOOKS[name]
        given = ", ".join(f"{key} = {value!r}" for key, value in values.items())
        return f"{name} is {cls.type_name} with {given}\n\n{explain_material(cls.type_name)}"
    if name not in MATERIALS:
        hint = did_you_mean(name, [*LOOKS, *MATERIALS]) or "; 'wrt materials' lists them"
        raise InputError(f"there is no material {name!r}{hint}")
    cls = MATERIALS[name]
    import wrt

    python = f"wrt.{cls.__name__}" if getattr(wrt, cls.__name__, None) is cls else f"{cls.__module__}.{cls.__name__}"
    text = inspect.getdoc(cls) or ""
    paragraphs = [plain(part) for part in text.partition("\nAttributes:")[0].split("\n\n")]
    parameters = parameters_of(cls)
    start_of = _starts(parameters)
    rows = [_fill(p.meaning, start_of(p)) or start_of(p).rstrip() for p in parameters]
    head = [f"{name} (in Python {python})", *(_fill(part) for part in paragraphs if part)]
    return "\n\n".join([*head, "\n".join(rows), _fill(_FOOTNOTE)])


def _starts(parameters: list[Parameter]) -> Callable[[Parameter], str]:
    """Return a function from a parameter to the columns before its meaning, as wide as all parameters need."""
    labels, defaults = (max(len(p[k]) for p in parameters) for k in (1, 2))
    return lambda p: f"  {p.label:<{labels}}  {p.default:<{defaults}}  "


def _fill(text: str, start: str = "") -> str:
    """Return text wrapped after `start`, without breaks in names with hyphens."""
    return textwrap.fill(text, WIDTH, break_on_hyphens=False, initial_indent=start, subsequent_indent=" " * len(start))


def _first_clause(text: str) -> str:
    """Return text up to its first full stop or semicolon."""
    return re.split(r"[.;](?:\s|$)", text, maxsplit=1)[0]


def _default(field: dataclasses.Field[Any]) -> str:
    """Return a default value as in scene files."""
    value = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
    if value is dataclasses.MISSING:
        return "required"
    if isinstance(value, Material):
        return value.type_name
    if isinstance(value, (bool, type(None))):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


# --- Presets ---------------------------------------------------------------------------------------

_HOFFMAN = "Hoffman 2014, Physics and Math of Shading, SIGGRAPH course Physically Based Shading in Theory and Practice"
_CORNELL = "Cornell University, CS 4620, Light Reflection and Advanced Shading"
_KHRONOS = "Khronos Group 2024, KHR_materials_dispersion"
_MEASURED = (
    "from spectra under D65: Johnson and Christy 1972 and 1974, Rakić 1995, Rakić et al. 1998, Weaver et al. 1975, "
    "Inagaki et al. 1981, Querry 1985, Karlsson and Ribbing 1982"
)


def list_presets() -> str:
    """Return all names, the keys that take them, their values and their sources."""
    by_f0 = [name for name in DIELECTRIC_F0 if ALIASES.get(name, name) not in DIELECTRIC_IOR]
    tables: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
        ("metal = NAME, by eta and k", _MEASURED, METAL_IOR),
        ("f0 = NAME, and metal = NAME if it is not above: metals", _HOFFMAN, METAL_F0),
        ("f0 = NAME, metal = NAME: semiconductors", _HOFFMAN, SEMICONDUCTOR_F0),
        ("f0 = NAME: dielectrics, the middle of the range", _HOFFMAN, DIELECTRIC_F0),
        ("ior = NAME, the middle of the range", _CORNELL, DIELECTRIC_IOR),
        ("ior = NAME, by the middle of the range of f0", _HOFFMAN, {n: f"{dielectric_ior(n):.3f}" for n in by_f0}),
        (
            "dispersion = NAME, by the Abbe number",
            _KHRONOS,
            {name: (f"{abbe:g}", f"{20.0 / abbe:.3f}") for name, abbe in DIELECTRIC_ABBE.items()},
        ),
    )
    paragraphs = []
    for heading, source, presets in tables:
        rows = ([name, *_cells(value)] for name, value in presets.items())
        lines = ["  " + "  ".join(f"{cell:<22}" for cell in row).rstrip() for row in rows]
        paragraphs.append("\n".join([heading, *textwrap.wrap(f"({source})", WIDTH), *lines]))
    symbols = ", ".join(f"{symbol} ({name})" for symbol, name in ALIASES.items())
    paragraphs.append("\n".join(textwrap.wrap(f"Other names: {symbols}. Upper and lower case are the same.", WIDTH)))
    return "\n\n".join(paragraphs)


def _cells(value: Any) -> list[str]:
    """Return a preset as texts: those it has, a colour, two colours, or a range."""
    if isinstance(value, str):
        return [value]
    if isinstance(value[0], (str, tuple)):
        return [cell for each in value for cell in _cells(each)]
    if len(value) == 3:
        return [" ".join(f"{x:.3f}" for x in value)]
    low, high = value
    return [f"{low:g}" if low == high else f"{low:g} to {high:g}"]
