"""Triangles that are cut before the tree is built: every hit is where it was, and only those that stand out are cut."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from test_bvh import HARD, build, check, grid, needles, soup
from test_intersection import random_rays
from test_intersector import assert_same

import wrt
import wrt.upload.accel.bvh as module
from wrt.upload.accel.bvh import MORE_PIECES


def mesh_of(corners: NDArray) -> wrt.Mesh:
    return wrt.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def slivers(count: int, length: float, width: float) -> NDArray[np.float32]:
    """Return long thin triangles askew."""
    rng = np.random.default_rng(1)
    start, along, aside = rng.uniform(-1.0, 1.0, (count, 3)), *rng.normal(size=(2, count, 3))
    along *= length / np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along, aside)
    aside *= width / np.linalg.norm(aside, axis=1, keepdims=True)
    return np.stack([start, start + along, start + aside], axis=1).astype(np.float32)


def ball(subdivisions: int = 5) -> NDArray[np.float32]:
    mesh = wrt.sphere(subdivisions=subdivisions)
    return mesh.vertices[mesh.faces]


def room() -> NDArray[np.float32]:
    mesh = wrt.box((-2.5, -1.5, -2.5), (2.5, 2.5, 2.5)).rotated((0.3, 1.0, 0.2), 33.0)
    return mesh.vertices[mesh.faces]


SCENES = {
    "slivers among a ball": lambda: np.concatenate([ball(), slivers(400, 2.5, 0.02)]),
    "a ball in a room": lambda: np.concatenate([ball(), room()]),
    "soup": lambda: soup(3_000, size=0.2),
    "needles": lambda: needles(500),
    "coplanar": lambda: np.concatenate([grid(30, 1), 25.0 * grid(1, 1)]),
    "coincident": lambda: np.repeat(soup(3, size=1.0), 400, axis=0),
    "huge": lambda: soup(1_000, size=0.5) * np.float32(1e12),
    "tiny": lambda: soup(1_000, size=0.5) * np.float32(1e-11),
    "far away": lambda: soup(1_000, size=0.5) + np.float32([1000.0, -2000.0, 500.0]),
}


@pytest.fixture
def forced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut triangles into several times as many pieces, whether it pays or not."""
    monkeypatch.setattr(module, "MORE_PIECES", 5.0)
    monkeypatch.setattr(module, "WORTH_CUTTING", np.inf)


def whole(mesh: wrt.Mesh, device: str, monkeypatch: pytest.MonkeyPatch) -> wrt.Intersector:
    with monkeypatch.context() as patch:
        patch.setattr(module, "WORTH_CUTTING", 0.0)
        return wrt.Intersector(mesh, device=device)


@pytest.mark.parametrize("name", SCENES)
def test_pieces_cover_their_triangles(name: str, device: str, forced: None, report: Report) -> None:
    corners = SCENES[name]()
    tree = build(corners, device)
    report(f"{name}: pieces a triangle", tree.built.references / len(corners))
    assert len(corners) < tree.built.references <= 6 * len(corners)
    check(tree, corners, pieces=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", HARD)
def test_hard_triangles_are_cut_without_harm(name: str, device: str, forced: None) -> None:
    corners = HARD[name]()
    check(build(corners, device), corners)


@pytest.mark.parametrize("name", SCENES)
def test_hits_are_those_of_whole_triangles(
    name: str, device: str, forced: None, monkeypatch: pytest.MonkeyPatch, report: Report
) -> None:
    """Bit for bit, by each of the ways to trace rays."""
    mesh = mesh_of(SCENES[name]())
    cut, plain = wrt.Intersector(mesh, device=device), whole(mesh, device, monkeypatch)
    assert cut._built.references > plain._built.references == len(mesh.faces)
    for count in (1_000, 50_000):
        rays = random_rays(mesh.bounds, count, seed=2)
        hits, expected = cut.closest_hit(*rays), plain.closest_hit(*rays)
        report(f"{name}: rays that hit, of {count}", int((expected.triangle >= 0).sum()))
        assert_same(hits, expected)
        np.testing.assert_array_equal(cut.any_hit(*rays), expected.triangle >= 0)


@pytest.mark.parametrize("name", ["slivers among a ball", "soup"])
def test_packets_hit_what_they_hit_of_whole_triangles(
    name: str, device: str, forced: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rays that go together meet every triangle of a leaf, also those after two pieces of one triangle."""
    mesh = mesh_of(SCENES[name]())
    cut, plain = wrt.Intersector(mesh, device=device), whole(mesh, device, monkeypatch)
    across, up = np.meshgrid(np.linspace(-0.5, 0.5, 300), np.linspace(-0.5, 0.5, 300))
    directions = np.stack([across, up, np.full_like(up, -1.0)], axis=-1).reshape(-1, 3)
    origins = np.tile(mesh.bounds.mean(axis=0) + [0.0, 0.0, 3.0], (len(directions), 1))
    expected = plain.closest_hit(origins, directions)
    assert (expected.triangle >= 0).sum() > 10_000
    assert_same(cut.closest_hit(origins, directions), expected)
    np.testing.assert_array_equal(cut.any_hit(origins, directions), expected.triangle >= 0)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_nothing_escapes_where_pieces_meet(scale: float, device: str, forced: None) -> None:
    """A hundred thousand rays from inside a coarse ball, of which every triangle is cut."""
    mesh = wrt.sphere(subdivisions=1).rotated((1.0, 2.0, 3.0), 40.0).scaled(scale).translated((scale, 2.0 * scale, 0.0))
    tracer = wrt.Intersector(mesh, device=device)
    assert tracer._built.references > 3 * len(mesh.faces)
    rng = np.random.default_rng(3)
    origins = scale * (0.4 * rng.uniform(-1.0, 1.0, (100_000, 3)) + np.array([1.0, 2.0, 0.0]))
    directions = rng.normal(size=origins.shape)
    # Also towards the planes that the pieces share: halves of the scene, halves of those.
    low, high = mesh.bounds
    aims = low + (high - low) * rng.integers(0, 17, origins.shape) / 16.0
    directions[::2] = (aims - origins)[::2]
    assert (tracer.closest_hit(origins, directions).triangle >= 0).all()
    assert tracer.any_hit(origins, directions).all()


def test_like_triangles_are_not_cut(device: str) -> None:
    for corners in (ball(), soup(5_000), grid(50, 0), slivers(5_000, 1.0, 0.01)):
        assert build(corners, device).built.references == len(corners)


def test_triangles_are_cut_only_where_it_pays(device: str, report: Report) -> None:
    """Walls around a mesh lie at the root as they are; slivers across it are in the way of every ray."""
    for name, pays in (("slivers among a ball", True), ("a ball in a room", False)):
        corners = SCENES[name]()
        references = build(corners, device).built.references
        report(f"{name}: pieces", references, len(corners))
        assert (references > len(corners)) == pays
        assert references <= (1.0 + MORE_PIECES) * len(corners)


def test_trees_over_pieces_do_not_depend_on_threads() -> None:
    mesh = mesh_of(SCENES["slivers among a ball"]())
    trees = [wrt.Intersector(mesh, threads=threads)._built for threads in (1, 2, 5)]
    assert trees[0].references > len(mesh.faces)
    for tree in trees[1:]:
        for a, b in ((tree.data.nodes, trees[0].data.nodes), (tree.data.leaves, trees[0].data.leaves)):
            np.testing.assert_array_equal(a.numpy().view(np.int32), b.numpy().view(np.int32))


def test_trees_over_pieces_can_be_refitted(device: str) -> None:
    mesh = mesh_of(SCENES["slivers among a ball"]())
    tracer = wrt.Intersector(mesh, device=device)
    assert tracer._built.references > len(mesh.faces)
    for angle in (40.0, 80.0):
        moved = mesh.rotated((1.0, 1.0, 0.0), angle)
        tracer.refit(moved.vertices)
        rays = random_rays(moved.bounds, 20_000, seed=4)
        expected = wrt.Intersector(moved, device=device).closest_hit(*rays)
        assert (expected.triangle >= 0).any()
        assert_same(tracer.closest_hit(*rays), expected)
