"""Adjoints of all functions below one that `wp.grad` differentiates, whoever has the module compiled.

Warp 1.19 generates an adjoint for that function and for functions first called below it. If the kernel has called a
function before, its adjoint is empty: it compiles, and derivatives are silently 0. For kernels that are differentiated
as a whole, Warp marks the callees again when it knows all calls. The same is done here from the functions of `wp.grad`.
"""

from typing import Any

from warp._src.context import ModuleBuilder


def complete_adjoints() -> None:
    """Have Warp generate them from now on, in the modules that call them and in no others."""
    if ModuleBuilder._propagate_used_by_backward_kernel is not _propagate:
        ModuleBuilder._propagate_used_by_backward_kernel = _propagate


_of_warp: Any = ModuleBuilder._propagate_used_by_backward_kernel


def _propagate(builder: Any) -> None:
    _of_warp(builder)
    remaining = [function.adj for function in builder.functions if function.adj.force_adjoint_codegen]
    while remaining:
        adjoint = remaining.pop()
        # A module built later resets the first mark, but not the second.
        adjoint.used_by_backward_kernel, adjoint.force_adjoint_codegen = True, False
        remaining += (f.adj for f in adjoint.called_user_functions if not f.adj.used_by_backward_kernel)
