"""A tree whose triangles have moved answers as one that was built where they are now."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.kernels import upload
from test_bvh import HARD, build, check, read_back, soup
from test_intersection import random_rays
from test_intersector import assert_same, camera_rays

import wrt
from wrt.backend.device import Device
from wrt.upload.accel.bvh import refit_bvh

Rays = tuple[NDArray[np.float32], NDArray[np.float32]]
Array = NDArray[np.float32]


def ball() -> wrt.Mesh:
    return wrt.sphere(subdivisions=4)


def twisted(p: NDArray) -> Array:
    angle = 2.0 * p[:, 1]
    x, z = p[:, 0] * np.cos(angle) - p[:, 2] * np.sin(angle), p[:, 0] * np.sin(angle) + p[:, 2] * np.cos(angle)
    return np.stack([x, p[:, 1], z], axis=1).astype(np.float32)


def random_place(p: NDArray, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, p.shape).astype(np.float32)


MOVES = {
    "not at all": lambda p: p.copy(),
    "a little": lambda p: p + np.random.default_rng(1).normal(scale=0.01, size=p.shape).astype(np.float32),
    "twisted": twisted,
    "mirrored": lambda p: p * np.float32([-1.0, 1.0, 1.0]),
    "flattened": lambda p: p * np.float32([1.0, 1.0, 0.0]),
    "far away": lambda p: p + np.float32([1e3, -2e3, 5e2]),
    "large": lambda p: p * np.float32(1e6),
    "tiny": lambda p: p * np.float32(1e-6),
    "anywhere": lambda p: random_place(p, 2),
    "to one point": lambda p: np.full_like(p, 0.5),
    "one vertex out": lambda p: np.concatenate([p[:1] + np.float32([5.0, 3.0, 2.0]), p[1:]]),
}


def batches(mesh: wrt.Mesh) -> list[Rays]:
    """Return rays that are traced one by one, in turn, and in packets."""
    low, high = mesh.bounds
    middle, size = 0.5 * (low + high), float((high - low).max()) or 1.0
    origins, directions = camera_rays(66)
    camera = (0.5 * size * origins + middle).astype(np.float32), directions
    bounds = np.stack([middle - 0.5 * size, middle + 0.5 * size])
    return [random_rays(bounds, 1500, seed=3), random_rays(bounds, 6000, seed=4), camera]


def assert_answers(tracer: wrt.Intersector, fresh: wrt.Intersector, mesh: wrt.Mesh) -> int:
    """Assert that two intersectors give the same answers; return how many rays hit."""
    hits = 0
    for rays in batches(mesh):
        expected = fresh.closest_hit(*rays)
        assert_same(tracer.closest_hit(*rays), expected)
        np.testing.assert_array_equal(tracer.any_hit(*rays), fresh.any_hit(*rays))
        hits += int((expected.triangle >= 0).sum())
    return hits


@pytest.mark.parametrize("name", MOVES)
def test_answers_are_those_of_a_fresh_tree(name: str, device: str, report: Report) -> None:
    """Bit for bit, however far the vertices went."""
    mesh = ball()
    moved = wrt.Mesh(MOVES[name](mesh.vertices), mesh.faces)
    tracer = wrt.Intersector(mesh, device=device)
    tracer.refit(moved.vertices)
    hits = assert_answers(tracer, wrt.Intersector(moved, device=device), moved)
    report(f"{name}: rays that hit", hits)
    assert hits == 0 if name == "to one point" else hits > 500


@pytest.mark.parametrize("name", HARD)
def test_refitted_trees_are_whole_and_tight(name: str, device: str) -> None:
    """What must hold of any tree, of one whose triangles went anywhere: boxes exact, unused places never hit."""
    corners = HARD[name]()
    tree = build(corners, device)
    moved = soup(len(corners), seed=5, size=0.2)
    indices = upload(np.arange(3 * len(corners)), int, device)
    if tree.built.references > len(corners):
        # Boxes of pieces become boxes of whole triangles, for good.
        refit_bvh(tree.built, upload(corners.reshape(-1, 3), wp.vec3, device), indices, Device(device))
        tree = read_back(tree.built)
    refit_bvh(tree.built, upload(moved.reshape(-1, 3), wp.vec3, device), indices, Device(device))
    check(read_back(tree.built), moved, pieces=False)
    # And back: not a bit is left of where they were.
    refit_bvh(tree.built, upload(corners.reshape(-1, 3), wp.vec3, device), indices, Device(device))
    again = read_back(tree.built)
    for before, after in ((tree.lower, again.lower), (tree.upper, again.upper), (tree.corners, again.corners)):
        np.testing.assert_array_equal(after, before)
    np.testing.assert_array_equal(again.children, tree.children)
    np.testing.assert_array_equal(again.numbers, tree.numbers)


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 100])
def test_unused_places_stay_unhit(count: int, device: str) -> None:
    """Rays at all places where they were, and where they are."""
    before = soup(count, seed=6, size=0.3)
    after = before[:, :, [1, 2, 0]] + np.float32(4.0)
    tracer = wrt.Intersector(wrt.Mesh(before.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)), device=device)
    tracer.refit(after.reshape(-1, 3))
    rng = np.random.default_rng(7)
    weights = rng.dirichlet(np.ones(3), 5000)
    for corners, expected in ((before, False), (after, True)):
        which = rng.integers(0, count, 5000)
        targets = np.einsum("ij,ijk->ik", weights, corners[which].astype(np.float64))
        directions = rng.normal(size=(5000, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        short = tracer.any_hit(targets - 0.01 * directions, directions, t_max=0.02)
        assert (short == expected).mean() > 0.99 if expected else not short.any()


def test_many_refits(device: str) -> None:
    """Each as good as the first: nothing adds up."""
    mesh = ball()
    tracer = wrt.Intersector(mesh, device=device)
    for seed in range(20):
        tracer.refit(random_place(mesh.vertices, seed))
        if seed % 7 == 6:
            moved = wrt.Mesh(random_place(mesh.vertices, seed), mesh.faces)
            assert_answers(tracer, wrt.Intersector(moved, device=device), moved)
    tracer.refit(mesh.vertices)
    assert_answers(tracer, wrt.Intersector(mesh, device=device), mesh)


def test_refits_do_not_depend_on_threads() -> None:
    mesh = wrt.sphere(subdivisions=5)
    moved = twisted(mesh.vertices)
    trees = []
    for threads in (1, 2, 5):
        tracer = wrt.Intersector(mesh, threads=threads)
        tracer.refit(moved)
        trees.append(tracer._built.data)
    for tree in trees[1:]:
        np.testing.assert_array_equal(tree.nodes.numpy().view(np.int32), trees[0].nodes.numpy().view(np.int32))
        np.testing.assert_array_equal(tree.leaves.numpy().view(np.int32), trees[0].leaves.numpy().view(np.int32))


def test_vertices_as_numpy_are_copied(device: str) -> None:
    mesh = ball()
    tracer, moved = wrt.Intersector(mesh, device=device), twisted(mesh.vertices)
    tracer.refit(moved)
    kept = moved.copy()
    moved[:] = 0.0
    np.testing.assert_array_equal(tracer._points.numpy(), kept)
    tracer.refit(kept.astype(np.float64).tolist())
    after = wrt.Mesh(kept, mesh.faces)
    assert_answers(tracer, wrt.Intersector(after, device=device), after)


def test_vertices_as_a_warp_array_are_not_copied(device: str) -> None:
    """A simulation may write them where they are, and call again."""
    mesh = ball()
    tracer = wrt.Intersector(mesh, device=device)
    points = upload(mesh.vertices, wp.vec3, device)
    for move in (twisted, MOVES["far away"], MOVES["a little"]):
        moved = wrt.Mesh(move(mesh.vertices), mesh.faces)
        points.assign(moved.vertices)
        tracer.refit(points)
        assert tracer._points.ptr == points.ptr
        assert_answers(tracer, wrt.Intersector(moved, device=device), moved)


def test_meshes_of_a_scene_one_after_the_other(device: str) -> None:
    scene = wrt.Scene()
    for offset in ((0.0, 0.0, 0.0), (1.5, 0.0, 0.0)):
        scene.add(ball().translated(offset))
    vertices = twisted(np.concatenate([shape.mesh.vertices for shape in scene.shapes]))
    tracer = wrt.Intersector(scene, device=device)
    tracer.refit(vertices)
    count = len(ball().vertices)
    moved = wrt.Mesh(vertices, np.concatenate([ball().faces, ball().faces + count]))
    assert assert_answers(tracer, wrt.Intersector(moved, device=device), moved) > 100


def with_one(value: float) -> Array:
    vertices = ball().vertices.copy()
    vertices[17, 1] = value
    return vertices


REFUSED = {
    "NaN": (lambda: with_one(np.nan), "vertex 17 is not finite"),
    "infinite": (lambda: with_one(-np.inf), "vertex 17 is not finite"),
    "too few": (lambda: ball().vertices[:-1], "there are 2561 vertices, but the tree was built over 2562"),
    "none": (lambda: np.zeros((0, 3)), "there are 0 vertices"),
    "flat": (lambda: ball().vertices.ravel(), "vertices must be"),
}


@pytest.mark.parametrize("kind", ["NumPy", "Warp"])
@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.parametrize("placed", [False, True], ids=["one tree", "instances"])
def test_what_is_refused_changes_nothing(placed: bool, name: str, kind: str, device: str) -> None:
    make, message = REFUSED[name]
    mesh = ball()
    if placed:
        tracer = wrt.Intersector.of_instances([mesh], [0], np.eye(4)[None], device=device)
    else:
        tracer = wrt.Intersector(mesh, device=device)
    before = [tracer.closest_hit(*rays) for rays in batches(mesh)]
    vertices = make()
    if kind == "Warp":
        vertices = upload(vertices.astype(np.float32), float if vertices.ndim == 1 else wp.vec3, device)
    with pytest.raises(wrt.InputError, match=message) as error:
        tracer.refit(vertices)
    assert "\n" not in str(error.value)
    for rays, expected in zip(batches(mesh), before, strict=True):
        assert_same(tracer.closest_hit(*rays), expected)
    tracer.refit(mesh.vertices)
    for rays, expected in zip(batches(mesh), before, strict=True):
        assert_same(tracer.closest_hit(*rays), expected)


def test_instances_follow_their_mesh(device: str) -> None:
    """Each of the meshes by itself, before instances move and after."""
    meshes = [ball(), wrt.box()]
    rng = np.random.default_rng(8)
    numbers = np.array([0, 1, 0, 1, 1, 0])
    transforms = np.tile(np.eye(4), (6, 1, 1))
    transforms[:, :3, :3] += rng.normal(scale=0.3, size=(6, 3, 3))
    transforms[:, :3, 3] = rng.uniform(-2.0, 2.0, (6, 3))
    other = transforms[::-1].copy()
    tracer = wrt.Intersector.of_instances(meshes, numbers, transforms, device=device)
    bounds = wrt.box((-3.0, -3.0, -3.0), (3.0, 3.0, 3.0))
    places = transforms

    def assert_fresh() -> None:
        fresh = wrt.Intersector.of_instances(meshes, numbers, places, device=device)
        assert assert_answers(tracer, fresh, bounds) > 100

    for step, (number, move) in enumerate([(0, twisted), (1, MOVES["a little"]), (0, MOVES["mirrored"])]):
        moved = move(meshes[number].vertices) * np.float32(1.5)
        meshes[number] = wrt.Mesh(moved, meshes[number].faces)
        tracer.refit(moved if step else upload(moved, wp.vec3, device), mesh=number)
        assert_fresh()
        places = other if places is transforms else transforms
        tracer.move(places)
        assert_fresh()


def test_meshes_that_are_not_there() -> None:
    tracer = wrt.Intersector.of_instances([ball()], [0], np.eye(4)[None])
    for mesh in (1, -1, 0.5):
        with pytest.raises(wrt.InputError, match="mesh"):
            tracer.refit(ball().vertices, mesh=mesh)
