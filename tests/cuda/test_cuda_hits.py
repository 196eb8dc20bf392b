"""What CUDA would hit is what the CPU hits, with kernels as NVRTC compiles them, on an emulator.

Trees are built by the branches for CUDA, so they are others; hits are the same.
"""

import numpy as np
import pytest
from numpy.typing import NDArray
from support.emulated_cuda.backend import GPU, emulated_cuda
from support.ray_trees import HARD, Tree, assert_greedy, batches, build, check, grid, mesh_of, read_back, soup

import wrt
from wrt.kernels.accel.build.levels import SUBTREE

pytestmark = pytest.mark.machinery


@pytest.fixture(scope="module")
def gpu():
    with emulated_cuda(optimization=0) as backend:
        yield backend


def on_both(mesh: wrt.Mesh) -> tuple[wrt.Intersector, wrt.Intersector]:
    return wrt.Intersector(mesh, device="cpu"), wrt.Intersector(mesh, device=GPU)


def assert_same_hits(cpu: wrt.Intersector, cuda: wrt.Intersector, origins: NDArray, directions: NDArray) -> wrt.Hits:
    a, b = cpu.closest_hit(origins, directions), cuda.closest_hit(origins, directions)
    np.testing.assert_array_equal(a.triangle, b.triangle)
    hit = a.triangle >= 0
    np.testing.assert_allclose(b.t[hit], a.t[hit], rtol=1e-5)
    np.testing.assert_allclose(np.stack([b.u, b.v])[:, hit], np.stack([a.u, a.v])[:, hit], atol=1e-3)
    np.testing.assert_array_equal(cpu.any_hit(origins, directions), cuda.any_hit(origins, directions))
    return a


@pytest.mark.parametrize("name", ["single", "in turn", "packets"])
def test_hits_agree(name, gpu):
    """The nearest hit of each ray, and whether there is one within a distance."""
    mesh = mesh_of(soup(3000, 4, 0.2))
    cpu, cuda = on_both(mesh)
    origins, directions = batches(mesh)[name]
    hits = assert_same_hits(cpu, cuda, origins, directions)
    hit = hits.triangle >= 0
    assert 0.2 < hit.mean() < 1.0
    for factor, blocked in ((0.999, False), (1.001, True)):
        reach = np.where(hit, hits.t * np.float32(factor), np.float32(1.0)).astype(np.float32)
        np.testing.assert_array_equal(cuda.any_hit(origins, directions, t_max=reach)[hit], blocked)
    assert gpu.launches["trace_rays"] > 0


def test_difficult_rays_hit_the_same(gpu):
    """Along the axes and within the planes of boxes, of no length, of tiny and huge ones, from far away, not finite."""
    mesh = mesh_of(soup(500, 5, 0.3))
    cpu, cuda = on_both(mesh)
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


def test_rays_along_the_sides_of_boxes_hit(gpu):
    """Straight to the corners of a grid of squares: each ray is in planes between boxes of the tree."""
    squares = grid(12, 1)
    origins = np.unique(squares.reshape(-1, 3), axis=0) + np.float32([3.0, 0.0, 0.0])
    directions = np.tile(np.float32([-1.0, 0.0, 0.0]), (len(origins), 1))
    assert (assert_same_hits(*on_both(mesh_of(squares)), origins, directions).triangle >= 0).all()


def test_edges_are_closed_and_surfaces_are_left(gpu):
    """Rays to the edges and vertices of a closed mesh hit it; rays from its surface hit what they do on the CPU."""
    turn = np.linalg.qr(np.random.default_rng(12).normal(size=(3, 3)))[0].astype(np.float32)
    mesh = wrt.sphere(subdivisions=2)
    mesh = wrt.Mesh(mesh.vertices @ turn + np.float32([3.1, -1.7, 0.3]), mesh.faces)
    cpu, cuda = on_both(mesh)
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


def test_of_coincident_triangles_the_lowest_is_hit(gpu):
    """Of forty, which fill several leaves."""
    numbers = np.random.default_rng(14).permutation(np.repeat(np.arange(20), 40))
    lowest = np.array([np.flatnonzero(numbers == k)[0] for k in range(20)])
    mesh = mesh_of(soup(20, 7, 0.5)[numbers])
    hits = wrt.Intersector(mesh, device=GPU).closest_hit(*batches(mesh)["single"])
    hit = hits.triangle[hits.triangle >= 0]
    assert len(np.unique(hit)) > 10
    np.testing.assert_array_equal(hit, lowest[numbers[hit]])


def test_instances_hit_the_same(gpu):
    rng = np.random.default_rng(10)
    places = np.stack([np.eye(4)] * 20)
    places[:, :3, :3] += 0.5 * rng.normal(size=(20, 3, 3))
    places[:, :3, 3] = rng.uniform(-3.0, 3.0, (20, 3))
    meshes = [mesh_of(soup(60, 11, 0.2)), wrt.sphere(subdivisions=1)]
    which = np.arange(20) % 2
    cpu, cuda = (wrt.Intersector.of_instances(meshes, which, places, device=device) for device in ("cpu", GPU))
    origins = rng.uniform(-6.0, 6.0, (1000, 3)).astype(np.float32)
    directions = (rng.uniform(-3.0, 3.0, (1000, 3)) - origins).astype(np.float32)
    assert (assert_same_hits(cpu, cuda, origins, directions).triangle >= 0).mean() > 0.2


TREES = {
    "one triangle": HARD["one triangle"],
    "one more than a leaf": HARD["one more than a leaf"],
    "soup": lambda: soup(3000, 8),
    "large triangles": HARD["large triangles"],
    "coincident": lambda: np.repeat(soup(1), 2000, axis=0),
    "coplanar": lambda: grid(60, 1)[:2500],
    "exponential": lambda: HARD["exponential"]()[:2000],
}


@pytest.mark.parametrize("name", TREES)
def test_trees_are_whole_and_tight(name, gpu, report):
    """Large ones are split level by level, in chunks, which on the CPU takes many more triangles."""
    corners, before = TREES[name](), dict(gpu.launches)
    tree = build(corners, GPU)
    check(tree, corners)
    assert_greedy(tree)
    split = gpu.launches.get("split_nodes", 0) > before.get("split_nodes", 0)
    assert split == (tree.built.references > SUBTREE)
    if name in ("soup", "large triangles"):
        # By the surface area heuristic: larger nodes are split in the same bins.
        costs = areas(build(corners, "cpu")), areas(tree)
        report(f"{name}: cost", costs[1], costs[0])
        assert costs[1] == pytest.approx(costs[0], rel=1e-3)


def areas(tree: Tree) -> float:
    """Return the sum of the areas of all boxes, in those of the root."""
    used = (tree.lower <= tree.upper).all(axis=2)
    x, y, z = (tree.upper[used].astype(np.float64) - tree.lower[used]).T
    low, high = tree.built.bounds
    a, b, c = high - low
    return float((x * y + y * z + z * x).sum() / (a * b + b * c + c * a))


def test_trees_are_refitted(gpu):
    mesh = mesh_of(soup(1000, 9))
    cuda = wrt.Intersector(mesh, device=GPU)
    moved = (mesh.vertices * np.float32([1.5, -0.7, 1.0]) + np.sin(3.0 * mesh.vertices[:, ::-1])).astype(np.float32)
    cuda.refit(moved)
    check(read_back(cuda._built), moved.reshape(-1, 3, 3))
    cpu = wrt.Intersector(wrt.Mesh(moved, mesh.faces), device="cpu")
    assert_same_hits(cpu, cuda, *batches(wrt.Mesh(moved, mesh.faces))["single"])
