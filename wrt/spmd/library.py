"""The C++ library of the wide kernels, the kinds of parameters of its functions, and native functions for lanes."""

import functools
import re
from collections.abc import Iterable
from typing import Any

from wrt.kernels.native import headers_of, included_by, text_of
from wrt.spmd.ir import Unsupported


def library(lanes: int, *, exact: str = "") -> str:
    """Return the C++ that all wide code with this number of lanes begins with.

    `exact` is a header that comes first: "exact/with_spheres.h" or "exact/with_quadrics.h" if kernels test spheres, or
    disks and cylinders, too.
    """
    define = text_of(exact) if exact else ""
    return f"#define LANES_WIDTH {lanes}\n{define}{text_of('lanes/library.h')}"


ANYTHING = "?"
"""The kind of a parameter whose type is a template parameter."""
A_NUMBER = "number"
"""The kind of a parameter that is a vector's element, of any type."""

_WIDE = {
    "_in_one_tree__locals__traverse": "closest_hit",
    "_sample_tree": "sample_light_tree",
    "reverse_bits": "reverse_bits",
    "further_dimension": "further_dimension",
}
"""Native functions (`wp.func_native`) with a version for lanes in `kernels/native/lanes`, by name."""

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
    """Return whether the library has a function for arguments of these kinds; ANYTHING fits each."""

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
        if m[1] in macros:
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


def traverses_one_tree(functions: Iterable[str]) -> bool:
    """Return whether any of the functions with these names looks for hits in a tree without instances."""
    return any(_WIDE.get(name) == "closest_hit" for name in functions)


def native_function(types: Any, function: Any) -> str:
    """Return the C++ of a native function for lanes: its wide version, or a loop that calls it for each lane."""
    if headers := included_by(function):
        return "".join(text_of(header) for header in headers if header not in headers_of("lanes/library.h"))
    name = f"wide_{function.native_func}"
    arguments = function.adj.args
    result = function.adj.return_var[0]
    wide_parameters = ", ".join(f"const {types.wide(a.type)}& {a.label}" for a in arguments)
    if function.key in _WIDE:
        passed = ", ".join(a.label for a in arguments)
        call = f"lanes::{_WIDE[function.key]}({passed}, exec)"
        return (
            f"LANES_INLINE {types.wide(result.type)} {name}({wide_parameters}, lanes::Mask exec) {{ return {call}; }}\n"
        )
    if not all(types.is_whole(a.type) for a in arguments):
        raise Unsupported(f"{function.key}: takes arrays that differ between lanes")
    parameters = ", ".join(f"{a.ctype()} {a.label}" for a in arguments)
    passed = ", ".join(a.label if types.is_shared(a.type) else f"lanes::lane({a.label}, l)" for a in arguments)
    return f"""
static {result.ctype()} {name}_of_one({parameters}) {{
{function.native_snippet}
}}
static {types.wide(result.type)} {name}({wide_parameters}, lanes::Mask exec) {{
    using lanes::set_lane;
    {types.wide(result.type)} r;
    LANES_EACH(l, exec) set_lane(r, l, {name}_of_one({passed}));
    return r;
}}
"""
