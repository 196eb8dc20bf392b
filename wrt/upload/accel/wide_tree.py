"""A wide tree that is not written yet, as the CPU and GPUs find it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class WideNodes(NamedTuple):
    """Wide nodes that are written together.

    Attributes:
        size: their number.
        children: the binary nodes of their children, eight for each, −1 for none.
        inner_start: number of the first inner child of each, counted from that of the first node.
        leaf_start: likewise of the first leaf.
        first: number of the first node, of its first inner child, and of its first leaf.
    """

    size: int
    children: Any
    inner_start: Any
    leaf_start: Any
    first: tuple[int, int, int]


class WideTree(NamedTuple):
    """A wide tree that is not written yet.

    Attributes:
        level_starts: number of the first wide node of each level, then the number of all nodes.
        leaf_count: number of leaves.
        parts: the wide nodes.
        nodes: the binary tree.
        boxes: the boxes in order.
        box: (2, 3) float32 corners of the root.
        cost: expected cost of a ray.
    """

    level_starts: tuple[int, ...]
    leaf_count: int
    parts: list[WideNodes]
    nodes: Any
    boxes: Any
    box: NDArray[np.float32]
    cost: float
