"""Adjoint code for the modules that need it, and for no others.

Warp generates the adjoint of a function if one of the module's kernels is differentiated as a whole, or if the function
is marked. `wp.grad` marks the function that it differentiates, and those below that the kernel has not called before:
the adjoints of the others are empty, and derivatives silently 0. The marks stay, so that modules compiled later would
get adjoint code that they never call.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def adjoints_of(module: Any) -> Iterator[None]:
    """Mark all functions below `module.differentiated`, if it has that, while the module is compiled."""
    marked: dict[Any, None] = {}
    for function in getattr(module, "differentiated", ()):
        _collect(function, marked)
    _mark(marked, True)
    try:
        yield
    finally:
        _mark(marked, False)


def _mark(functions: dict[Any, None], is_marked: bool) -> None:
    for function in functions:
        function.adj.force_adjoint_codegen = is_marked


def _collect(function: Any, found: dict[Any, None]) -> None:
    """Add the overloads of a function and all functions that they refer to."""
    for overload in {function, *function.user_overloads.values()}:
        if overload not in found and not overload.is_builtin() and overload.adj is not None:
            found[overload] = None
            _, _, called = overload.adj.get_references()
            static = overload.adj.resolved_static_expressions.values()
            for each in (*called, *(value for value in static if isinstance(value, type(function)))):
                if not each.is_builtin():
                    _collect(each, found)
