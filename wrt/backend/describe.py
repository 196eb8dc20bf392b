"""Describe constants, structs and kernels of Warp as entries of the table of artefacts (see `artefacts.py`)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from wrt.backend.arrays import SUFFIXES

PLAIN = (bool, int, float, str)
"""Types of constants that the table holds directly."""

COOPERATIVE = b"wp_cpu_"
"""Prefix of the functions that cooperative kernels call, whose threads wait for one another."""

AddStruct = Callable[[str, list[Any]], None]
"""Adds a struct to the table, by name, with size and fields."""


def call_name(module: str, function: str, arguments: tuple[Any, ...]) -> str:
    """Return the name of a call in the table."""
    return f"{module}.{function}({', '.join(map(repr, arguments))})"


def describe(value: Any, add_struct: AddStruct) -> dict[str, Any] | None:
    """Return the entry of a constant, a kernel, a struct or a named tuple; None for anything else."""
    import warp as wp
    from warp._src.codegen import Struct

    if isinstance(value, PLAIN) or (type(value) is tuple and all(isinstance(each, PLAIN) for each in value)):
        return {"value": value}
    if isinstance(value, wp.Kernel):
        return {"kernel": [value.module.name, value.func.__qualname__]}
    if isinstance(value, Struct):
        return {"struct": describe_struct(value, add_struct)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):  # a reflection model
        return {"fields": {name: each for name, each in value._asdict().items() if isinstance(each, PLAIN)}}
    return None


def describe_struct(struct: Any, add_struct: AddStruct) -> str:
    """Add a struct and its nested structs to the table, and return its name."""
    name = f"{struct.cls.__module__}.{struct.cls.__qualname__}"
    _, fields = _layout([(field, variable.type) for field, variable in struct.vars.items()], add_struct)
    add_struct(name, [ctypes.sizeof(struct.ctype), fields])
    return name


def describe_arguments(kernel: Any, add_struct: AddStruct) -> list[Any]:
    """Return the size of a kernel's arguments, and the name, type and offset of each."""
    return _layout([(argument.label, argument.type) for argument in kernel.adj.args], add_struct)


def _layout(fields: list[tuple[str, Any]], add_struct: AddStruct) -> list[Any]:
    """Return the size of fields laid out as in C, and the name, type and offset of each."""
    described = [(name, *_type(kind, add_struct)) for name, kind in fields]
    c_struct: Any = type("Layout", (ctypes.Structure,), {"_fields_": [(name, c) for name, _, c in described]})
    size = ctypes.sizeof(c_struct)
    return [size, [[name, kind, getattr(c_struct, name).offset] for name, kind, _ in described]]


def _type(kind: Any, add_struct: AddStruct) -> tuple[str, Any]:
    """Return the name of a field's type, and its ctypes type."""
    import warp as wp
    from warp._src.codegen import Struct
    from warp._src.types import array_t, is_array

    if isinstance(kind, Struct):
        return f"struct {describe_struct(kind, add_struct)}", kind.ctype
    if is_array(kind):
        return "array", array_t
    kind = {int: wp.int32, float: wp.float32, bool: wp.bool}.get(kind, kind)
    if issubclass(kind, ctypes.Array):
        shape, suffix = "x".join(map(str, kind._shape_)), SUFFIXES[kind._wp_scalar_type_.__name__]
        return f"{'vec' if len(kind._shape_) == 1 else 'mat'}{shape}{suffix}", kind
    return kind.__name__, kind._type_
