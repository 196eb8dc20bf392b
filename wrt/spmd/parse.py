"""The parser: Warp's generated C++, line by line, to the intermediate form of `ir.py`.

Warp writes a function as plain statements between `if`s, labels and `goto`s: each statement is one operation on
variables that are mostly set once. Only this file knows their syntax.
"""

import re
from collections.abc import Callable
from pathlib import PurePath
from typing import Any

from warp._src.codegen import strip_reference

from wrt.spmd import ir
from wrt.spmd.remedies import refusal

_V = r"(var_\w+)"
_LABEL = r"((?:for|while)_\d+)"
_CONVERSIONS = {
    "float": "to_float32",
    "int": "to_int32",
    **{name: f"to_{name}" for name in ("float32", "int32", "uint32", "int64", "float64")},
}


def parse(function: Any, structs: dict[str, Any]) -> ir.Function:
    """Return the intermediate form of a function or kernel that Warp has built.

    Args:
        function: Warp's function or kernel.
        structs: All structs, by their names in Warp's C++.

    Raises:
        Unsupported: A line has an unknown form.
    """
    adj = function.adj
    arguments, variables = ([_variable(v) for v in of] for of in (adj.args, adj.variables))
    parser = _Parser(structs, {v.name: v for v in (*arguments, *variables)})
    is_native = bool(getattr(function, "native_snippet", None))
    lines = [] if is_native else [line.strip() for line in adj.blocks[0].body_forward]
    source, number, file = "", 0, PurePath(adj.filename or "").name
    for line in lines:
        if m := _SOURCE.fullmatch(line):
            source = f"{file}:{m[2]}: {function.key}: `{m[1]}`"
        elif line and not line.startswith(("//", "#line")):
            try:
                parser.statement(line, number, source)
            except ir.Unsupported as error:
                raise refusal(source, str(error)) from None
            except KeyError:
                raise refusal(source, line) from None
            number += 1
    marks = frozenset(getattr(function.func, "spmd_marks", ()))
    result = adj.return_var[0].type if adj.return_var else None
    name = getattr(function, "native_func", "")
    outside = not function.func.__module__.startswith("wrt.")
    return ir.Function(function.key, name, arguments, variables, parser.bodies[0], marks, result, outside)


_SOURCE = re.compile(r"// (.*?) *<L (\d+)>")
"""Warp's comment above the code of a line of Python."""


def _variable(v: Any) -> ir.Variable:
    return ir.Variable(v.emit(), strip_reference(v.type), v.ctype(), v.constant)


class _Parser:
    """Builds the tree of statements of one function.

    Attributes:
        bodies: The open lists of statements, outermost first.
    """

    def __init__(self, structs: dict[str, Any], variables: dict[str, ir.Variable]) -> None:
        self._structs = structs
        self.variables = variables
        self._pointers: dict[str, ir.Expression] = {}
        self._loops: list[str] = []
        self.bodies: list[list[ir.Statement]] = [[]]

    def statement(self, line: str, number: int, source: str) -> None:
        """Add the statement of a line, or open or close a block."""
        for pattern, make in _STATEMENTS:
            if m := pattern.fullmatch(line):
                s = make(self, *m.groups())
                break
        else:
            raise ir.Unsupported(line)
        if s is None:
            return
        s.line, s.number, s.source = line, number, source
        if isinstance(s, (ir.If, ir.Loop)):
            self.bodies[-2].append(s)
        else:
            self.bodies[-1].append(s)

    # Blocks.

    def open_if(self, negated: str, condition: str) -> ir.Statement:
        body: list[ir.Statement] = []
        self.bodies.append(body)
        return ir.If(self.operand(condition), bool(negated), body)

    def close(self) -> None:
        self.bodies.pop()

    def open_loop(self, label: str) -> ir.Statement:
        body: list[ir.Statement] = []
        self.bodies.append(body)
        self._loops.append(label)
        return ir.Loop(label, body)

    def close_loop(self, label: str) -> None:
        last = self.bodies.pop().pop()  # back to the start
        if self._loops.pop() != label or not isinstance(last, ir.Jump) or last.kind != "start":
            raise ir.Unsupported(f"loop {label}: contains labels of another loop")

    def jump(self, kind: str, label: str) -> ir.Statement:
        if label != self._loops[-1]:
            raise ir.Unsupported(f"goto {kind}_{label}: leaves more than one loop")
        return ir.Jump(kind, label)

    # Values.

    def set(self, name: str, text: str) -> ir.Statement:
        value = self.expression(text)
        if self.variables[name].is_pointer:
            self._pointers[name] = value
        return ir.Set(self.variables[name], value)

    def update(self, name: str, fields: str, value: str) -> ir.Statement:
        return ir.Update(self.variables[name], tuple(fields.split(".")[1:]), self.variables[value])

    def operand(self, name: str) -> ir.Expression:
        """Return a variable, or the target of a pointer."""
        if name not in self._pointers and name not in self.variables:
            raise ir.Unsupported(f"{name}: is not a variable")
        return self._pointers.get(name) or self.variables[name]

    def operands(self, text: str) -> tuple[ir.Expression, ...]:
        return tuple(map(self.operand, text.split(", "))) if text else ()

    def expression(self, text: str) -> ir.Expression:
        for pattern, make in _EXPRESSIONS:
            if m := pattern.fullmatch(text):
                value: ir.Expression = make(self, *m.groups())
                return value
        raise ir.Unsupported(text)

    def call(self, name: str, arguments: str) -> ir.Call:
        if not _OF_MODULE.fullmatch(name):
            raise ir.Unsupported(f"{name}({arguments})")
        return ir.Call(name, tuple(self.variables[a] for a in arguments.split(", ") if a))

    def function(self, name: str, arguments: str) -> ir.Expression:
        if name not in self._structs:
            return self.call(name, arguments)
        if arguments:
            raise ir.Unsupported(f"{name}({arguments}): constructs a struct from values")
        return ir.Zero(self._structs[name])


_OF_MODULE = re.compile(r"\w+_\d+")
"""Names of the functions of a module in Warp's C++."""


def _path(members: str) -> tuple[str, ...]:
    """Return the names in ").name).name"."""
    return tuple(members.split(").")[1:])


def _builtin(parser: _Parser, name: str, arguments: str) -> ir.Expression:
    return ir.Builtin(_CONVERSIONS.get(name, name), parser.operands(arguments))


def _operation(parser: _Parser, a: str, operator: str, b: str) -> ir.Expression:
    return ir.Operation(operator, parser.variables[a], parser.variables[b])


def _compiled(table: dict[str, Any]) -> list[tuple[re.Pattern[str], Callable[..., Any]]]:
    return [(re.compile(pattern), make) for pattern, make in table.items()]


_STATEMENTS = _compiled(
    {
        rf"if \((!?){_V}\) \{{": _Parser.open_if,
        r"\}": _Parser.close,
        rf"start_{_LABEL}:;": _Parser.open_loop,
        rf"end_{_LABEL}:;": _Parser.close_loop,
        rf"if \(iter_cmp\({_V}\) == 0\) goto end_{_LABEL};": lambda p, range_, label: ir.Leave(
            label, ir.Builtin("iter_cmp", (p.operand(range_),))
        ),
        rf"if \(\({_V}\) == false\) goto end_{_LABEL};": lambda p, condition, label: ir.Leave(
            label, p.operand(condition)
        ),
        rf"goto (start|end)_{_LABEL};": _Parser.jump,
        rf"return ?{_V}?;": lambda p, name: ir.Return(p.variables[name] if name else None),
        rf"wp::assign\({_V}, {_V}\);": lambda p, name, value: p.update(name, "", value),
        r"wp::(\w+_inplace|array_store|store)\((.*)\);": lambda p, name, arguments: ir.Do(
            ir.Builtin(name, p.operands(arguments))
        ),
        rf"{_V}((?:\.\w+)+) = {_V};": _Parser.update,
        rf"{_V} = (.*);": _Parser.set,
        r"([a-zA-Z_]\w*)\((.*)\);": lambda p, name, arguments: ir.Do(p.call(name, arguments)),
    }
)

_EXPRESSIONS = _compiled(
    {
        _V: _Parser.operand,
        r"(-?[\d.]+(?:e-?\d+)?(?:f|ll|u|ull)?)": lambda _, text: ir.Literal(text),
        rf"&\(\(\(\*wp::address\(\(+{_V}((?:\)\.\w+)+), {_V}\)\)\)\.([\w.]+)\)": lambda p, base, array, index, field: (
            ir.ElementAddress(p.variables[base], _path(array), p.variables[index], field)
        ),
        rf"&\(\(+{_V}((?:\)\.\w+)+)\)": lambda p, base, fields: ir.Address(p.variables[base], _path(fields)),
        rf"&\({_V}(?:->|\.)(\w+)\)": lambda p, base, field: ir.MemberAddress(p.operand(base), field),
        r"wp::cast<wp::(\w+)>\((.*)\)": lambda p, to, value: ir.Builtin(f"cast_{to}", p.operands(value)),
        r"wp::(vec|mat)_t<(.*), ?(wp::\w+|bool)>\((.*)\)": lambda p, container, size, number, arguments: ir.Compose(
            container, size, number, p.operands(arguments)
        ),
        r"wp::(\w+(?:<[\w:, ]+>)?)\((.*)\)": _builtin,
        r"bool\((.*)\)": lambda p, value: ir.Builtin("to_bool", p.operands(value)),
        r"builtin_tid1d\(\)": lambda _: ir.Builtin("tid", ()),
        rf"\({_V} (==|!=|<|>|<=|>=) {_V}\)": _operation,
        rf"{_V} (&&|\|\|) {_V}": _operation,
        r"([A-Za-z_]\w*)\((.*)\)": _Parser.function,
    }
)
