"""Collapse a binary tree to wide nodes: the host side of `kernels/accel/build/collapse.py`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device

LEVELS_PER_READ = 2
"""Levels between two reads of the next one's size on a GPU. A level costs three launches, of about 15 us each, and a
read 20 us (estimated for an H100)."""


class WideTree(NamedTuple):
    """A wide tree that is not written yet.

    Attributes:
        level_starts: number of the first wide node of each level, then the number of all nodes.
        leaf_count: number of leaves.
        wide: the WideNodes struct.
        nodes: the binary tree.
        boxes: the boxes in order.
        box: (2, 3) float32 corners of the root.
        cost: expected cost of a ray.
    """

    level_starts: tuple[int, ...]
    leaf_count: int
    wide: Any
    nodes: Any
    boxes: Any
    box: NDArray[np.float32]
    cost: float

    def write(self, leaf_nodes: int, out: Any, device: Device) -> Any:
        """Write the wide nodes; return for each leaf its first box and the number of boxes, as vec2i.

        Args:
            leaf_nodes: the number of the first leaf if leaves are nodes as well; otherwise −1.
            out: array of float to write to.
            device: the device.
        """
        backend = current_backend()
        collapse = backend.kernels("wrt.kernels.accel.build.collapse")
        leaf_ranges = backend.empty(self.leaf_count, "vec2i", device.name)
        inputs = [self.wide, self.nodes, leaf_nodes, out, backend.view(out, int, out.shape), leaf_ranges]
        device.launch(collapse.write_nodes, self.level_starts[-1], inputs, waits=False)
        return leaf_ranges


def collapse(nodes: Any, costs: Any, most: int, boxes: Any, device: Device, max_depth: int) -> WideTree:
    """Collapse a binary tree at the least cost; stop at one level more than `max_depth`.

    Args:
        nodes: array of BinaryNode.
        costs: the costs of collapsing them.
        most: bound on the wide nodes: each replaces one inner node at least.
        boxes: the boxes that the tree is over, for the result.
        device: the device.
        max_depth: levels that the tree may have.
    """
    backend = current_backend()
    kernels = backend.kernels("wrt.kernels.accel.build.collapse")

    name = device.name
    wide = kernels.WideNodes()
    wide.root, wide.inner_before, wide.leaves_before = (backend.empty(most, int, name) for _ in range(3))
    wide.inner, wide.leaves = (backend.zeros(most, int, name) for _ in range(2))
    wide.children = backend.empty(8 * most, int, name)
    wide.start = backend.zeros(max_depth + 3, int, name)
    device.launch(kernels.begin_wide_nodes, 1, [wide], waits=False)
    # Nodes of a level, and up to its end, at most.
    width = until = 1
    for level in range(max_depth + 1):
        device.launch(kernels.find_children, width, [level, wide, nodes], waits=False)
        backend.sum_before(wide.inner[:until], wide.inner_before[:until])
        device.launch(kernels.list_inner, width, [level, wide, nodes], waits=False)
        if device.is_cpu or level % LEVELS_PER_READ == LEVELS_PER_READ - 1:
            begin, end = backend.fetch(wide.start[level + 1 : level + 3]).tolist()
            if begin == end:
                break
            width, until = end - begin, end
        else:
            width = min(8 * width, most)
            until = min(until + width, most)
    backend.sum_before(wide.leaves[:until], wide.leaves_before[:until])
    summary = backend.empty(8 + len(wide.start), int, name)
    device.launch(kernels.summarize, 1, [until - 1, wide, nodes, costs, summary], waits=False)
    numbers = backend.fetch(summary)
    starts = numbers[8:].tolist()
    levels = next(k for k in range(len(starts)) if k == len(starts) - 1 or starts[k] == starts[k + 1])
    bits = numbers[1:8].view(np.float32)
    box, cost = bits[1:].reshape(2, 3), float(bits[0])
    return WideTree(tuple(starts[: levels + 1]), int(numbers[0]), wide, nodes, boxes, box, cost)
