"""What CUDA would render and hit is what the CPU does: kernels as NVRTC compiles them, on an emulator.

`support/emulated_cuda` says what that covers. Films of the two differ by rounding alone: the same numbers of rays, and
colours that agree. Trees are built by the branches for CUDA, so they are others; hits are the same.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.emulated_cuda.backend import EmulatedBackend, emulated_cuda
from support.films_of_devices import FILMS, OPTIONS, film_cases, films_of
from test_bvh import HARD, Tree, build, check, grid, read_back
from test_bvh import soup as corners_of
from test_difficult_triangles import batches, mesh_of
from test_tree_layout import assert_greedy

import wrt
from wrt.kernels.accel.build.levels import SUBTREE
from wrt.rendering.render_kernel import REGENERATE

GPU = "cuda:0"

CASES = film_cases()


@pytest.fixture(scope="module", params=[90, pytest.param(75, marks=pytest.mark.slow)], ids=["sm_90", "sm_75"])
def gpu(request: pytest.FixtureRequest) -> Iterator[EmulatedBackend]:
    """A GPU of an architecture; modules are compiled without optimisation, as they hardly run."""
    with emulated_cuda(request.param, optimization=0) as backend:
        yield backend


@pytest.mark.parametrize("name", [*FILMS[:1], *(pytest.param(name, marks=pytest.mark.slow) for name in FILMS[1:])])
def test_films_agree(name: str, gpu: EmulatedBackend, report: Report) -> None:
    if gpu.architecture_of(GPU) != 90 and name in FILMS[2:]:
        pytest.skip("no source of ours asks for the architecture: two films tell as much as all, which take minutes")
    before = dict(gpu.launches)
    films = films_of(name, CASES[name], GPU)
    launched = {kernel for kernel, count in gpu.launches.items() if count > before.get(kernel, 0)}
    votes = any(kernel.startswith("make_regenerating_kernel") for kernel in launched)
    assert votes or any(kernel.endswith("render_pass") for kernel in launched)
    assert votes == ("layers" not in OPTIONS.get(name, CASES[name].options))
    assert {"build_listed", "write_nodes"} <= launched
    report(f"{name}: rays", films.rays[1], films.rays[0])
    for layer, share in films.agreeing.items():
        report(f"{name}, {layer}: pixels that agree", share)
    assert films.problems == []


@pytest.mark.parametrize("name", [FILMS[0], pytest.param("models-fisheye", marks=pytest.mark.slow)])
def test_films_of_a_loop_for_each_path_agree(name: str, gpu: EmulatedBackend, monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel that `WRT_REGENERATE=0` chooses."""
    if gpu.architecture_of(GPU) != 90:
        pytest.skip("no source of ours asks for the architecture")
    monkeypatch.setenv(REGENERATE, "0")
    before = dict(gpu.launches)
    films = films_of(name, CASES[name], GPU)
    launched = {kernel for kernel, count in gpu.launches.items() if count > before.get(kernel, 0)}
    assert not any(kernel.startswith("make_regenerating_kernel") for kernel in launched)
    assert films.problems == []


def test_bits_do_not_depend_on_which_lanes_meet(gpu: EmulatedBackend) -> None:
    """Votes of whole warps or of parts of them; passes of one sample or several; threads of one warp or another."""
    if gpu.architecture_of(GPU) != 90:
        pytest.skip("no source of ours asks for the architecture")

    def sums(*targets: int, apart: bool = False, crop: tuple[int, int, int, int] = (10, 12, 31, 22)) -> NDArray:
        renderer = wrt.Renderer(wrt.load("cornell-box"), width=40, height=40, crop=crop, device="cuda")
        gpu.library(renderer._kernel.scalar).set_apart(apart)
        for target in targets:
            renderer._trace(target, 0.0)
        assert (renderer.film.counts == targets[-1]).all()
        both = np.concatenate([renderer.film.fetch(name) for name in ("total", "total_of_squares")], axis=-1)
        return both.reshape(crop[3] - crop[1], crop[2] - crop[0], 6)

    whole = sums(6)
    assert (whole[..., :3].max(axis=2) > 0.0).mean() > 0.5
    np.testing.assert_array_equal(sums(6, apart=True), whole)
    np.testing.assert_array_equal(sums(1, 2, 6), whole)
    np.testing.assert_array_equal(sums(6, crop=(13, 13, 30, 20)), whole[1:8, 3:20])


@pytest.mark.parametrize("name", ["single", "in turn", "packets"])
def test_hits_agree(name: str, gpu: EmulatedBackend) -> None:
    """The nearest hit of each ray, and whether there is one within a distance."""
    mesh = mesh_of(corners_of(3000, 4, 0.2))
    cpu, cuda = wrt.Intersector(mesh, device="cpu"), wrt.Intersector(mesh, device=GPU)
    origins, directions = batches(mesh)[name]
    assert_same_hits(cpu, cuda, origins, directions)
    hits = cpu.closest_hit(origins, directions)
    assert 0.2 < (hits.triangle >= 0).mean() < 1.0
    for factor, blocked in ((0.999, False), (1.001, True)):
        reach = np.where(hits.triangle >= 0, hits.t * np.float32(factor), np.float32(1.0)).astype(np.float32)
        hit = hits.triangle >= 0
        np.testing.assert_array_equal(cuda.any_hit(origins, directions, t_max=reach)[hit], blocked)
    assert gpu.launches["trace_rays"] > 0


def assert_same_hits(cpu: wrt.Intersector, cuda: wrt.Intersector, origins: NDArray, directions: NDArray) -> None:
    a, b = cpu.closest_hit(origins, directions), cuda.closest_hit(origins, directions)
    np.testing.assert_array_equal(a.triangle, b.triangle)
    hit = a.triangle >= 0
    np.testing.assert_allclose(b.t[hit], a.t[hit], rtol=1e-5)
    np.testing.assert_allclose(np.stack([b.u, b.v])[:, hit], np.stack([a.u, a.v])[:, hit], atol=1e-3)
    np.testing.assert_array_equal(cpu.any_hit(origins, directions), cuda.any_hit(origins, directions))


def test_difficult_rays_hit_the_same(gpu: EmulatedBackend) -> None:
    """Along the axes and within the planes of boxes, of no length, of tiny and huge ones, from far away, not finite."""
    mesh = mesh_of(corners_of(500, 5, 0.3))
    cpu, cuda = wrt.Intersector(mesh, device="cpu"), wrt.Intersector(mesh, device=GPU)
    rng = np.random.default_rng(6)
    n = 600
    origins = rng.choice(mesh.vertices.ravel(), (n, 3)).astype(np.float32)
    directions = rng.choice(np.float32([-1.0, -1e-20, 0.0, -0.0, 1e-20, 1.0]), (n, 3))
    assert_same_hits(cpu, cuda, origins, directions)
    directions = rng.normal(size=(n, 3)).astype(np.float32)
    for scale in (1e-15, 1e15):
        assert_same_hits(cpu, cuda, origins, directions * np.float32(scale))
    bad = directions.copy()
    bad[np.arange(n), rng.integers(0, 3, n)] = rng.choice(np.float32([np.nan, np.inf, -np.inf]), n)
    for broken in ((origins, bad), (bad, directions), (origins, 0.0 * directions)):
        assert (cuda.closest_hit(*broken).triangle == -1).all()
        assert not cuda.any_hit(*broken).any()
    far = (1e21 * rng.choice([-1.0, 0.0, 1.0], (n, 3))).astype(np.float32)
    cuda.closest_hit(far, -far)
    assert (cuda.closest_hit(far + np.float32(3e38), directions).triangle == -1).all()


def test_rays_along_the_sides_of_boxes_hit(gpu: EmulatedBackend) -> None:
    """Straight to the corners of a grid of squares: each ray is in planes between boxes of the tree."""
    squares = grid(12, 1)
    mesh = mesh_of(squares)
    cpu, cuda = wrt.Intersector(mesh, device="cpu"), wrt.Intersector(mesh, device=GPU)
    origins = np.unique(squares.reshape(-1, 3), axis=0) + np.float32([3.0, 0.0, 0.0])
    directions = np.tile(np.float32([-1.0, 0.0, 0.0]), (len(origins), 1))
    assert_same_hits(cpu, cuda, origins, directions)
    assert (cuda.closest_hit(origins, directions).triangle >= 0).all()


def test_edges_are_closed_and_surfaces_are_left(gpu: EmulatedBackend) -> None:
    """Rays to the edges and vertices of a closed mesh hit it; rays from its surface hit what they do on the CPU."""
    turn = np.linalg.qr(np.random.default_rng(12).normal(size=(3, 3)))[0].astype(np.float32)
    mesh = wrt.sphere(subdivisions=2)
    mesh = wrt.Mesh(mesh.vertices @ turn + np.float32([3.1, -1.7, 0.3]), mesh.faces)
    cpu, cuda = wrt.Intersector(mesh, device="cpu"), wrt.Intersector(mesh, device=GPU)
    corners = mesh.vertices[mesh.faces]
    aims = np.concatenate([mesh.vertices, *[0.5 * (corners[:, k] + corners[:, k - 1]) for k in range(3)]])
    center = np.float32([3.0, -1.6, 0.4])
    origins, directions = np.tile(center, (len(aims), 1)), aims - center
    hits = cuda.closest_hit(origins, directions)
    assert (hits.triangle >= 0).all()
    np.testing.assert_array_equal(hits.triangle, cpu.closest_hit(origins, directions).triangle)
    # The point of a hit is beside the surface by a rounding error.
    points = origins + hits.t[:, None] * directions
    away = np.random.default_rng(13).normal(size=points.shape).astype(np.float32)
    np.testing.assert_array_equal(cuda.closest_hit(points, away).triangle, cpu.closest_hit(points, away).triangle)


def test_of_coincident_triangles_the_lowest_is_hit(gpu: EmulatedBackend) -> None:
    """Of forty, which fill several leaves."""
    numbers = np.random.default_rng(14).permutation(np.repeat(np.arange(20), 40))
    lowest = np.array([np.flatnonzero(numbers == k)[0] for k in range(20)])
    mesh = mesh_of(corners_of(20, 7, 0.5)[numbers])
    hits = wrt.Intersector(mesh, device=GPU).closest_hit(*batches(mesh)["single"])
    hit = hits.triangle[hits.triangle >= 0]
    assert len(np.unique(hit)) > 10
    np.testing.assert_array_equal(hit, lowest[numbers[hit]])


TREES = {
    "one triangle": HARD["one triangle"],
    "one more than a leaf": HARD["one more than a leaf"],
    "soup": lambda: corners_of(3000, 8),
    "large triangles": HARD["large triangles"],
    "coincident": lambda: np.repeat(corners_of(1), 2000, axis=0),
    "coplanar": lambda: HARD["coplanar y"]()[:2500],
    "exponential": lambda: HARD["exponential"]()[:2000],
}


@pytest.mark.parametrize("name", TREES)
def test_trees_are_whole_and_tight(name: str, gpu: EmulatedBackend) -> None:
    """Large ones are split level by level, in chunks, which on the CPU takes many more triangles."""
    corners, before = TREES[name](), dict(gpu.launches)
    tree = build(corners, GPU)
    check(tree, corners)
    assert_greedy(tree)
    split = gpu.launches.get("split_nodes", 0) > before.get("split_nodes", 0)
    assert split == (tree.built.references > SUBTREE)


@pytest.mark.parametrize("name", ["soup", "large triangles"])
def test_trees_cost_what_those_of_the_cpu_cost(name: str, gpu: EmulatedBackend, report: Report) -> None:
    """By the surface area heuristic: larger nodes are split in the same bins."""
    corners = TREES[name]()
    costs = [areas(build(corners, device)) for device in ("cpu", GPU)]
    report(f"{name}: cost", costs[1], costs[0])
    assert costs[1] == pytest.approx(costs[0], rel=1e-3)


def areas(tree: Tree) -> float:
    """Return the sum of the areas of all boxes, in those of the root."""
    used = (tree.lower <= tree.upper).all(axis=2)
    x, y, z = (tree.upper[used].astype(np.float64) - tree.lower[used]).T
    low, high = tree.built.bounds
    a, b, c = high - low
    return float((x * y + y * z + z * x).sum() / (a * b + b * c + c * a))


@pytest.mark.slow
def test_trees_are_refitted(gpu: EmulatedBackend) -> None:
    corners = corners_of(1000, 9)
    mesh = mesh_of(corners)
    cuda = wrt.Intersector(mesh, device=GPU)
    moved = (mesh.vertices * np.float32([1.5, -0.7, 1.0]) + np.sin(3.0 * mesh.vertices[:, ::-1])).astype(np.float32)
    cuda.refit(moved)
    check(read_back(cuda._built), moved.reshape(-1, 3, 3))
    cpu = wrt.Intersector(wrt.Mesh(moved, mesh.faces), device="cpu")
    assert_same_hits(cpu, cuda, *batches(wrt.Mesh(moved, mesh.faces))["single"])


def test_instances_hit_the_same(gpu: EmulatedBackend) -> None:
    rng = np.random.default_rng(10)
    places = np.stack([np.eye(4)] * 20)
    places[:, :3, :3] += 0.5 * rng.normal(size=(20, 3, 3))
    places[:, :3, 3] = rng.uniform(-3.0, 3.0, (20, 3))
    meshes = [mesh_of(corners_of(60, 11, 0.2)), wrt.sphere(subdivisions=1)]
    cpu, cuda = (
        wrt.Intersector.of_instances(meshes, np.arange(20) % 2, places, device=device) for device in ("cpu", GPU)
    )
    origins = rng.uniform(-6.0, 6.0, (1000, 3)).astype(np.float32)
    directions = (rng.uniform(-3.0, 3.0, (1000, 3)) - origins).astype(np.float32)
    a, b = cpu.closest_hit(origins, directions), cuda.closest_hit(origins, directions)
    np.testing.assert_array_equal(a.triangle, b.triangle)
    hit = a.triangle >= 0
    np.testing.assert_allclose(b.t[hit], a.t[hit], rtol=1e-5)
    assert (a.triangle >= 0).mean() > 0.2
