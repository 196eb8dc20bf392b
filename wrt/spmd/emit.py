"""The emitter: the intermediate form as C++ for several lanes.

As in ISPC (Pharr and Mark 2012), the mask `exec` holds the active lanes: an `if` narrows it to those for which the
condition holds, and is skipped if there are none; a loop runs as long as any lane is active; `return`, `break` and
`continue` deactivate lanes until the end of the function, the loop, or the round. Only variables that outlive their
block must be assigned under the mask, so most statements stay as they were.
"""

import re
from collections.abc import Iterable
from typing import Any

from warp._src.codegen import constant_str

from wrt.spmd import ir
from wrt.spmd.analysis import Liveness, constant_ranges, range_of, set_by
from wrt.spmd.library import names
from wrt.spmd.remedies import RANDOM, refusal
from wrt.spmd.types import NUMBERS, Types

_ALL_TYPES = re.compile(r"to_\w+|cast_\w+|iter_\w+|copy|extract|indexref|load|range|address")
"""Functions of `kernels/native/lanes` that take whatever Warp's do."""


def _takes_all(call: ir.Builtin) -> bool:
    """Return whether a call has a form for lanes whatever its arguments; elements of constants have none."""
    is_of_constant = call.name == "extract" and getattr(call.arguments[0], "constant", None) is not None
    return _ALL_TYPES.fullmatch(call.name) is not None and not is_of_constant


class Emitter:
    """Writes the statements of one function.

    Attributes:
        liveness: Where the function's variables are set, and which of them outlive their block.
        keep_all: Whether all assignments are masked.
    """

    def __init__(self, types: Types, function: ir.Function) -> None:
        """Take a function."""
        self._types = types
        self._function = function
        self.liveness = Liveness(function.body)
        self.keep_all = False
        self._ranges = constant_ranges(function.body)
        self._counters = {
            s.variable: s.value.arguments[0]
            for s in ir.walk(function.body)
            if isinstance(s, ir.Set) and isinstance(s.value, ir.Builtin) and s.value.name == "iter_next"
        }
        self._loops: list[str] = []
        self._depth = 0  # open `if`s
        self._end: str | None = None  # the statement that ends the function, if it may end once all lanes are done
        self._cut: str | None = None  # the loop whose parts of a round are blocks of their own
        self._current = ir.Statement()

    def declaration(self, v: ir.Variable) -> str:
        """Return the declaration of a variable; empty if C++ needs none."""
        if v in self._ranges or self._counters.get(v) in self._ranges or v.is_pointer:
            return ""
        if v.constant is not None:
            return f"    const {v.ctype} {v.name} = {constant_str(v.constant)};\n"
        try:
            return f"    {self._types.wide(v.type)} {v.name};\n"
        except ir.Unsupported as error:
            sources = (s.source for s in ir.walk(self._function.body) if set_by(s) is v)
            raise refusal(next(sources, self._function.key), str(error)) from None

    def declarations(self, variables: Iterable[ir.Variable]) -> str:
        """Return the declarations of variables."""
        return "".join(map(self.declaration, variables))

    def whole(self) -> str:
        """Return the body of a function with the active lanes `exec_in`; any result is in `result_`."""
        self._end = "return result_;" if self._function.result is not None else "return;"
        masks = "    lanes::Mask exec = exec_in, returned_ = false;\n"
        return self.declarations(self._function.variables) + masks + self.code(self._function.body)

    def until_return(self, statements: Iterable[ir.Statement]) -> str:
        """Return the C++ of statements before the reverse part of an adjoint function, which have no result."""
        self._end = "break;"
        return f"    do {{\n{self.code(statements)}    }} while (false);\n"

    def operand(self, e: ir.Expression) -> str:
        """Return the C++ of an operand; of a constant integer, its number."""
        constant = e.constant if isinstance(e, ir.Variable) else None
        return str(constant) if type(constant) is int else self._operand(e)

    def in_loop(self, label: str, statements: Iterable[ir.Statement], cut: bool = False) -> str:
        """Return the C++ of statements in a loop that is emitted elsewhere.

        If the loop is `cut`, they form a block, which ends once all lanes have left it.
        """
        self._loops.append(label)
        self._cut = label if cut else None
        code = self.code(statements)
        self._cut = None
        self._loops.pop()
        return code

    def code(self, statements: Iterable[ir.Statement]) -> str:
        """Return the C++ of statements, one per line.

        Raises:
            Unsupported: There is an unknown kind of statement.
        """
        return "".join(f"    {self._statement(s)}\n" for s in statements)

    def _statement(self, s: ir.Statement) -> str:
        self._current = s
        match s:
            case ir.Set():
                return self._set(s)
            case ir.Update(variable, fields, value):
                return f"lanes::set({'.'.join((variable.name, *fields))}, {value.name}, exec);"
            case ir.Do(call):
                return self._do(call)
            case ir.If():
                return self._if(s)
            case ir.Loop():
                return self._loop(s)
            case ir.Leave(loop, condition):
                if range_of(s) in self._ranges:
                    return ""
                mask = "lanes::more" if range_of(s) else "lanes::to_bool"
                mask += f"({self._operand(range_of(s) or condition)})"
                leaving = f"broken_{loop} = broken_{loop} | (exec & ~on); exec = exec & on;"
                return f"{{ const lanes::Mask on = {mask}; {leaving} }} if (!lanes::any(exec)) break;"
            case ir.Jump(kind, loop):
                mask = f"{'broken' if kind == 'end' else 'continued'}_{loop}"
                return f"{mask} = {mask} | exec; exec = false;"
            case ir.Return(value, label):
                result = f"lanes::set_first(result_, {value.name}, exec, returned_); " if value else ""
                result += f"at_{label} = exec; " if label else ""
                return f"{result}returned_ = returned_ | exec; exec = false;"
            case ir.Verbatim(code):
                return code
        raise self._unsupported()

    def _unsupported(self, why: str = "") -> ir.Unsupported:
        return refusal(self._current.source or self._function.key, why or self._current.line)

    def _if(self, s: ir.If) -> str:
        before = f"before_{s.number}"
        condition = f"{'~' if s.negated else ''}lanes::to_bool({self._operand(s.condition)})"
        text = f"{{ const lanes::Mask {before} = exec; exec = exec & {condition}; if (lanes::any(exec)) {{\n"
        self._depth += 1
        text += self.code(s.body)
        self._depth -= 1
        inactive = ["returned_"]  # lanes that have returned, or left the round of the innermost loop
        if self._loops:
            inactive += [f"broken_{self._loops[-1]}", f"continued_{self._loops[-1]}"]
        text += f"    }} exec = {before} & ~({' | '.join(inactive)}); }}"
        if self._depth:
            return text
        if self._end is not None and not self._loops and _has(s.body, ir.Return):
            text += f" if (!lanes::any(exec)) {self._end}"
        if self._loops == [self._cut] and _has(s.body, (ir.Return, ir.Jump, ir.Loop)):
            text += " if (!lanes::any(exec)) break;"
        return text

    def _loop(self, s: ir.Loop) -> str:
        loop = s.label
        head = "for (;;) {"
        if ends := self._ranges.get(range_of(s.body[0])):
            begin, end, step = (0, ends[0], 1) if len(ends) == 1 else (ends[0], ends[1], (*ends, 1)[2])
            k = f"counter_{loop}"
            head = f"LANES_UNROLL for (int {k} = {begin}; {k} {'<' if step > 0 else '>'} {end}; {k} += {step}) {{"
        masks = f"lanes::Mask broken_{loop} = false, continued_{loop} = false;"
        self._loops.append(loop)
        code = self.code(s.body)
        self._loops.pop()
        next_round = f"exec = before_{loop} & ~(returned_ | broken_{loop}); continued_{loop} = false;"
        return f"""{{ const lanes::Mask before_{loop} = exec; {masks} {head}
{code}    {next_round} if (!lanes::any(exec)) break; }}
    exec = before_{loop} & ~returned_; }}"""

    def _do(self, call: ir.Builtin | ir.Call) -> str:
        arguments = ", ".join(map(self._operand, call.arguments))
        if isinstance(call, ir.Call):
            return f"wide_{call.function}({arguments}, exec);"
        if call.name == "store":
            parts = ir.expressions(call.arguments[0])
            if any(isinstance(e, ir.ElementAddress) or ir.is_builtin(e, "address") for e in parts):
                raise self._unsupported("stores into a part of an array's element")
            return f"lanes::set(*{arguments}, exec);"
        if self._function.is_from_outside and call.name not in names():
            target, *others = call.arguments
            if not isinstance(target, ir.Variable) or not call.name.endswith("_inplace"):
                raise self._unsupported()
            of_lane = ", ".join(["of_lane", *map(self._of_lane, others)])
            each = f"auto of_lane = lanes::lane({target.name}, l); wp::{call.name}({of_lane});"
            return f"LANES_EACH(l, exec) {{ {each} set_lane({target.name}, l, of_lane); }}"
        if call.name == "assign_inplace":
            arguments = self._with_known_indices(call.arguments)
        return f"lanes::{call.name}({arguments}, exec);"

    def _set(self, s: ir.Set) -> str:
        v = s.variable
        value = "" if v in self._ranges else self._value(s.value)
        if v in self._ranges or v.is_pointer:
            return ""
        if v in self._counters:
            if self._counters[v] in self._ranges:
                return f"const int {v.name} = counter_{self._loops[-1]};"
            return f"lanes::set({v.name}, {value}, exec);" if v in self.liveness.outliving else f"{v.name} = {value};"
        moves = isinstance(s.value, ir.Variable) or ir.is_builtin(s.value, "load", "copy", "where", "extract")
        if v.ctype in ("wp::uint8", "wp::uint16") and not moves:
            raise self._unsupported("arithmetic on fewer than 32 bits")
        if self._function.is_from_outside and isinstance(s.value, ir.Builtin) and not _takes_all(s.value):
            if RANDOM.match(s.value.name):
                raise self._unsupported(s.value.name)
            if s.value.name not in names() or s.value.name == "extract":
                return self._each(v.name, s.value)
            each = f"[&] {{ {self._types.wide(v.type)} r; {self._each('r', s.value)} return r; }}"
            value = f"lanes::either(0, LANES_FUNCTION({s.value.name}), {each}, {value.partition('(')[2]}"
        shared = self._types.is_shared(v.type) or v.ctype == "wp::shape_t"
        if not shared and (self.keep_all or v in self.liveness.outliving):
            return f"lanes::set({v.name}, {value}, exec);"
        return f"{v.name} = {value};"

    # Values.

    def _operand(self, e: ir.Expression) -> str:
        return e.name if isinstance(e, ir.Variable) else f"({self._value(e)})"

    def _each(self, result: str, call: ir.Builtin) -> str:
        """Return the C++ that calls one of Warp's functions for each lane."""
        arguments = ", ".join(map(self._of_lane, call.arguments))
        return f"LANES_EACH(l, exec) set_lane({result}, l, wp::{call.name}({arguments}));"

    def _of_lane(self, e: ir.Expression) -> str:
        """Return an argument of one of Warp's functions that has no version for lanes and is called for each."""
        if not isinstance(e, ir.Variable):
            raise self._unsupported()
        is_same = e.constant is not None or self._types.is_shared(e.type)
        return e.name if is_same else f"lanes::lane({e.name}, l)"

    def _with_known_indices(self, arguments: tuple[ir.Expression, ...]) -> str:
        """Return arguments with constant indices as numbers, which select the C++ overload."""
        return ", ".join([self._operand(arguments[0]), *map(self.operand, arguments[1:])])

    def _value(self, e: ir.Expression) -> str:
        match e:
            case ir.Variable(name):
                return name
            case ir.Literal(text):
                return text
            case ir.Zero(t):
                return self._types.zero(t)
            case ir.Address(base, fields):
                is_whole = not fields or self._types.is_whole(base.type)
                if not is_whole and fields[0] not in dict(self._types.fields(base.type)):
                    raise self._unsupported(f"{base.name}.{fields[0]}: each lane has its own array")
                return f"&({_member(base, fields)})"
            case ir.MemberAddress(base, field):
                return f"&({self._operand(base)}{'.' if isinstance(base, ir.Variable) else '->'}{field})"
            case ir.ElementAddress(base, array, index, field):
                return f"LANES_MEMBER({_member(base, array)}, {index.name}, {field})"
            case ir.Call(function, arguments):
                return f"wide_{function}({', '.join([*map(self._operand, arguments), 'exec'])})"
            case ir.Builtin():
                return self._builtin(e)
            case ir.Compose(container, size, number, arguments):
                if number not in NUMBERS:
                    raise self._unsupported()
                return f"lanes::make_{container}<{size}, {NUMBERS[number]}>({', '.join(map(self._operand, arguments))})"
            case ir.Operation("&&" | "||", left, right):
                return f"(lanes::to_bool({left.name}) {e.operator[0]} lanes::to_bool({right.name}))"
            case ir.Operation(operator, left, right):
                return f"lanes::Mask({left.name} {operator} {right.name})"
        raise self._unsupported()

    def _builtin(self, e: ir.Builtin) -> str:
        arguments = ", ".join(map(self._operand, e.arguments))
        if e.name == "tid":
            return "thread_"
        if e.name == "to_bool":
            return f"lanes::to_bool({arguments})"
        if e.name == "iter_next":
            return f"lanes::next({arguments}, exec)"
        of = e.arguments[0] if e.name == "indexref" else None
        member = of is None or (isinstance(of, ir.Address) and len(of.fields) < 2)
        if not member:
            raise self._unsupported()
        if e.name in ("load", "atomic_add"):
            return f"lanes::{e.name}({arguments}, exec)"
        if e.name in ("extract", "indexref"):
            arguments = self._with_known_indices(e.arguments)
        return f"lanes::{e.name}({arguments})"


def _member(base: ir.Variable, fields: tuple[str, ...]) -> str:
    text = base.name
    for f in fields:
        text = f"({text}).{f}"
    return text


def _has(statements: list[ir.Statement], kinds: Any) -> bool:
    return any(isinstance(s, kinds) for s in ir.walk(statements))
