"""What kernels for several lanes cannot have, and how to write it instead."""

import re

from wrt.spmd.ir import Unsupported

RANDOM = re.compile(r"rand(?!_init)\w+|sample_\w+|poisson")
"""Warp's functions that change the state of random numbers that they are given."""

_KINDS = (
    (r"v?printf?\b|wp::print\(", "a function prints", "leave that out"),
    (r"assert\(", "it has an `assert`", "leave it out"),
    (r"rand\w+|sample_\w+|poisson", "it draws random numbers", "use those that the function is given, such as `u`"),
    (r"constructs a struct", "a struct is made from values", "make it empty, as in `s = Lobe()`, and set its fields"),
    (r"ret_\d|results", "a function has several results", "return a struct"),
    (r"type wp::(quat|transform|spatial)\w*", "it has a quaternion, a transform or a tile", "use vectors and matrices"),
    (r"type ", "it has a type of number other than int, uint32, int64, float and float64", "use one of these"),
    (r"each lane has its own array|arrays that differ", "an array is chosen at run time", "choose an index instead"),
    (r"goto|labels", "a `break` or `continue` leaves more than one loop", "end each loop by a condition"),
)
"""Patterns of what the translator met; what that is in Python; what to write instead."""


def refusal(place: str, met: str) -> Unsupported:
    """Return the exception for something in Warp's C++, at a place in a user's code."""
    for pattern, what, remedy in _KINDS:
        if re.match(pattern, met) or (" " in pattern and re.search(pattern, met)):
            return Unsupported(f"{place}: {what}; {remedy}")
    return Unsupported(f"{place}: Warp's `{met}` has no form for several lanes; write it with other functions")
