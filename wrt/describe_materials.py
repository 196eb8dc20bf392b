"""The materials in words, for `wrt materials`: what their classes say about themselves, laid out for a terminal."""

from __future__ import annotations

import dataclasses
import inspect
import re
import textwrap
import typing
from typing import Any

from wrt.docstrings import meanings_of, plain, summary_of
from wrt.errors import InputError, did_you_mean
from wrt.materials import MATERIALS, Material
from wrt.textures import ImageTexture

WIDTH = 100
"""Characters in a line at most."""

_VARIES = "*"
_FOOTNOTE = (
    f'{_VARIES} may vary over the surface: in scene files {{ texture = "FILE" }}, with channel = "r", "g" or "b" and '
    'linear = true for files that hold numbers, or "vertex-colors".'
)


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter of a material.

    Attributes:
        name: as in Python and in scene files.
        default: as scene files write it, or a word where they cannot.
        meaning: what the class says of it, in one line.
        varies: whether it may be an image or the mesh's vertex colours.
    """

    name: str
    default: str
    meaning: str
    varies: bool

    @property
    def label(self) -> str:
        """The name, marked where the value may vary."""
        return self.name + _VARIES * self.varies


def parameters_of(cls: type[Material], *, inherited: bool = True) -> list[Parameter]:
    """Return a material's parameters, its own before those that every material has.

    Args:
        cls: the material's class.
        inherited: whether those that every material has are wanted.
    """
    meanings = meanings_of(cls)
    hints = typing.get_type_hints(cls)
    common = {field.name for field in dataclasses.fields(Material)}
    fields = sorted(dataclasses.fields(cls), key=lambda field: field.name in common)
    return [
        Parameter(
            field.name,
            _default(field),
            meanings.get(field.name, ""),
            ImageTexture in typing.get_args(hints[field.name]),
        )
        for field in fields
        if inherited or field.name not in common
    ]


def list_materials() -> str:
    """Return all materials with their parameters, a line each."""
    shown = {name: parameters_of(cls, inherited=False) for name, cls in MATERIALS.items()}
    shown["every material"] = parameters_of(Material)
    everything = [parameter for parameters in shown.values() for parameter in parameters]
    widths = (max(len(p.label) for p in everything), max(len(p.default) for p in everything))
    paragraphs = []
    for name, parameters in shown.items():
        head = textwrap.shorten(f"{name}: {_first_clause(summary_of(MATERIALS.get(name)))}", WIDTH, placeholder=" …")
        rows = [_row(p, _first_clause(p.meaning), widths, shorten=True) for p in parameters]
        paragraphs.append("\n".join([head.removesuffix(":"), *rows]))
    ending = f"{_fill(_FOOTNOTE)}\n'wrt materials NAME' says more of one."
    return "\n\n".join([*paragraphs, ending])


def explain_material(name: str) -> str:
    """Return all that is said of one material.

    Raises:
        InputError: where there is none of that name.
    """
    if name not in MATERIALS:
        hint = did_you_mean(name, MATERIALS) or "; 'wrt materials' lists them"
        raise InputError(f"there is no material {name!r}{hint}")
    cls = MATERIALS[name]
    import wrt

    python = f"wrt.{cls.__name__}" if getattr(wrt, cls.__name__, None) is cls else f"{cls.__module__}.{cls.__name__}"
    text = inspect.getdoc(cls) or ""
    paragraphs = [plain(part) for part in text.partition("\nAttributes:")[0].split("\n\n")]
    parameters = parameters_of(cls)
    widths = (max(len(p.label) for p in parameters), max(len(p.default) for p in parameters))
    rows = [_row(p, p.meaning, widths, shorten=False) for p in parameters]
    head = [f"{name} (in Python {python})", *(_fill(part) for part in paragraphs if part)]
    return "\n\n".join([*head, "\n".join(rows), _fill(_FOOTNOTE)])


def _row(parameter: Parameter, meaning: str, widths: tuple[int, int], *, shorten: bool) -> str:
    start = f"  {parameter.label:<{widths[0]}}  {parameter.default:<{widths[1]}}  "
    if shorten:
        return (start + textwrap.shorten(meaning, WIDTH - len(start), placeholder=" …")).rstrip()
    return _fill(meaning, start) or start.rstrip()


def _fill(text: str, start: str = "") -> str:
    """Return text wrapped after `start`, names with hyphens whole."""
    return textwrap.fill(text, WIDTH, break_on_hyphens=False, initial_indent=start, subsequent_indent=" " * len(start))


def _first_clause(text: str) -> str:
    """Return text up to its first full stop or semicolon."""
    return re.split(r"[.;](?:\s|$)", text, maxsplit=1)[0]


def _default(field: dataclasses.Field[Any]) -> str:
    """Return a default as scene files write it."""
    value = field.default
    if field.default_factory is not dataclasses.MISSING:
        value = field.default_factory()
    if value is dataclasses.MISSING:
        return "required"
    if value is None:
        return "none"
    if isinstance(value, Material):
        return value.type_name
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(map(str, value))}]"
    return str(value)
