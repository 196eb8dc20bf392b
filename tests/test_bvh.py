"""The ray tree: whole, tight and shallow for any triangles, and one answer where many are right."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import ArrayLike, NDArray
from support.kernels import upload

from wrt.backend.device import Device
from wrt.kernels.accel.bvh import Bvh, bvh_any_hit, bvh_closest_hit
from wrt.kernels.native import at_file_level, text_of
from wrt.kernels.native.constants import LEAF_FLOATS, LEAF_SIZE, MAX_DEPTH, NODE_FLOATS, STACK_SIZE, WIDTH
from wrt.upload.accel.bvh import BuiltBvh, build_bvh


@dataclasses.dataclass
class Tree:
    """A built tree, read back.

    Attributes:
        built: what the builder returned.
        lower, upper: (nodes, 8, 3) boxes.
        children: (nodes, 8) as kept.
        corners: (leaves, LEAF_SIZE, 3, 3) triangles as kept.
        numbers: (leaves, LEAF_SIZE) triangle numbers.
    """

    built: BuiltBvh
    lower: NDArray
    upper: NDArray
    children: NDArray
    corners: NDArray
    numbers: NDArray


def build(corners: ArrayLike, device: str) -> Tree:
    """Build the tree over (N, 3, 3) corners."""
    points = np.asarray(corners, np.float32).reshape(-1, 3)
    return build_indexed(points, np.arange(len(points)), device)


def build_indexed(points: NDArray, indices: NDArray, device: str) -> Tree:
    return read_back(build_bvh(upload(points, wp.vec3, device), upload(indices.ravel(), int, device), Device(device)))


def read_back(built: BuiltBvh) -> Tree:
    nodes = built.data.nodes.numpy().reshape(-1, NODE_FLOATS)
    leaves = built.data.leaves.numpy().reshape(-1, LEAF_FLOATS)
    boxes = nodes[:, :48].reshape(-1, 2, 3, WIDTH).transpose(1, 0, 3, 2)
    return Tree(
        built,
        boxes[0],
        boxes[1],
        nodes[:, 48:].copy().view(np.int32),
        leaves[:, : 9 * LEAF_SIZE].reshape(-1, 3, 3, LEAF_SIZE).transpose(0, 3, 1, 2),
        leaves[:, 9 * LEAF_SIZE :].copy().view(np.int32),
    )


def check(tree: Tree, corners: ArrayLike, *, pieces: bool | None = None) -> None:
    """Assert all that must hold of any tree, or of one over `pieces` of triangles; None for what the builder chose."""
    cut = tree.built.references > len(corners)
    pieces = cut if pieces is None else pieces
    corners = np.asarray(corners, np.float32)
    assert len(tree.children) == tree.built.nodes
    assert len(tree.numbers) == tree.built.leaves
    used = (tree.lower <= tree.upper).all(axis=2)
    # Unused places can be hit by no ray.
    assert (tree.lower[~used] > tree.upper[~used]).all()
    assert used.any(axis=1).all()
    inner = used & (tree.children >= 0)
    leaf = used & (tree.children < 0)
    # Every node but the root, and every leaf, has one parent.
    np.testing.assert_array_equal(np.sort(tree.children[inner]), np.arange(1, tree.built.nodes))
    np.testing.assert_array_equal(np.sort(-1 - tree.children[leaf]), np.arange(tree.built.leaves))
    # A parent is written before its children, so one sweep finds all depths.
    depth = np.zeros(tree.built.nodes, int)
    parents, places = np.nonzero(inner)
    order = np.argsort(tree.children[parents, places])
    for parent, place in zip(parents[order], places[order], strict=True):
        child = tree.children[parent, place]
        assert child > parent
        depth[child] = depth[parent] + 1
    assert depth.max() + 1 == tree.built.depth <= MAX_DEPTH

    # Leaves: distinct places, each triangle once, or at least once where some are cut; its corners its own.
    degenerate = (tree.corners == tree.corners[:, :, :1]).all(axis=(2, 3))
    first = np.ones_like(tree.numbers, bool)
    # A place beyond the leaf's triangles repeats the number of its last, with one corner three times.
    first[:, 1:] = tree.numbers[:, 1:] != tree.numbers[:, :-1]
    if cut:
        whole = (tree.corners == corners[tree.numbers]).all(axis=(2, 3))
        assert (whole | degenerate)[~first].all()
        np.testing.assert_array_equal(np.unique(tree.numbers[first]), np.arange(len(corners)))
    else:
        assert degenerate[~first].all()
        assert (np.diff(first.astype(int), axis=1) <= 0).all()
        np.testing.assert_array_equal(np.sort(tree.numbers[first]), np.arange(len(corners)))
    assert first.any(axis=1).all()
    np.testing.assert_array_equal(tree.corners[first], corners[tree.numbers[first]])
    if pieces:
        check_pieces(tree, corners, first)

    # Boxes: exactly those of what is inside, from the leaves up.
    inside = np.where(first[:, :, None, None], tree.corners, np.nan)
    leaf_low, leaf_high = np.nanmin(inside, axis=(1, 2)), np.nanmax(inside, axis=(1, 2))
    low, high = tree.lower.copy(), tree.upper.copy()
    for node in range(tree.built.nodes - 1, -1, -1):
        for place in np.flatnonzero(used[node]):
            child = tree.children[node, place]
            if child < 0:
                expected = leaf_low[-1 - child], leaf_high[-1 - child]
                if pieces:
                    assert (low[node, place] >= expected[0]).all()
                    assert (high[node, place] <= expected[1]).all()
                    continue
            else:
                filled = used[child]
                expected = low[child][filled].min(axis=0), high[child][filled].max(axis=0)
            assert (low[node, place] == expected[0]).all()
            assert (high[node, place] == expected[1]).all()


def check_pieces(tree: Tree, corners: NDArray, first: NDArray) -> None:
    """Assert that every point of a triangle is in the box of a leaf that holds it."""
    rng = np.random.default_rng(0)
    weights = np.concatenate([np.eye(3), 0.5 - 0.5 * np.eye(3), rng.dirichlet(np.full(3, 0.5), 60)])
    points = np.einsum("sk,tkx->tsx", weights, corners.astype(np.float64))
    covered = np.zeros(points.shape[:2], bool)
    nodes, places = np.nonzero((tree.lower <= tree.upper).all(axis=2) & (tree.children < 0))
    leaves = -1 - tree.children[nodes, places]
    for k in range(LEAF_SIZE):
        holds = first[leaves, k]
        number = tree.numbers[leaves[holds], k]
        low, high = (box[nodes, places][holds][:, None] for box in (tree.lower, tree.upper))
        inside = ((points[number] >= low) & (points[number] <= high)).all(axis=2)
        np.logical_or.at(covered, number, inside)
    assert covered.all()


def soup(n: int, seed: int = 0, size: float = 0.05) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    return (rng.uniform(-1.0, 1.0, (n, 1, 3)) + size * rng.normal(size=(n, 3, 3))).astype(np.float32)


def grid(n: int, axis: int) -> NDArray[np.float32]:
    """Return 2n² triangles of a square grid in the plane that is perpendicular to an axis."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n)))
    a, b, c, d = (np.stack([i + di, j + dj, 0 * i], axis=1) for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.roll(triangles, axis, axis=2).astype(np.float32)


def exponential(n: int, repeat: int, base: float = 2.0) -> NDArray[np.float32]:
    scale = base ** -np.arange(n, dtype=np.float64)
    triangle = np.array([(1.0, 0.0, 0.0), (1.1, 0.1, 0.0), (1.0, 0.1, 0.1)])
    return np.repeat(scale[:, None, None] * triangle, repeat, axis=0).astype(np.float32)


def needles(n: int) -> NDArray[np.float32]:
    rng = np.random.default_rng(3)
    a = rng.uniform(-1.0, 1.0, (n, 3))
    d = rng.normal(size=(n, 3))
    return np.stack([a, a + 100.0 * d, a + 1e-4 * rng.normal(size=(n, 3))], axis=1).astype(np.float32)


def on_a_line(n: int, spacing: str) -> NDArray[np.float32]:
    """Return triangles without area along the x axis: all boxes have a surface of zero."""
    x = np.arange(n, dtype=np.float64) if spacing == "even" else 1.03 ** np.arange(n)
    result = np.zeros((n, 3, 3))
    result[:, :, 0] = x[:, None] + np.array([0.0, 0.25, 0.5])
    return result.astype(np.float32)


HARD = {
    "one triangle": lambda: soup(1),
    "two triangles": lambda: soup(2),
    "a full leaf": lambda: soup(LEAF_SIZE),
    "one more than a leaf": lambda: soup(LEAF_SIZE + 1),
    "soup": lambda: soup(30_000),
    "large triangles": lambda: soup(2_000, size=2.0),
    "coincident": lambda: np.repeat(soup(1), 100_000, axis=0),
    "coincident pairs": lambda: np.repeat(soup(5_000), 2, axis=0),
    "points": lambda: np.repeat(soup(5_000)[:, :1], 3, axis=1),
    "one point": lambda: np.ones((10_000, 3, 3), np.float32),
    "exponential": lambda: exponential(120, 40),
    "exponential, crowded": lambda: exponential(120, 1000),
    "exponential, single": lambda: exponential(126, 1),
    "exponential, slow": lambda: exponential(4000, 3, 1.02),
    "needles": lambda: needles(5_000),
    "coplanar x": lambda: grid(60, 0),
    "coplanar y": lambda: grid(60, 1),
    "coplanar z": lambda: grid(60, 2),
    "on a line": lambda: on_a_line(20_000, "even"),
    "on a line, exponential": lambda: on_a_line(2_500, "exponential"),
    "one far away": lambda: np.concatenate([soup(5_000), soup(1) + 1e6]),
    "tiny": lambda: soup(5_000) * np.float32(1e-6),
    "vanishing areas": lambda: soup(20_000) * np.float32(1e-24),
    "huge": lambda: soup(5_000) * np.float32(1e15),
    "overflowing areas": lambda: soup(5_000) * np.float32(1e25),
}


@pytest.mark.parametrize("name", HARD)
def test_trees_are_whole_tight_and_shallow(name: str, device: str, report: Report) -> None:
    corners = HARD[name]()
    tree = build(corners, device)
    report(f"{name}: {len(corners)} triangles, levels", tree.built.depth, f"<= {MAX_DEPTH}")
    check(tree, corners)


def test_shared_vertices(device: str) -> None:
    corners = grid(20, 1)
    points, inverse = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    check(build_indexed(points, inverse.reshape(-1), device), corners)


def test_a_tree_is_the_same_for_any_number_of_threads() -> None:
    corners = soup(40_000)
    points = upload(corners.reshape(-1, 3), wp.vec3, "cpu")
    indices = upload(np.arange(3 * len(corners)), int, "cpu")
    trees = [build_bvh(points, indices, Device("cpu", threads=threads)).data for threads in (1, 2, 5)]
    for tree in trees[1:]:
        np.testing.assert_array_equal(tree.nodes.numpy().view(np.int32), trees[0].nodes.numpy().view(np.int32))
        np.testing.assert_array_equal(tree.leaves.numpy().view(np.int32), trees[0].leaves.numpy().view(np.int32))


def test_the_stack_holds_the_deepest_tree() -> None:
    """Of a node's children all but the one entered wait, on every level."""
    assert STACK_SIZE >= (WIDTH - 1) * MAX_DEPTH + 1


@wp.kernel(enable_backward=False)
def cast(
    tree: Bvh,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    triangle_out: wp.array(dtype=int),
    tuv_out: wp.array(dtype=wp.vec3),
    any_out: wp.array(dtype=int),
):
    i = wp.tid()
    hit = bvh_closest_hit(tree, origins[i], directions[i], 0.0, 1.0e30)
    triangle_out[i] = hit.triangle
    tuv_out[i] = wp.vec3(hit.t, hit.u, hit.v)
    any_out[i] = int(bvh_any_hit(tree, origins[i], directions[i], 0.0, 1.0e30))


def cast_rays(tree: Tree, o: NDArray, d: NDArray, device: str, kernel: wp.Kernel = cast) -> tuple[NDArray, ...]:
    out = [wp.zeros(len(o), dtype=dtype, device=device) for dtype in (wp.int32, wp.vec3, wp.int32)]
    inputs = [tree.built.data, upload(o, wp.vec3, device), upload(d, wp.vec3, device)]
    wp.launch(kernel, len(o), inputs, out, device=device)
    triangle, tuv, any_hit = (array.numpy() for array in out)
    np.testing.assert_array_equal(any_hit.astype(bool), triangle >= 0)
    return triangle, tuv


def rays(n: int, seed: int) -> tuple[NDArray, NDArray]:
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(n, 3))
    origins *= 3.0 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.uniform(-0.8, 0.8, (n, 3)) - origins
    # Also along axes, and in the planes of boxes' sides.
    directions[: n // 10, 0] = 0.0
    directions[: n // 20, 1] = 0.0
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return origins.astype(np.float32), directions.astype(np.float32)


@pytest.mark.parametrize("copies", [2, 7, 40])
def test_of_coincident_triangles_the_lowest_number_is_hit(copies: int, device: str, report: Report) -> None:
    """However the copies are strewn among the others, and so over the leaves."""
    single = soup(1_500, seed=5, size=0.2)
    origins, directions = rays(20_000, seed=6)
    for seed in (7, 8):
        order = np.random.default_rng(seed).permutation(copies * len(single))
        corners = np.tile(single, (copies, 1, 1))[order]
        which = np.tile(np.arange(len(single)), copies)[order]
        lowest = np.full(len(single), len(corners))
        np.minimum.at(lowest, which, np.arange(len(corners)))
        triangle, tuv = cast_rays(build(corners, device), origins, directions, device)
        hit = triangle >= 0
        assert 0.2 < hit.mean() < 1.0
        np.testing.assert_array_equal(triangle[hit], lowest[which[triangle[hit]]])
        # And it is the triangle and the distance that the mesh without copies gives.
        expected, expected_tuv = cast_rays(build(single, device), origins, directions, device)
        np.testing.assert_array_equal(hit, expected >= 0)
        np.testing.assert_array_equal(tuv[hit], expected_tuv[hit])
        same = which[triangle[hit]] == expected[hit]
        report(f"{copies} copies: rays that hit the same triangle", float(same.mean()), 1.0)
        # Where two different triangles are equally far, the lowest number may be another in another order.
        assert same.mean() > 0.999


def test_hits_do_not_depend_on_the_order_of_triangles(device: str) -> None:
    corners = soup(5_000, seed=9, size=0.1)
    origins, directions = rays(20_000, seed=10)
    triangle, tuv = cast_rays(build(corners, device), origins, directions, device)
    order = np.random.default_rng(11).permutation(len(corners))
    permuted, permuted_tuv = cast_rays(build(corners[order], device), origins, directions, device)
    np.testing.assert_array_equal(permuted_tuv[:, 0], tuv[:, 0])
    hit = triangle >= 0
    assert (order[permuted[hit]] == triangle[hit]).mean() > 0.9999


def test_winding_does_not_move_a_hit(device: str, report: Report) -> None:
    corners = soup(5_000, seed=12, size=0.1)
    origins, directions = rays(20_000, seed=13)
    triangle, tuv = cast_rays(build(corners, device), origins, directions, device)
    flipped, flipped_tuv = cast_rays(build(corners[:, ::-1], device), origins, directions, device)
    np.testing.assert_array_equal(flipped >= 0, triangle >= 0)
    hit = triangle >= 0
    same = flipped[hit] == triangle[hit]
    # Two crossing triangles may be equally far to rounding.
    assert same.mean() > 0.999
    difference = np.abs(flipped_tuv[hit, 0] / tuv[hit, 0] - 1.0)
    report("largest relative change of distance", float(difference.max()), 0.0)
    # Sums of three products in another order: rounding, as large as the triangle is seen edge on.
    assert np.quantile(difference, 0.99) < 1e-6
    assert difference.max() < 1e-4
    # (u, v) belong to the second and third corner: the first and the second one swapped ends.
    u, v = tuv[hit][same, 1], tuv[hit][same, 2]
    np.testing.assert_allclose(flipped_tuv[hit][same, 1], u, atol=1e-3)
    np.testing.assert_allclose(flipped_tuv[hit][same, 2], 1.0 - u - v, atol=1e-3)


# What CUDA has built in and clang has not, with the same rounding.
_INTRINSICS = """
static inline float __fmul_rn(float a, float b) { volatile float r = a * b; return (float)r; }
static inline float fminf(float a, float b) { return a != a ? b : b != b ? a : a < b ? a : b; }
static inline float fmaxf(float a, float b) { return a != a ? b : b != b ? a : a > b ? a : b; }
static inline int __ffs(unsigned m) { return __builtin_ffs((int)m); }
struct alignas(8) int2 { int x, y; };
static inline int2 make_int2(int x, int y) { return {x, y}; }
"""


def make_cast(traversal: str, name: str) -> wp.Kernel:
    """Return a kernel that does what `cast` does, by another form of the header `traversal.h`."""
    header = at_file_level(traversal, f"{name}_traversal")

    @wp.func_native("return wrt::closest_hit(bvh, origin, direction, t_min, t_max, any_hit);")
    def traverse(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, t_min: float, t_max: float, any_hit: bool) -> wp.vec4:
        header()

    @wp.kernel(enable_backward=False, module=f"test_bvh.{name}")
    def cast_otherwise(
        tree: Bvh,
        origins: wp.array(dtype=wp.vec3),
        directions: wp.array(dtype=wp.vec3),
        triangle_out: wp.array(dtype=int),
        tuv_out: wp.array(dtype=wp.vec3),
        any_out: wp.array(dtype=int),
    ):
        i = wp.tid()
        found = traverse(tree, origins[i], directions[i], 0.0, 1.0e30, False)
        triangle_out[i] = wp.cast(found[0], wp.int32)
        tuv_out[i] = wp.vec3(found[1], found[2], found[3])
        found = traverse(tree, origins[i], directions[i], 0.0, 1.0e30, True)
        any_out[i] = int(wp.cast(found[0], wp.int32) >= 0)

    return cast_otherwise


# The traversal with the loops that CUDA gets in place of vectors.
cast_scalar = make_cast(f"#define WRT_VECTORS 0\n{_INTRINSICS}{text_of('traversal.h')}", "scalar")


@pytest.mark.parametrize("name", ["soup", "large triangles", "coincident pairs", "coplanar y", "one far away"])
def test_loops_find_what_vectors_find(name: str, report: Report) -> None:
    """The branch for CUDA, compiled for the CPU: bit for bit the same hits."""
    tree = build(HARD[name](), "cpu")
    origins, directions = rays(50_000, seed=14)
    triangle, tuv = cast_rays(tree, origins, directions, "cpu")
    scalar_triangle, scalar_tuv = cast_rays(tree, origins, directions, "cpu", cast_scalar)
    report(f"{name}: rays that hit, of {len(origins)}", int((triangle >= 0).sum()))
    assert (triangle >= 0).any()
    np.testing.assert_array_equal(scalar_triangle, triangle)
    np.testing.assert_array_equal(scalar_tuv[:, 0], tuv[:, 0])
    np.testing.assert_allclose(scalar_tuv[:, 1:], tuv[:, 1:], atol=1e-6)
