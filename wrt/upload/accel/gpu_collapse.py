"""Find the nodes of the wide tree on a GPU: the host side of `kernels/accel/build/wide_levels.py`."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.upload.accel.wide_tree import WideNodes, WideTree

LEVELS_PER_READ = 2
"""Levels between two looks at whether there are more. A level costs three launches, of about 15 us each, and
a look 20 us (estimated for an H100)."""


def collapse_on_gpu(nodes: Any, costs: Any, boxes: Any, device: Device, max_depth: int) -> WideTree:
    """Collapse a binary tree; stop at one level more than `max_depth`.

    Args:
        nodes: array of BinaryNode.
        costs: the costs of collapsing them.
        boxes: the boxes that the tree is over, for the result.
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
        if level % LEVELS_PER_READ == LEVELS_PER_READ - 1:
            begin, end = backend.fetch(wide.start[level + 1 : level + 3]).tolist()
            if begin == end:
                break
        width *= 8
        until += width
    backend.sum_before(wide.leaves, wide.leaves_before)
    summary = backend.empty(8 + len(wide.start), int, name)
    device.launch(kernels.summarize, 1, [wide, nodes, costs, summary], waits=False)
    numbers = backend.fetch(summary)
    starts = numbers[8:].tolist()
    levels = next(k for k in range(len(starts)) if k == len(starts) - 1 or starts[k] == starts[k + 1])
    level_starts = tuple(starts[: levels + 1])
    bits = numbers[1:8].view(np.float32)
    part = WideNodes(level_starts[-1], wide.children, wide.inner_before, wide.leaves_before, (0, 1, 0))
    return WideTree(level_starts, int(numbers[0]), [part], nodes, boxes, bits[1:].reshape(2, 3), float(bits[0]))
