"""The C++ of kernels: headers that clang compiles for the CPU and nvrtc for CUDA.

`wp.func_native` declares a function written in C++. Its snippet calls a template or a function from a header, and the
body of the Python function calls the result of `include` for that header:

    traversal_h = include("traversal.h")

    @wp.func_native("return wrt::trace_ray(bvh, ...);")
    def _traverse(bvh: Bvh, ...) -> wp.vec4:
        traversal_h()

Warp then puts the header's text into the module once, before the function, and hashes it with the module: no compiled
module depends on a file. Headers include each other as usual; `constants.h` is generated from `constants.py`.
"""

import functools
import re
from pathlib import Path

import warp as wp

from wrt.kernels.native import constants

_FOLDER = Path(__file__).parent
_INCLUDE = re.compile(r'^#include "([\w./]+)"\n', re.MULTILINE)


@functools.cache
def headers_of(name: str) -> tuple[str, ...]:
    """Return the names of a header and of all that it includes, dependencies first."""
    found: dict[str, None] = {}
    for included in _INCLUDE.findall(_read(name)):
        found.update(dict.fromkeys(headers_of(included)))
    return (*found, name)


@functools.cache
def text_of(name: str) -> str:
    """Return the text of a header, and before it of all headers that it includes, each between guards."""
    text = ""
    for header in headers_of(name):
        guard = f"WRT_{_identifier(header).upper()}"
        body = _INCLUDE.sub("", _read(header)).replace("#pragma once\n", "")
        text += f"#ifndef {guard}\n#define {guard}\n{body}#endif\n"
    return text


@functools.cache
def _read(name: str) -> str:
    return constants_header() if name == "constants.h" else (_FOLDER / name).read_text(encoding="utf-8")


@functools.cache
def include(*names: str) -> wp.Function:
    """Return the device function that adds headers to the modules of its callers, in this order."""
    _included[key := f"include_{_identifier('_'.join(names))}"] = names
    return at_file_level("".join(map(text_of, names)), key)


_included: dict[str, tuple[str, ...]] = {}


def included_by(function: wp.Function) -> tuple[str, ...]:
    """Return the headers that a function made by `include` adds; none for other functions."""
    return _included.get(function.key, ())


def at_file_level(code: str, name: str) -> wp.Function:
    """Return a device function of that name that adds C++ to the modules of its callers, before these.

    Its snippet closes the braces that Warp puts around it, and opens those of a function that is never called.
    """

    def header(): ...

    header.__name__ = header.__qualname__ = name
    return wp.func_native(f"\n}}\n{code}static CUDA_CALLABLE inline void end_of_{name}() {{\n")(header)


def _identifier(name: str) -> str:
    return re.sub(r"\W", "_", name)


def constants_header() -> str:
    """Return `constants.h`: numbers as constants, tables as macros with the elements of an array."""
    lines, tables = [], []
    for name, value in vars(constants).items():
        if name.isupper() and isinstance(value, tuple):
            rows = ", ".join("{" + ", ".join(f"{v}u" for v in row) + "}" for row in value)
            tables.append(f"#define WRT_{name} {rows}")
        elif name.isupper():
            lines.append(f"constexpr {'int' if isinstance(value, int) else 'double'} {name} = {value!r};")
    return "\n".join(["#pragma once", "namespace wrt {", *lines, "} // namespace wrt", *tables, ""])
