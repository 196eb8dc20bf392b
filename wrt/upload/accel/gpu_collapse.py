"""Find the nodes of the wide tree on a GPU: the host side of `kernels/accel/build/wide_levels.py`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device


class WideTree(NamedTuple):
    """The nodes of a wide tree that is not written yet.

    Attributes:
        level_starts: number of the first wide node of each level, then the number of all nodes.
        leaf_count: number of leaves.
        cost: expected cost of a ray.
        box: (2, 3) float32 corners of the root.
        children: binary nodes of the children of each wide node, −1 for none.
        inner_start: inner children of all nodes before, for each.
        leaf_start: likewise leaves.
    """

    level_starts: tuple[int, ...]
    leaf_count: int
    cost: float
    box: NDArray[np.float32]
    children: Any
    inner_start: Any
    leaf_start: Any


def collapse_on_gpu(nodes: Any, costs: Any, device: Device, max_depth: int) -> WideTree:
    """Collapse a binary tree; stop at one level more than `max_depth`. The host reads once, at the end.

    Args:
        nodes: array of BinaryNode.
        costs: the costs of collapsing them.
        device: the device.
        max_depth: levels that the tree may have.
    """
    backend = current_backend()
    kernels = backend.kernels("wrt.kernels.accel.build.wide_levels")

    name, most = device.name, len(nodes) // 2  # a wide node replaces one inner node at least
    wide = kernels.WideLevels()
    wide.root, wide.inner_before, wide.leaves_before = (backend.empty(most, int, name) for _ in range(3))
    wide.inner, wide.leaves = (backend.zeros(most, int, name) for _ in range(2))
    wide.children = backend.empty(8 * most, int, name)
    wide.start = backend.zeros(max_depth + 3, int, name)
    device.launch(kernels.begin_levels, 1, [wide], waits=False)
    # Nodes of a level, and up to its end, at most.
    width = until = 1
    for level in range(max_depth + 1):
        width, until = min(width, most), min(until, most)
        device.launch(kernels.find_level_children, width, [level, wide, nodes], waits=False)
        backend.sum_before(wide.inner[:until], wide.inner_before[:until])
        device.launch(kernels.list_level_inner, width, [level, wide, nodes], waits=False)
        width *= 8
        until += width
    backend.sum_before(wide.leaves, wide.leaves_before)
    summary = backend.empty(8 + len(wide.start), int, name)
    device.launch(kernels.summarize, 1, [wide, nodes, costs, summary], waits=False)
    numbers = summary.numpy()
    starts = numbers[8:].tolist()
    levels = next(k for k in range(len(starts)) if k == len(starts) - 1 or starts[k] == starts[k + 1])
    bits = numbers[1:8].view(np.float32)
    return WideTree(
        tuple(starts[: levels + 1]),
        int(numbers[0]),
        float(bits[0]),
        bits[1:].reshape(2, 3),
        wide.children,
        wide.inner_before,
        wide.leaves_before,
    )
