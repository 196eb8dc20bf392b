"""Adjoint functions for several lanes: Warp's own, line by line.

Such a function first computes its variables again, until it would return. It then jumps to the label of that `return`
in its reverse part, and goes back from there, adding to adjoints of variables. With lanes the reverse part begins
with none active; a lane joins at the label of the `return` that it took.
"""

import re
from collections.abc import Iterable, Mapping
from typing import Any

from warp._src.codegen import Struct, strip_reference
from warp._src.types import type_is_matrix, type_is_vector

from wrt.spmd import ir
from wrt.spmd.analysis import changes
from wrt.spmd.emit import Emitter
from wrt.spmd.parse import is_code, statements, variable
from wrt.spmd.types import Types, name_of

_PLACE = r"(adj_\w+)((?:\.\w+)*)"
_LABEL = re.compile(r"(label\d+):;")
_IF = re.compile(r"if \((!?)(var_\w+)\) \{")
_GAIN = re.compile(rf"{_PLACE} \+= {_PLACE};")
_CLEAR = re.compile(rf"{_PLACE} = \{{\}};")
_ASSIGN = re.compile(rf"{_PLACE} = {_PLACE};")
_CALL = re.compile(r"(wp::)?adj_(\w+)\((.*)\);")
_OTHER_NAMES = {"float": "to_float32"}
"""Warp's functions that have other names in `kernels/native/lanes/adjoints.h`."""


def has_derivative(types: Types, t: Any) -> bool:
    """Return whether a type has an adjoint: numbers in float32, and what consists of them."""
    t = strip_reference(t)
    if types.is_shared(t):
        return False
    if isinstance(t, Struct):
        return any(has_derivative(types, of) for _, of in types.fields(t))
    of = t._wp_scalar_type_ if type_is_vector(t) or type_is_matrix(t) else t
    return name_of(of) == "wp::float32"


def inputs_of(f: Any) -> list[Any]:
    """Return the arguments of a function, or those of the function whose adjoint this is."""
    arguments: list[Any] = f.adj.args
    return arguments[: f.adj.custom_reverse_num_input_args] if f.adj.custom_reverse_mode else arguments


class Adjoints:
    """The adjoints of the functions that a kernel differentiates."""

    def __init__(self, types: Types, functions: Iterable[Any], structs: Mapping[str, Any]) -> None:
        """Take the functions that Warp has built, among them adjoints written by hand, and structs by their names."""
        self._types, self._structs = types, dict(structs)
        self._functions: dict[str, Any] = {}
        for f in functions:
            if f.native_func not in self._functions or f.adj.custom_reverse_mode:
                self._functions[f.native_func] = f
        self._code: dict[str, str] = {}  # by name of the function, callees first

    def code(self, names: Iterable[str]) -> str:
        """Return the C++ of functions `wide_grad_NAME`: derivatives by the first argument, of a result's sum."""
        gradients = "".join(self._gradient(self._functions[name]) for name in sorted(names))
        gains = "".join(
            f"LANES_INLINE void gain(wide_{name_of(t)}& to, const wide_{name_of(t)}& x, lanes::Mask exec) {{\n"
            f"    using lanes::gain; {' '.join(f'gain(to.{f}, x.{f}, exec);' for f in self._differentiable(t))} }}\n"
            for t in self._types.structs
            if not self._types.is_uniform(t)
        )
        return gains + "".join(self._code.values()) + gradients

    def declaration(self, name: str) -> str:
        """Return the declaration of such a function."""
        arguments = [f"const {self._types.wide(v.type)}& {v.emit()}" for v in self._functions[name].adj.args]
        result = self._types.wide(self._functions[name].adj.args[0].type)
        return f"static inline {result} wide_grad_{name}({', '.join(arguments)}, const lanes::Mask exec)"

    def _differentiable(self, t: Any) -> list[str]:
        return [label for label, of in self._types.fields(t) if has_derivative(self._types, of)]

    def _zero(self, t: Any, name: str) -> str:
        return f"{self._types.wide(t)} {name} = {self._types.zero(t)};"

    def _gradient(self, f: Any) -> str:
        self._add(f)
        arguments = [variable(v) for v in f.adj.args]
        adjoints = {_adjoint_of(v): v.type for v in arguments if has_derivative(self._types, v.type)}
        zeros = "".join(f"    {self._zero(t, name)}\n" for name, t in adjoints.items())
        result = self._types.wide(f.adj.return_var[0].type)
        passed = ", ".join([*(v.name for v in arguments), *adjoints])
        return f"""
{self.declaration(f.native_func)} {{
{zeros}    {result} adj_ret;
    lanes::fill(adj_ret, 1.0f);
    wide_adj_{f.native_func}({passed}, adj_ret, exec);
    return {_adjoint_of(arguments[0])};
}}
"""

    def _add(self, f: Any) -> None:
        """Add the adjoint of a function and of its callees."""
        name = f.native_func
        if name not in self._code:
            code = self._by_hand(f) if f.adj.custom_reverse_mode else _Reversed(self._types, self, f).code()
            self._code[name] = code  # after its callees

    def called(self, name: str) -> Any:
        """Return a function whose adjoint another one calls."""
        self._add(self._functions[name])
        return self._functions[name]

    def is_native(self, name: str) -> bool:
        """Return whether a function is written in C++, and has no derivative."""
        return bool(getattr(self._functions[name], "native_snippet", None))

    def body(self, f: Any, lines: Iterable[str], variables: list[ir.Variable]) -> list[ir.Statement]:
        """Return the statements of lines of a function with these variables."""
        return statements(f, lines, self._structs, variables)

    def _by_hand(self, f: Any) -> str:
        count = len(inputs_of(f))
        arguments, variables = ([variable(v) for v in of] for of in (f.adj.args, f.adj.variables))
        adjoints = [ir.Variable(f"var_{_adjoint_of(v)}", v.type, v.ctype) for v in arguments[:count]]
        lines = [re.sub(r"\badj_(\w+)\b(?!\()", r"var_adj_\1", line) for line in f.adj.blocks[0].body_forward]

        def masked(s: ir.Statement) -> list[ir.Statement]:
            if isinstance(s, ir.Set) and isinstance(s.value, ir.Variable) and s.variable in adjoints:
                return [ir.Update(s.variable, (), s.value)]
            return [s]

        body = ir.rebuilt(self.body(f, lines, [*arguments, *variables, *adjoints]), masked)
        function = ir.Function(f.key, f.native_func, arguments, variables, body, frozenset())
        wide = self._types.wide
        parameters = [f"const {wide(v.type)}& {v.name}" for v in arguments]
        parameters[count:count] = [f"{wide(v.type)}& {v.name}" for v in adjoints]
        return f"""
static inline void wide_adj_{f.native_func}({", ".join(parameters)}, const lanes::Mask exec_in) {{
{Emitter(self._types, function).whole()}}}
"""


class _Reversed:
    """An adjoint that Warp has made."""

    def __init__(self, types: Types, adjoints: Adjoints, f: Any) -> None:
        self._types, self._adjoints, self._f = types, adjoints, f
        self._arguments, self._variables = ([variable(v) for v in of] for of in (f.adj.args, f.adj.variables))
        named = {v.name: v for v in (*self._arguments, *self._variables)}
        body = adjoints.body(f, f.adj.blocks[0].body_replay, list(named.values()))
        function = ir.Function(f.key, f.native_func, self._arguments, self._variables, body, frozenset())
        self._changed = [a for a in self._arguments if changes(body, a)]
        self._body, self._emitter = body, Emitter(types, function)
        self._named = named
        self._adjoint_types = {_adjoint_of(v): v.type for v in named.values()}
        self._adjoint_types["adj_ret"] = strip_reference(f.adj.return_var[0].type)

    def code(self) -> str:
        types, f = self._types, self._f
        lines = list(filter(is_code, map(str.strip, reversed(f.adj.blocks[0].body_reverse))))
        reverse = "".join(f"    {text}\n" for text in self._lines(lines) if text)
        labels = sorted(set(_LABEL.findall("\n".join(lines))))
        stays = [a for a in self._arguments if a not in self._changed or types.is_shared(a.type)]
        parameters = [
            f"const {types.wide(a.type)}& {a.name}" if a in stays else f"{types.wide(a.type)} {a.name}"
            for a in self._arguments
        ]
        adjoints = [a for a in self._arguments if has_derivative(types, a.type)]
        parameters += [f"{types.wide(a.type)}& {_adjoint_of(a)}" for a in adjoints]
        parameters.append(f"const {types.wide(self._adjoint_types['adj_ret'])}& adj_ret")
        used = set(re.findall(r"\badj_\w+", reverse))
        zeros = "".join(
            f"    {types.wide(v.type)} {_adjoint_of(v)} = {types.zero(v.type)};\n"
            for v in self._variables
            if _adjoint_of(v) in used
        )
        masks = "".join(f", at_{label} = false" for label in labels)
        return f"""
static inline void wide_adj_{f.native_func}({", ".join(parameters)}, const lanes::Mask exec_in) {{
    if (!lanes::any(exec_in)) return;
{self._emitter.declarations(self._variables)}{zeros}
    lanes::Mask exec = exec_in, returned_ = false{masks};
{self._emitter.until_return(self._body)}
    exec = false;
{reverse}}}
"""

    def _lines(self, lines: list[str]) -> Iterable[str]:
        """Yield the C++ of the reverse part."""
        open_ifs: list[str] = []
        for number, line in enumerate(lines):
            if m := _LABEL.fullmatch(line):
                yield f"exec = exec | at_{m[1]};"
            elif m := _IF.fullmatch(line):
                joins = "".join(f" | at_{label}" for label in _labels_within(lines[number + 1 :]))
                condition = f"{'~' if m[1] else ''}lanes::to_bool({self._operand(m[2])})"
                before = f"before_{number}"
                yield (
                    f"{{ const lanes::Mask {before} = exec; exec = exec & {condition}; if (lanes::any(exec{joins})) {{"
                )
                open_ifs.append(f"}} exec = {before}{joins}; }}")
            elif line == "}":
                yield open_ifs.pop()
            elif line != "return;":
                yield self._statement(line)

    def _statement(self, line: str) -> str:
        if m := _GAIN.fullmatch(line):
            to, fields, of, of_fields = m.groups()
            return f"gain({to}{fields}, {of}{of_fields}, exec);" if self._counts(to, fields) else ""
        if m := _CLEAR.fullmatch(line):
            to, fields = m.groups()
            zero = self._types.zero(self._type_of(to, fields)) if self._counts(to, fields) else ""
            return f"lanes::set({to}{fields}, {zero}, exec);" if zero else ""
        if (m := _ASSIGN.fullmatch(line)) and not self._counts(m[1], m[2]):
            return ""
        if m := _CALL.fullmatch(line):
            return self._call(*m.groups())
        raise ir.Unsupported(f"{self._f.key}: {line}")

    def _call(self, of_warp: str | None, name: str, arguments: str) -> str:
        names = arguments.split(", ")
        values = [n for n in names if n.startswith("var_")]
        adjoints = [n for n in names if n.startswith("adj_")]
        if len(values) + len(adjoints) < len(names):
            raise ir.Unsupported(f"{self._f.key}: adj_{name}({arguments})")
        if of_warp is None:
            if self._adjoints.is_native(name):
                return ""
            types = [a.type for a in inputs_of(self._adjoints.called(name))] + [self._adjoint_types[adjoints[-1]]]
            kept = [n for n, t in zip(adjoints, types, strict=True) if has_derivative(self._types, t)]
            passed = [*map(self._operand, values), *kept]
            is_needed = bool(kept) and kept[-1] == adjoints[-1]
            return f"wide_adj_{name}({', '.join(passed)}, exec);" if is_needed else ""
        kept = [n for n in adjoints if self._counts(n)]
        if kept[-1:] != adjoints[-1:] or len(kept) < 2:
            return ""  # neither the result nor any operand has a derivative
        passed = [self._emitter.operand(self._named[n]) for n in values]
        return f"lanes::adj_{_OTHER_NAMES.get(name, name)}({', '.join([*passed, *kept])}, exec);"

    def _operand(self, name: str) -> str:
        v = self._named[name]
        if v.is_pointer:
            raise ir.Unsupported(f"{self._f.key}: {name} is a pointer in the adjoint")
        return name

    def _type_of(self, adjoint: str, fields: str = "") -> Any:
        t = self._adjoint_types[adjoint]
        for label in fields.split(".")[1:]:
            t = strip_reference(t.vars[label].type)
        return t

    def _counts(self, adjoint: str, fields: str = "") -> bool:
        """Return whether an adjoint, or a field of it, has a derivative."""
        return has_derivative(self._types, self._type_of(adjoint, fields))


def _labels_within(lines: list[str]) -> list[str]:
    """Return the labels up to the end of the block whose lines these are."""
    labels, depth = [], 1
    for line in lines:
        depth += line.endswith("{")
        depth -= line == "}"
        if depth == 0:
            break
        labels += _LABEL.findall(line)
    return labels


def _adjoint_of(v: ir.Variable) -> str:
    return "adj_" + v.name.removeprefix("var_")
