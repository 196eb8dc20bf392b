"""What the types of a kernel become where one thread does the work of sixteen."""

import re
from typing import Any

import warp as wp
from warp._src.codegen import Struct, Var, strip_reference
from warp._src.types import is_array

from wrt.kernels.wide.library import ANYTHING

NUMBERS = {
    "wp::float32": "lanes::Floats",
    "wp::int32": "lanes::Ints",
    "wp::uint32": "lanes::Uints",
    "wp::uint16": "lanes::Uints",
    "wp::uint8": "lanes::Uints",
    "wp::int64": "lanes::Longs",
    "wp::float64": "lanes::Doubles",
    "bool": "lanes::Mask",
}
"""Numbers of one lane in Warp's C++, and of sixteen in that of `numbers.h`."""

_VECTOR = re.compile(r"wp::vec_t<(\d+), ?(\S+)>")
_MATRIX = re.compile(r"wp::mat_t<(\d+), ?(\d+), ?(\S+)>")
_CONSTRUCTION = re.compile(r"var_\w+ = ([A-Za-z_]\w*_[0-9a-f]{8})\(")


class Unsupported(Exception):
    """A kernel does something that is not known for sixteen lanes."""


def name_of(t: Any) -> str:
    """Return the name of a type in Warp's C++."""
    return str(Var.type_to_ctype(t))


def has_array(t: Any) -> bool:
    """Return whether a type is a struct that leads to arrays, as a whole scene does."""
    return isinstance(t, Struct) and any(is_array(v.type) or has_array(v.type) for v in t.vars.values())


class Types:
    """The types of a module's functions.

    Attributes:
        structs: all, each after those of its fields.
        struct_names: theirs in C++.
    """

    def __init__(self, functions: list[Any]) -> None:
        """Take the functions and kernels that Warp has built, each with its `adj`."""
        self._functions = functions
        constructed = set()
        for function in functions:
            for line in lines_of(function):
                if m := _CONSTRUCTION.match(line):
                    constructed.add(m[1])
        self._constructed = constructed
        arguments = [strip_reference(a.type) for f in functions if isinstance(f, wp.Kernel) for a in f.adj.args]
        self._given = {name_of(t) for t in arguments if isinstance(t, Struct)}
        self._elements: set[str] = set()  # structs of which there are arrays
        self.structs = self._in_order()
        self.struct_names = {name_of(t) for t in self.structs}

    def is_uniform(self, t: Any) -> bool:
        """Return whether all lanes share a struct: the kernel's argument or one of arrays, where no other is made."""
        return (has_array(t) or name_of(t) in self._given) and name_of(t) not in self._constructed | self._elements

    def fields(self, t: Any) -> list[tuple[str, Any]]:
        """Return the fields of a struct for sixteen lanes: none that leads to arrays where each lane has its own."""
        fields = [(v.label, strip_reference(v.type)) for v in t.vars.values()]
        return [(label, of) for label, of in fields if name_of(t) not in self._elements or not self.is_shared(of)]

    def is_whole(self, t: Any) -> bool:
        """Return whether a type has all its fields for sixteen lanes."""
        t = strip_reference(t)
        return not isinstance(t, Struct) or self.is_uniform(t) or len(self.fields(t)) == len(t.vars)

    def is_shared(self, t: Any) -> bool:
        """Return whether all lanes share one value of a type."""
        return is_array(t) or self.is_uniform(t)

    def wide(self, t: Any) -> str:
        """Return the C++ type of sixteen values of Warp's type t, or of the one that they share.

        Raises:
            Unsupported: where there is none.
        """
        t = strip_reference(t)
        name = name_of(t)
        if self.is_shared(t) or name == "wp::shape_t":
            return name
        if isinstance(t, Struct):
            return f"wide_{name}"
        if name in NUMBERS:
            return NUMBERS[name]
        if m := _VECTOR.fullmatch(name):
            return f"lanes::Vector<{m[1]}, {number(m[2])}>"
        if m := _MATRIX.fullmatch(name):
            return f"lanes::Matrix<{m[1]}, {m[2]}, {number(m[3])}>"
        if name == "wp::range_t":
            return "lanes::Range"
        raise Unsupported(f"type {name}")

    def kind(self, t: Any) -> str:
        """Return what a type is for `can_be_called`."""
        wide = self.wide(t)
        if wide == "wp::shape_t":
            return "shape"
        for start, kind in (("lanes::Vector", "vector"), ("lanes::Matrix", "matrix"), ("lanes::", wide[7:])):
            if wide.startswith(start):
                return kind
        return ANYTHING

    def _in_order(self) -> list[Any]:
        """Return all structs, each after those of its fields."""
        order: list[Any] = []
        seen = set()

        def visit(t: Any) -> None:
            t = strip_reference(t)
            if is_array(t):
                t = t.dtype
                if isinstance(t, Struct):
                    self._elements.add(name_of(t))
            if isinstance(t, Struct) and t not in seen:
                seen.add(t)
                for v in t.vars.values():
                    visit(v.type)
                order.append(t)

        for function in self._functions:
            for v in (*function.adj.args, *function.adj.variables):
                visit(v.type)
        return order

    def declarations(self, declared: list[Any]) -> str:
        """Return C++ of all structs, of one lane where Warp does not declare them itself, and of sixteen.

        `declared` are the types of the kernel's arguments: those, and what they lead to, Warp declares.
        """
        known = set()
        waiting = list(declared)
        while waiting:
            t = strip_reference(waiting.pop())
            if is_array(t):
                t = t.dtype
            if isinstance(t, Struct) and t not in known:
                known.add(t)
                waiting += [v.type for v in t.vars.values()]
        out = []
        for t in self.structs:
            if t not in known:
                fields = " ".join(f"{name_of(v.type)} {v.label};" for v in t.vars.values())
                out.append(f"struct {name_of(t)} {{ {fields} }};\n")
            if not self.is_uniform(t):
                out.append(self._wide_struct(t))
        return "".join(out)

    def _wide_struct(self, t: Any) -> str:
        name = name_of(t)
        wide = f"wide_{name}"
        fields = self.fields(t)
        varying = [(label, of) for label, of in fields if not self.is_shared(of)]

        def zero(label: str, of: Any) -> str:
            if self.is_shared(of):
                return f"r.{label} = {self.wide(of)}();"
            if isinstance(of, Struct):
                return f"r.{label} = {self.wide(of)}::zero();"
            return f"lanes::clear(r.{label});"

        def each(pattern: str, of: list[tuple[str, Any]]) -> str:
            return " ".join(pattern.format(f=label, type=name_of(type_)) for label, type_ in of)

        members = " ".join(f"{self.wide(of)} {label};" for label, of in fields)
        gathered = "r.{f} = gather<OFFSET + (int)__builtin_offsetof(%s, {f}), SIZE>(base, record, ({type}*)0, exec);"
        return f"""
struct {wide};
template<> struct lanes::WideOf<{name}> {{ typedef {wide} type; }};
struct {wide} {{
    {members}
    {wide}() {{}}
    {wide}(const {name}& a) : {", ".join(f"{label}(a.{label})" for label, _ in fields)} {{}}
    static {wide} zero() {{ {wide} r; {" ".join(zero(*field) for field in fields)} return r; }}
    {name} lane(int l) const {{ {name} r; {each("r.{f} = lanes::lane(this->{f}, l);", fields)} return r; }}
}};
LANES_INLINE {wide} blend(lanes::Mask m, const {wide}& a, const {wide}& b) {{
    using lanes::blend; {wide} r; {each("r.{f} = blend(m, a.{f}, b.{f});", fields)} return r; }}
LANES_INLINE void set_lane({wide}& x, int l, const {name}& s) {{
    using lanes::set_lane; {each("set_lane(x.{f}, l, s.{f});", varying)} }}
LANES_INLINE void move({wide}& to, const {wide}& x, lanes::Move m) {{
    using lanes::move; {each("move(to.{f}, x.{f}, m);", varying)} }}
template<int OFFSET, int SIZE>
LANES_INLINE {wide} gather(const char* base, lanes::i16 record, {name}*, lanes::Mask exec) {{
    using lanes::gather; {wide} r; {each(gathered % name, varying)} return r; }}
"""


def number(name: str) -> str:
    """Return what a number of one lane is called for sixteen."""
    if name not in NUMBERS:
        raise Unsupported(f"type {name}")
    return NUMBERS[name]


def lines_of(function: Any) -> list[str]:
    """Return the statements of a function or kernel as Warp writes them; none of one that is written in C++."""
    if getattr(function, "native_snippet", None):
        return []
    lines = (line.strip() for line in function.adj.blocks[0].body_forward)
    return [line for line in lines if line and not line.startswith(("//", "#line"))]
