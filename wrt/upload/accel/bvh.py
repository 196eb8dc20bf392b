"""Build the wide BVH on a device: the host side of the kernels in `kernels/accel/build`."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.upload.accel.binary_tree import split_boxes
from wrt.upload.accel.gpu_tree import split_on_gpu
from wrt.upload.accel.wide_tree import WideTree, collapse

SAH_DEPTHS = (48, 8)
"""Depths down to which the binary tree is split by the surface area heuristic, tried in this order until the tree is
shallow enough for the traversal stack. With the last one, which also skips reinsertion, the tree is at most 8 + 23
levels deep, for 2^26 triangles at eight a leaf."""

MORE_PIECES = 0.2
"""Boxes that splitting large triangles may add, relative to the triangles; measured in docs/notes/rays.md."""

WORTH_CUTTING = 0.9
"""A tree over split triangles is used if its cost is below this fraction of the cost over whole triangles."""

FEW_CUT = 4
"""If less than one in this many triangles is split, only those are tested to decide whether to build the whole tree
again: for a scan in a studio, that would take as long as the first build."""


@dataclass(frozen=True)
class BuiltBvh:
    """A tree on a device.

    Attributes:
        data: the Bvh struct that kernels take.
        level_starts: number of the first wide node of each level, then the number of all nodes.
        leaves: number of leaves.
        references: triangle references in leaves; more than triangles if large ones were split.
        bytes: memory of nodes and leaves.
    """

    data: Any
    level_starts: tuple[int, ...]
    leaves: int
    references: int
    bytes: int

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) float64 lowest and highest corner of the current triangles."""
        root = self.data.nodes[:48].numpy().reshape(2, 3, 8).astype(np.float64)
        return np.stack([root[0].min(axis=1), root[1].max(axis=1)])

    @property
    def depth(self) -> int:
        """Levels of wide nodes."""
        return len(self.level_starts) - 1

    @property
    def nodes(self) -> int:
        """Number of wide nodes."""
        return self.level_starts[-1]


def build_bvh(points: Any, indices: Any, device: Device) -> BuiltBvh:
    """Build the tree over triangles.

    Args:
        points: array of vec3 on the device.
        indices: array of int on the device, three a triangle, at least one triangle.
        device: the device.

    Raises:
        InputError: when there are too many triangles for 32-bit offsets.
    """
    count = len(indices) // 3
    if count >= 2**26:
        raise InputError(f"{count} triangles are more than the {2**26 - 1} that one ray tree can hold")

    backend = current_backend()
    kernels = backend.kernels("wrt.kernels.accel.build.collapse")
    bvh = backend.kernels("wrt.kernels.core.ray_tree")
    constants = backend.kernels("wrt.kernels.native.constants")

    tree = _wide_tree(_boxes(points, indices, device), device, constants.MAX_DEPTH)
    pieces = _cut_triangles(points, indices, tree, device)
    if pieces is not None:
        cut_tree = _wide_tree(pieces, device, constants.MAX_DEPTH)
        if cut_tree.cost < WORTH_CUTTING * tree.cost:
            tree = cut_tree
        del pieces, cut_tree
    starts, leaf_count, references = tree.level_starts, tree.leaf_count, len(tree.boxes)
    if max(leaf_count * constants.LEAF_FLOATS, starts[-1] * constants.NODE_FLOATS) >= 2**31:
        raise InputError(f"a ray tree of {leaf_count} leaves is larger than 32-bit offsets reach")
    data = bvh.Bvh()
    data.nodes = device.empty_large(starts[-1] * constants.NODE_FLOATS)
    leaf_ranges = tree.write(-1, data.nodes, device)
    numbers = device.empty_large(references, int)
    device.launch(kernels.list_numbers, references, [tree.boxes, numbers], waits=False)
    del tree  # free its memory for the leaves, which are as large
    data.leaves = device.empty_large(leaf_count * constants.LEAF_FLOATS)
    device.launch(
        kernels.write_leaves, leaf_count, [leaf_ranges, numbers, points, indices, data.leaves, _as_int(data.leaves)]
    )
    return BuiltBvh(data, starts, leaf_count, references, 4 * (len(data.nodes) + len(data.leaves)))


def kernels_of_building(device: Device) -> list[Any]:
    """Return one kernel of each module that builds trees on a device, in order of use."""
    modules = {"split": "make_boxes", "top": "split_nodes", "reinsert": "find_places"}
    if not device.is_cpu:
        modules |= {"levels": "begin_tree", "upwards": "write_all_parents", "moves": "rate_nodes"}
    modules |= {"collapse": "price_nodes", "presplit": "find_importance"}
    backend = current_backend()
    return [getattr(backend.kernels(f"wrt.kernels.accel.build.{name}"), kernel) for name, kernel in modules.items()]


def _boxes(points: Any, indices: Any, device: Device) -> Any:
    """Return the boxes of triangles."""
    split = current_backend().kernels("wrt.kernels.accel.build.split")
    count = len(indices) // 3
    boxes = device.empty_large(count, "vec8")
    device.launch(split.make_boxes, count, [points, indices, boxes], waits=False)
    return boxes


def _cut_triangles(points: Any, indices: Any, tree: WideTree, device: Device) -> Any:
    """Return the boxes of triangles after splitting the most wasteful, or None if that costs more than `tree`."""
    presplit = current_backend().kernels("wrt.kernels.accel.build.presplit")

    count, (low, high) = len(indices) // 3, tree.box
    with np.errstate(over="ignore"):
        size = np.maximum(high - low, np.float32(1e-30))
    if not np.isfinite(size).all():
        return None
    scene = [tuple(low.tolist()), tuple(size.tolist())]
    importance = device.empty_large(count)
    device.launch(presplit.find_importance, count, [points, indices, *scene, importance], waits=False)
    # Pieces in proportion to importance respect MORE_PIECES, and do not split triangles that are all alike.
    total = current_backend().total(importance)
    if not 0.0 < total < np.inf:
        return None
    pieces = device.empty_large(count, int)
    device.launch(presplit.count_pieces, count, [importance, MORE_PIECES * count / total, pieces], waits=False)
    del importance  # free its memory
    cut = _cut_ones(pieces, device)
    if cut is None or count + cut.pieces - len(cut.triangles) >= 2**26:
        return None
    if FEW_CUT * len(cut.triangles) < count and not _worth_cutting(points, indices, scene, cut, device):
        return None
    return _pieces(points, indices, scene, pieces, device)


class _Cut(NamedTuple):
    """Triangles that are cut: their numbers and how many pieces each makes, on the device, and the sum of these."""

    triangles: Any
    counts: Any
    pieces: int


def _cut_ones(counts: Any, device: Device) -> _Cut | None:
    """Return the triangles that make more than one piece, given the pieces of each; None if there are none."""
    backend = current_backend()
    presplit = backend.kernels("wrt.kernels.accel.build.presplit")
    is_cut = backend.empty(len(counts), int, device.name)
    device.launch(presplit.mark_cut, len(counts), [counts, is_cut], waits=False)
    place, number = _sums_before(is_cut)
    if not number:
        return None
    triangles, numbers = (backend.empty(number, int, device.name) for _ in range(2))
    device.launch(presplit.list_cut, len(counts), [counts, place, triangles, numbers], waits=False)
    return _Cut(triangles, numbers, _sums_before(numbers)[1])


def _pieces(points: Any, indices: Any, scene: list[Any], pieces: Any, device: Device) -> Any:
    """Return the boxes of triangles that are split into the given numbers of pieces."""
    presplit = current_backend().kernels("wrt.kernels.accel.build.presplit")
    start, total = _sums_before(pieces)
    boxes = device.empty_large(total, "vec8")
    device.launch(presplit.write_pieces, len(pieces), [points, indices, *scene, start, pieces, boxes], waits=False)
    return boxes


def _worth_cutting(points: Any, indices: Any, scene: list[Any], cut: _Cut, device: Device) -> bool:
    """Return whether splitting pays in a tree over the split triangles alone, as an estimate for the whole."""
    backend = current_backend()
    presplit = backend.kernels("wrt.kernels.accel.build.presplit")
    constants = backend.kernels("wrt.kernels.native.constants")

    count = len(cut.triangles)
    corners = backend.empty(3 * count, int, device.name)
    device.launch(presplit.pick_corners, count, [indices, cut.triangles, corners], waits=False)
    whole_tree = _wide_tree(_boxes(points, corners, device), device, constants.MAX_DEPTH)
    cut_tree = _wide_tree(_pieces(points, corners, scene, cut.counts, device), device, constants.MAX_DEPTH)
    return cut_tree.cost < WORTH_CUTTING * whole_tree.cost


def refit_bvh(built: BuiltBvh, points: Any, indices: Any, device: Device) -> None:
    """Refit a tree to moved vertices; it stays correct, and fast while they move little.

    Args:
        built: the tree, changed in place.
        points: array of vec3 on the device, as many as the tree was built over.
        indices: the indices that the tree was built over.
        device: the device of the tree.
    """
    refit = current_backend().kernels("wrt.kernels.accel.build.refit")

    numbers = _as_int(built.data.leaves)
    device.launch(refit.refit_leaves, built.leaves, [points, indices, numbers, built.data], waits=False)
    children = _as_int(built.data.nodes)
    for start, end in reversed(list(itertools.pairwise(built.level_starts))):
        device.launch(refit.refit_level, end - start, [start, built.data, children], waits=start == 0)


def build_upper_tree(lower: np.ndarray, upper: np.ndarray, device: Device) -> Any:
    """Return the nodes of a tree over boxes, as `kernels/accel/intersect.py` reads it: leaf n is −1 − n.

    Args:
        lower: (N, 3) float32 lower corners, at least one.
        upper: (N, 3) float32 upper corners.
        device: the device.
    """
    backend = current_backend()
    kernels = backend.kernels("wrt.kernels.accel.build.collapse")
    constants = backend.kernels("wrt.kernels.native.constants")

    rows = np.zeros((len(lower), 8), np.float32)
    rows[:, :3], rows[:, 4:7] = lower, -upper
    rows[:, 3] = np.arange(len(lower), dtype=np.int32).view(np.float32)
    boxes = backend.array(rows, "vec8", device.name)
    # Each leaf becomes another node, whose children are single boxes.
    tree = _wide_tree(boxes, device, constants.MAX_DEPTH - 1)
    leaf_nodes = tree.level_starts[-1]
    out = device.empty_large((leaf_nodes + tree.leaf_count) * constants.NODE_FLOATS)
    leaf_ranges = tree.write(leaf_nodes, out, device)
    device.launch(kernels.write_leaf_nodes, len(leaf_ranges), [leaf_ranges, boxes, leaf_nodes, out, _as_int(out)])
    return out


def _wide_tree(boxes: Any, device: Device, max_depth: int) -> WideTree:
    """Return the wide tree over boxes, and reorder them to match."""
    split = split_boxes if device.is_cpu else split_on_gpu
    for sah_depth in SAH_DEPTHS:
        nodes, costs, inner_nodes = split(boxes, device, sah_depth, reinserts=sah_depth == SAH_DEPTHS[0])
        tree = collapse(nodes, costs, max(1, inner_nodes), boxes, device, max_depth)
        if len(tree.level_starts) - 1 <= max_depth:
            break
    return tree


def _as_int(array: Any) -> Any:
    """Return a view of the same memory as integers."""
    return current_backend().view(array, int, array.shape)


def _sums_before(counts: Any) -> tuple[Any, int]:
    """Return the exclusive prefix sums, and the total."""
    backend = current_backend()
    start = backend.sums_before(counts)
    return start, int(backend.fetch(start[-1:])[0] + backend.fetch(counts[-1:])[0])
