"""What a file of a volume holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.io import memory_limits
from wrt.io.memory_limits import Limit

VOLUMES = Limit("volumes", 2**28, 128)
"""67 million numbers, such as 400 x 400 x 400, plus 32 for each byte of the files: sparse files are small for their
box."""


@dataclass(frozen=True)
class Volume:
    """Values in a box.

    Attributes:
        values: (nz, ny, nx) numbers or (nz, ny, nx, 3) colours at the centres of cells.
        places: `lower`, `upper` and `transform` of the box, as a DensityGrid takes them, where the file has them.
        others: `albedo` and `emission`, where the file has them.
    """

    values: NDArray[Any]
    places: dict[str, Any] = field(default_factory=dict)
    others: dict[str, NDArray[Any]] = field(default_factory=dict)


def take_memory(cells: int, channels: int = 1) -> None:
    """Count the memory of so many cells against the limit of a load.

    Raises:
        InputError: when that exceeds the limit.
    """
    memory_limits.take(VOLUMES, cells * channels * np.dtype(np.float32).itemsize)
