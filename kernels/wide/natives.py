"""Functions that are written in C++, for sixteen lanes."""

import re
from typing import Any

from wrt.kernels.low_discrepancy import COLUMNS
from wrt.kernels.wide.light_tree import SAMPLE_TREE
from wrt.kernels.wide.rays import RAYS
from wrt.kernels.wide.types import Types, Unsupported

_REVERSE_BITS = """
LANES_INLINE lanes::Uints NAME(lanes::Uints bits, lanes::Mask) {
    return lanes::Uints(__builtin_elementwise_bitreverse(bits.v));
}
"""

# All lanes ask for the same dimension: kernels name it.
_FURTHER_DIMENSION = """
LANES_INLINE lanes::Uints NAME(lanes::Uints index, lanes::Ints dimension, lanes::Mask exec) {
    if (!lanes::any(exec)) return lanes::Uints(0u);
    static const unsigned columns[3][32] = {COLUMNS};
    const unsigned* const column = columns[lanes::lane(dimension, __builtin_ctz(lanes::bits(exec))) - 2];
    lanes::u16 digits = 0u, rest = exec.v ? index.v : (lanes::u16)0u;
    for (int k = 0; lanes::any(lanes::Uints(rest) != lanes::Uints(0u)); rest >>= 1, ++k)
        digits ^= -(rest & 1u) & column[k];
    return lanes::Uints(digits);
}
"""

_WIDE = {
    "_traverse": RAYS,
    "_sample_tree": SAMPLE_TREE,
    "reverse_bits": _REVERSE_BITS,
    "further_dimension": _FURTHER_DIMENSION,
}


def native_function(types: Types, function: Any) -> str:
    """Return the C++ of a function of `func_native`: one made for lanes, or its own, called for one after the other."""
    name = f"wide_{function.native_func}"
    arguments = function.adj.args
    if function.key in _WIDE:
        code = _WIDE[function.key].replace("COLUMNS", COLUMNS)
        return re.sub(r"\bNAME(?=\b|_)", name, code).replace("TREE_TYPE", arguments[0].ctype())
    result = function.adj.return_var[0]
    if not all(types.is_whole(a.type) for a in arguments):
        raise Unsupported(f"{function.key}: takes arrays of which each lane has its own")
    one = ", ".join(f"{a.ctype()} {a.label}" for a in arguments)
    many = ", ".join(f"const {types.wide(a.type)}& {a.label}" for a in arguments)
    passed = ", ".join(a.label if types.is_shared(a.type) else f"lanes::lane({a.label}, l)" for a in arguments)
    return f"""
static {result.ctype()} {name}_of_one({one}) {{
{function.native_snippet}
}}
static {types.wide(result.type)} {name}({many}, lanes::Mask exec) {{
    using lanes::set_lane;
    {types.wide(result.type)} r;
    LANES_EACH(l, exec) set_lane(r, l, {name}_of_one({passed}));
    return r;
}}
"""
