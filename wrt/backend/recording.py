"""Describe the kernels that Warp has compiled in this process, so that other processes can run them without Warp.

The notes have four tables by name:

- `files`: Warp's modules: the compiled file, its size, and the symbol and argument layout of each kernel;
- `structs`: size in bytes, and name, type and offset of each field;
- `modules`: constants, structs and kernels of the modules of `kernels/` that the host has used;
- `calls`: results of functions of those modules.

A type is written "int8", "float32" and so on, "vec3" or "mat3x3" with one of SUFFIXES, "array", or "struct NAME".
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
from typing import TYPE_CHECKING, Any

from wrt.backend.kernel_cache import Build

if TYPE_CHECKING:
    from wrt.backend.warp_backend import WarpBackend

Notes = dict[str, dict[str, Any]]

PLAIN = (bool, int, float, str)
"""Types of constants that notes hold directly."""

SUFFIXES = {"float32": "", "float64": "d", "int32": "i", "uint32": "ui"}
"""Suffixes of vector and matrix names by number type, as in Warp."""

_COOPERATIVE = b"wp_cpu_"
"""Prefix of the functions that cooperative kernels call, whose threads wait for one another."""


def call_name(module: str, function: str, arguments: tuple[Any, ...]) -> str:
    """Return the name of a call in the notes."""
    return f"{module}.{function}({', '.join(map(repr, arguments))})"


def compiled_by_warp(backend: WarpBackend) -> Notes:
    """Return notes on everything that Warp has loaded on the CPU for wrt in this process."""
    from warp._src.context import runtime

    notes: Notes = {"files": {}, "structs": {}, "modules": {}, "calls": {}}
    if runtime is None:
        return notes
    notes["files"] = _files(notes["structs"])
    for module in backend.modules:
        names = vars(sys.modules[module]).items()
        found = {name: _described(value, notes["structs"]) for name, value in names if not name.startswith("_")}
        notes["modules"][module] = {name: value for name, value in found.items() if value is not None}
    calls = {call: _described(result, notes["structs"]) for call, result in backend.calls.items()}
    notes["calls"] = {call: result for call, result in calls.items() if result is not None}
    return notes


def _files(structs: dict[str, Any]) -> dict[str, Any]:
    from warp._src.context import user_modules

    files = {}
    for name, module in user_modules.items():
        build = Build.of(module, "cpu")
        if not name.startswith("wrt.") or build is None or not build.is_loaded:
            continue
        symbols = build.symbols()
        kernels = {
            kernel.func.__qualname__: [symbol, *_layout([(arg.label, arg.type) for arg in kernel.adj.args], structs)]
            for kernel, symbol in symbols
            if kernel.adj.kernel_dim == 1
        }
        if len(kernels) < len(symbols):
            continue  # kernels with the same name, or with more than one thread dimension
        with contextlib.suppress(OSError):
            built = build.path.read_bytes()
            if _COOPERATIVE not in built:
                files[name] = {"file": str(build.path), "bytes": len(built), "kernels": kernels}
    return files


def _described(value: Any, structs: dict[str, Any]) -> Any:
    """Return the note of a constant, a kernel, a struct or a named tuple; None for anything else."""
    import warp as wp
    from warp._src.codegen import Struct

    if isinstance(value, PLAIN) or (type(value) is tuple and all(isinstance(each, PLAIN) for each in value)):
        return {"value": value}
    if isinstance(value, wp.Kernel):
        return {"kernel": [value.module.name, value.func.__qualname__]}
    if isinstance(value, Struct):
        return {"struct": _struct(value, structs)}
    if not isinstance(value, tuple) or not hasattr(value, "_asdict"):
        return None
    # A reflection model. Another process may register other functions under the name of a user's model.
    if not all(each.func.__module__.startswith("wrt.") for each in value if isinstance(each, wp.Function)):
        return None
    return {"fields": {k: v for k, v in value._asdict().items() if isinstance(v, (bool, int, float, str))}}


def _struct(struct: Any, structs: dict[str, Any]) -> str:
    """Note a struct and its nested structs, and return its name."""
    name = f"{struct.cls.__module__}.{struct.cls.__qualname__}"
    if name not in structs:
        fields = struct.vars
        _, layout = _layout([(field, variable.type) for field, variable in fields.items()], structs)
        structs[name] = [ctypes.sizeof(struct.ctype), layout]
    return name


def _layout(fields: list[tuple[str, Any]], structs: dict[str, Any]) -> list[Any]:
    """Return the size of fields laid out as in C, and the name, type and offset of each."""
    described = [(name, *_type(kind, structs)) for name, kind in fields]
    c_struct: Any = type("Layout", (ctypes.Structure,), {"_fields_": [(name, c) for name, _, c in described]})
    size = ctypes.sizeof(c_struct)
    return [size, [[name, kind, getattr(c_struct, name).offset] for name, kind, _ in described]]


def _type(kind: Any, structs: dict[str, Any]) -> tuple[str, Any]:
    """Return the note of a field's type, and its ctypes type."""
    import warp as wp
    from warp._src.codegen import Struct
    from warp._src.types import array_t, is_array

    if isinstance(kind, Struct):
        return f"struct {_struct(kind, structs)}", kind.ctype
    if is_array(kind):
        return "array", array_t
    kind = {int: wp.int32, float: wp.float32, bool: wp.bool}.get(kind, kind)
    if issubclass(kind, ctypes.Array):
        shape, suffix = "x".join(map(str, kind._shape_)), SUFFIXES[kind._wp_scalar_type_.__name__]
        return f"{'vec' if len(kind._shape_) == 1 else 'mat'}{shape}{suffix}", kind
    return kind.__name__, kind._type_
