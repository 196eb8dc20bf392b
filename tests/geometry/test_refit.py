"""A refitted tree answers as one that is built over the moved triangles."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.kernels import upload
from support.ray_trees import HARD, assert_same, batches, build, check, read_back, soup

import wrt
from wrt.backend.device import Device
from wrt.upload.accel.bvh import refit_bvh

Array = NDArray[np.float32]
BALL = wrt.sphere(subdivisions=4)


def twisted(p: NDArray) -> Array:
    angle = 2.0 * p[:, 1]
    x, z = p[:, 0] * np.cos(angle) - p[:, 2] * np.sin(angle), p[:, 0] * np.sin(angle) + p[:, 2] * np.cos(angle)
    return np.stack([x, p[:, 1], z], axis=1).astype(np.float32)


MOVES = {
    "not at all": lambda p: p.copy(),
    "twisted": twisted,
    "mirrored": lambda p: p * np.float32([-1.0, 1.0, 1.0]),
    "flattened": lambda p: p * np.float32([1.0, 1.0, 0.0]),
    "far away": lambda p: p + np.float32([1e3, -2e3, 5e2]),
    "anywhere": lambda p: np.random.default_rng(2).uniform(-1.0, 1.0, p.shape).astype(np.float32),
    "to one point": lambda p: np.full_like(p, 0.5),
    "one vertex out": lambda p: np.concatenate([p[:1] + np.float32([5.0, 3.0, 2.0]), p[1:]]),
}


def assert_answers(tracer: wrt.Intersector, fresh: wrt.Intersector, mesh: wrt.Mesh) -> int:
    """Assert that two intersectors give the same answers; return how many rays hit."""
    hits = 0
    for rays in batches(mesh).values():
        expected = fresh.closest_hit(*rays)
        assert_same(tracer.closest_hit(*rays), expected)
        np.testing.assert_array_equal(tracer.any_hit(*rays), fresh.any_hit(*rays))
        hits += int((expected.triangle >= 0).sum())
    return hits


def test_answers_are_those_of_a_fresh_tree(device: str, report: Report) -> None:
    """To the bit, however far the vertices move, after any number of refits; arrays of NumPy are copied."""
    tracer = wrt.Intersector(BALL, device=device)
    for number, (name, move) in enumerate(MOVES.items()):
        moved = wrt.Mesh(move(BALL.vertices), BALL.faces)
        vertices = moved.vertices.copy()
        tracer.refit(vertices.astype(np.float64).tolist() if number % 2 else vertices)
        vertices[:] = 0.0
        hits = assert_answers(tracer, wrt.Intersector(moved, device=device), moved)
        report(f"{name}: rays that hit", hits)
        assert hits == 0 if name == "to one point" else hits > 500


@pytest.mark.not_emulated
def test_vertices_as_a_warp_array_are_not_copied(device: str) -> None:
    """A simulation may write to them in place, and call `refit` again."""
    tracer, points = wrt.Intersector(BALL, device=device), upload(BALL.vertices, wp.vec3, device)
    for move in (twisted, MOVES["far away"]):
        moved = wrt.Mesh(move(BALL.vertices), BALL.faces)
        points.assign(moved.vertices)
        tracer.refit(points)
        assert tracer._points.ptr == points.ptr
        assert_answers(tracer, wrt.Intersector(moved, device=device), moved)


@pytest.mark.parametrize("name", ["one triangle", "one more than a leaf", "soup", "large triangles", "needles"])
def test_refitted_trees_are_whole_and_tight(name: str, device: str) -> None:
    """Also when triangles moved anywhere: boxes are exact, and unused slots are never hit."""
    corners = HARD[name]()
    tree = build(corners, device)
    moved = soup(len(corners), seed=5, size=0.2)
    indices = upload(np.arange(3 * len(corners)), int, device)

    def refit(to: Array) -> None:
        refit_bvh(tree.built, upload(to.reshape(-1, 3), wp.vec3, device), indices, Device(device))

    if tree.built.references > len(corners):
        # Boxes of pieces become boxes of whole triangles, for good.
        refit(corners)
        tree = read_back(tree.built)
    refit(moved)
    check(read_back(tree.built), moved, pieces=False)
    # And back: not a bit is left of where they were.
    refit(corners)
    refitted = read_back(tree.built)
    for field in ("lower", "upper", "corners", "children", "numbers"):
        np.testing.assert_array_equal(getattr(refitted, field), getattr(tree, field))


def test_meshes_of_a_scene_one_after_the_other(device: str) -> None:
    scene = wrt.Scene()
    for offset in ((0.0, 0.0, 0.0), (1.5, 0.0, 0.0)):
        scene.add(BALL.translated(offset))
    vertices = twisted(np.concatenate([shape.mesh.vertices for shape in scene.shapes]))
    tracer = wrt.Intersector(scene, device=device)
    tracer.refit(vertices)
    moved = wrt.Mesh(vertices, np.concatenate([BALL.faces, BALL.faces + len(BALL.vertices)]))
    assert assert_answers(tracer, wrt.Intersector(moved, device=device), moved) > 100


REFUSED = {
    "vertex 17 is not finite": np.where(np.arange(2562)[:, None] == 17, np.float32(np.nan), BALL.vertices),
    "there are 2561 vertices, but the tree was built over 2562": BALL.vertices[:-1],
    "vertices must be": BALL.vertices.ravel(),
}


@pytest.mark.not_emulated
@pytest.mark.parametrize("kind", ["NumPy", "Warp"])
@pytest.mark.parametrize("placed", [False, True], ids=["one tree", "instances"])
def test_what_is_refused_changes_nothing(placed: bool, kind: str, device: str) -> None:
    if placed:
        tracer = wrt.Intersector.of_instances([BALL], [0], np.eye(4)[None], device=device)
        for mesh in (1, -1, 0.5):
            with pytest.raises(wrt.InputError, match="mesh"):
                tracer.refit(BALL.vertices, mesh=mesh)
    else:
        tracer = wrt.Intersector(BALL, device=device)
    rays = batches(BALL)["in turn"]
    before = tracer.closest_hit(*rays)
    for message, vertices in REFUSED.items():
        array = upload(vertices, float if vertices.ndim == 1 else wp.vec3, device) if kind == "Warp" else vertices
        with pytest.raises(wrt.InputError, match=rf"^[^\n]*{message}[^\n]*$"):
            tracer.refit(array)
    assert_same(tracer.closest_hit(*rays), before)


@pytest.mark.not_emulated
def test_instances_follow_their_mesh(device: str) -> None:
    """Each mesh by itself, before and after instances move."""
    meshes = [BALL, wrt.box()]
    rng = np.random.default_rng(8)
    numbers = np.array([0, 1, 0, 1, 1, 0])
    places = np.tile(np.eye(4), (6, 1, 1))
    places[:, :3, :3] += rng.normal(scale=0.3, size=(6, 3, 3))
    places[:, :3, 3] = rng.uniform(-2.0, 2.0, (6, 3))
    tracer = wrt.Intersector.of_instances(meshes, numbers, places, device=device)
    for step, (number, move) in enumerate([(0, twisted), (1, MOVES["far away"]), (0, MOVES["mirrored"])]):
        moved = move(meshes[number].vertices) * np.float32(1.5 if step != 1 else 1e-3)
        meshes[number] = wrt.Mesh(moved, meshes[number].faces)
        tracer.refit(moved if step else upload(moved, wp.vec3, device), mesh=number)
        for _ in range(2):
            fresh = wrt.Intersector.of_instances(meshes, numbers, places, device=device)
            assert assert_answers(tracer, fresh, wrt.box((-3.0,) * 3, (3.0,) * 3)) > 100
            places = places[::-1].copy()
            tracer.move(places)
