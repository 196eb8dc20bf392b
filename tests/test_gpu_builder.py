"""A GPU builds trees in many threads without waiting for the host, and the same ones in any order of its threads."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import ROOT, Report
from numpy.typing import NDArray
from support.emulated_cuda.backend import GPU, EmulatedBackend, emulated_cuda, entry_of
from support.emulated_cuda.libraries import BLOCK
from support.kernels import upload
from test_bvh import HARD, Tree, build, check, rays, soup
from test_reinsertion import scattered

from wrt.backend.device import Device
from wrt.kernels.accel.build import moves
from wrt.kernels.accel.build.levels import SUBTREE
from wrt.kernels.accel.build.split import BinaryNode
from wrt.upload.accel import gpu_collapse, gpu_tree
from wrt.upload.accel.gpu_tree import least_levels, most_levels
from wrt.upload.accel.reinsertion import LARGEST, levels_of

ONE_THREAD = {"begin_tree", "begin_levels", "summarize"}
"""Kernels of one thread."""


class ShuffledBackend(EmulatedBackend):
    """Runs the blocks of each grid in another order: backwards, or at random."""

    def __init__(self, seed: int | None) -> None:
        super().__init__(optimization=0)
        self._rng = None if seed is None else np.random.default_rng(seed)

    def run_grid(self, kernel: Any, count: int, packed: list[Any]) -> None:
        blocks = np.arange(-(-count // BLOCK))[::-1]
        if self._rng is not None:
            blocks = self._rng.permutation(blocks)
        for block in blocks.tolist():
            threads = range(block * BLOCK, (block + 1) * BLOCK)
            self.library(kernel).run(entry_of(kernel), count, packed, threads=threads)


def bumpy(subdivisions: int) -> NDArray[np.float32]:
    points, faces = model().bumpy_ball(subdivisions)
    return points[faces]


TREES = {
    "bumpy ball": lambda: bumpy(4),
    "soup": lambda: soup(9_000),
    "large triangles": HARD["large triangles"],
    "coincident pairs": lambda: np.repeat(soup(2_000), 2, axis=0),
    "scattered": lambda: scattered(5_000),
}


FEW = [*list(TREES)[:1], *(pytest.param(name, marks=pytest.mark.slow) for name in list(TREES)[1:])]


def model() -> Any:
    """Return the module `scripts/gpu_builder_model.py`, which puts its own folder on the path."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        return importlib.import_module("gpu_builder_model")


def built_by(backend: EmulatedBackend, corners: NDArray[np.float32]) -> Tree:
    with emulated_cuda(counting=backend):
        return build(corners, GPU)


@pytest.mark.parametrize("name", FEW)
def test_the_order_of_threads_changes_no_bit(name: str) -> None:
    corners = TREES[name]()
    first = built_by(EmulatedBackend(optimization=0), corners)
    for seed in (None, 1, 2):
        other = built_by(ShuffledBackend(seed), corners)
        for field in ("lower", "upper", "children", "numbers", "corners"):
            np.testing.assert_array_equal(getattr(other, field), getattr(first, field))


class BlindBackend(EmulatedBackend):
    """Lets the host see in no round of moves that there are none left."""

    def fetch(self, array: wp.array, *, beside: bool = False) -> Any:
        numbers = super().fetch(array, beside=beside)
        return np.array([LARGEST, numbers[1]], np.int32) if array.shape == (2,) else numbers


@pytest.mark.parametrize("name", FEW)
def test_looking_whether_there_is_more_to_do_changes_no_bit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    corners = TREES[name]()
    looks = EmulatedBackend(optimization=0)
    tree = built_by(looks, corners)
    monkeypatch.setattr(gpu_tree, "least_levels", lambda *_: 1000)
    monkeypatch.setattr(gpu_collapse, "LEVELS_PER_READ", 1000)
    blind = BlindBackend(optimization=0)
    monkeypatch.setattr(gpu_tree, "most_levels", lambda count, subtree, depth: min(depth + 7, max(0, count - subtree)))
    other = built_by(blind, corners)
    for field in ("lower", "upper", "children", "numbers", "corners"):
        np.testing.assert_array_equal(getattr(other, field), getattr(tree, field))
    for kernel in ("fill_level_bins", "find_level_children", "find_places"):
        assert looks.launches[kernel] <= blind.launches[kernel]
    assert sum(looks.launches.values()) < 0.6 * sum(blind.launches.values())


@pytest.mark.parametrize(("subdivisions", "most"), [(1, 60), (2, 110), (3, 160)])
def test_small_meshes_take_few_launches(subdivisions: int, most: int, report: Report) -> None:
    corners, backend = bumpy(subdivisions), EmulatedBackend(optimization=0)
    check(built_by(backend, corners), corners)
    launches = sum(backend.launches.values())
    report(f"launches for a tree of {len(corners)} triangles", launches)
    assert launches < most


def visits(tree: Tree, origins: NDArray[np.float32], directions: NDArray[np.float32], ends: NDArray) -> float:
    """Return how many boxes a ray enters before its end, on average: what it cannot but visit."""
    used = (tree.lower <= tree.upper).all(axis=2)
    low, high = tree.lower[used].astype(np.float64), tree.upper[used].astype(np.float64)
    total = 0
    with np.errstate(divide="ignore", invalid="ignore"):
        for o, d, end in zip(origins.astype(np.float64), directions.astype(np.float64), ends, strict=True):
            a, b = (low - o) / d, (high - o) / d
            enters = np.fmax.reduce(np.fmin(a, b), axis=1)
            leaves = np.fmin.reduce(np.fmax(a, b), axis=1)
            total += int(((np.maximum(enters, 0.0) <= leaves) & (enters <= end)).sum())
    return total / len(origins)


@pytest.mark.parametrize("name", FEW)
def test_rays_visit_as_many_boxes_as_in_the_tree_of_the_cpu(name: str, report: Report) -> None:
    """Splits are the same; moves differ a little, as they are chosen side by side."""
    corners = TREES[name]()
    origins, directions = rays(1_500, seed=3)
    tree, cpu = built_by(EmulatedBackend(optimization=0), corners), build(corners, "cpu")
    check(tree, corners)
    ends = _ends(cpu, origins, directions)
    found, expected = (visits(each, origins, directions, ends) for each in (tree, cpu))
    report(f"{name}: boxes that a ray visits", found, expected)
    assert found <= 1.01 * expected


def _ends(tree: Tree, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> NDArray[np.float64]:
    from test_bvh import cast_rays

    triangle, tuv = cast_rays(tree, origins, directions, "cpu")
    return np.where(triangle >= 0, tuv[:, 0], np.inf).astype(np.float64)


@pytest.mark.parametrize("gains", [(2.0, 1.0), (1.0, 2.0)])
def test_of_two_moves_to_below_each_other_the_better_is_made(gains: tuple[float, float]) -> None:
    """Their neighbours are apart, so locks exclude neither, and both together would cut a ring off the tree."""
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


@pytest.fixture(scope="module")
def counted() -> Any:
    """The model's counts of builds and refits over balls of 1280 and 5120 triangles."""
    script = model()
    return script, [script.count(subdivisions) for subdivisions in (3, 4)]


@pytest.mark.slow
def test_the_host_reads_back_a_few_numbers(counted: Any, report: Report) -> None:
    """The sums that decide whether triangles are cut, the size of the tree, and whether levels and moves are left."""
    _, counts = counted
    for build_count, refit_count in counts:
        report(f"{build_count.triangles} triangles: bytes that the host reads", build_count.read_bytes)
        assert build_count.reads <= 20
        assert build_count.read_bytes < 512
        assert refit_count.reads == 0


@pytest.mark.slow
def test_no_stage_has_one_thread(counted: Any, report: Report) -> None:
    """But for three kernels that write a few numbers. No thread works longer in larger trees."""
    script, ((small, _), (large, refit)) = counted
    alone = {name for name, k in large.kernels.items() if k.threads == 1}
    assert alone == ONE_THREAD
    assert all(large.kernels[name].longest < 1000 for name in ONE_THREAD)
    for name, k in large.kernels.items():
        before = small.kernels[name]
        growth = k.longest / k.launches / max(before.longest / before.launches, 1.0)
        # Launches without work are part of the mean, and levels in use grow by two of six.
        assert growth < 2.5
    assert max(k.threads for k in refit.kernels.values()) > 500
    goal = script.estimated([small, large], script.TARGET)
    report(f"s for {goal.triangles} triangles, estimated", script.seconds(goal))
    assert script.seconds(goal) < 0.3


@pytest.mark.slow
def test_counts_of_a_kernel_are_those_of_its_code(counted: Any) -> None:
    """Boxes of triangles: 36 bytes of corners, 12 of indices, and 32 of the box, in a thread each."""
    script, ((small, _), (large, _)) = counted
    for each in (small, large):
        k = each.kernels["make_boxes"]
        assert (k.launches, k.threads) == (1, each.triangles)
        # The rest are the fields of the arrays' descriptions, if they are in global memory at all.
        assert 80 <= k.bytes / each.triangles < 200
        assert k.instructions == pytest.approx(k.longest * each.triangles, rel=0.05)
    assert script.grown([100.0, 400.0], [10, 40], 4000) == pytest.approx(40_000.0)
    assert script.grown([100.0, 101.0], [10, 40], 160) == pytest.approx(102.0)


def test_levels_suffice() -> None:
    """Where each split parts one box from the others, and where all are halved."""
    assert most_levels(SUBTREE, SUBTREE, 48) == 0
    assert most_levels(SUBTREE + 1, SUBTREE, 48) == 1
    for count in (129, 256, 257, 1000, 10**7):
        left, halvings = count, 0
        while left > SUBTREE:
            left, halvings = left - left // 2, halvings + 1
        assert least_levels(count, SUBTREE) == halvings
        assert most_levels(count, SUBTREE, 0) == min(halvings, count - SUBTREE)
        assert most_levels(count, SUBTREE, 8) >= min(8 + halvings, count - SUBTREE)
