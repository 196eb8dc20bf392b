"""Triangles that are hard to build trees over, rays to trace through them, and what must hold of every tree."""

from __future__ import annotations

import dataclasses

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

import wrt
from support.kernels import upload
from wrt.backend.device import Device
from wrt.kernels.native.constants import LEAF_FLOATS, LEAF_SIZE, MAX_DEPTH, NODE_FLOATS, WIDTH
from wrt.upload.accel.bvh import BuiltBvh, build_bvh

Rays = tuple[NDArray[np.float32], NDArray[np.float32]]

# --- Trees -------------------------------------------------------------------------------------------


@dataclasses.dataclass
class Tree:
    """A built tree, read back: (nodes, 8, 3) boxes, (nodes, 8) children, and of (leaves, LEAF_SIZE) triangles all."""

    built: BuiltBvh
    lower: NDArray
    upper: NDArray
    children: NDArray
    corners: NDArray
    numbers: NDArray

    @property
    def used(self) -> NDArray[np.bool_]:
        """Whether a child is at each place: a ray hits no box whose lower corner is above its upper one."""
        return np.asarray((self.lower <= self.upper).all(axis=2))


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
    corners, used = np.asarray(corners, np.float32), tree.used
    cut = tree.built.references > len(corners)
    pieces = cut if pieces is None else pieces
    assert (tree.lower[~used] > tree.upper[~used]).all()
    assert used.any(axis=1).all()
    # Every node but the root, and every leaf, has one parent, which is written before it.
    parents, places = np.nonzero(used & (tree.children >= 0))
    inner, leaves = tree.children[parents, places], -1 - tree.children[used & (tree.children < 0)]
    np.testing.assert_array_equal(np.sort(inner), np.arange(1, len(tree.children)))
    np.testing.assert_array_equal(np.sort(leaves), np.arange(len(tree.numbers)))
    assert (inner > parents).all()
    depth = np.ones(len(tree.children), int)
    for child, parent in sorted(zip(inner, parents, strict=True)):
        depth[child] = depth[parent] + 1
    assert depth.max() == tree.built.depth <= MAX_DEPTH

    # Leaves: distinct places, each triangle once, or at least once where some are cut; its corners its own.
    # A place beyond the leaf's triangles repeats the number of its last, with one corner three times.
    first = np.ones_like(tree.numbers, bool)
    first[:, 1:] = tree.numbers[:, 1:] != tree.numbers[:, :-1]
    repeated = (tree.corners == tree.corners[:, :, :1]).all(axis=(2, 3))
    if cut:
        repeated |= (tree.corners == corners[tree.numbers]).all(axis=(2, 3))
        np.testing.assert_array_equal(np.unique(tree.numbers[first]), np.arange(len(corners)))
    else:
        assert (np.diff(first.astype(int), axis=1) <= 0).all()
        np.testing.assert_array_equal(np.sort(tree.numbers[first]), np.arange(len(corners)))
    assert repeated[~first].all()
    np.testing.assert_array_equal(tree.corners[first], corners[tree.numbers[first]])
    if pieces:
        check_pieces(tree, corners, first)

    # Boxes: exactly those of what is inside, from the leaves up, and within them for pieces.
    inside = np.where(first[:, :, None, None], tree.corners, np.nan)
    is_leaf, node = tree.children < 0, np.maximum(tree.children, 0)
    leaf = np.where(used & is_leaf, -1 - tree.children, 0)
    for box, extreme, beyond, sign in ((tree.lower, np.nanmin, np.inf, 1.0), (tree.upper, np.nanmax, -np.inf, -1.0)):
        of_node = extreme(np.where(used[:, :, None], box, beyond), axis=1)[node]
        expected = np.where(is_leaf[:, :, None], extreme(inside, axis=(1, 2))[leaf], of_node)
        exact = used & ~(is_leaf & pieces)
        np.testing.assert_array_equal(box[exact], expected[exact])
        assert (sign * box[used] >= sign * expected[used]).all()


def check_pieces(tree: Tree, corners: NDArray, first: NDArray) -> None:
    """Assert that every point of a triangle is in the box of a leaf that holds it."""
    rng = np.random.default_rng(0)
    weights = np.concatenate([np.eye(3), 0.5 - 0.5 * np.eye(3), rng.dirichlet(np.full(3, 0.5), 60)])
    points = np.einsum("sk,tkx->tsx", weights, corners.astype(np.float64))
    covered = np.zeros(points.shape[:2], bool)
    nodes, places = np.nonzero(tree.used & (tree.children < 0))
    leaves = -1 - tree.children[nodes, places]
    for k in range(LEAF_SIZE):
        holds = first[leaves, k]
        number = tree.numbers[leaves[holds], k]
        low, high = (box[nodes, places][holds][:, None] for box in (tree.lower, tree.upper))
        inside = ((points[number] >= low) & (points[number] <= high)).all(axis=2)
        np.logical_or.at(covered, number, inside)
    assert covered.all()


OCTANTS = np.array([[1.0 - 2.0 * ((k >> axis) & 1) for axis in range(3)] for k in range(8)])
"""Row k points towards the corner with the bits of 7 − k: bit `axis` of k is set where it is negative."""


def assert_greedy(tree: Tree) -> None:
    """Assert that children were put into places best first: of two, neither would fit the place of the other better.

    How fast rays are depends on it, not what they hit.
    """
    used = tree.used[:, :, None]
    low, high = tree.lower.astype(np.float64), tree.upper.astype(np.float64)
    least, most = np.where(used, low, np.inf).min(axis=1), np.where(used, high, -np.inf).max(axis=1)
    # Place p is towards the corner that the bits of p name.
    fit = np.where(used, (least + most)[:, None] - low - high, 0.0) @ OCTANTS.T
    fit[~tree.used] = -np.inf
    placed = np.diagonal(fit, axis1=1, axis2=2)
    rounding = 2.0**-20 * np.where(used, np.abs(low) + np.abs(high), 0.0).sum(axis=2).max(axis=1)
    assert (fit <= np.maximum(placed[:, :, None], placed[:, None]) + rounding[:, None, None]).all()


# --- Triangles ---------------------------------------------------------------------------------------


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


def on_a_line(n: int) -> NDArray[np.float32]:
    """Return triangles without area along the x axis: all boxes have a surface of zero."""
    result = np.zeros((n, 3, 3), np.float32)
    result[:, :, 0] = np.arange(n)[:, None] + np.array([0.0, 0.25, 0.5])
    return result


def slivers(count: int, length: float, width: float) -> NDArray[np.float32]:
    """Return long thin triangles askew."""
    rng = np.random.default_rng(1)
    start, along, aside = rng.uniform(-1.0, 1.0, (count, 3)), *rng.normal(size=(2, count, 3))
    along *= length / np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along, aside)
    aside *= width / np.linalg.norm(aside, axis=1, keepdims=True)
    return np.stack([start, start + along, start + aside], axis=1).astype(np.float32)


HARD = {
    "one triangle": lambda: soup(1),
    "a full leaf": lambda: soup(LEAF_SIZE),
    "one more than a leaf": lambda: soup(LEAF_SIZE + 1),
    "soup": lambda: soup(30_000),
    "large triangles": lambda: soup(2_000, size=2.0),
    "coincident": lambda: np.repeat(soup(1), 100_000, axis=0),
    "coincident pairs": lambda: np.repeat(soup(5_000), 2, axis=0),
    "points": lambda: np.repeat(soup(5_000)[:, :1], 3, axis=1),
    "one point": lambda: np.ones((10_000, 3, 3), np.float32),
    "exponential": lambda: exponential(120, 40),
    "exponential, single": lambda: exponential(126, 1),
    "exponential, slow": lambda: exponential(4000, 3, 1.02),
    "needles": lambda: slivers(5_000, 100.0, 1e-4),
    "coplanar": lambda: grid(60, 1),
    "on a line": lambda: on_a_line(20_000),
    "one far away": lambda: np.concatenate([soup(5_000), soup(1) + 1e6]),
    "vanishing areas": lambda: soup(20_000) * np.float32(1e-24),
    "overflowing areas": lambda: soup(5_000) * np.float32(1e25),
    "overflowing sums": lambda: soup(200) * np.float32([1e36, 0.01, 0.01]) + np.float32([2e38, 0.0, 0.0]),
}


def scattered(count: int, seed: int = 1) -> NDArray[np.float32]:
    """Return small triangles above two as large as all: no plane parts the large ones from those below the others."""
    corners = soup(count, seed=seed, size=0.03)
    corners[:, :, 1] *= 0.05
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    a, b, c, d = ((x, low[1], z) for x in (low[0], high[0]) for z in (low[2], high[2]))
    return np.concatenate([corners, np.array([[a, b, c], [b, c, d]], np.float32)])


def mesh_of(corners: NDArray) -> wrt.Mesh:
    """Return a mesh of (N, 3, 3) corners."""
    return wrt.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def soup_mesh(seed: int, n: int) -> wrt.Mesh:
    return mesh_of(soup(n, seed, 0.3).astype(np.float64))


# --- Rays --------------------------------------------------------------------------------------------

FEW, MANY = 1000, 4400
"""Rays: a small batch, and one that is traced several at a time."""


def unit(vectors: NDArray) -> NDArray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rotation(rng: np.random.Generator) -> NDArray[np.float64]:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def affine(linear: NDArray, offset: NDArray | tuple[float, ...] = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = linear, offset
    return m


def random_rays(bounds: NDArray, n: int, seed: int) -> Rays:
    """Return rays from all around towards points of the ball around some bounds."""
    rng = np.random.default_rng(seed)
    center, radius = bounds.mean(axis=0), 0.5 * np.linalg.norm(bounds[1] - bounds[0])
    a, b = rng.normal(size=(2, n, 3))
    origins = center + 2.0 * radius * unit(a)
    targets = center + radius * rng.random((n, 1)) * unit(b)
    return origins.astype(np.float32), unit(targets - origins).astype(np.float32)


def camera_rays(count: int, height: float = 3.0) -> Rays:
    """Return rays of one origin, row by row."""
    side = int(count**0.5)
    y, x = np.mgrid[0:side, 0:side] / side - 0.5
    directions = np.stack([x, y, np.full_like(x, -1.0)], axis=2).reshape(-1, 3).astype(np.float32)
    return np.tile(np.float32([0.0, 0.0, height]), (len(directions), 1)), directions


def batches(mesh: wrt.Mesh) -> dict[str, Rays]:
    """Return rays that are traced one by one, in turn and in packets."""
    low, high = mesh.bounds
    middle, size = 0.5 * (low + high), float((high - low).max()) or 1.0
    bounds = np.stack([middle - 0.5 * size, middle + 0.5 * size])
    origins, directions = camera_rays(MANY)
    return {
        "single": random_rays(bounds, FEW, seed=1),
        "in turn": random_rays(bounds, MANY, seed=2),
        "packets": ((0.5 * size * origins + middle).astype(np.float32), directions),
    }


def inner_rays(mesh: wrt.Mesh, origins: NDArray, seed: int) -> Rays:
    """Return rays from points towards faces, edges and corners of a mesh, a third each."""
    rng = np.random.default_rng(seed)
    count = len(origins)
    weights, kind = rng.random((count, 3)), rng.integers(0, 3, count)
    weights[kind == 1, 2] = 0.0
    weights[kind == 2, 1:] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    corners = mesh.vertices.astype(np.float64)[mesh.faces[rng.integers(0, len(mesh.faces), count)]]
    origins = origins.astype(np.float32)
    return origins, unit(np.einsum("ij,ijk->ik", weights, corners) - origins).astype(np.float32)


# --- Hits --------------------------------------------------------------------------------------------


def assert_same(a: wrt.Hits, b: wrt.Hits) -> None:
    for name, x, y in zip(a._fields, a, b, strict=True):
        np.testing.assert_array_equal(x, y, err_msg=name)


def assert_sane(hits: wrt.Hits) -> None:
    """Assert that hits have finite positive distances, and misses infinite ones."""
    hit = hits.triangle >= 0
    assert np.isfinite(hits.t[hit]).all()
    assert (hits.t[hit] > 0.0).all()
    assert np.isinf(hits.t[~hit]).all()
    assert np.isfinite(hits.u).all()
    assert np.isfinite(hits.v).all()
