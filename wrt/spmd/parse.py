"""The parser: Warp's generated C++, line by line, to the intermediate form of `ir.py`.

Warp writes a function as plain statements between `if`s, labels and `goto`s: each statement is one operation on
variables that are mostly set once. Only this file knows their syntax.
"""

import re
from collections.abc import Callable, Iterable
from pathlib import PurePath
from typing import Any

from warp._src.codegen import strip_reference

from wrt.spmd import ir
from wrt.spmd.analysis import uses
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
    arguments, variables = ([variable(v) for v in of] for of in (function.adj.args, function.adj.variables))
    variables = [v for v in variables if not v.ctype.startswith("wp::tuple_t")]  # see `_Parser.pack`
    is_native = bool(getattr(function, "native_snippet", None))
    lines = [] if is_native else function.adj.blocks[0].body_forward
    body = statements(function, lines, structs, [*arguments, *variables])
    marks = frozenset(getattr(function.func, "spmd_marks", ()))
    result = function.adj.return_var[0].type if function.adj.return_var else None
    name = getattr(function, "native_func", "")
    outside = not function.func.__module__.startswith("wrt.")
    return ir.Function(function.key, name, arguments, variables, body, marks, result, outside)


_SOURCE = re.compile(r"// (.*?) *<L (\d+)>")
"""Warp's comment above the code of a line of Python."""


def is_code(line: str) -> bool:
    """Return whether a line of Warp's C++, without indentation, is neither empty nor a comment nor a directive."""
    return bool(line) and not line.startswith(("//", "#line"))


def statements(
    function: Any, lines: Iterable[str], structs: dict[str, Any], variables: list[ir.Variable]
) -> list[ir.Statement]:
    """Return the statements of lines of a function, in which there are these variables.

    Raises:
        Unsupported: A line has an unknown form.
    """
    parser = _Parser(structs, {v.name: v for v in variables})
    source, number, file = "", 0, PurePath(function.adj.filename or "").name
    for line in map(str.strip, lines):
        if m := _SOURCE.fullmatch(line):
            source = f"{file}:{m[2]}: {function.key}: `{m[1]}`"
        elif is_code(line):
            try:
                parser.statement(line, number, source)
            except ir.Unsupported as error:
                raise refusal(source, str(error)) from None
            except KeyError:
                raise refusal(source, line) from None
            number += 1
    (body,) = parser.bodies
    if lost := {v.name for v in uses(body)} & parser.unset:
        raise ir.Unsupported(f"uses {min(lost)}, a derivative by another than the first argument of a function")
    return body


def variable(v: Any) -> ir.Variable:
    """Return Warp's variable."""
    return ir.Variable(v.emit(), strip_reference(v.type), v.ctype(), v.constant)


class _Parser:
    """Builds the tree of statements of one function.

    Attributes:
        bodies: The open lists of statements, outermost first.
        unset: Names of variables that stay without a value.
    """

    def __init__(self, structs: dict[str, Any], variables: dict[str, ir.Variable]) -> None:
        self._structs = structs
        self.variables = variables
        self._pointers: dict[str, ir.Expression] = {}
        self._loops: list[str] = []
        self._tuples: dict[str, list[str]] = {}
        self.unset: set[str] = set()
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

    # Of `wp.grad`. Warp calls its function after setting the result's adjoint to one and all others to zero.

    def gradient(self, function: str, arguments: str) -> ir.Statement:
        names = arguments.split(", ")
        count = len(names) // 2
        first, *others = names[count:-1]
        self.unset.update(others)
        return ir.Set(self.variables[first], self.call(f"grad_{function}", ", ".join(names[:count])))

    def pack(self, name: str, parts: str) -> None:
        self._tuples[name] = parts.split(", ")

    def unpack(self, name: str, number: str, of: str) -> ir.Statement | None:
        if number == "0":
            return ir.Set(self.variables[name], ir.Builtin("copy", (self.operand(self._tuples[of][0]),)))
        self.unset.add(name)
        return None

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
        r"goto (label\d+);": lambda _, label: ir.Return(None, label),
        rf"{_V} = (?:\{{\}}|wp::vec_t<\d+, wp::float32>\(1\));": lambda *_: None,
        r"adj_(\w+)\((.*)\);": _Parser.gradient,
        rf"{_V} = wp::tuple_t<.*>\((.*)\);": _Parser.pack,
        rf"{_V} = wp::extract<(\d+)>\({_V}\);": _Parser.unpack,
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
