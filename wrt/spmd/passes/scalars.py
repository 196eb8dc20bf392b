"""Scalar replacement: a variable for each member of a struct.

Whether a path stores a variable is decided for each variable. A state in one struct would be stored and moved as a
whole, with members that a scene never uses.
"""

from dataclasses import replace
from itertools import chain
from typing import Any

from warp._src.codegen import Struct, strip_reference

from wrt.spmd import ir
from wrt.spmd.types import name_of


def split_structs(function: ir.Function, structs: set[str]) -> ir.Function:
    """Return a function in which variables of the named structs are replaced by one for each member.

    Raises:
        Unsupported: Such a variable is used as a whole.
    """
    split = {v: _members(v) for v in function.variables if isinstance(v.type, Struct) and name_of(v.type) in structs}
    body = _split_all(function, function.body, split)
    variables = [list(split[v].values()) if v in split else [v] for v in function.variables]
    return replace(function, variables=list(chain(*variables)), body=body)


Split = dict[ir.Variable, dict[str, ir.Variable]]
"""The variables that are replaced, with the variables of their members."""


def _members(v: ir.Variable) -> dict[str, ir.Variable]:
    types = {label: strip_reference(member.type) for label, member in v.type.vars.items()}
    return {label: ir.Variable(f"{v.name}_{label}", t, name_of(t)) for label, t in types.items()}


def _split_all(function: ir.Function, statements: list[ir.Statement], split: Split) -> list[ir.Statement]:
    out = []
    for s in statements:
        for new in _of_members(s, split):
            new = ir.substituted(new, lambda e: _member_of(e, split))
            if isinstance(new, ir.If | ir.Loop):
                new.body = _split_all(function, new.body, split)
            elif whole := next((e for e in ir.own_expressions(new) if e in split), None):
                raise ir.Unsupported(
                    f"{function.key}: uses a {name_of(whole.type)} as a whole in `{s.line}`; as it is the state of an "
                    "@inline_stage, pass its members, or mark the function that takes it as well"
                )
            out.append(new)
    return out


def _of_members(s: ir.Statement, split: Split) -> list[ir.Statement]:
    """Return the assignments of members for a statement that sets a struct."""
    v = s.variable if isinstance(s, ir.Set | ir.Update) else None
    if v not in split or v is None:
        return [s]

    def of(e: Any, label: str) -> Any:
        return split[e][label] if e in split else e

    if isinstance(s, ir.Update) and s.fields:
        return [ir.Update(split[v][s.fields[0]], s.fields[1:], s.value, line=s.line)]
    if isinstance(s, ir.Update) and s.value in split:
        return [ir.Update(member, (), of(s.value, label), line=s.line) for label, member in split[v].items()]
    value = s.value if isinstance(s, ir.Set) else None
    if isinstance(value, ir.Zero):
        return [ir.Set(member, ir.Zero(member.type), line=s.line) for member in split[v].values()]
    if isinstance(value, ir.Builtin) and value.name in ("copy", "where"):
        return [
            ir.Set(member, ir.Builtin(value.name, tuple(of(a, label) for a in value.arguments)), line=s.line)
            for label, member in split[v].items()
        ]
    return [s]


def _member_of(e: Any, split: Split) -> Any:
    """Return the replacement of an expression that leads to a member."""
    if isinstance(e, ir.Address) and e.base in split:
        return ir.Address(split[e.base][e.fields[0]], e.fields[1:])
    if isinstance(e, ir.MemberAddress) and e.base in split:
        return ir.Address(split[e.base][e.field], ())
    if isinstance(e, ir.Builtin) and e.name == "load":
        target = e.arguments[0]
        if isinstance(target, ir.Address) and not target.fields:
            return ir.Builtin("copy", (target.base,))
    return e
