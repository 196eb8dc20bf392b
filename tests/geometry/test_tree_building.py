"""The builder of ray trees: trees are complete, tight and shallow, also with cut triangles and moved nodes."""

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
    scattered,
    slivers,
    soup,
)

import wrt
import wrt.upload.accel.bvh as module
from wrt.backend.device import Device
from wrt.upload.accel.binary_tree import CHUNK, SUBTREE, levels_of, split_boxes
from wrt.upload.accel.bvh import MORE_PIECES, build_bvh
from wrt.upload.accel.gpu_tree import split_on_gpu


def slow_but(quick: set[Any], names: Any) -> list[Any]:
    return [name if name in quick else pytest.param(name, marks=pytest.mark.slow) for name in names]


LARGE = {"coincident", "exponential, slow", "on a line", "vanishing areas", "soup"}
PLACED = {"soup", "large triangles", "needles", "coplanar", "exponential"}


@pytest.mark.parametrize("name", slow_but(set(HARD) - LARGE, HARD))
def test_trees_are_whole_tight_and_shallow(name: str, device: str) -> None:
    corners = HARD[name]()
    tree = build(corners, device)
    check(tree, corners)
    if name in PLACED:
        assert_greedy(tree)


def test_shared_vertices_and_equal_boxes(device: str) -> None:
    """No plane separates equal boxes: the chunks of a node are halved by number."""
    corners = grid(20, 1)
    points, inverse = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    check(build_indexed(points, inverse.reshape(-1), device), corners)
    indices, points = np.tile(np.arange(3), 2 * CHUNK + 3), soup(1)[0]
    check(build_indexed(points, indices, device), points[indices.reshape(-1, 3)])


COUNTS = [SUBTREE, SUBTREE + 1, CHUNK - 1, CHUNK + 1, 2 * CHUNK + 1]
"""Where one triangle more or less gives a thread its own subtree or chunk."""


@pytest.mark.parametrize("count", slow_but({SUBTREE + 1}, [*COUNTS, "pieces"]))
def test_trees_do_not_depend_on_threads(count: int | str) -> None:
    corners = CUT["slivers among a ball"]() if isinstance(count, str) else soup(count, seed=4)
    points = upload(corners.reshape(-1, 3), wp.vec3, "cpu")
    indices = upload(np.arange(3 * len(corners)), int, "cpu")
    tree = build(corners, "cpu")
    check(tree, corners)
    assert (tree.built.references > len(corners)) == (count == "pieces")
    for threads in (1, 3):
        built = build_bvh(points, indices, Device("cpu", threads=threads)).data
        for name in ("nodes", "leaves"):
            ours, theirs = (getattr(data, name).numpy().view(np.int32) for data in (tree.built.data, built))
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("count", slow_but({700}, [700, 40_000]))
def test_nodes_are_moved_to_where_boxes_are_smaller(count: int, device: str) -> None:
    """Large triangles above many small ones: no plane separates them, but subtrees can be inserted elsewhere."""
    corners, areas = scattered(count), []
    check(build(corners, device), corners)
    for reinserts in (True, False):
        make = split_boxes if device == "cpu" else split_on_gpu
        points, indices = (
            upload(corners.reshape(-1, 3), wp.vec3, device),
            upload(np.arange(3 * len(corners)), int, device),
        )
        boxes = module._boxes(points, indices, Device(device))
        nodes, *_ = make(boxes, Device(device), module.SAH_DEPTHS[0], reinserts=reinserts)
        used = nodes.numpy()[np.concatenate(levels_of(nodes))]
        x, y, z = (used["upper"].astype(np.float64) - used["lower"])[used["right"] != 0].T
        areas.append((x * y + y * z + z * x).sum())
    assert areas[0] < 0.98 * areas[1]


# --- Triangles that are cut --------------------------------------------------------------------------


def ball_in(*meshes: NDArray) -> NDArray[np.float32]:
    mesh = wrt.sphere(subdivisions=5)
    return np.concatenate([mesh.vertices[mesh.faces], *meshes])


def room() -> NDArray[np.float32]:
    mesh = wrt.box((-2.5, -1.5, -2.5), (2.5, 2.5, 2.5)).rotated((0.3, 1.0, 0.2), 33.0)
    return mesh.vertices[mesh.faces]


CUT = {
    "slivers among a ball": lambda: ball_in(slivers(400, 2.5, 0.02)),
    "a ball in a room": lambda: ball_in(room()),
    "needles": lambda: slivers(500, 100.0, 1e-4),
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
    """To the bit, for single rays, interleaved rays and packets."""
    corners = CUT[name]()
    tree = build(corners, device)
    assert len(corners) < tree.built.references <= 6 * len(corners)
    check(tree, corners, pieces=True)
    mesh = mesh_of(corners)
    cut = wrt.Intersector(mesh, device=device)
    monkeypatch.setattr(module, "WORTH_CUTTING", 0.0)
    plain = wrt.Intersector(mesh, device=device)
    assert cut._built.references > plain._built.references == len(corners)
    hits = 0
    for rays in batches(mesh).values():
        expected = plain.closest_hit(*rays)
        assert_same(cut.closest_hit(*rays), expected)
        np.testing.assert_array_equal(cut.any_hit(*rays), expected.triangle >= 0)
        hits += int((expected.triangle >= 0).sum())
    assert hits > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(HARD) - {"coincident"}))
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
