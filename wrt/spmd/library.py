"""The C++ library of the wide kernels: its text, and its functions with the kinds of their parameters."""

import functools
import re

from wrt.kernels.native import text_of


def library(lanes: int, *, exact: str = "") -> str:
    """Return the C++ that all wide code for so many lanes begins with; which may include a header.

    That is "exact/with_spheres.h" or "exact/with_quadrics.h" if kernels test spheres, or disks and cylinders, too.
    """
    define = text_of(exact) if exact else ""
    return f"#define LANES_WIDTH {lanes}\n{define}{text_of('lanes/library.h')}"


ANYTHING = "?"
"""The kind of a parameter whose type is a template parameter."""
A_NUMBER = "number"
"""The kind of a parameter that is a vector's element, of any type."""

_MACRO = re.compile(r"^#define (LANES_\w+)\((.*?)\)((?:.*\\\n)*.*)\n", re.MULTILINE)
_FUNCTION = re.compile(r"LANES_(?:INLINE|VECTOR|MATRIX)\b[^;{}()]*?\b(\w+)\(([^{};]*?)\)(?: -> [^{};]*)?\s*\{")
_KINDS = (("same<T>", A_NUMBER), ("Vector<", "vector"), ("Matrix<", "matrix"), ("shape_t", "shape"))
_NUMBERS = {
    **{name: name for name in ("Floats", "Ints", "Uints", "Longs", "Doubles", "Mask")},
    "float": "Floats",
    "int": "Ints",
    "unsigned": "Uints",
    "wp::int64": "Longs",
    "double": "Doubles",
    "bool": "Mask",
}


@functools.cache
def library_functions() -> dict[str, set[tuple[str, ...]]]:
    """Return the kinds of parameters of each function: "Floats" and the like, "vector", "matrix", or ANYTHING."""
    found: dict[str, set[tuple[str, ...]]] = {}
    for m in _FUNCTION.finditer(_expanded()):
        parameters = [p for p in _split(m[2]) if p and p != "Mask exec"]
        found.setdefault(m[1], set()).add(tuple(_kind(p) for p in parameters))
    return found


def can_be_called(name: str, arguments: list[str]) -> bool:
    """Return whether there is a function for arguments of these kinds, some of which may be ANYTHING."""

    def takes(parameter: str, argument: str) -> bool:
        number = parameter == A_NUMBER and argument in _NUMBERS.values()
        return number or ANYTHING in (parameter, argument) or parameter == argument

    return any(
        len(parameters) == len(arguments) and all(map(takes, parameters, arguments))
        for parameters in library_functions().get(name, ())
    )


def _expanded() -> str:
    """Return the library with macros that define functions expanded."""
    text = text_of("lanes/memory.h").replace("sizeof(T)", "")
    macros = {m[1]: (_split(m[2]), m[3].replace("\\\n", "\n")) for m in _MACRO.finditer(text)}
    out = [text := _MACRO.sub("", text)]
    for m in re.finditer(r"^(LANES_\w+)\((.*)\)$", text, re.MULTILINE):
        if m[1] in macros and not m[1].startswith("LANES_CONSTANT"):  # those do not add functions for lanes
            names, body = macros[m[1]]
            for name, value in zip(names, _split(m[2]), strict=True):
                body = re.sub(rf"\b{name}\b", value, body)
            out.append(body)
    return "\n".join(out)


def _split(parameters: str) -> list[str]:
    """Return the parameters in a list, keeping those in angle brackets together."""
    return [p.strip() for p in re.findall(r"(?:[^,<]|<(?:[^<>]|<[^<>]*>)*>)+", parameters)]


def _kind(parameter: str) -> str:
    for text, kind in _KINDS:
        if text in parameter and "Element<" not in parameter and "Place<" not in parameter:
            return kind
    words = re.sub(r"\bconst\b|&", "", parameter).split()
    return _NUMBERS.get(words[0], ANYTHING)
