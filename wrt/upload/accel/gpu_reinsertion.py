"""Reinsert subtrees of the binary tree on a GPU: the host side of `kernels/accel/build/moves.py`."""

from __future__ import annotations

from typing import Any

from wrt.backend import current_backend
from wrt.backend.cuda.warp_errors import ran_out
from wrt.backend.device import Device
from wrt.upload.accel.reinsertion import LARGEST, LEAST, ROUNDS

MOST_VISITS = 4096
"""Nodes that a search visits at most. Among triangles of ordinary size the longest visits some hundred; among those as
large as the scene it would visit nearly all nodes, one after the other."""

TURNS = 6
"""Turns in which the moves of a round are chosen. Moves still undecided then wait for the next round."""


def reinsert_on_gpu(nodes: Any, parents: Any, visits: Any, device: Device) -> None:
    """Reinsert the largest nodes of a binary tree where they reduce the total surface area.

    In each round the host reads two numbers, and stops once no node has a better place.

    Args:
        nodes: array of BinaryNode, changed in place; places without a node have a count of 0.
        parents: their parents, changed in place.
        visits: as many zeros, which they are again afterwards.
        device: the device.

    Raises:
        NotEnoughMemory: if the device lacks memory to sort the nodes.
    """
    backend = current_backend()
    kernels = backend.kernels("wrt.kernels.accel.build.moves")
    reinsert = backend.kernels("wrt.kernels.accel.build.reinsert")
    upwards = backend.kernels("wrt.kernels.accel.build.upwards")

    name, size = device.name, len(nodes)
    count = min(LARGEST, size)
    if size < LEAST:
        return
    moves = kernels.Moves()
    moves.node, moves.place, moves.state = (backend.empty(count, int, name) for _ in range(3))
    moves.gain = backend.empty(count, float, name)
    moves.locks, moves.mover = (backend.zeros(size, "int64", name) for _ in range(2))
    moves.touched = backend.zeros(size, int, name)
    moves.found = backend.empty(2, int, name)
    keys, numbers = backend.empty(2 * size, float, name), backend.empty(2 * size, int, name)

    def launch(kernel: Any, threads: int, *inputs: Any) -> None:
        device.launch(kernel, threads, list(inputs), waits=False)

    for number in range(1, ROUNDS + 1):
        launch(kernels.rate_nodes, size, nodes, moves, keys, numbers)
        backend.sort_pairs(keys, numbers, size)
        launch(kernels.pick_largest, size, keys, numbers, max(LEAST, 1), moves)
        launch(reinsert.find_places, count, moves.node, nodes, parents, MOST_VISITS, moves.place, moves.gain)
        for turn in range(TURNS):
            turns = number * TURNS + turn
            launch(kernels.lock_nodes, count, moves, nodes, parents, number, turns, int(turn == 0))
            if turn == 0:
                places, unsorted = backend.fetch(moves.found).tolist()
                if unsorted:
                    raise ran_out(name)
                if not places:
                    return
            launch(kernels.choose_moves, count, moves, nodes, parents, number, turns)
        launch(kernels.exclude_cycles, count, moves, parents, number)
        launch(kernels.make_moves, count, moves, nodes, parents)
        launch(upwards.refit_from_leaves, size, nodes, parents, visits)
