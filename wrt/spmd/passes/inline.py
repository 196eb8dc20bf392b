"""Inlining of the stages of a path function.

Stages are functions that take the state of a path and return it. A call would pass the whole state; inlined, a part of
a round touches only the members that it uses.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import count

from wrt.spmd import ir
from wrt.spmd.passes.copies import without_copies
from wrt.spmd.passes.demands import Module
from wrt.spmd.passes.scalars import split_structs
from wrt.spmd.passes.uses import changes
from wrt.spmd.types import name_of


def without_stages(function: ir.Function, module: Module) -> ir.Function:
    """Return a function with the stages that it calls, directly or through stages, inlined.

    The state, a struct that stages take and return, is replaced by a variable for each member, as is any other struct
    that a stage returns if it is used member by member.

    Raises:
        Unsupported: A stage returns before its end, or the state is used as a whole.
    """
    stages = module.marked("inline_stage")
    if stages.isdisjoint(ir.calls(function.body)):
        return function
    variables = list(function.variables)
    body = list(_inlined(function.body, stages, module, variables, count(1)))
    function = replace(function, variables=variables, body=body)
    states: set[str] = set()
    results: set[str] = set()
    for stage in map(module.functions.__getitem__, stages):
        takes = {name_of(a.type) for a in stage.arguments}
        (states if name_of(stage.result) in takes else results).add(name_of(stage.result))
    function = split_structs(function, states)
    for result in sorted(results - states):
        with suppress(ir.Unsupported):
            function = split_structs(function, {result})
    return without_copies(function)


def _inlined(
    body: list[ir.Statement], stages: set[str], module: Module, variables: list[ir.Variable], numbers: Iterator[int]
) -> Iterator[ir.Statement]:
    for s in body:
        call = s.value if isinstance(s, ir.Set) else None
        if isinstance(call, ir.Call) and call.function in stages:
            stage = module.functions[call.function]
            statements = _copied(stage, s, call, variables, next(numbers))
            yield from _inlined(statements, stages, module, variables, numbers)
        elif isinstance(s, ir.If | ir.Loop):
            yield replace(s, body=list(_inlined(s.body, stages, module, variables, numbers)))
        else:
            yield s


def _copied(
    stage: ir.Function, s: ir.Statement, call: ir.Call, variables: list[ir.Variable], number: int
) -> list[ir.Statement]:
    """Return the statements of a stage with variables of its own, which end with the assignment of its result."""
    returns = [inner for inner in ir.walk(stage.body) if isinstance(inner, ir.Return)]
    if returns != stage.body[-1:] or returns[0].value is None:
        raise ir.Unsupported(f"{stage.key}: must return once, its state, in its last line, as an @inline_stage")

    def own(v: ir.Variable) -> ir.Variable:
        variables.append(replace(v, name=f"{v.name}_{number}"))
        return variables[-1]

    into: dict[ir.Variable, ir.Variable] = {v: own(v) for v in stage.variables}
    first: list[ir.Statement] = []
    for parameter, given in zip(stage.arguments, call.arguments, strict=True):
        if changes(stage.body, parameter):
            into[parameter] = own(parameter)
            first.append(ir.Set(into[parameter], ir.Builtin("copy", (given,)), line=s.line))
        else:
            into[parameter] = given
    labels = {loop.label: f"{loop.label}_{number}" for loop in ir.walk(stage.body) if isinstance(loop, ir.Loop)}

    def anew(inner: ir.Statement) -> ir.Statement:
        inner = ir.substituted(inner, lambda e: into.get(e, e) if isinstance(e, ir.Variable) else e)
        if isinstance(inner, ir.Loop):
            inner.label = labels[inner.label]
        if isinstance(inner, ir.Leave | ir.Jump):
            inner.loop = labels[inner.loop]
        if isinstance(inner, ir.If):
            inner.number = 10_000 * number + inner.number  # masks are named by it
        if isinstance(inner, ir.If | ir.Loop):
            inner.body = list(map(anew, inner.body))
        return inner

    assert isinstance(s, ir.Set)
    result = ir.Set(s.variable, ir.Builtin("copy", (into[returns[0].value],)), line=s.line)
    return [*first, *map(anew, stage.body[:-1]), result]
