"""What statements read, set and change, which variables outlive a loop, and which values all lanes share."""

from collections.abc import Iterable
from typing import Any

from wrt.spmd import ir


def uses(statements: Iterable[ir.Statement]) -> set[ir.Variable]:
    """Return the variables that statements read or set."""
    return {e for s in ir.walk(statements) for e in ir.own_expressions(s) if isinstance(e, ir.Variable)}


def set_by(s: ir.Statement) -> ir.Variable | None:
    """Return the variable that a statement sets, as a whole or in a member."""
    return s.variable if isinstance(s, (ir.Set, ir.Update)) else None


def through_pointer(e: ir.Expression) -> bool:
    """Return whether an expression reads or writes the target of an address."""
    address = (ir.Address, ir.MemberAddress, ir.ElementAddress)
    return any(isinstance(part, address) or ir.is_builtin(part, "address", "indexref") for part in ir.expressions(e))


def stores_into(s: ir.Statement) -> set[ir.Variable]:
    """Return the variables that a statement may store into through an address or an index."""
    if not isinstance(s, ir.Do) or not isinstance(s.call, ir.Builtin):
        return set()
    target = s.call.arguments[0]
    if isinstance(target, ir.Variable):
        return {target} if s.call.name.endswith("_inplace") else set()
    return {e for e in ir.expressions(target) if isinstance(e, ir.Variable)}


def changes(statements: Iterable[ir.Statement], v: ir.Variable) -> bool:
    """Return whether statements may change a variable."""
    return any(set_by(s) is v or v in stores_into(s) for s in ir.walk(statements))


def returns_once(function: ir.Function) -> bool:
    """Return whether a function returns a variable in its last line, and nowhere else."""
    returns = [s for s in ir.walk(function.body) if isinstance(s, ir.Return)]
    return bool(returns) and returns == function.body[-1:] and returns[0].value is not None


def constant_ranges(body: list[ir.Statement]) -> dict[ir.Variable, list[int]]:
    """Return the ranges of `for` loops with constant ends; such loops stay loops in C++."""
    found = {}
    for s in ir.walk(body):
        if isinstance(s, ir.Set) and isinstance(s.value, ir.Builtin) and s.value.name == "range":
            ends = [a.constant for a in s.value.arguments if isinstance(a, ir.Variable)]
            if None not in ends:
                found[s.variable] = ends
    return found


def range_of(s: ir.Statement) -> Any:
    """Return the range that a statement tests to continue a loop, if it does."""
    return s.condition.arguments[0] if isinstance(s, ir.Leave) and isinstance(s.condition, ir.Builtin) else None


def same_for_all(function: ir.Function, v: ir.Variable, before: list[ir.Statement]) -> bool:
    """Return whether a variable is set only `before` the loop over rounds of a path function, and from constants."""
    settings = [s for s in ir.walk(function.body) if set_by(s) is v]
    if not settings or not set(settings) <= set(before):
        return False
    statements = list(ir.walk(function.body))
    if changes(statements[statements.index(settings[-1]) + 1 :], v) or any(_stores_by(s, v) for s in statements):
        return False
    return all(u is v or u.constant is not None for s in settings for u in uses([s]))


def _stores_by(s: ir.Statement, v: ir.Variable) -> bool:
    """Return whether a statement stores to an address that depends on v."""
    if not isinstance(s, ir.Do) or not isinstance(s.call, ir.Builtin):
        return False
    return any(through_pointer(a) and v in ir.expressions(a) for a in s.call.arguments)


class Liveness:
    """Where the variables of a function are set, and which are needed for longer.

    Attributes:
        loops: The loops around each variable's first assignment, outermost first.
        outliving: Variables that are used after a loop in which they are set. Each lane keeps its value from when it
            left, so assignments to them are masked.
    """

    def __init__(self, body: list[ir.Statement]) -> None:
        """Take the statements of a function."""
        self.loops: dict[ir.Variable, tuple[str, ...]] = {}
        self.outliving: set[ir.Variable] = set()
        self._follow(body, ())

    def _follow(self, statements: list[ir.Statement], inside: tuple[str, ...]) -> None:
        for s in statements:
            for v in ir.expressions(s.value) if isinstance(s, ir.Set) else ir.own_expressions(s):
                loops = self.loops.get(v, ()) if isinstance(v, ir.Variable) else ()
                if inside[: len(loops)] != loops:
                    self.outliving.add(v)
            if isinstance(s, ir.Set):
                self.loops.setdefault(s.variable, inside)
            if isinstance(s, ir.If | ir.Loop):
                self._follow(s.body, (*inside, s.label) if isinstance(s, ir.Loop) else inside)
