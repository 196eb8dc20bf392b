"""The statements of a function, one lane's in Warp's C++, for sixteen lanes at once.

Warp writes a function as plain statements over variables that are set once, between `if`s, labels and `goto`s. For
many lanes (as ISPC does with C: Pharr and Mark 2012) `exec` says which of them are here: an `if` narrows it to those
for which it holds, and is left out where there are none; a loop runs as long as any lane does; `return`, `break` and
`continue` take lanes out until the end of the function, the loop, or the round. Only what outlives its block must
spare the lanes that are elsewhere, so most statements stay what they were.
"""

import re
from collections.abc import Callable, Sequence
from typing import Any

from warp._src.codegen import constant_str, strip_reference

from wrt.kernels.wide.library import ANYTHING, can_be_called
from wrt.kernels.wide.types import NUMBERS, Types, Unsupported, lines_of

_LABEL = r"((?:for|while)_\d+)"
START = re.compile(rf"start_{_LABEL}:;")
END = re.compile(rf"end_{_LABEL}:;")
SET = re.compile(r"(var_\w+) = (.*);")
VARIABLE = re.compile(r"var_\w+")
NEXT = re.compile(r"(var_\w+) = wp::iter_next\((var_\w+)\);")
NO_MORE = re.compile(rf"if \(iter_cmp\((var_\w+)\) == 0\) goto end_{_LABEL};")
_SETS = re.compile(r"(var_\w+)(?:\.\w+)* = |wp::assign\((var_\w+),")
_STORES = re.compile(r"wp::(?:store|array_store|assign\w*)\(")
_LEAVE = re.compile(r"return|goto ")
RANGE = re.compile(r"(var_\w+) = wp::range\((.*)\);")
_STRUCT = re.compile(r"([A-Za-z_]\w*_[0-9a-f]{8})\((.*)\)")


class Body:
    """The statements of one function, and what must be known of its variables to write them for sixteen lanes.

    Attributes:
        lines: the statements of one lane.
        variables: all, by name.
        where_set: the loops, outermost first, in which a variable is set.
        outliving: variables that are used after the loop in which they are set: each lane keeps what it left with.
        keep_all: whether whatever is set must spare the lanes that are elsewhere.
        loops: the loops that are open.
        blocks: the `if`s that are open.
        pointers: what variables that point somewhere stand for.
        result: what `return` is followed by where the function may end once all lanes have returned.
        cut: the loop of which a part of a round is a block of its own, which ends once all lanes have left it.
    """

    def __init__(self, types: Types, function: Any) -> None:
        """Take a function or kernel that Warp has built."""
        self.types = types
        self.adj = function.adj
        self.lines = lines_of(function)
        self.constants = {v.emit(): v.constant for v in self.adj.variables if v.constant is not None}
        self.variables = {v.emit(): v for v in (*self.adj.args, *self.adj.variables)}
        self.counted: dict[str, list[int]] = {}  # ranges known beforehand, which stay loops of C++
        self.counters: dict[str, str] = {}
        for line in self.lines:
            if m := RANGE.fullmatch(line):
                ends = m[2].split(", ")
                if all(end in self.constants for end in ends):
                    self.counted[m[1]] = [self.constants[end] for end in ends]
            if (m := NEXT.fullmatch(line)) and m[2] in self.counted:
                self.counters[m[1]] = m[2]
        self.where_set: dict[str, list[str]] = {}
        self.outliving: set[str] = set()
        self._follow_variables()
        self.pointers = {v.emit(): "" for v in self.adj.variables if v.ctype().endswith("*")}
        self.blocks: list[int] = []
        self.loops: list[str] = []
        self.keep_all = False
        self.result: str | None = None
        self.cut: str | None = None

    def _follow_variables(self) -> None:
        open_loops: list[str] = []
        for line in self.lines:
            if m := START.fullmatch(line):
                open_loops.append(m[1])
                continue
            if m := END.fullmatch(line):
                open_loops.remove(m[1])
                continue
            m = re.match(r"(var_\w+) = ", line)
            for used in VARIABLE.findall(line[m.end() :] if m else line):
                loops = self.where_set.get(used)
                if loops and open_loops[: len(loops)] != loops:
                    self.outliving.add(used)
            if m:
                self.where_set.setdefault(m[1], list(open_loops))

    def changes(self, name: str, first: int = 0, end: int | None = None) -> bool:
        """Return whether a line from `first` to before `end` may change a variable that was set before."""
        change = re.compile(rf"{name}(\.\w+)* = |wp::assign\w*\({name}\b|.*&\({name}\b|.*&{name}\b")
        return any(change.match(line) for line in self.lines[first:end])

    def used(self, numbers: Sequence[int]) -> set[str]:
        """Return the variables of lines, by their numbers, and those that pointers among them lead to."""
        names = set(VARIABLE.findall("\n".join(self.lines[i] for i in numbers)))
        for line in reversed(self.lines[: max(numbers, default=-1) + 1]):
            if (m := SET.fullmatch(line)) and m[1] in self.pointers and m[1] in names:
                names.update(VARIABLE.findall(m[2]))
        return names

    def set_by(self, i: int) -> str | None:
        """Return the variable that a statement sets, or a member of it."""
        m = _SETS.match(self.lines[i])
        return m and (m[1] or m[2])

    def same_for_all(self, name: str, end: int) -> bool:
        """Return whether a variable is set before a line alone, and from constants."""
        setting = [i for i in range(len(self.lines)) if self.set_by(i) == name]
        if not setting or setting[-1] >= end or self.changes(name, setting[-1] + 1):
            return False
        into = {name}  # and what points there
        for line in self.lines:
            if (m := SET.fullmatch(line)) and m[1] in self.pointers and into & {*VARIABLE.findall(m[2])}:
                into.add(m[1])
            if _STORES.match(line) and (into - {name}) & {*VARIABLE.findall(line)}:
                return False
        return all({*VARIABLE.findall(self.lines[i])} <= {name, *self.constants} for i in setting)

    def outermost(self, first: int, end: int) -> dict[int, int]:
        """Return for each line from `first` to before `end` where the outermost `if` or loop around it begins."""
        found, depth = {}, 0
        for i in range(first, end):
            line = self.lines[i]
            found[i] = i if depth == 0 else found[i - 1]
            depth += bool(line.endswith("{") or START.fullmatch(line)) - bool(line == "}" or END.fullmatch(line))
        return found

    def later(self, first: int, end: int, last: int) -> dict[int, int]:
        """Return which lines from `first` to before `end` can wait, each with the line that it then comes before.

        That is the first line from `end` to before `last` that uses what they set, or what is outermost around it.
        """
        outermost = self.outermost(first, last)
        users: dict[str, list[int]] = {}
        for i in range(first, last):
            for name in set(VARIABLE.findall(self.lines[i])):
                users.setdefault(name, []).append(i)
        places: dict[int, int] = {}
        for i in reversed(range(first, end)):
            m = SET.fullmatch(self.lines[i])
            if not m or m[1] in self.outliving or outermost[i] != i or self.pointers.keys() & {*VARIABLE.findall(m[0])}:
                continue
            place = min((places.get(k, outermost[k]) for k in users[m[1]] if k > i), default=end)
            if place > end and not any(self.changes(name, i + 1, place) for name in VARIABLE.findall(m[2])):
                places[i] = place
        return places

    def declaration(self, v: Any) -> str:
        """Return the declaration of a variable; nothing for those that C++ does without."""
        name, ctype = v.emit(), v.ctype()
        if name in self.counters or name in self.counted or name in self.pointers:
            return ""
        if v.constant is not None:
            return f"    const {ctype} {name} = {constant_str(v.constant)};\n"
        return f"    {self.types.wide(v.type)} {name};\n"

    def whole(self) -> str:
        """Return the body of a function whose lanes are `exec_in`; it leaves `result_`, if it has a result."""
        self.result = " result_" if self.adj.return_var else ""
        declarations = [self.declaration(v) for v in self.adj.variables]
        masks = "    lanes::Mask exec = exec_in, returned_ = false;\n"
        return "".join(declarations) + masks + self.code(range(len(self.lines)))

    def code(self, numbers: Sequence[int]) -> str:
        """Return statements, by their numbers."""
        return "".join(f"    {self.statement(i)}\n" for i in numbers)

    def _still_here(self) -> str:
        """Return the mask of those that neither returned nor left the round of the innermost loop."""
        left = ["returned_"]
        if self.loops:
            left += [f"broken_{self.loops[-1]}", f"continued_{self.loops[-1]}"]
        return f"~({' | '.join(left)})"

    def statement(self, i: int) -> str:
        """Return a statement, by its number.

        Raises:
            Unsupported: where it is of a kind that is not known.
        """
        line = self.lines[i]
        for pattern, write in _STATEMENTS:
            if m := pattern.fullmatch(line):
                return write(self, m, i)
        raise Unsupported(line)

    def _if(self, m: re.Match[str], i: int) -> str:
        self.blocks.append(i)
        condition = f"{'~' if m[1] else ''}lanes::to_bool({m[2]})"
        return f"{{ const lanes::Mask before_{i} = exec; exec = exec & {condition}; if (lanes::any(exec)) {{"

    def _end_if(self, m: re.Match[str], i: int) -> str:
        start = self.blocks.pop()
        end = f"}} exec = before_{start} & {self._still_here()}; }}"
        if self.result is not None and not self.blocks and not self.loops:
            if any(line.startswith("return") for line in self.lines[start:i]):
                end += f" if (!lanes::any(exec)) return{self.result};"
        if self.loops == [self.cut] and not self.blocks and any(map(_LEAVE.match, self.lines[start:i])):
            end += " if (!lanes::any(exec)) break;"
        return end

    def _start_loop(self, m: re.Match[str], i: int) -> str:
        loop = m[1]
        self.loops.append(loop)
        masks = f"lanes::Mask broken_{loop} = false, continued_{loop} = false;"
        head = f"{{ const lanes::Mask before_{loop} = exec; {masks} "
        following = NO_MORE.fullmatch(self.lines[i + 1])
        if following and following[1] in self.counted:
            ends = self.counted[following[1]]
            begin, end, step = (0, ends[0], 1) if len(ends) == 1 else (ends[0], ends[1], (*ends, 1)[2])
            k = f"counter_{loop}"
            return f"{head}LANES_UNROLL for (int {k} = {begin}; {k} {'<' if step > 0 else '>'} {end}; {k} += {step}) {{"
        return head + "for (;;) {"

    def _end_loop(self, m: re.Match[str], i: int) -> str:
        loop = self.loops.pop()
        if loop != m[1]:
            raise Unsupported(self.lines[i])
        return f"exec = before_{loop} & ~returned_; }}"

    def _no_more(self, m: re.Match[str], i: int) -> str:
        if m[1] in self.counted:
            return ""
        return self._leave_unless(f"lanes::more({m[1]})", m[2])

    def _while(self, m: re.Match[str], i: int) -> str:
        return self._leave_unless(f"lanes::to_bool({m[1]})", m[2])

    def _leave_unless(self, mask: str, loop: str) -> str:
        left = f"broken_{loop} = broken_{loop} | (exec & ~on); exec = exec & on;"
        return f"{{ const lanes::Mask on = {mask}; {left} }} if (!lanes::any(exec)) break;"

    def _next(self, m: re.Match[str], i: int) -> str:
        if m[1] in self.counters:
            return f"const int {m[1]} = counter_{self.loops[-1]};"
        return f"{m[1]} = lanes::next({m[2]}, exec);"

    def _goto(self, m: re.Match[str], i: int) -> str:
        loop = m[2]
        if loop != self.loops[-1]:
            raise Unsupported(self.lines[i])
        if m[1] == "start" and self.lines[i + 1] == f"end_{loop}:;":
            again = f"exec = before_{loop} & ~(returned_ | broken_{loop}); continued_{loop} = false;"
            return f"{again} if (!lanes::any(exec)) break; }}"
        mask = f"{'broken' if m[1] == 'end' else 'continued'}_{loop}"
        return f"{mask} = {mask} | exec; exec = false;"

    def _return(self, m: re.Match[str], i: int) -> str:
        result = f"lanes::set_first(result_, {m[1]}, exec, returned_); " if m[1] else ""
        return f"{result}returned_ = returned_ | exec; exec = false;"

    def _range(self, m: re.Match[str], i: int) -> str:
        if m[1] in self.counted:
            return ""
        return self._set(SET.fullmatch(self.lines[i]), i)  # type: ignore[arg-type]

    def _assign(self, m: re.Match[str], i: int) -> str:
        return f"lanes::set({m[1]}, {m[2]}, exec);"

    def _assign_inplace(self, m: re.Match[str], i: int) -> str:
        self._must_take("assign_inplace", m[1], i)
        return f"lanes::assign_inplace({self._known(m[1])}, exec);"

    def _array_store(self, m: re.Match[str], i: int) -> str:
        self._must_take("array_store", m[1], i)
        return f"lanes::array_store({self._pointed(m[1])}, exec);"

    def _store(self, m: re.Match[str], i: int) -> str:
        if "(lanes::address(" in self._pointed(m[1]) or "LANES_MEMBER(" in self._pointed(m[1]):
            raise Unsupported(self.lines[i])
        return f"lanes::set(*{self._pointed(m[1])}, {m[2]}, exec);"

    def _set(self, m: re.Match[str], i: int) -> str:
        name, value = m[1], self.expression(self._pointed(m[2]))
        if name in self.pointers:
            self.pointers[name] = f"({value})"
            return ""
        v = self.variables[name]
        if v.ctype() in ("wp::uint8", "wp::uint16") and not re.match(r"wp::(load|copy|where|extract)\(|var_", m[2]):
            raise Unsupported(f"{self.lines[i]}: arithmetic of fewer than 32 bits")
        shared = self.types.is_shared(strip_reference(v.type)) or v.ctype() == "wp::shape_t"
        if not shared and (self.keep_all or name in self.outliving):
            return f"lanes::set({name}, {value}, exec);"
        return f"{name} = {value};"

    def _call(self, m: re.Match[str], i: int) -> str:
        return f"wide_{m[1]}({m[2]}, exec);"

    def _pointed(self, text: str) -> str:
        """Return a text with what pointers stand for in their place."""
        return VARIABLE.sub(lambda m: self.pointers.get(m[0]) or m[0], text)

    def _known(self, arguments: str) -> str:
        """Return arguments with indices that are constants as numbers, by which C++ chooses a function."""
        first, *others = arguments.split(", ")
        known = [str(self.constants[a]) if type(self.constants.get(a)) is int else a for a in others]
        return ", ".join([first, *known])

    def _must_take(self, name: str, arguments: str, i: int) -> None:
        if not can_be_called(name, self._kinds(arguments)):
            raise Unsupported(self.lines[i])

    def _kinds(self, arguments: str) -> list[str]:
        """Return what arguments are for `can_be_called`: anything where they are no plain variables."""
        names = re.findall(r"(?:[^,(]|\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\))+", arguments)
        variables = [self.variables.get(name.strip()) for name in names]
        return [ANYTHING if v is None or v.emit() in self.pointers else self.types.kind(v.type) for v in variables]

    def _must_have(self, name: str, field: str) -> None:
        t = strip_reference(self.variables[name].type)
        if not self.types.is_whole(t) and field not in dict(self.types.fields(t)):
            raise Unsupported(f"{name}.{field}: each lane has its own array")

    def expression(self, text: str) -> str:
        """Return what a variable is set to.

        Raises:
            Unsupported: where it is of a kind that is not known.
        """
        if m := re.fullmatch(r"&\(\(\(\*wp::address\((.*?), (var_\w+)\)\)\)\.([\w.]+)\)", text):
            return f"LANES_MEMBER({m[1]}, {m[2]}, {m[3]})"
        if m := re.match(r"&\(+(var_\w+)\)\.(\w+)", text):
            self._must_have(m[1], m[2])
        if text.startswith("&(") or VARIABLE.fullmatch(text) or re.fullmatch(r"-?[\d.]+(e-?\d+)?(f|ll|u|ull)?", text):
            return text
        if m := re.fullmatch(r"wp::(\w+)\((.*)\)", text):
            name, arguments = m.groups()
            name = _CONVERSIONS.get(name, name)
            element = name == "indexref" and re.fullmatch(r"\(?&\(\((var_\w+)\)\.[\w.]+\)\)?, var_\w+", arguments)
            if not can_be_called(name, self._kinds(arguments)) or (name == "indexref" and not element):
                raise Unsupported(text)
            if name == "load":
                return f"lanes::load({arguments}, exec)"
            if name in ("extract", "indexref"):
                return f"lanes::{name}({self._known(arguments)})"
            return f"lanes::{name}({arguments})"
        if m := re.fullmatch(r"wp::cast<wp::(\w+)>\((.*)\)", text):
            if not can_be_called(f"cast_{m[1]}", self._kinds(m[2])):
                raise Unsupported(text)
            return f"lanes::cast_{m[1]}({m[2]})"
        if (m := re.fullmatch(r"wp::(vec|mat)_t<(.*), ?(wp::\w+|bool)>\((.*)\)", text)) and m[3] in NUMBERS:
            if (m[1] == "mat" or ", " in m[4]) and {"vector", "matrix"} & set(self._kinds(m[4])):
                raise Unsupported(text)
            return f"lanes::make_{m[1]}<{m[2]}, {NUMBERS[m[3]]}>({m[4]})"
        if m := re.fullmatch(r"bool\((.*)\)", text):
            return f"lanes::to_bool({m[1]})"
        if text == "builtin_tid1d()":
            return "thread_"
        if m := re.fullmatch(r"\((var_\w+) (==|!=|<|>|<=|>=) (var_\w+)\)", text):
            kinds = set(self._kinds(f"{m[1]}, {m[3]}"))
            if not kinds <= {ANYTHING, *ORDERED} and not (m[2] in ("==", "!=") and kinds <= {"vector", "Mask"}):
                raise Unsupported(text)
            return f"lanes::Mask({m[1]} {m[2]} {m[3]})"
        if m := re.fullmatch(r"(var_\w+) (&&|\|\|) (var_\w+)", text):
            return f"(lanes::to_bool({m[1]}) {m[2][0]} lanes::to_bool({m[3]}))"
        if (m := _STRUCT.fullmatch(text)) and m[1] in self.types.struct_names:
            if m[2]:
                raise Unsupported(text)
            return f"wide_{m[1]}::zero()"
        if m := re.fullmatch(r"([A-Za-z_]\w*)\((.*)\)", text):
            return f"wide_{m[1]}({m[2] + ', ' if m[2] else ''}exec)"
        raise Unsupported(text)


_CONVERSIONS = {
    "float": "to_float32",
    "int": "to_int32",
    **{name: f"to_{name}" for name in ("float32", "int32", "uint32", "int64", "float64")},
}

ORDERED = ("Floats", "Ints", "Uints", "Longs", "Doubles")
"""Kinds that have all comparisons."""

_Write = Callable[[Body, "re.Match[str]", int], str]
_STATEMENTS: list[tuple[re.Pattern[str], _Write]] = [
    (re.compile(pattern) if isinstance(pattern, str) else pattern, write)
    for pattern, write in (
        (r"if \((!?)(var_\w+)\) \{", Body._if),
        (r"\}", Body._end_if),
        (START, Body._start_loop),
        (END, Body._end_loop),
        (NO_MORE, Body._no_more),
        (rf"if \(\((var_\w+)\) == false\) goto end_{_LABEL};", Body._while),
        (NEXT, Body._next),
        (rf"goto (start|end)_{_LABEL};", Body._goto),
        (r"return ?(var_\w+)?;", Body._return),
        (RANGE, Body._range),
        (r"wp::assign\((var_\w+), (var_\w+)\);", Body._assign),
        (r"wp::assign_inplace\((.*)\);", Body._assign_inplace),
        (r"wp::array_store\((.*)\);", Body._array_store),
        (r"wp::store\((var_\w+), (var_\w+)\);", Body._store),
        (r"(var_\w+(?:\.\w+)+) = (var_\w+);", Body._assign),
        (SET, Body._set),
        (r"([a-zA-Z_]\w*)\((.*)\);", Body._call),
    )
]
