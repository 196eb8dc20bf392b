"""The ray tree's builder: trees are whole, tight and shallow for any triangles, cut ones and moved nodes included."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from support.kernels import upload
from support.ray_trees import (
    HARD,
    assert_greedy,
    assert_same,
    batches,
    build,
    build_indexed,
    check,
    grid,
    mesh_of,
    needles,
    random_rays,
    scattered,
    slivers,
    soup,
)

import wrt
import wrt.upload.accel.bvh as module
from wrt.backend.device import Device
from wrt.upload.accel.binary_tree import CHUNK, SUBTREE, split_boxes
from wrt.upload.accel.bvh import MORE_PIECES, SAH_DEPTHS, _boxes, build_bvh
from wrt.upload.accel.gpu_reinsertion import reinsert_on_gpu
from wrt.upload.accel.gpu_tree import find_parents, split_on_gpu
from wrt.upload.accel.reinsertion import levels_of, reinsert


def slow_but(quick: set[Any], names: Any) -> list[Any]:
    return [name if name in quick else pytest.param(name, marks=pytest.mark.slow) for name in names]


LARGE = {"coincident", "exponential, crowded", "exponential, slow", "on a line", "vanishing areas", "soup"}
PLACED = {"soup", "large triangles", "needles", "coplanar x", "tiny", "exponential"}


@pytest.mark.parametrize("name", slow_but(set(HARD) - LARGE, HARD))
def test_trees_are_whole_tight_and_shallow(name: str, device: str) -> None:
    corners = HARD[name]()
    tree = build(corners, device)
    check(tree, corners)
    if name in PLACED:
        assert_greedy(tree)


def test_shared_vertices_and_equal_boxes(device: str) -> None:
    """No plane parts equal boxes: the chunks of a node are halved by number."""
    corners = grid(20, 1)
    points, inverse = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    check(build_indexed(points, inverse.reshape(-1), device), corners)
    indices, points = np.tile(np.arange(3), 2 * CHUNK + 3), soup(1)[0]
    check(build_indexed(points, indices, device), points[indices.reshape(-1, 3)])


def assert_same_trees(one: Any, other: Any) -> None:
    for a, b in ((one.nodes, other.nodes), (one.leaves, other.leaves)):
        np.testing.assert_array_equal(a.numpy().view(np.int32), b.numpy().view(np.int32))


SIZES = [SUBTREE, SUBTREE + 1, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 1]


@pytest.mark.parametrize("count", slow_but({SUBTREE + 1, CHUNK + 1}, SIZES))
def test_trees_do_not_depend_on_threads(count: int) -> None:
    """Where one triangle more or less gives a thread its own subtree or chunk."""
    corners = soup(count, seed=4)
    points, indices = upload(corners.reshape(-1, 3), wp.vec3, "cpu"), upload(np.arange(3 * count), int, "cpu")
    tree = build(corners, "cpu")
    check(tree, corners)
    for threads in (1, 3):
        assert_same_trees(build_bvh(points, indices, Device("cpu", threads=threads)).data, tree.built.data)


# --- Triangles that are cut --------------------------------------------------------------------------


def ball_in(*others: NDArray) -> NDArray[np.float32]:
    mesh = wrt.sphere(subdivisions=5)
    return np.concatenate([mesh.vertices[mesh.faces], *others])


def room() -> NDArray[np.float32]:
    mesh = wrt.box((-2.5, -1.5, -2.5), (2.5, 2.5, 2.5)).rotated((0.3, 1.0, 0.2), 33.0)
    return mesh.vertices[mesh.faces]


CUT = {
    "slivers among a ball": lambda: ball_in(slivers(400, 2.5, 0.02)),
    "a ball in a room": lambda: ball_in(room()),
    "soup": lambda: soup(3_000, size=0.2),
    "needles": lambda: needles(500),
    "coplanar": lambda: np.concatenate([grid(30, 1), 25.0 * grid(1, 1)]),
    "coincident": lambda: np.repeat(soup(3, size=1.0), 400, axis=0),
    "huge": lambda: soup(1_000, size=0.5) * np.float32(1e12),
    "far away": lambda: soup(1_000, size=0.5) + np.float32([1000.0, -2000.0, 500.0]),
}


@pytest.fixture
def forced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut triangles into several times as many pieces, whether it pays or not."""
    monkeypatch.setattr(module, "MORE_PIECES", 5.0)
    monkeypatch.setattr(module, "WORTH_CUTTING", np.inf)


@pytest.mark.parametrize("name", slow_but({"coplanar", "coincident", "far away"}, CUT))
def test_pieces_cover_their_triangles_and_change_no_hit(
    name: str, device: str, forced: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit for bit, by each of the ways to trace rays: packets, too, meet what follows two pieces of one triangle."""
    corners = CUT[name]()
    tree = build(corners, device)
    assert len(corners) < tree.built.references <= 6 * len(corners)
    check(tree, corners, pieces=True)
    mesh = mesh_of(corners)
    cut = wrt.Intersector(mesh, device=device)
    monkeypatch.setattr(module, "WORTH_CUTTING", 0.0)
    plain = wrt.Intersector(mesh, device=device)
    assert cut._built.references > plain._built.references == len(corners)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 300), np.linspace(-0.5, 0.5, 300))
    directions = np.stack([np.full_like(y, -1.0), x, y], axis=-1).reshape(-1, 3)
    middle, size = mesh.bounds.mean(axis=0), np.ptp(mesh.bounds, axis=0).max()
    packets = np.tile(middle + [size, 0.0, 0.0], (len(directions), 1)), directions
    hits = 0
    for rays in (random_rays(mesh.bounds, 1_000, seed=2), random_rays(mesh.bounds, 50_000, seed=2), packets):
        expected = plain.closest_hit(*rays)
        assert_same(cut.closest_hit(*rays), expected)
        np.testing.assert_array_equal(cut.any_hit(*rays), expected.triangle >= 0)
        hits += int((expected.triangle >= 0).sum())
    assert hits > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(HARD) - {"coincident", "exponential, crowded"}))
def test_hard_triangles_are_cut_without_harm(name: str, device: str, forced: None) -> None:
    corners = HARD[name]()
    check(build(corners, device), corners)


def test_triangles_are_cut_only_where_it_pays(device: str) -> None:
    """Walls around a mesh lie at the root as they are; slivers across it are in the way of every ray."""
    for corners in (ball_in(), soup(5_000), grid(50, 0), slivers(5_000, 1.0, 0.01)):
        assert build(corners, device).built.references == len(corners)
    for name, pays in (("slivers among a ball", True), ("a ball in a room", False)):
        corners = CUT[name]()
        references = build(corners, device).built.references
        assert (references > len(corners)) == pays
        assert references <= (1.0 + MORE_PIECES) * len(corners)


@pytest.mark.slow
def test_trees_over_pieces_do_not_depend_on_threads_and_can_be_refitted(device: str) -> None:
    mesh = mesh_of(CUT["slivers among a ball"]())
    tracer = wrt.Intersector(mesh, device=device)
    assert tracer._built.references > len(mesh.faces)
    if device == "cpu":
        for threads in (1, 3):
            assert_same_trees(wrt.Intersector(mesh, threads=threads)._built.data, tracer._built.data)
    for angle in (40.0, 80.0):
        moved = mesh.rotated((1.0, 1.0, 0.0), angle)
        tracer.refit(moved.vertices)
        fresh = wrt.Intersector(moved, device=device)
        for rays in batches(moved).values():
            assert_same(tracer.closest_hit(*rays), fresh.closest_hit(*rays))


# --- Nodes that are moved ----------------------------------------------------------------------------

Nodes = NDArray[Any]


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


MOVED = ["a full leaf", "soup", "needles", "one point", "exponential", "vanishing areas", "overflowing areas"]


@pytest.mark.parametrize(
    "name", slow_but({"a full leaf", "one point", "scattered"}, [*MOVED, "scattered", "many scattered"])
)
def test_trees_stay_whole_where_nodes_move(name: str, device: str) -> None:
    """The same leaves, boxes that are those around their children, and no larger areas."""
    corners = scattered({"scattered": 700, "many scattered": 40_000}[name]) if "scattered" in name else HARD[name]()
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
    assert not ratio > 1.0 + 1e-6
    if name == "scattered":
        check(build(corners, device), corners)
    assert "scattered" not in name or ratio < 0.98


def test_moves_do_not_depend_on_threads() -> None:
    trees = []
    for threads in (1, 3):
        nodes = split(scattered(5000), Device("cpu", threads=threads))
        improve(nodes, Device("cpu", threads=threads))
        used = np.concatenate(levels_of(nodes))
        trees.append((used, *(nodes.numpy()[name][used] for name in ("lower", "upper", "right"))))
    for one, other in zip(*trees, strict=True):
        np.testing.assert_array_equal(one, other)
