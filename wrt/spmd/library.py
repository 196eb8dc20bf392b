"""The C++ that wide kernels call, and native functions for lanes."""

import functools
import re
from collections.abc import Collection
from typing import Any

from wrt.kernels.native import headers_of, included_by, text_of
from wrt.spmd.ir import Unsupported


def library(lanes: int, *, exact: str = "", adjoints: bool = False) -> str:
    """Return the C++ that all wide code with this number of lanes begins with.

    `exact` is a header that comes first: one of "exact/with_*.h" if kernels test exact shapes, too. `adjoints` adds
    those of Warp's functions.
    """
    define = text_of(exact) if exact else ""
    last = text_of("lanes/adjoints.h") if adjoints else ""
    return f"#define LANES_WIDTH {lanes}\n{define}{text_of('lanes/library.h')}{last}"


@functools.cache
def names() -> frozenset[str]:
    """Return the names of functions in that C++: Warp's functions that are not among them have no version for lanes."""
    return frozenset(re.findall(r"(?<=[\w>&] )\w+(?=[(<])|(?<=\()\w+(?=,)", library(16)))


_WIDE = {
    "_in_one_tree__locals__traverse": "closest_hit",
    "add_exactly": "add_exactly",
    "_sample_tree": "sample_light_tree",
    "_next_light_box": "next_light_box",
    "reverse_bits": "reverse_bits",
    "further_dimension": "further_dimension",
}
"""Native functions (`wp.func_native`) with a version for lanes in `kernels/native/lanes`, by name."""


def trees_of(query: str, functions: Collection[str]) -> str | None:
    """Return the C++ type of the trees through which the rays of a ray query go together.

    Args:
        query: the name of its function.
        functions: the names of all functions of the module.

    Returns:
        A type of `kernels/native/lanes/ray_queries.h`; None for queries of other things, and for moving instances.
    """
    name = re.fullmatch(r"(?:closest_hit|occluded)(_of_surfaces)?_?(.*)", query)
    if name and "_in_one_tree__locals__traverse" in functions and (name[1] or not name[2]):
        return "InOneTree"
    if name and "_in_instances__locals__traverse" in functions and name[2].startswith("still"):
        return "InInstances"
    return None


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
    if all(types.is_shared(a.type) for a in arguments):
        return f"static {types.wide(result.type)} {name}({parameters}, lanes::Mask) {{ {function.native_snippet} }}\n"
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
