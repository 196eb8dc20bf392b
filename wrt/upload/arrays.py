"""Arrays for kernels: records from rows, and the largest arrays.

Kernels number the elements of arrays with 32 bits, and compute addresses from the numbers with 64.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError

MOST_ELEMENTS = 2**31 - 1
"""Elements of an array: 24 GB of texels, vertices or normals, 8 GB of numbers such as those of a ray tree."""


def require_countable(count: int, what: str) -> None:
    """Raise InputError if an array of `count` elements is too large; `what` names them."""
    if count > MOST_ELEMENTS:
        raise InputError(f"{count:,} {what} are more than the {MOST_ELEMENTS:,} that kernels can number")


def packed(rows: Iterable[Sequence[Any] | Mapping[str, Any]], struct: Any) -> NDArray[Any]:
    """Return an array of a struct of kernels; a row has all values in order, or some by name, the others being 0."""
    listed = list(rows)
    records = np.zeros(len(listed), struct.numpy_dtype())
    for record, row in zip(records, listed, strict=True):
        for name, value in row.items() if isinstance(row, Mapping) else zip(records.dtype.names, row, strict=True):
            record[name] = value
    return records
