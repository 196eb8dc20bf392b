"""Which variables statements read, set and change, and which outlive the loop in which they are set."""

from collections.abc import Iterable

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
    return any(isinstance(part, address) or _is_element(part) for part in ir.expressions(e))


def _is_element(e: ir.Expression) -> bool:
    return isinstance(e, ir.Builtin) and e.name in ("address", "indexref")


def stores_into(s: ir.Statement) -> set[ir.Variable]:
    """Return the variables that a statement may store into through an address or an index."""
    if not isinstance(s, ir.Do) or not isinstance(s.call, ir.Builtin):
        return set()
    target = s.call.arguments[0]
    if isinstance(target, ir.Variable):
        return {target} if s.call.name == "assign_inplace" else set()
    return {e for e in ir.expressions(target) if isinstance(e, ir.Variable)}


def changes(statements: Iterable[ir.Statement], v: ir.Variable) -> bool:
    """Return whether statements may change a variable."""
    return any(set_by(s) is v or v in stores_into(s) for s in ir.walk(statements))


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
            first = s.variable if isinstance(s, ir.Set) else None
            read = s.value if isinstance(s, ir.Set) else s
            for v in ir.expressions(read) if isinstance(s, ir.Set) else ir.own_expressions(s):
                loops = self.loops.get(v, ()) if isinstance(v, ir.Variable) else ()
                if inside[: len(loops)] != loops:
                    self.outliving.add(v)
            if first is not None:
                self.loops.setdefault(first, inside)
            if hasattr(s, "body"):
                self._follow(s.body, (*inside, s.label) if isinstance(s, ir.Loop) else inside)
