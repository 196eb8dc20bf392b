"""The largest arrays: kernels number elements with 32 bits, and compute addresses from the numbers with 64."""

from __future__ import annotations

from wrt.errors import InputError

MOST_ELEMENTS = 2**31 - 1
"""Elements of an array: 24 GB of texels, vertices or normals, 8 GB of numbers such as those of a ray tree."""


def require_countable(count: int, what: str) -> None:
    """Raise InputError if an array of `count` elements is too large; `what` names them."""
    if count > MOST_ELEMENTS:
        raise InputError(f"{count:,} {what} are more than the {MOST_ELEMENTS:,} that kernels can number")
