"""Uniform values: constant ranges, and variables that depend on constants alone."""

from wrt.spmd import ir
from wrt.spmd.passes.uses import changes, set_by, through_pointer, uses


def known_ranges(body: list[ir.Statement]) -> dict[ir.Variable, list[int]]:
    """Return the ranges of `for` loops with constant ends; such loops stay loops in C++."""
    found = {}
    for s in ir.walk(body):
        if isinstance(s, ir.Set) and isinstance(s.value, ir.Builtin) and s.value.name == "range":
            ends = [a.constant for a in s.value.arguments if isinstance(a, ir.Variable)]
            if None not in ends:
                found[s.variable] = ends
    return found


def same_for_all(function: ir.Function, v: ir.Variable, before: list[ir.Statement]) -> bool:
    """Return whether a variable is set only before the loop over rounds, and from constants.

    Args:
        function: The path function.
        v: The variable.
        before: The statements before the loop.
    """
    settings = [s for s in ir.walk(function.body) if set_by(s) is v]
    if not settings or not set(settings) <= set(before):
        return False
    everything = list(ir.walk(function.body))
    if changes(everything[everything.index(settings[-1]) + 1 :], v) or any(_stores_by(s, v) for s in everything):
        return False
    return all(u is v or u.constant is not None for s in settings for u in uses([s]))


def _stores_by(s: ir.Statement, v: ir.Variable) -> bool:
    """Return whether a statement stores to an address that depends on v."""
    if not isinstance(s, ir.Do) or not isinstance(s.call, ir.Builtin):
        return False
    return any(through_pointer(a) and v in ir.expressions(a) for a in s.call.arguments)
