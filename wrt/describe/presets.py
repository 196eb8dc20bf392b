"""The named optical constants for `wrt materials --presets`, by table, each with its source."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

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
from wrt.values import Vec3

_HOFFMAN = "Hoffman 2014, Physics and Math of Shading, SIGGRAPH course Physically Based Shading in Theory and Practice"
_CORNELL = "Cornell University, CS 4620, Light Reflection and Advanced Shading"
_KHRONOS = "Khronos Group 2024, KHR_materials_dispersion"
_MEASURED = (
    "from spectra under D65: Johnson and Christy 1972 and 1974, Rakić 1995, Rakić et al. 1998, Weaver et al. 1975, "
    "Inagaki et al. 1981, Querry 1985, Karlsson and Ribbing 1982"
)


def list_presets() -> str:
    """Return all names, the keys that take them, their values and their sources."""
    from textwrap import wrap

    tables = (
        ("metal = NAME, by eta and k", _MEASURED, ((name, *map(_rgb, value)) for name, value in METAL_IOR.items())),
        ("f0 = NAME, and metal = NAME if it is not above: metals", _HOFFMAN, _colors(METAL_F0)),
        ("f0 = NAME, metal = NAME: semiconductors", _HOFFMAN, _colors(SEMICONDUCTOR_F0)),
        ("f0 = NAME: dielectrics, the middle of the range", _HOFFMAN, _ranges(DIELECTRIC_F0)),
        ("ior = NAME, the middle of the range", _CORNELL, _ranges(DIELECTRIC_IOR)),
        (
            "ior = NAME, by the middle of the range of f0",
            _HOFFMAN,
            (
                (name, f"{dielectric_ior(name):.3f}")
                for name in DIELECTRIC_F0
                if ALIASES.get(name, name) not in DIELECTRIC_IOR
            ),
        ),
        (
            "dispersion = NAME, by the Abbe number",
            _KHRONOS,
            ((name, f"{abbe:g}", f"{20.0 / abbe:.3f}") for name, abbe in DIELECTRIC_ABBE.items()),
        ),
    )
    paragraphs = []
    for heading, source, rows in tables:
        cells = [[name, *values] for name, *values in rows]
        lines = ["  " + "  ".join(f"{cell:<22}" for cell in row).rstrip() for row in cells]
        paragraphs.append("\n".join([heading, *wrap(f"({source})", 100), *lines]))
    symbols = ", ".join(f"{symbol} ({name})" for symbol, name in ALIASES.items())
    paragraphs.append("\n".join(wrap(f"Other names: {symbols}. Upper and lower case are the same.", 100)))
    return "\n\n".join(paragraphs)


def _rgb(value: Vec3) -> str:
    return " ".join(f"{x:.3f}" for x in value)


def _colors(table: Mapping[str, Vec3]) -> Iterable[tuple[str, str]]:
    return ((name, _rgb(value)) for name, value in table.items())


def _ranges(table: Mapping[str, tuple[float, float]]) -> Iterable[tuple[str, str]]:
    for name, (low, high) in table.items():
        yield name, f"{low:g}" if low == high else f"{low:g} to {high:g}"
