"""Nodes of the binary tree moved to where they cost less: the best place is found, and the tree stays whole."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.kernels import upload
from test_bvh import HARD, build, check, soup

from wrt.backend.device import Device
from wrt.kernels.accel.build import reinsert as bvh_reinsert
from wrt.upload.accel import gpu_reinsertion, reinsertion
from wrt.upload.accel.binary_tree import split_boxes
from wrt.upload.accel.bvh import SAH_DEPTHS, _boxes
from wrt.upload.accel.gpu_reinsertion import reinsert_on_gpu
from wrt.upload.accel.gpu_tree import find_parents, split_on_gpu
from wrt.upload.accel.reinsertion import ANY_VISITS, LEAST, levels_of, reinsert

Nodes = NDArray[Any]


def scattered(count: int, seed: int = 1) -> NDArray[np.float32]:
    """Return small triangles above two as large as all: no plane parts the large ones from those below the others."""
    corners = soup(count, seed=seed, size=0.03)
    corners[:, :, 1] *= 0.05
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    a, b, c, d = ((x, low[1], z) for x in (low[0], high[0]) for z in (low[2], high[2]))
    return np.concatenate([corners, np.array([[a, b, c], [b, c, d]], np.float32)])


def split(corners: NDArray[np.float32], device: Device) -> Any:
    """Return the binary tree over triangles as the splits leave it."""
    points = upload(corners.reshape(-1, 3), wp.vec3, device.name)
    indices = upload(np.arange(3 * len(corners)), int, device.name)
    make = split_boxes if device.is_cpu else split_on_gpu
    nodes, _ = make(_boxes(points, indices, device), device, SAH_DEPTHS[0], reinserts=False)
    return nodes


def improve(nodes: Any, device: Device) -> None:
    """Reinsert nodes as builds on the device do."""
    if device.is_cpu:
        reinsert(nodes, device)
    else:
        visits = upload(np.zeros(len(nodes)), int, device.name)
        reinsert_on_gpu(nodes, find_parents(nodes, device), visits, device)
        assert not visits.numpy().any()


def areas(nodes: Nodes) -> NDArray[np.float64]:
    """Return half the surfaces of nodes."""
    x, y, z = (nodes["upper"].astype(np.float64) - nodes["lower"]).T
    return np.asarray(x * y + y * z + z * x)


def inner(nodes: Any) -> NDArray[np.int32]:
    """Return the numbers of a tree's inner nodes."""
    used = np.concatenate(levels_of(nodes))
    return used[nodes.numpy()["right"][used] != 0]


def parents_of(nodes: Any) -> NDArray[np.int32]:
    """Return each node's parent, −1 for the root and places not in use."""
    everything, parents = nodes.numpy(), np.full(len(nodes), -1, np.int32)
    for side in ("left", "right"):
        parents[everything[side][inner(nodes)]] = inner(nodes)
    return parents


def moved(nodes: Nodes, parents: NDArray[np.int32], node: int, place: int) -> float:
    """Return the sum of the areas of inner nodes if a node were put beside another one."""
    left, right = nodes["left"].copy(), nodes["right"].copy()

    def replace(parent: int, child: int, other: int) -> None:
        side = left if left[parent] == child else right
        side[parent] = other

    parent = int(parents[node])
    sibling = int(right[parent] if left[parent] == node else left[parent])
    above = int(parents[parent] if place == sibling else parents[place])
    replace(int(parents[parent]), parent, sibling)
    replace(above, place, parent)
    left[parent], right[parent] = place, node

    def total(at: int) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        if right[at] == 0:
            return nodes["lower"][at].astype(np.float64), nodes["upper"][at].astype(np.float64), 0.0
        (low, high, some), (other_low, other_high, more) = total(left[at]), total(right[at])
        low, high = np.minimum(low, other_low), np.maximum(high, other_high)
        x, y, z = high - low
        return low, high, some + more + float(x * y + y * z + z * x)

    return total(0)[2]


@pytest.mark.parametrize("seed", range(3))
def test_the_best_place_is_found(seed: int, device: str, report: Report) -> None:
    """Every node tried beside every other one."""
    nodes = split(scattered(160, seed), Device(device))
    parents, used, everything = parents_of(nodes), np.concatenate(levels_of(nodes)), nodes.numpy()
    before = float(areas(everything[inner(nodes)]).sum())
    moving = np.array([k for k in used if parents[k] > 0], np.int32)
    places, gains = (wp.zeros(len(moving), dtype=kind, device=device) for kind in (int, float))
    inputs = [upload(moving, int, device), nodes, upload(parents, int, device), ANY_VISITS, places, gains]
    Device(device).launch(bvh_reinsert.find_places, len(moving), inputs)
    better = 0
    for node, place, gain in zip(moving, places.numpy(), gains.numpy(), strict=True):
        below = [k for k in used if _leads_to(parents, int(k), int(node))]
        above = _way_up(parents, int(node))
        others = [int(k) for k in used if k != 0 and k not in below and k not in above]
        sums = np.array([moved(everything, parents, int(node), k) for k in others])
        most = before - sums.min()
        if place < 0:
            assert most < 2e-5 * areas(everything[parents[node : node + 1]])[0] + 1e-6 * before
        else:
            better += 1
            assert gain == pytest.approx(most, rel=1e-3, abs=1e-6 * before)
            assert before - moved(everything, parents, int(node), int(place)) == pytest.approx(most, abs=1e-6 * before)
    report("nodes that would be better elsewhere", f"{better} of {len(moving)}")
    assert 0 < better < len(moving)


def _way_up(parents: NDArray[np.int32], node: int) -> list[int]:
    way = [int(parents[node])]
    while way[-1] >= 0:
        way.append(int(parents[way[-1]]))
    return way


def _leads_to(parents: NDArray[np.int32], node: int, to: int) -> bool:
    return node == to or to in _way_up(parents, node)


@pytest.mark.parametrize("name", [*HARD, "scattered", "many scattered"])
def test_trees_stay_whole(name: str, device: str, report: Report) -> None:
    """The same leaves, boxes that are those around their children, and no larger areas."""
    corners = scattered(700) if name == "scattered" else scattered(40_000) if name == "many scattered" else HARD[name]()
    nodes = split(corners, Device(device))
    before, everything = inner(nodes), nodes.numpy().copy()
    leaves = np.setdiff1d(np.concatenate(levels_of(nodes)), before)
    improve(nodes, Device(device))
    after, result = inner(nodes), nodes.numpy()
    np.testing.assert_array_equal(np.sort(after), np.sort(before))
    np.testing.assert_array_equal(np.sort(np.setdiff1d(np.concatenate(levels_of(nodes)), after)), np.sort(leaves))
    np.testing.assert_array_equal(result[leaves], everything[leaves])
    left, right = result[result["left"][after]], result[result["right"][after]]
    np.testing.assert_array_equal(result["lower"][after], np.minimum(left["lower"], right["lower"]))
    np.testing.assert_array_equal(result["upper"][after], np.maximum(left["upper"], right["upper"]))
    with np.errstate(over="ignore", invalid="ignore"):
        ratio = areas(result[after]).sum() / areas(everything[before]).sum()
    report(f"{name}: areas, of before", ratio)
    assert not ratio > 1.0 + 1e-6
    assert "scattered" not in name or ratio < 0.98


def test_rays_find_what_they_found(device: str) -> None:
    corners = scattered(3000)
    check(build(corners, device), corners)


def test_a_search_ends_after_so_many_nodes(device: str) -> None:
    """With what it has found by then: nothing, less than the best, or the best."""
    nodes = split(scattered(300), Device(device))
    parents, used = parents_of(nodes), np.concatenate(levels_of(nodes))
    moving = np.array([k for k in used if parents[k] > 0], np.int32)
    found = []
    for visits in (1, 8, 4 * len(used), ANY_VISITS):
        places, gains = (wp.zeros(len(moving), dtype=kind, device=device) for kind in (int, float))
        inputs = [upload(moving, int, device), nodes, upload(parents, int, device), visits, places, gains]
        Device(device).launch(bvh_reinsert.find_places, len(moving), inputs)
        found.append((places.numpy().copy(), gains.numpy().copy()))
    assert (found[0][0] == -1).all(), "the first node is the sibling, beside which it is"
    some, best = found[1], found[3]
    assert 0 < (some[0] >= 0).sum() < (best[0] >= 0).sum()
    assert (some[1] <= best[1]).all()
    for one, other in zip(found[2], best, strict=True):
        np.testing.assert_array_equal(one, other)


def test_small_trees_are_left_alone(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    corners = scattered(8 * LEAST // 4)
    nodes = split(corners, Device(device))
    assert 1 < len(np.concatenate(levels_of(nodes))) < LEAST
    before = nodes.numpy().copy()
    improve(nodes, Device(device))
    used = np.concatenate(levels_of(nodes))
    np.testing.assert_array_equal(nodes.numpy()[used], before[used])
    for module in (reinsertion, gpu_reinsertion):
        monkeypatch.setattr(module, "LEAST", 0)
    improve(nodes, Device(device))
    assert (nodes.numpy()[used] != before[used]).any()


def test_threads_change_nothing() -> None:
    trees = []
    for threads in (1, 3):
        nodes = split(scattered(5000), Device("cpu", threads=threads))
        improve(nodes, Device("cpu", threads=threads))
        used = np.concatenate(levels_of(nodes))
        trees.append((used, *(nodes.numpy()[name][used] for name in ("lower", "upper", "right"))))
    for one, other in zip(*trees, strict=True):
        np.testing.assert_array_equal(one, other)
