"""Inlining of the stages of a path function, and a variable for each member of the state that they pass on.

Stages are functions that take the state of a path and return it. A call would pass the whole state, and a path would
store and move it as a whole, with members that a scene never uses. Inlined and split, each member is stored only where
it is needed.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import count
from typing import Any

from warp._src.codegen import Struct, strip_reference

from wrt.spmd import ir
from wrt.spmd.analysis import changes, returns_once
from wrt.spmd.copies import without_copies
from wrt.spmd.types import name_of

Split = dict[ir.Variable, dict[str, ir.Variable]]
"""The variables that are replaced, with the variables of their members."""


def without_stages(function: ir.Function, module: ir.Module, *, splits_all: bool = True) -> ir.Function:
    """Return a function with the stages that it calls, directly or through stages, inlined.

    The state, a struct that stages take and return, is replaced by a variable for each member, as is any other struct
    that a stage returns if it is used member by member.

    Args:
        function: The function.
        module: The functions that it may call.
        splits_all: Whether the state must be replaced, as for a path function. Otherwise it is replaced wherever
            possible, and calls whose results nothing uses are left out.

    Raises:
        Unsupported: A stage returns before its end, or the state is used as a whole although it must not be.
    """
    stages = module.marked("inline_stage")
    if stages.isdisjoint(ir.calls(function.body)):
        return function
    variables = list(function.variables)
    numbers = count(1)
    is_from_outside = function.is_from_outside

    def inlined(s: ir.Statement) -> Iterator[ir.Statement]:
        nonlocal is_from_outside
        call = s.value if isinstance(s, ir.Set) else None
        if isinstance(s, ir.Set) and isinstance(call, ir.Call) and call.function in stages:
            stage = module.functions[call.function]
            is_from_outside |= stage.is_from_outside
            for copied in _copied(stage, s, call, variables, next(numbers)):
                yield from inlined(copied)
        else:
            yield s

    body = ir.rebuilt(function.body, inlined)
    function = replace(function, body=body, variables=variables, is_from_outside=is_from_outside)
    states: set[str] = set()
    results: set[str] = set()
    for stage in map(module.functions.__getitem__, stages):
        arguments = {name_of(a.type) for a in stage.arguments}
        (states if name_of(stage.result) in arguments else results).add(name_of(stage.result))
    if splits_all:
        function = split_structs(function, states)
        results -= states
    for result in sorted(results | (set() if splits_all else states)):
        with suppress(ir.Unsupported):
            function = split_structs(function, {result})
    return without_copies(function, pure=() if splits_all else module.pure())


def _copied(
    stage: ir.Function, s: ir.Set, call: ir.Call, variables: list[ir.Variable], number: int
) -> list[ir.Statement]:
    """Return the statements of a stage with variables of its own, which end with the assignment of its result."""
    if not returns_once(stage):
        raise ir.Unsupported(f"{stage.key}: must return once, its state, in its last line, as an @inline_stage")

    def renamed(v: ir.Variable) -> ir.Variable:
        variables.append(replace(v, name=f"{v.name}_{number}"))
        return variables[-1]

    into: dict[ir.Variable, ir.Variable] = {v: renamed(v) for v in stage.variables}
    first: list[ir.Statement] = []
    for parameter, argument in zip(stage.arguments, call.arguments, strict=True):
        if changes(stage.body, parameter):
            into[parameter] = renamed(parameter)
            first.append(ir.Set(into[parameter], ir.Builtin("copy", (argument,)), line=s.line))
        else:
            into[parameter] = argument
    labels = {loop.label: f"{loop.label}_{number}" for loop in ir.walk(stage.body) if isinstance(loop, ir.Loop)}

    def copy(inner: ir.Statement) -> ir.Statement:
        inner = ir.substituted(inner, lambda e: into.get(e, e) if isinstance(e, ir.Variable) else e)
        if isinstance(inner, ir.Loop):
            inner.label, inner.is_of_stage = labels[inner.label], inner.is_of_stage or not stage.is_from_outside
        if isinstance(inner, ir.Leave | ir.Jump):
            inner.loop = labels[inner.loop]
        if isinstance(inner, ir.If):
            inner.number = 10_000 * number + inner.number  # masks are named by it
        if isinstance(inner, ir.If | ir.Loop):
            inner.body = list(map(copy, inner.body))
        return inner

    end = stage.body[-1]
    assert isinstance(end, ir.Return)
    assert end.value is not None
    result = ir.Set(s.variable, ir.Builtin("copy", (into[end.value],)), line=s.line)
    return [*first, *map(copy, stage.body[:-1]), result]


def split_structs(function: ir.Function, structs: set[str]) -> ir.Function:
    """Return a function in which variables of the named structs are replaced by one for each member.

    Raises:
        Unsupported: Such a variable is used as a whole.
    """
    split: Split = {}
    for v in function.variables:
        if isinstance(v.type, Struct) and name_of(v.type) in structs:
            types = {label: strip_reference(member.type) for label, member in v.type.vars.items()}
            split[v] = {label: ir.Variable(f"{v.name}_{label}", t, name_of(t)) for label, t in types.items()}
    variables = [member for v in function.variables for member in (split[v].values() if v in split else [v])]

    def by_members(s: ir.Statement) -> Iterator[ir.Statement]:
        if isinstance(s, ir.Set) and s.variable.is_pointer:
            return  # its uses have its target
        for new in _of_members(s, split):
            new = ir.substituted(new, lambda e: _member_of(e, split))
            if state := next((e for e in ir.own_expressions(new) if e in split), None):
                raise ir.Unsupported(
                    f"{function.key}: uses a {name_of(state.type)} as a whole in `{s.line}`; as it is the state of an "
                    "@inline_stage, pass its members, or mark the function that takes it as well"
                )
            yield new

    return replace(function, variables=variables, body=ir.rebuilt(function.body, by_members))


def _of_members(s: ir.Statement, split: Split) -> list[ir.Statement]:
    """Return the assignments of members for a statement that sets a struct."""
    if isinstance(s, ir.Update) and s.fields and s.variable not in split and s.value in split:
        return [ir.Update(s.variable, (*s.fields, label), v, line=s.line) for label, v in split[s.value].items()]
    if not isinstance(s, ir.Set | ir.Update) or s.variable not in split:
        return [s]
    members, value = split[s.variable], s.value

    def member(e: Any, label: str) -> Any:
        return split[e][label] if e in split else e

    if isinstance(s, ir.Update):
        if s.fields:
            return [ir.Update(members[s.fields[0]], s.fields[1:], s.value, line=s.line)]
        if s.value in split:
            return [ir.Update(v, (), member(value, label), line=s.line) for label, v in members.items()]
    elif isinstance(value, ir.Zero):
        return [ir.Set(v, ir.Zero(v.type), line=s.line) for v in members.values()]
    elif isinstance(value, ir.Builtin) and value.name in ("copy", "where"):
        return [
            ir.Set(v, ir.Builtin(value.name, tuple(member(a, label) for a in value.arguments)), line=s.line)
            for label, v in members.items()
        ]
    return [s]


def _member_of(e: Any, split: Split) -> Any:
    """Return the replacement of an expression that leads to a member."""
    if isinstance(e, ir.Address) and e.base in split and e.fields:
        return ir.Address(split[e.base][e.fields[0]], e.fields[1:])
    if isinstance(e, ir.MemberAddress) and isinstance(e.base, ir.Address) and not e.base.fields:
        e = ir.MemberAddress(e.base.base, e.field)
    if isinstance(e, ir.MemberAddress) and e.base in split:
        return ir.Address(split[e.base][e.field], ())
    if isinstance(e, ir.Builtin) and e.name == "load":
        target = e.arguments[0]
        if isinstance(target, ir.Address) and not target.fields:
            return ir.Builtin("copy", (target.base,))
    return e
