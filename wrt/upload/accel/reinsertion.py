"""Reinsert subtrees of the binary tree where they cost less: the host side of `kernels/accel/build/reinsert.py`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device

ROUNDS = 6
"""Rounds of reinsertion; in one round, moves that touch the same nodes exclude one another."""

LARGEST = 4096
"""Nodes that are reinserted in a round, those with the largest area."""

NEAR_ROOT = 8 * LARGEST
"""These nodes are searched for in the top levels that hold this many: areas shrink further down."""

ANY_VISITS = 2**31 - 1
"""Nodes that a search may visit: as many as there are."""

LEAST = 32
"""Smaller trees are not worth optimising."""


def levels_of(nodes: Any) -> list[NDArray[np.int32]]:
    """Return the node numbers of a binary tree, an array of BinaryNode that begins with the root, by depth."""
    all_nodes = nodes.numpy()
    levels = [np.zeros(1, np.int32)]
    while len(levels[-1]):
        right = all_nodes["right"][levels[-1]]
        inner = levels[-1][right != 0]
        levels.append(np.concatenate([all_nodes["left"][inner], right[right != 0]]))
    return levels[:-1]


def reinsert(nodes: Any, device: Device) -> None:
    """Reinsert the largest nodes of a binary tree where they reduce the total surface area.

    Args:
        nodes: array of BinaryNode, changed in place.
        device: its device.
    """
    backend = current_backend()
    kernels = backend.kernels("wrt.kernels.accel.build.reinsert")

    levels = levels_of(nodes)
    upper_levels = 1 + int(np.searchsorted(np.cumsum([len(level) for level in levels]), NEAR_ROOT))
    numbers = np.concatenate(levels[:upper_levels])
    if len(numbers) < LEAST:
        return
    parents = backend.array(np.full(len(nodes), -1, np.int32), int, device.name)
    all_nodes = nodes.numpy()
    for level in levels:
        inner = level[all_nodes["right"][level] != 0]
        device.launch(kernels.write_parents, len(inner), [backend.array(inner, int, device.name), nodes, parents])
    touched = backend.empty(len(nodes), int, device.name)
    for _ in range(ROUNDS):
        moving = _largest(nodes, numbers)
        on_device = backend.array(moving, int, device.name)
        places = backend.empty(len(moving), int, device.name)
        gains = backend.empty(len(moving), float, device.name)
        device.launch(kernels.find_places, len(moving), [on_device, nodes, parents, ANY_VISITS, places, gains])
        found, saved = places.numpy(), gains.numpy()
        order = np.argsort(-saved, kind="stable")
        order = order[found[order] >= 0]
        if not len(order):
            return
        touched.zero_()
        chosen = [backend.array(numbers[order], int, device.name) for numbers in (moving, found)]
        device.launch(kernels.move_nodes, 1, [*chosen, nodes, parents, touched])


def _largest(nodes: Any, numbers: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return those of some node numbers whose nodes have the largest area."""
    some = nodes.numpy()[numbers]
    with np.errstate(over="ignore", invalid="ignore"):
        size = some["upper"] - some["lower"]
        areas = size[:, 0] * size[:, 1] + size[:, 1] * size[:, 2] + size[:, 2] * size[:, 0]
    return numbers[np.argsort(-areas, kind="stable")[:LARGEST]]
