"""The intermediate form of a kernel's functions: a tree of statements over typed variables.

`parse.py` makes this tree from Warp's plain statements, labels and `goto`s, and `emit.py` writes it as C++ for several
lanes.
"""

import functools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any


class Unsupported(Exception):
    """A kernel uses something that the translator does not support."""


@dataclass(frozen=True, eq=False, slots=True)
class Variable:
    """A variable of a function.

    Attributes:
        name: Its name in C++.
        type: Warp's type; for a pointer, that of its target.
        ctype: The type in Warp's C++.
        constant: Its value if it is a constant, else None.
    """

    name: str
    type: Any
    ctype: str
    constant: Any = None

    @property
    def is_pointer(self) -> bool:
        """Whether it points into another variable; its uses are replaced by its target."""
        return self.ctype.endswith("*")


@dataclass(frozen=True, eq=False, slots=True)
class Literal:
    """A number in Warp's text."""

    text: str


@dataclass(frozen=True, eq=False, slots=True)
class Address:
    """The address of a member: `&((base).field)`."""

    base: Variable
    fields: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class MemberAddress:
    """The address of a member of a call's result, or of an expression that is an address itself: `&(base->field)`."""

    base: "Expression"
    field: str


@dataclass(frozen=True, eq=False, slots=True)
class ElementAddress:
    """The address of a member of an array's element: `&((*wp::address((base).array, index)).field)`."""

    base: Variable
    array: tuple[str, ...]
    index: Variable
    field: str


@dataclass(frozen=True, eq=False, slots=True)
class Builtin:
    """A call of one of Warp's own functions, such as `wp::add`; "tid" is the thread's index."""

    name: str
    arguments: tuple["Expression", ...]


@dataclass(frozen=True, eq=False, slots=True)
class Call:
    """A call of another function of the module."""

    function: str
    arguments: tuple[Variable, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Zero:
    """A zero of a type, or a struct of zeros."""

    type: Any


@dataclass(frozen=True, eq=False, slots=True)
class Compose:
    """A vector ("vec") or a matrix ("mat") made of elements of the type `number`."""

    container: str
    size: str
    number: str
    arguments: tuple["Expression", ...]


@dataclass(frozen=True, eq=False, slots=True)
class Operation:
    """A comparison of two variables, or `&&` or `||`."""

    operator: str
    left: Variable
    right: Variable


Expression = Variable | Literal | Address | MemberAddress | ElementAddress | Builtin | Call | Zero | Compose | Operation


@dataclass(eq=False, slots=True, kw_only=True)
class Statement:
    """Any statement; for messages, `line` is Warp's text, `number` the line's number, and `source` says where it is."""

    line: str = ""
    number: int = -1
    source: str = ""


@dataclass(eq=False, slots=True)
class Set(Statement):
    """The first, and usually only, assignment to a variable."""

    variable: Variable
    value: Expression


@dataclass(eq=False, slots=True)
class Update(Statement):
    """A later assignment to a variable, or to one of its members."""

    variable: Variable
    fields: tuple[str, ...]
    value: Variable


@dataclass(eq=False, slots=True)
class Do(Statement):
    """A call for its effect: a store, or a function without a result."""

    call: Builtin | Call


@dataclass(eq=False, slots=True)
class If(Statement):
    """Statements that are executed if a condition holds, or if it does not (`negated`)."""

    condition: Expression
    negated: bool
    body: "list[Statement]" = field(default_factory=list)


@dataclass(eq=False, slots=True)
class Loop(Statement):
    """An endless loop; a `Leave` in it ends it.

    `is_of_stage` tells those of built-in stages from the loops of the function in which they were inlined.
    """

    label: str
    body: "list[Statement]" = field(default_factory=list)
    is_of_stage: bool = False


@dataclass(eq=False, slots=True)
class Leave(Statement):
    """Leave the loop unless a condition holds: a variable, or a range's test `Builtin("iter_cmp", ...)`."""

    loop: str
    condition: Expression


@dataclass(eq=False, slots=True)
class Jump(Statement):
    """A `break` ("end") or `continue` ("start")."""

    kind: str
    loop: str


@dataclass(eq=False, slots=True)
class Return(Statement):
    """The end of the function for the active lanes; in an adjoint function, of its first part (`label`)."""

    value: Variable | None
    label: str = ""


@dataclass(eq=False, slots=True)
class Verbatim(Statement):
    """C++ inserted by a pass."""

    code: str


@dataclass(eq=False, slots=True)
class Function:
    """A function or kernel of a module.

    Attributes:
        key: Its name in Python.
        name: Its name in C++; empty for a kernel.
        arguments: Its arguments.
        variables: All other variables, including constants.
        body: Its statements.
        marks: Its marks; see `kernels/core/spmd_marks.py`.
        result: The type of its result, or None.
        is_from_outside: Whether it is a user's; it may call Warp's functions with any types.
    """

    key: str
    name: str
    arguments: list[Variable]
    variables: list[Variable]
    body: list[Statement]
    marks: frozenset[str]
    result: Any = None
    is_from_outside: bool = False


class Module:
    """The functions of a module by their C++ names, and their marks."""

    def __init__(self, functions: list[Function]) -> None:
        """Take the functions."""
        self.functions = {f.name: f for f in functions}

    def marked(self, mark: str) -> set[str]:
        """Return the names of functions with a mark."""
        return {name for name, f in self.functions.items() if mark in f.marks}

    @functools.cache  # noqa: B019  # a module lives as long as one translation
    def pure(self) -> frozenset[str]:
        """Return the names of functions that do nothing but return a value."""
        found = {name for name, f in self.functions.items() if f.body and not any(map(_has_effect, walk(f.body)))}
        while impure := {name for name in found if not set(calls(self.functions[name].body)) <= found}:
            found -= impure
        return frozenset(found)

    def calls(self, s: Statement, mark: str) -> bool:
        """Return whether a statement, or a nested one, calls a function with a mark."""
        return not self.marked(mark).isdisjoint(calls([s]))


def _has_effect(s: Statement) -> bool:
    is_local = isinstance(s, Do) and isinstance(s.call, Builtin) and s.call.name.endswith("_inplace")
    is_local &= isinstance(s, Do) and isinstance(s.call.arguments[0], Variable)
    return (isinstance(s, Do) and not is_local) or any(is_builtin(e, "atomic_add") for e in own_expressions(s))


def _fields(e: Any) -> Iterable[str]:
    # `dataclasses.fields` took a sixth of the translation.
    names: Iterable[str] = e.__dataclass_fields__
    return names


def expressions(e: Any) -> Iterator[Any]:
    """Yield an expression and all its subexpressions."""
    yield e
    for name in _fields(e) if not isinstance(e, Variable) else ():
        value = getattr(e, name)
        for part in value if isinstance(value, tuple) else (value,):
            if hasattr(part, "__dataclass_fields__"):
                yield from expressions(part)


def own_expressions(s: Statement) -> Iterator[Any]:
    """Yield all expressions of a statement, without those of statements in its body."""
    for name in _fields(s):
        value = getattr(s, name)
        if hasattr(value, "__dataclass_fields__"):
            yield from expressions(value)


def walk(statements: Iterable[Statement]) -> Iterator[Statement]:
    """Yield statements and all nested ones, in order."""
    for s in statements:
        yield s
        if isinstance(s, (If, Loop)):
            yield from walk(s.body)


def substituted(s: Any, change: Callable[[Any], Any]) -> Any:
    """Return a statement or an expression with `change` applied to its expressions, innermost first.

    The body of an `if` or a loop is unchanged.
    """
    if isinstance(s, Variable) or not hasattr(s, "__dataclass_fields__"):
        return change(s)
    parts = {name: getattr(s, name) for name in _fields(s)}
    for name, value in parts.items():
        if isinstance(value, tuple):
            parts[name] = tuple(substituted(part, change) for part in value)
        elif hasattr(value, "__dataclass_fields__"):
            parts[name] = substituted(value, change)
    new = type(s)(**parts)
    return new if isinstance(s, Statement) else change(new)


def rebuilt(body: list[Statement], change: Callable[[Statement], Iterable[Statement]]) -> list[Statement]:
    """Return statements, each replaced by the results of `change`; so are those in the bodies of the results."""
    results = (new for s in body for new in change(s))
    return [replace(s, body=rebuilt(s.body, change)) if isinstance(s, (If, Loop)) else s for s in results]


def calls(statements: Iterable[Statement]) -> Iterator[str]:
    """Yield the names of the module's functions that statements call."""
    for s in walk(statements):
        yield from (e.function for e in own_expressions(s) if isinstance(e, Call))


def is_builtin(e: Any, *names: str) -> bool:
    """Return whether an expression is a call of one of Warp's functions with these names."""
    return isinstance(e, Builtin) and e.name in names
