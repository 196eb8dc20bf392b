"""Translate a module of PTX to C++: for each kernel, a function that runs a range of its threads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from support.emulated_cuda.operands import Operands, name_of, unsigned
from support.emulated_cuda.operations import TOGETHER, translate
from support.emulated_cuda.ptx import (
    Brace,
    Entry,
    Instruction,
    Label,
    Module,
    NotTranslated,
    Registers,
    Statement,
    Variable,
    bits_of,
)

PRELUDE, LANES = ((Path(__file__).parent / name).read_text(encoding="utf-8") for name in ("prelude.h", "lanes.h"))

_THREAD = "char* const* P, char* shared, const u32 tid_x, const u32 ntid_x, const u32 ctaid_x, const u32 nctaid_x"


def to_cpp(module: Module) -> str:
    """Return a module as C++.

    Each kernel becomes `void NAME(char* const* P, u64 first, u64 last, u32 block, u32 blocks)`, which runs the threads
    `first` to last − 1 of a grid of `blocks` blocks of `block` threads, one after the other or, where they wait for one
    another, a warp after the other. P has the addresses of the arguments.

    Raises:
        NotTranslated: listing everything in it that the emulator does not know.
    """
    addresses, shared, out = {}, 0, [PRELUDE, LANES]
    used = {op for entry in (*module.functions, *module.entries) for op in _names(entry.body)}
    for variable in module.variables:
        if variable.space == "shared":
            shared = -(-shared // variable.align) * variable.align
            addresses[variable.name] = str(shared)
            shared += variable.size
        elif variable.name in used:
            out.append(_variable(variable))
            addresses[variable.name] = f"(u64){name_of(variable.name)}"
    unknown: list[str] = []
    functions = {function.name: function for function in module.functions}
    out += [f"static void {name_of(name)}_called(char*, {_THREAD});" for name in sorted(functions)]
    for entry in (*module.functions, *module.entries):
        out += _entry(entry, addresses, shared, functions, unknown)
    if unknown:
        raise NotTranslated(", ".join(dict.fromkeys(unknown)))
    return "\n".join(out) + "\n"


def _names(body: tuple[Statement, ...]) -> Iterator[str]:
    """Yield the names in operands, of variables among others."""
    for statement in body:
        if isinstance(statement, Instruction):
            for operand in statement.operands:
                yield operand.strip("[]").partition("+")[0]


def _variable(variable: Variable) -> str:
    kind = unsigned(bits_of(variable.kind))
    values = [f"({kind}){_constant(value, variable.kind)}" for value in variable.values]
    start = f" = {{{', '.join(values)}}}" if values else ""
    count = 1 if variable.count is None else variable.count
    return f"alignas({variable.align}) static {kind} {name_of(variable.name)}[{count}]{start};"


def _constant(value: str, kind: str) -> str:
    return Operands({}).value(value, "u" + kind[1:] if kind[0] in "fb" else kind)


def _entry(
    entry: Entry,
    addresses: dict[str, str],
    shared: int,
    functions: Mapping[str, Entry],
    unknown: list[str],
) -> Iterator[str]:
    """Yield a function, or for a kernel the functions of one thread and of many; add to `unknown`."""
    name = name_of(entry.name)
    parameters = {name: f"(u64)P[{i}]" for i, name in enumerate(entry.parameters)}
    operands = Operands({**addresses, **parameters, **dict.fromkeys(entry.results, "(u64)R")})
    operands.functions = frozenset(functions)
    for statement in entry.body:
        if isinstance(statement, Variable) and statement.space == "shared":
            shared = -(-shared // statement.align) * statement.align
            operands.addresses[statement.name] = str(shared)
            shared += statement.size
    called = entry.name in functions
    persistent: dict[int, Registers | Variable] = {}
    if not called and _waits(entry):
        operands.stops, persistent = 0, _persistent(entry)
        yield from _waiting_thread(entry, list(persistent.values()), operands)
    else:
        yield (
            f"static void {name}_called(char* R, {_THREAD}) {{"
            if called
            else f"static void {name}_thread({_THREAD}) {{"
        )
    for place, statement in enumerate(entry.body):
        if place in persistent:
            continue
        try:
            yield _statement(statement, operands)
        except NotTranslated as error:
            unknown.append(str(error))
    yield "}"
    if operands.stops is not None:
        yield f"""extern "C" void {name}(char* const* P, u64 first, u64 last, u32 block, u32 blocks) {{
    alignas(64) char shared[{max(shared, 1)}];
    {name}_lane lanes[32];
    for (u64 i = first & ~31ull; i < last; i += 32) {{
        u32 there = 0;
        for (u32 k = 0; k < 32; ++k) there |= (first <= i + k && i + k < last) << k;
        run_warp(lanes, there, [&]({name}_lane& lane, const u32 k) {{
            {name}_thread(lane, P, shared, (i + k) % block, block, (i + k) / block, blocks);
        }});
    }}
}}"""
    elif not called:
        yield f"""extern "C" void {name}(char* const* P, u64 first, u64 last, u32 block, u32 blocks) {{
    alignas(64) char shared[{max(shared, 1)}];
    for (u64 i = first; i < last; ++i) {name}_thread(P, shared, i % block, block, i / block, blocks);
}}"""


def _waits(entry: Entry) -> bool:
    return any(isinstance(s, Instruction) and s.opcode[0] in TOGETHER for s in entry.body)


def _persistent(entry: Entry) -> dict[int, Registers | Variable]:
    """Return the declarations of what a thread keeps while it waits, by their places: all outside of inner blocks."""
    found: dict[int, Registers | Variable] = {}
    depth = 0
    for place, s in enumerate(entry.body):
        if isinstance(s, Brace):
            depth += 1 if s.text == "{" else -1
        elif depth == 0 and (isinstance(s, Registers) or (isinstance(s, Variable) and s.space == "local")):
            found[place] = s
    return found


def _waiting_thread(entry: Entry, persistent: list[Registers | Variable], operands: Operands) -> Iterator[str]:
    """Yield a struct of what a thread keeps, and the begin of a function that runs it until it waits or ends."""
    name = name_of(entry.name)
    yield f"struct {name}_lane : Lane {{"
    yield from (_statement(s, operands) for s in persistent)
    yield f"}};\nstatic void {name}_thread({name}_lane& lane, {_THREAD}) {{"
    operands.lane = frozenset(name for s in persistent if isinstance(s, Registers) for name in s.names)
    operands.addresses |= {s.name: f"(u64)lane.{name_of(s.name)}" for s in persistent if isinstance(s, Variable)}
    stops = sum(isinstance(s, Instruction) and s.opcode[0] in TOGETHER for s in entry.body)
    cases = " ".join(f"case {i}: goto stop_{i};" for i in range(1, stops + 1))
    yield f"const u32 from = lane.at;\nlane.at = ENDED;\nswitch (from) {{ {cases} }}"


def _statement(statement: Statement, operands: Operands) -> str:
    if isinstance(statement, Brace):
        return statement.text
    if isinstance(statement, Label):
        return f"{name_of(statement.name)}:;"
    if isinstance(statement, Registers):
        operands.registers |= dict.fromkeys(statement.names, bits_of(statement.kind))
        return f"{unsigned(bits_of(statement.kind))} {', '.join(map(name_of, statement.names))};"
    if isinstance(statement, Variable):
        if statement.space == "shared":
            return ""
        if statement.space not in ("local", "param"):
            raise NotTranslated(f"{statement.space} {statement.name} in a kernel")
        name = name_of(statement.name)
        operands.addresses[statement.name] = f"(u64){name}"
        return f"alignas({max(statement.align, 8)}) char {name}[{statement.size}];"
    body = translate(statement, operands)
    guard = f"if ({operands.value(statement.guard, 'pred')}) " if statement.guard else ""
    # Braces around what declares nothing make compiling longer.
    return f"{guard}{body}" if body.count(";") == 1 else f"{guard}{{ {body} }}"
