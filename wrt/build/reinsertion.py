"""Moving subtrees of the binary tree to where they cost less: the host's side of `kernels/bvh_reinsert.py`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.device import Device

ROUNDS = 6
"""How often places are looked for; in one round what is near to a move stays where it is."""

LARGEST = 4096
"""Of so many nodes a round, those of the largest area."""

NEAR_ROOT = 8 * LARGEST
"""Looked for among the nodes of the first levels that have so many together: further down areas are smaller."""

LEAST = 32
"""In trees of fewer nodes nothing is to be gained."""


def levels_of(nodes: Any) -> list[NDArray[np.int32]]:
    """Return the numbers of a binary tree's nodes, by depth.

    Args:
        nodes: wp.array of BinaryNode, the first one the root.
    """
    all_nodes = nodes.numpy()
    levels = [np.zeros(1, np.int32)]
    while len(levels[-1]):
        right = all_nodes["right"][levels[-1]]
        inner = levels[-1][right != 0]
        levels.append(np.concatenate([all_nodes["left"][inner], right[right != 0]]))
    return levels[:-1]


def reinsert(nodes: Any, device: Device) -> None:
    """Move the largest nodes of a binary tree to where the sum of all areas is less.

    Args:
        nodes: wp.array of BinaryNode, changed in place.
        device: where it is.
    """
    import warp as wp

    from wrt.kernels import bvh_reinsert as k

    levels = levels_of(nodes)
    upper_levels = 1 + int(np.searchsorted(np.cumsum([len(level) for level in levels]), NEAR_ROOT))
    numbers = np.concatenate(levels[:upper_levels])
    if len(numbers) < LEAST:
        return
    parents = wp.full(len(nodes), -1, dtype=int, device=device.name)
    all_nodes = nodes.numpy()
    for level in levels:
        inner = level[all_nodes["right"][level] != 0]
        device.launch(k.write_parents, len(inner), [wp.array(inner, dtype=int, device=device.name), nodes, parents])
    touched = wp.empty(len(nodes), dtype=int, device=device.name)
    for _ in range(ROUNDS):
        moving = _largest(nodes, numbers)
        on_device = wp.array(moving, dtype=int, device=device.name)
        places = wp.empty(len(moving), dtype=int, device=device.name)
        gains = wp.empty(len(moving), dtype=float, device=device.name)
        device.launch(k.find_places, len(moving), [on_device, nodes, parents, places, gains])
        found, saved = places.numpy(), gains.numpy()
        order = np.argsort(-saved, kind="stable")
        order = order[found[order] >= 0]
        if not len(order):
            return
        touched.zero_()
        chosen = [wp.array(numbers[order], dtype=int, device=device.name) for numbers in (moving, found)]
        device.launch(k.move_nodes, 1, [*chosen, nodes, parents, touched])


def _largest(nodes: Any, numbers: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the numbers of those of some nodes that have the largest area."""
    some = nodes.numpy()[numbers]
    with np.errstate(over="ignore", invalid="ignore"):
        size = some["upper"] - some["lower"]
        areas = size[:, 0] * size[:, 1] + size[:, 1] * size[:, 2] + size[:, 2] * size[:, 0]
    return numbers[np.argsort(-areas, kind="stable")[:LARGEST]]
