"""Copy propagation and dead code elimination.

Inlining and scalar replacement leave copies and dead code: each stage copies every member of the state, and members
that a scene never uses are passed from round to round.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

from wrt.spmd import ir
from wrt.spmd.analysis import set_by, stores_into, uses


def without_copies(function: ir.Function, pure: Collection[str] = ()) -> ir.Function:
    """Return a function with copies replaced by their sources, where both stay the same, and without dead code.

    Calls of `pure` functions, which do nothing but return a value, may be dead.
    """
    body = _set_once(_settled(function.body, set()))
    while found := _Order(body).replaceable():
        body = _set_once(_replaced(body, found))
    return _without_unused(replace(function, body=body), pure)


def _settled(body: list[ir.Statement], false: set[Any]) -> list[ir.Statement]:
    """Return statements in which a `where` whose condition is known to be false is a copy.

    `false` are such conditions. After an `if` that ends in a jump, its condition is false for all active lanes.
    """
    out = []
    copied: dict[Any, Any] = {}  # conditions are loaded again each time
    for s in body:
        value = s.value if isinstance(s, ir.Set) and isinstance(s.value, ir.Builtin) else ir.Builtin("", ())
        if (
            isinstance(s, ir.Set)
            and value.name == "where"
            and copied.get(value.arguments[0], value.arguments[0]) in false
        ):
            s = replace(s, value=ir.Builtin("copy", value.arguments[2:]))
        if isinstance(s, ir.If | ir.Loop):
            s = replace(s, body=_settled(s.body, false if isinstance(s, ir.If) else set()))
        leaves = isinstance(s, ir.If) and not s.negated and s.body and isinstance(s.body[-1], ir.Jump)
        false_after = {copied.get(s.condition, s.condition)} if isinstance(s, ir.If) and leaves else set()
        changed = {v for inner in ir.walk([s]) for v in (set_by(inner), *stores_into(inner))}
        false = false - changed | false_after
        copied = {v: of for v, of in copied.items() if v not in changed and of not in changed}
        if value.name == "copy" and isinstance(s, ir.Set):
            copied[s.variable] = copied.get(value.arguments[0], value.arguments[0])
        out.append(s)
    return out


def _set_once(body: list[ir.Statement]) -> list[ir.Statement]:
    """Return statements in which a variable that is zero until its first change is set by that change instead.

    Members of a struct that a stage makes are set like that. A change spares lanes that are elsewhere, which for a
    surface of sixteen lanes means 3,000 bytes; the first value of a variable need not.
    """
    # Lanes that leave a round between both keep what they had, which must not be used after the loop.
    outside = uses([s for s in body if not isinstance(s, ir.Loop)])
    return _set_once_in(body, outside, set())


def _set_once_in(body: list[ir.Statement], outside: set[Any], earlier: set[Any]) -> list[ir.Statement]:
    """Return such statements; zeros of variables of `earlier` statements may matter in the next round."""
    out: list[ir.Statement | None] = []
    zeros: dict[Any, int] = {}  # where variables were made zero that nothing has used since
    for s in body:
        if isinstance(s, ir.If | ir.Loop):
            s = replace(s, body=_set_once_in(s.body, outside, set(earlier)))
        inner = list(ir.walk([s]))
        if isinstance(s, ir.Update) and not s.fields and s.variable in zeros and s.value is not s.variable:
            out[zeros[s.variable]] = None
            s = ir.Set(s.variable, ir.Builtin("copy", (s.value,)), line=s.line)
        touched = {e for one in inner for e in (*ir.own_expressions(one), set_by(one)) if isinstance(e, ir.Variable)}
        if any(isinstance(one, ir.Jump | ir.Leave) for one in inner):
            touched |= outside
        zeros = {v: at for v, at in zeros.items() if v not in touched}
        if isinstance(s, ir.Set) and isinstance(s.value, ir.Zero) and s.variable not in earlier:
            zeros[s.variable] = len(out)
        earlier |= touched
        out.append(s)
    return [s for s in out if s is not None]


class _Order:
    """Where variables are set and used, by the numbers of statements in order.

    It also has the loops around each statement and the block that contains it.
    """

    def __init__(self, body: list[ir.Statement]) -> None:
        self._all: list[tuple[ir.Statement, tuple[str, ...], int]] = []
        self._ends: dict[tuple[str, ...], tuple[int, int]] = {}  # for each loop, its last statement and its block
        self._add(body, ())
        self._changes: dict[ir.Variable, list[int]] = {}
        self._users: dict[ir.Variable, list[int]] = {}
        for i, (s, *_) in enumerate(self._all):
            for v in {e for e in ir.own_expressions(s) if isinstance(e, ir.Variable)}:
                self._users.setdefault(v, []).append(i)
            for changed in {set_by(s), *stores_into(s)}:
                if changed is not None:
                    self._changes.setdefault(changed, []).append(i)

    def _add(self, body: list[ir.Statement], loops: tuple[str, ...]) -> None:
        for s in body:
            self._all.append((s, loops, id(body)))
            if isinstance(s, ir.Loop):
                inside = (*loops, s.label)
                self._add(s.body, inside)
                self._ends[inside] = (len(self._all) - 1, id(s.body))
            elif isinstance(s, ir.If):
                self._add(s.body, loops)

    def replaceable(self) -> dict[ir.Variable, ir.Variable]:
        """Return copies that can be replaced in one step, so no copy is the source of another."""
        found: dict[ir.Variable, ir.Variable] = {}
        for v, changes in self._changes.items():
            source = _copied_from(self._all[changes[0]][0])
            if source is None or source is v or source.ctype != v.ctype:
                continue
            if {v, source} & {*found, *found.values()}:
                continue
            if (len(changes) == 1 and self._stays(v, source)) or self._takes_over(v, source):
                found[v] = source
        return found

    def _stays(self, v: ir.Variable, source: ir.Variable) -> bool:
        """Return whether the source of a copy is unchanged wherever the copy is used."""
        at = self._changes[v][0]
        loops = self._all[at][1]
        for user in self._users[v]:
            deeper = self._all[user][1]
            if user < at or deeper[: len(loops)] != loops:
                return False
            for change in self._changes.get(source, ()):
                statement, inside, _ = self._all[change]
                same_inner_loop = len(deeper) > len(loops) and deeper[: len(loops) + 1] == inside[: len(loops) + 1]
                if not _gives_back(statement, v) and (at < change < user or same_inner_loop):
                    return False
        return True

    def _takes_over(self, v: ir.Variable, source: ir.Variable) -> bool:
        """Return whether a copy can share its source's variable.

        This holds if the source is set before the copy in the same round and not used after it; or if after the copy
        the source only takes the copy's value back, and does so on each way out of the round.
        """
        at = self._changes[v][0]
        loops = self._all[at][1]
        if len(loops) != 1 or any(u < at or self._all[u][1][:1] != loops for u in self._users[v]):
            return False
        end, block = self._ends[loops]
        later = [i for i in self._users[source] if at < i]
        if not later:
            first = self._changes.get(source, [end])[0]
            return first < at and self._all[first][1] == loops
        later = [i for i in later if i <= end]
        if not all(_gives_back(self._all[i][0], v) for i in later):
            return False
        exits = [
            (i, of)
            for i, (s, inside, of) in enumerate(self._all)
            if at <= i <= end and isinstance(s, ir.Jump) and inside == loops
        ]
        return all(
            any(i <= out and self._all[i][2] == of and not any(i < k <= out for k in self._changes[v]) for i in later)
            for out, of in [*exits, (end, block)]
        )


def _copied_from(s: ir.Statement) -> ir.Variable | None:
    """Return the variable that a statement copies, if it does."""
    value: Any = s.value if isinstance(s, ir.Set) and not s.variable.is_pointer else None
    if isinstance(value, ir.Builtin) and value.name in ("copy", "where"):
        sources = set(value.arguments[-2:])
        value = sources.pop() if len(sources) == 1 else None
    return value if isinstance(value, ir.Variable) and value.constant is None else None


def _gives_back(s: ir.Statement, v: ir.Variable) -> bool:
    return isinstance(s, ir.Update) and not s.fields and s.value is v


def _replaced(body: list[ir.Statement], found: dict[ir.Variable, ir.Variable]) -> list[ir.Statement]:
    def change(s: ir.Statement) -> list[ir.Statement]:
        if isinstance(s, ir.Set) and found.get(s.variable) is not None and found[s.variable] is _copied_from(s):
            return []
        s = ir.substituted(s, lambda e: found.get(e, e) if isinstance(e, ir.Variable) else e)
        return [] if isinstance(s, ir.Update) and _gives_back(s, s.variable) else [s]

    return ir.rebuilt(body, change)


def _without_unused(function: ir.Function, pure: Collection[str]) -> ir.Function:
    """Return a function without dead statements and unused variables."""
    read: set[ir.Variable] = set()
    count = -1
    while count != len(read):
        count = len(read)
        body = _live(function.body, read, pure)
    used = uses(body)
    variables = [v for v in function.variables if v in used]
    return replace(function, variables=variables, body=body)


def _live(body: list[ir.Statement], read: set[ir.Variable], pure: Collection[str]) -> list[ir.Statement]:
    """Return the statements with an effect or that set `read` variables, and add the variables that these read."""
    out = []
    for s in reversed(body):
        if isinstance(s, ir.If | ir.Loop):
            inner = _live(s.body, read, pure)
            if not inner:
                continue
            s = replace(s, body=inner)
        elif isinstance(s, ir.Set | ir.Update) and s.variable not in read and not _has_effect(s.value, pure):
            continue
        read.update(e for e in ir.own_expressions(s) if isinstance(e, ir.Variable))
        out.append(s)
    return out[::-1]


def _has_effect(e: ir.Expression, pure: Collection[str]) -> bool:
    return (isinstance(e, ir.Call) and e.function not in pure) or ir.is_builtin(e, "iter_next", "atomic_add")
