"""The types of a kernel for several lanes."""

from collections.abc import Iterable
from typing import Any

from warp._src.codegen import Struct, Var, strip_reference
from warp._src.types import is_array, type_is_matrix, type_is_vector

from wrt.spmd import ir

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
"""Types of numbers in Warp's C++, and their types for lanes in `numbers.h`."""


def name_of(t: Any) -> str:
    """Return the name of a type in Warp's C++."""
    return str(Var.type_to_ctype(t))


def has_array(t: Any) -> bool:
    """Return whether a type is a struct with arrays, directly or in members, such as a scene."""
    return isinstance(t, Struct) and any(is_array(v.type) or has_array(v.type) for v in t.vars.values())


def structs_in(types: Iterable[Any]) -> tuple[list[Any], set[str]]:
    """Return the structs in Warp's types, each after those of its members, and the names of array elements."""
    order: list[Any] = []
    elements = set()
    visited: set[Any] = set()

    def visit(t: Any) -> None:
        t = strip_reference(t)
        if is_array(t):
            t = t.dtype
            if isinstance(t, Struct):
                elements.add(name_of(t))
        if isinstance(t, Struct) and t not in visited:
            visited.add(t)
            for v in t.vars.values():
                visit(v.type)
            order.append(t)

    for t in types:
        visit(t)
    return order, elements


class Types:
    """The types of a module's functions.

    Attributes:
        structs: All structs, each after those of its members.
    """

    def __init__(self, functions: list[ir.Function], structs: list[Any], elements: set[str]) -> None:
        """Take the functions and the kernel, and the results of `structs_in`."""
        self.structs = structs
        self._elements = elements
        values = (s.value for f in functions for s in ir.walk(f.body) if isinstance(s, ir.Set))
        self._constructed = {name_of(value.type) for value in values if isinstance(value, ir.Zero)}
        arguments = [a.type for f in functions if not f.name for a in f.arguments]
        self._given = {name_of(t) for t in arguments if isinstance(t, Struct)}

    def is_uniform(self, t: Any) -> bool:
        """Return whether all lanes share a struct: an argument of the kernel or one with arrays, never constructed."""
        return (has_array(t) or name_of(t) in self._given) and name_of(t) not in self._constructed | self._elements

    def fields(self, t: Any) -> list[tuple[str, Any]]:
        """Return the fields of a struct for several lanes; a struct for each lane has none that leads to arrays."""
        fields = [(v.label, strip_reference(v.type)) for v in t.vars.values()]
        return [(label, of) for label, of in fields if name_of(t) not in self._elements or not self.is_shared(of)]

    def is_whole(self, t: Any) -> bool:
        """Return whether the type for several lanes has all fields."""
        t = strip_reference(t)
        return not isinstance(t, Struct) or self.is_uniform(t) or len(self.fields(t)) == len(t.vars)

    def is_shared(self, t: Any) -> bool:
        """Return whether all lanes share one value of a type."""
        return is_array(t) or self.is_uniform(t)

    def wide(self, t: Any) -> str:
        """Return the C++ type of Warp's type t for several lanes, or of the value that they share.

        Raises:
            Unsupported: There is none.
        """
        t = strip_reference(t)
        name = name_of(t)
        if self.is_shared(t) or name == "wp::shape_t":
            return name
        if isinstance(t, Struct):
            return f"wide_{name}"
        if name in NUMBERS:
            return NUMBERS[name]
        if type_is_vector(t) or type_is_matrix(t):
            size = ", ".join(map(str, t._shape_))
            return f"lanes::{'Vector' if type_is_vector(t) else 'Matrix'}<{size}, {_number(t._wp_scalar_type_)}>"
        if name == "wp::range_t":
            return "lanes::Range"
        raise ir.Unsupported(f"type {name}")

    def zero(self, t: Any) -> str:
        """Return the C++ of zeros of Warp's type t for several lanes, or of structs of zeros."""
        wide = self.wide(t)
        if isinstance(t, Struct):
            return f"{wide}::zero()"
        if type_is_vector(t) or type_is_matrix(t):
            return f"lanes::make_{'vec' if type_is_vector(t) else 'mat'}<{wide.partition('<')[2]}()"
        return f"{wide}({'false' if wide == 'lanes::Mask' else 0})"

    def declarations(self, arguments: list[Any]) -> str:
        """Return the C++ of all structs for several lanes, and for one lane if Warp does not declare them.

        Warp declares the types of the kernel's `arguments`, and the types that they contain.
        """
        declared = set(structs_in(arguments)[0])
        out = []
        for t in self.structs:
            if t not in declared:
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
        members_set = f": {', '.join(f'{label}(a.{label})' for label, _ in fields)} " if fields else ""
        gathered = "r.{f} = gather<OFFSET + (int)__builtin_offsetof(%s, {f}), SIZE>(base, record, ({type}*)0, exec);"
        return f"""
struct {wide};
template<> struct lanes::WideOf<{name}> {{ typedef {wide} type; }};
struct {wide} {{
    {members}
    {wide}() {{}}
    {wide}(const {name}& a) {members_set}{{}}
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
LANES_INLINE {wide} gather(const char* base, lanes::ints record, {name}*, lanes::Mask exec) {{
    using lanes::gather; {wide} r; {each(gathered % name, varying)} return r; }}
"""


def _number(t: Any) -> str:
    """Return the type of lanes for a number's type."""
    if name_of(t) not in NUMBERS:
        raise ir.Unsupported(f"type {name_of(t)}")
    return NUMBERS[name_of(t)]
