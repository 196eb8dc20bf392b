"""A GPU builds the same trees whatever the order of its threads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from support.emulated_cuda.backend import GPU, EmulatedBackend, emulated_cuda, entry_of
from support.emulated_cuda.libraries import BLOCK
from support.kernels import upload
from support.ray_trees import HARD, Tree, build, check, scattered, soup

from wrt.backend.device import Device
from wrt.kernels.accel.build import moves
from wrt.kernels.accel.build.split import BinaryNode
from wrt.upload.accel.binary_tree import levels_of


class ShuffledBackend(EmulatedBackend):
    """Runs the blocks of each grid in a random order."""

    def __init__(self) -> None:
        super().__init__(optimization=0)
        self._rng = np.random.default_rng(1)

    def run_grid(self, kernel: Any, count: int, packed: list[Any]) -> None:
        for block in self._rng.permutation(-(-count // BLOCK)).tolist():
            threads = range(block * BLOCK, (block + 1) * BLOCK)
            self.library(kernel).run(entry_of(kernel), count, packed, threads=threads)


TREES = {
    "soup": lambda: soup(9_000),
    "large triangles": HARD["large triangles"],
    "coincident pairs": lambda: np.repeat(soup(2_000), 2, axis=0),
    "scattered": lambda: scattered(5_000),
}


def built_by(backend: EmulatedBackend, corners: NDArray[np.float32]) -> Tree:
    with emulated_cuda(counting=backend):
        return build(corners, GPU)


@pytest.mark.machinery
@pytest.mark.parametrize("name", TREES)
def test_trees_are_the_same_in_any_order_of_threads(name: str) -> None:
    corners = TREES[name]()
    tree, shuffled = built_by(EmulatedBackend(optimization=0), corners), built_by(ShuffledBackend(), corners)
    check(tree, corners)
    for field in ("lower", "upper", "children", "numbers", "corners"):
        np.testing.assert_array_equal(getattr(shuffled, field), getattr(tree, field))


@pytest.mark.slow
@pytest.mark.parametrize("gains", [(2.0, 1.0), (1.0, 2.0)])
def test_of_two_moves_to_below_each_other_the_better_is_made(gains: tuple[float, float]) -> None:
    """Their neighbours are distinct, so locks exclude neither, and both together would cut a cycle off the tree."""
    inner = {0: (1, 2), 1: (3, 4), 2: (5, 6), 3: (7, 8), 5: (9, 10), 7: (11, 12), 9: (13, 14)}
    rows, parents = np.zeros(15, BinaryNode.numpy_dtype()), np.full(15, -1)
    rows["count"] = 1
    for parent, children in inner.items():
        rows["left"][parent], rows["right"][parent] = children
        parents[list(children)] = parent
    with emulated_cuda(optimization=0):
        device, state = Device(GPU), moves.Moves()
        nodes, above = upload(rows, BinaryNode, GPU), upload(parents, int, GPU)
        state.node, state.place = upload([3, 5], int, GPU), upload([13, 11], int, GPU)
        state.gain, state.state = upload(gains, float, GPU), upload([0, 0], int, GPU)
        state.locks, state.mover = (upload(np.zeros(15), wp.int64, GPU) for _ in range(2))
        state.touched, state.found = upload(np.zeros(15), int, GPU), upload([0, 0], int, GPU)
        device.launch(moves.lock_nodes, 2, [state, nodes, above, 1, 6, 1])
        device.launch(moves.choose_moves, 2, [state, nodes, above, 1, 6])
        assert (state.state.numpy() == moves.CHOSEN).all()
        assert state.found.numpy().tolist() == [2, 0]
        device.launch(moves.exclude_cycles, 2, [state, above, 1])
        device.launch(moves.make_moves, 2, [state, nodes, above])
        found = nodes.numpy()
    first = gains[0] > gains[1]
    assert state.state.numpy().tolist() == [moves.CHOSEN, moves.EXCLUDED][:: 1 if first else -1]
    np.testing.assert_array_equal(np.sort(np.concatenate(levels_of(nodes))), np.arange(15))
    parent, place, node = (1, 13, 3) if first else (2, 11, 5)
    assert (found["left"][parent], found["right"][parent]) == (place, node)
