"""Build the binary tree on a GPU: the host side of `levels.py`, `upwards.py` and `moves.py` in `kernels/accel/build`.

The host does not know how many nodes a level has, so it launches threads for the most that it can have. Every few
levels it reads whether there is another one; otherwise a small mesh would pay mostly for launches without work.
"""

from __future__ import annotations

from typing import Any

from wrt.backend import current_backend
from wrt.backend.cuda.warp_errors import ran_out
from wrt.backend.device import Device
from wrt.upload.accel.binary_tree import LARGEST, LEAST, ROUNDS, empty_bins

LEVELS_PER_READ = 2
"""Levels between two reads of whether there are more, from the first level that may be the last. A level costs nine
launches, of about 15 us each, and a read 20 us (estimated for an H100)."""

MOST_BUILDERS = 1 << 17
"""Threads that build subtrees at most; each has bins of 2 KB."""

MOST_VISITS = 4096
"""Nodes that a search visits at most. Among triangles of ordinary size the longest visits some hundred; among those as
large as the scene it would visit nearly all nodes, one after the other."""

TURNS = 6
"""Turns in which the moves of a round are chosen. Moves still undecided then wait for the next round."""


def split_on_gpu(boxes: Any, device: Device, sah_depth: int, *, reinserts: bool) -> tuple[Any, Any, int]:
    """Return the binary tree, the costs for collapsing it, and a bound on inner nodes; reorder the boxes to match.

    For the arguments see `split_boxes` in `binary_tree.py`.
    """
    backend = current_backend()
    collapse = backend.kernels("wrt.kernels.accel.build.collapse")
    split = backend.kernels("wrt.kernels.accel.build.split")
    upwards = backend.kernels("wrt.kernels.accel.build.upwards")

    name, count = device.name, len(boxes)
    nodes = backend.zeros(2 * count, split.BinaryNode, name)
    # The centres share the memory of the costs, which are not needed before.
    costs = backend.empty(2 * count * collapse.COST_SLOTS, float, name)
    _split_all(nodes, boxes, backend.view(costs, "vec8", 2 * count), device, sah_depth)
    parents, visits = find_parents(nodes, device), backend.zeros(2 * count, int, name)
    if reinserts:
        _reinsert(nodes, parents, visits, device)
    device.launch(upwards.sweep_upwards, 2 * count, [nodes, parents, visits, costs], waits=False)
    return nodes, costs, count


def find_parents(nodes: Any, device: Device) -> Any:
    """Return the parent of each node of a binary tree."""
    backend = current_backend()
    upwards = backend.kernels("wrt.kernels.accel.build.upwards")
    parents = backend.empty(len(nodes), int, device.name)
    device.launch(upwards.write_all_parents, len(nodes), [nodes, parents], waits=False)
    return parents


def least_levels(count: int, subtree: int) -> int:
    """Return how many levels at least have nodes over more than `subtree` of `count` boxes, if all are halved."""
    return max(0, -(-count // subtree) - 1).bit_length()


def most_levels(count: int, subtree: int, sah_depth: int) -> int:
    """Return how many levels at most have nodes over more than `subtree` of `count` boxes.

    Splits by the surface area heuristic may part a single box from the others; nodes below `sah_depth` are halved.
    """
    return min(sah_depth + least_levels(count, subtree), max(0, count - subtree))


def _split_all(nodes: Any, boxes: Any, centers: Any, device: Device, sah_depth: int) -> None:
    """Split all nodes and set their boxes."""
    backend = current_backend()
    levels = backend.kernels("wrt.kernels.accel.build.levels")
    split = backend.kernels("wrt.kernels.accel.build.split")
    top = backend.kernels("wrt.kernels.accel.build.top")

    name, count = device.name, len(boxes)
    depths, least = most_levels(count, levels.SUBTREE, sah_depth), least_levels(count, levels.SUBTREE)
    most_nodes = count // (levels.SUBTREE + 1) + 1
    most_chunks = count // levels.CHUNK + most_nodes
    counts = backend.zeros(depths + 1, "int64", name)
    bins, splits = empty_bins(most_nodes, name), backend.empty(most_nodes, split.Split, name)
    level, following = top.Level(), top.Level()
    for each in (level, following):
        each.chunk, each.counts, each.splits = levels.CHUNK, counts, splits
        each.bin_boxes, each.bin_counts = bins
        each.node, each.start = (backend.empty(most_nodes, int, name) for _ in range(2))
    chunks = top.Chunks()
    chunks.place, chunks.left, chunks.left_before = (backend.empty(most_chunks, int, name) for _ in range(3))
    chunks.bin_boxes, chunks.bin_counts = empty_bins(most_chunks, name)
    roots, root_count = backend.empty(count, int, name), backend.zeros(1, int, name)

    def launch(kernel: Any, threads: int, *inputs: Any) -> None:
        device.launch(kernel, threads, list(inputs), waits=False)

    launch(levels.begin_tree, 1, count, nodes, centers, level, roots, root_count)
    launch(levels.bound_centers, -(-count // levels.CHUNK), levels.CHUNK, boxes, centers)
    sorted_boxes = backend.empty(count if depths else 0, "vec8", name)
    for depth in range(depths):
        reads = depth >= least and (depth - least) % LEVELS_PER_READ == 0
        if reads and not backend.fetch(counts[depth : depth + 1])[0]:
            break
        level.depth, following.depth = depth, depth + 1
        launch(levels.clear_bins, most_nodes * top.AXIS_BINS, level)
        launch(top.fill_chunk_bins, most_chunks, level, chunks, nodes, boxes, centers)
        launch(levels.join_bins, most_chunks * top.AXIS_BINS, level, chunks)
        launch(top.split_nodes, most_nodes, level, nodes, centers, sah_depth)
        launch(top.count_left, most_chunks, level, chunks, nodes)
        backend.sum_before(chunks.left, chunks.left_before)
        launch(levels.part_boxes, most_chunks, level, chunks, nodes, boxes, centers, sorted_boxes)
        launch(levels.copy_boxes, most_chunks, level, chunks, nodes, sorted_boxes, boxes)
        launch(levels.list_level, most_nodes, level, following, nodes, roots, root_count)
        level, following = following, level
    threads = min(-(-2 * count // levels.SUBTREE), MOST_BUILDERS)
    bins = empty_bins(threads, name)  # of each thread
    launch(levels.build_listed, threads, threads, roots, root_count, nodes, boxes, centers, *bins, sah_depth)


def _reinsert(nodes: Any, parents: Any, visits: Any, device: Device) -> None:
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
    no_costs = backend.empty(0, float, name)
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
        launch(upwards.sweep_upwards, size, nodes, parents, visits, no_costs)
