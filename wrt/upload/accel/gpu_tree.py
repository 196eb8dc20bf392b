"""Build the binary tree on a GPU: the host side of `kernels/accel/build/levels.py` and `upwards.py`.

The host does not know how many nodes a level has, so it launches as many threads as there may be. It reads one number
every few levels: whether there is another. By the model a small mesh would else pay mostly for launches without work.
"""

from __future__ import annotations

from typing import Any

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.upload.accel.binary_tree import empty_bins
from wrt.upload.accel.gpu_reinsertion import reinsert_on_gpu

LEVELS_PER_READ = 2
"""Levels between two looks at whether there are more, once there may be none. A level costs nine launches, of about
15 us each, and a look 20 us (estimated for an H100)."""

MOST_BUILDERS = 1 << 17
"""Threads that build subtrees at most; each has bins of 2 KB."""


def split_on_gpu(boxes: Any, device: Device, sah_depth: int, *, reinserts: bool) -> tuple[Any, Any]:
    """Return the binary tree and the costs for collapsing it, arrays on the device; reorder the boxes to match.

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
        reinsert_on_gpu(nodes, parents, visits, device)
    device.launch(upwards.price_upwards, 2 * count, [nodes, parents, visits, costs], waits=False)
    return nodes, costs


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

    name, count = device.name, len(boxes)
    depths, least = most_levels(count, levels.SUBTREE, sah_depth), least_levels(count, levels.SUBTREE)
    most_nodes = count // (levels.SUBTREE + 1) + 1
    most_chunks = count // levels.CHUNK + most_nodes
    counts = backend.zeros(depths + 1, "int64", name)
    bins, splits = empty_bins(most_nodes, name), backend.empty(most_nodes, split.Split, name)
    level, following = levels.Level(), levels.Level()
    for each in (level, following):
        each.counts, each.splits = counts, splits
        each.bin_boxes, each.bin_counts = bins
        each.node, each.start = (backend.empty(most_nodes, int, name) for _ in range(2))
    chunks = levels.LevelChunks()
    chunks.place, chunks.left, chunks.left_before = (backend.empty(most_chunks, int, name) for _ in range(3))
    chunks.bin_boxes, chunks.bin_counts = empty_bins(most_chunks, name)
    roots, root_count = backend.empty(count, int, name), backend.zeros(1, int, name)

    def launch(kernel: Any, threads: int, *inputs: Any) -> None:
        device.launch(kernel, threads, list(inputs), waits=False)

    launch(levels.begin_tree, 1, count, nodes, centers, level, roots, root_count)
    launch(levels.bound_centers, -(-count // levels.CHUNK), boxes, centers)
    sorted_boxes = backend.empty(count if depths else 0, "vec8", name)
    for depth in range(depths):
        looks = depth >= least and (depth - least) % LEVELS_PER_READ == 0
        if looks and not backend.fetch(counts[depth : depth + 1])[0]:
            break
        level.depth, following.depth = depth, depth + 1
        launch(levels.clear_bins, most_nodes * levels.AXIS_BINS, level)
        launch(levels.fill_level_bins, most_chunks, level, chunks, nodes, boxes, centers)
        launch(levels.join_bins, most_chunks * levels.AXIS_BINS, level, chunks)
        launch(levels.split_nodes, most_nodes, level, nodes, centers, sah_depth)
        launch(levels.count_left, most_chunks, level, chunks, nodes)
        backend.sum_before(chunks.left, chunks.left_before)
        launch(levels.part_boxes, most_chunks, level, chunks, nodes, boxes, centers, sorted_boxes)
        launch(levels.copy_boxes, most_chunks, level, chunks, nodes, sorted_boxes, boxes)
        launch(levels.list_level, most_nodes, level, following, nodes, roots, root_count)
        level, following = following, level
    threads = min(-(-2 * count // levels.SUBTREE), MOST_BUILDERS)
    bins = empty_bins(threads, name)  # of each thread
    launch(levels.build_listed, threads, threads, roots, root_count, nodes, boxes, centers, *bins, sah_depth)
