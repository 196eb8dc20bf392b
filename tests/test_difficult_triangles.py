"""Triangles that break ray tracers: each is hit rightly, hit by nothing, or refused by name."""

from __future__ import annotations

import resource
import time

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.exact_rays import Explained, Reason, exact_distances, explain, woop
from test_intersection import random_rays, soup

import wrt
from wrt.kernels.native.constants import MAX_DEPTH

Rays = tuple[NDArray[np.float32], NDArray[np.float32]]
Array = NDArray[np.float32]

FEW, MANY = 1000, 4400
"""Rays: a small batch, and one that is traced several at a time."""


def mesh_of(corners: NDArray) -> wrt.Mesh:
    """Return a mesh of (N, 3, 3) corners."""
    return wrt.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def camera_rays(count: int, height: float = 3.0) -> Rays:
    """Return rays of one origin, row by row."""
    side = int(count**0.5)
    y, x = np.mgrid[0:side, 0:side] / side - 0.5
    directions = np.stack([x, y, np.full_like(x, -1.0)], axis=2).reshape(-1, 3).astype(np.float32)
    return np.tile(np.float32([0.0, 0.0, height]), (len(directions), 1)), directions


def batches(mesh: wrt.Mesh) -> dict[str, Rays]:
    """Return rays that are traced one by one, in turn and in packets."""
    return {
        "single": random_rays(mesh.bounds, FEW, seed=1),
        "in turn": random_rays(mesh.bounds, MANY, seed=2),
        "packets": camera_rays(MANY),
    }


def explained(mesh: wrt.Mesh, rays: Rays, hits: wrt.Hits, step: int = 1) -> Explained:
    """Return the reasons for every step-th answer, none of which is missing."""
    some = slice(None, None, step)
    found = explain(mesh.vertices[mesh.faces], rays[0][some], rays[1][some], hits.triangle[some], woop)
    assert not (found.reason == Reason.NONE).any()
    return found


def assert_sane(hits: wrt.Hits) -> None:
    """Assert that a hit is a point at a distance, and what is no hit is none."""
    hit = hits.triangle >= 0
    assert np.isfinite(hits.t[hit]).all()
    assert (hits.t[hit] > 0.0).all()
    assert np.isinf(hits.t[~hit]).all()
    assert np.isfinite(hits.u).all()
    assert np.isfinite(hits.v).all()


# Triangles without area ------------------------------------------------------------------------------


def degenerate(count: int) -> Array:
    """Return triangles whose three corners, or two of them, are one point, anywhere in the unit cube."""
    rng = np.random.default_rng(3)
    a, b = rng.uniform(-1.0, 1.0, (2, count, 3))
    kinds = [(a, a, a), (a, a, b), (a, b, a), (b, a, a)]
    return np.concatenate([np.stack(kind, axis=1) for kind in kinds]).astype(np.float32)


def at_degenerate(corners: Array, seed: int) -> Rays:
    """Return a ray through the middle of the longest side of each triangle, and through one of its corners."""
    rng = np.random.default_rng(seed)
    middle = corners[:, [0, 1]].mean(axis=1), corners[:, [1, 2]].mean(axis=1), corners[:, 0]
    targets = np.concatenate(middle).astype(np.float64)
    origins = rng.normal(size=targets.shape)
    origins *= 3.0 / np.linalg.norm(origins, axis=1, keepdims=True)
    return origins.astype(np.float32), (targets - origins).astype(np.float32)


@pytest.mark.slow
def test_points_and_segments_are_never_hit(device: str) -> None:
    corners = degenerate(600)
    tracer = wrt.Intersector(mesh_of(corners), device=device)
    origins, directions = at_degenerate(corners, seed=4)
    assert len(origins) > MANY
    for rays in (origins, directions), (origins[:FEW], directions[:FEW]), camera_rays(MANY):
        assert (tracer.closest_hit(*rays).triangle == -1).all()
        assert not tracer.any_hit(*rays).any()


def test_points_and_segments_among_others_change_nothing(device: str) -> None:
    sound, flat = soup(5, 300), degenerate(500)
    corners = np.concatenate([sound.vertices[sound.faces], flat])
    order = np.random.default_rng(6).permutation(len(corners))
    alone = wrt.Intersector(sound, device=device)
    mixed = wrt.Intersector(mesh_of(corners[order]), device=device)
    for rays in [*batches(sound).values(), at_degenerate(flat, seed=7)]:
        expected, hits = alone.closest_hit(*rays), mixed.closest_hit(*rays)
        np.testing.assert_array_equal(hits.t, expected.t)
        hit = expected.triangle >= 0
        assert hit.any()
        np.testing.assert_array_equal(order[hits.triangle[hit]], expected.triangle[hit])


def test_three_corners_on_a_line_are_hit_at_most_where_rounding_opens_them(device: str, report: Report) -> None:
    """In float32 three corners on a line, seen from elsewhere, may span some area: as much as rounding makes."""
    rng = np.random.default_rng(8)
    start, step = rng.integers(-64, 64, (2, 2000, 1, 3)) / 64.0
    corners = (start + step * np.array([0.0, 1.0, 2.0])[:, None] / 4.0).astype(np.float32)
    mesh = mesh_of(corners)
    rays = at_degenerate(corners, seed=9)
    hits = wrt.Intersector(mesh, device=device).closest_hit(*rays)
    assert_sane(hits)
    hit = hits.triangle >= 0
    report("rays aimed at segments that hit one", int(hit.sum()), f"of {len(hit)}")
    direction = rays[1][hit].astype(np.float64)
    point = rays[0][hit] + hits.t[hit, None] * direction
    line = corners[hits.triangle[hit]].astype(np.float64)
    along = line[:, 2] - line[:, 0]
    length = np.linalg.norm(along, axis=1)
    sound = length > 0.0
    # The ray passes the line within what rounding does to coordinates taken from its origin.
    across = np.cross(along, direction)
    apart = np.abs(((point - line[:, 0]) * across).sum(axis=1)) / np.maximum(np.linalg.norm(across, axis=1), 1e-30)
    assert (apart[sound] <= 16.0 * 2.0**-24 * hits.t[hit][sound] * np.linalg.norm(direction[sound], axis=1)).all()


# Triangles in the same place -------------------------------------------------------------------------


def test_of_duplicates_the_lowest_number_is_hit_however_rays_are_traced(device: str) -> None:
    sound = soup(10, 300)
    copies = np.tile(np.arange(300), 9)
    np.random.default_rng(11).shuffle(copies)
    lowest = np.full(300, len(copies))
    np.minimum.at(lowest, copies, np.arange(len(copies)))
    alone = wrt.Intersector(sound, device=device)
    many = wrt.Intersector(wrt.Mesh(sound.vertices, sound.faces[copies]), device=device)
    for rays in batches(sound).values():
        expected, hits = alone.closest_hit(*rays), many.closest_hit(*rays)
        hit = expected.triangle >= 0
        assert hit.any()
        np.testing.assert_array_equal(hits.triangle, np.where(hit, lowest[expected.triangle], -1))
        np.testing.assert_array_equal(hits.t, expected.t)


def test_a_million_coincident_triangles(device: str, report: Report) -> None:
    """No plane parts them; the tree is shallow nevertheless, and no larger than of any million."""
    count = 1_000_000
    mesh = wrt.Mesh(np.eye(3), np.tile(np.arange(3), (count, 1)))
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
    tracer = wrt.Intersector(mesh, device=device)
    report("seconds to build", time.perf_counter() - start)
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / count
    report("bytes a triangle at the peak, kept", f"{grown:.0f}, {tracer.bytes_per_triangle:.0f}", "< 400, < 80")
    report("levels", tracer._built.depth, f"<= {MAX_DEPTH}")
    assert tracer._built.depth <= MAX_DEPTH
    assert grown < 400.0
    assert tracer.bytes_per_triangle < 80.0
    origins = np.float32([[2.0, 2.0, 2.0], [-1.0, -1.0, -1.0], [0.5, 0.4, 0.3], [5.0, 0.0, 0.0]])
    directions = np.float32([[-1.0, -1.0, -1.0], [1.0, 1.1, 1.2], [-0.1, -0.2, -0.1], [0.0, 1.0, 0.0]])
    hits = tracer.closest_hit(origins, directions)
    np.testing.assert_array_equal(hits.triangle, [0, 0, 0, -1])
    np.testing.assert_array_equal(tracer.any_hit(origins, directions), [True, True, True, False])


SHEETS = 8


def sheets(tilt: bool) -> wrt.Mesh:
    """Return grids over one square of the plane z = 0, or of a tilted one, of 1 to SHEETS cells a side."""
    corners = []
    for n in range(1, SHEETS + 1):
        x, y = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n)))
        a, b, c, d = (np.stack([x + i, y + j, 0 * x], axis=1) / n for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
        corners += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    result = 2.0 * np.concatenate(corners) - np.array([1.0, 1.0, 0.0])
    if tilt:
        result[:, :, 2] = 0.3 * result[:, :, 0] - 0.7 * result[:, :, 1]
    return mesh_of(result.astype(np.float32))


@pytest.mark.parametrize("tilt", [False, True])
def test_overlapping_sheets_in_one_plane_are_ties(tilt: bool, device: str, report: Report) -> None:
    """Which sheet is hit is open, but that one is hit and how far away is not."""
    mesh = sheets(tilt)
    tracer = wrt.Intersector(mesh, device=device)
    for name, rays in batches(mesh).items():
        hits = tracer.closest_hit(*rays)
        assert_sane(hits)
        counts = explained(mesh, rays, hits, step=4).counts()
        report(name, ", ".join(f"{n} {reason.value}" for reason, n in counts.items() if n))
        np.testing.assert_array_equal(tracer.any_hit(*rays), hits.triangle >= 0)
        o, d = (a.astype(np.float64) for a in rays)
        plane = np.array([-0.3, 0.7, 1.0]) if tilt else np.array([0.0, 0.0, 1.0])
        with np.errstate(divide="ignore"):
            t = -(o @ plane) / (d @ plane)
        within = (np.abs(o + t[:, None] * d)[:, :2] < 0.999).all(axis=1) & (t > 0.0)
        assert within.any()
        assert (hits.triangle[within] >= 0).all()
        # What is near to the plane is rounded to float32 when tilted, and seen from the side it moves t.
        steep = np.abs(d @ plane) > 0.1
        np.testing.assert_allclose(hits.t[within & steep], t[within & steep], rtol=1e-5)


# Needles ---------------------------------------------------------------------------------------------


def needles(count: int, aspect: float) -> wrt.Mesh:
    """Return needles of length one, as much thinner as `aspect` says, in a cube."""
    rng = np.random.default_rng(12)
    a = rng.uniform(-1.0, 1.0, (count, 3))
    along, aside = rng.normal(size=(2, count, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along, aside)
    aside /= aspect * np.linalg.norm(aside, axis=1, keepdims=True)
    return mesh_of(np.stack([a, a + along, a + aside], axis=1).astype(np.float32))


@pytest.mark.parametrize("aspect", [1e3, 1e6])
def test_needles_are_hit_where_they_are(aspect: float, device: str, report: Report) -> None:
    """Of rays aimed at them, and at the others that happen to be in the way."""
    mesh = needles(300, aspect)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    rng = np.random.default_rng(13)
    which = rng.integers(0, 300, MANY)
    weights = rng.dirichlet(np.ones(3), MANY)
    targets = np.einsum("ij,ijk->ik", weights, corners[which])
    origins = rng.normal(size=(MANY, 3))
    origins = (2.0 * origins / np.linalg.norm(origins, axis=1, keepdims=True)).astype(np.float32)
    rays = (origins, (targets - origins).astype(np.float32))
    tracer = wrt.Intersector(mesh, device=device)
    hits = tracer.closest_hit(*rays)
    assert_sane(hits)
    found = explained(mesh, rays, hits)
    report(f"aspect {aspect:g}: hit", float((hits.triangle >= 0).mean()), float((found.nearest >= 0).mean()))
    report(f"aspect {aspect:g}: answers", ", ".join(f"{n} {r.value}" for r, n in found.counts().items() if n))
    assert (hits.triangle >= 0).any()


@pytest.mark.parametrize("aspect", [10.0, 1e3, 1e5])
def test_a_ray_that_leaves_a_needle_does_not_hit_it(aspect: float, device: str, report: Report) -> None:
    """Half a million rays from points of needles, each to the side of the plane on which rounding put its origin."""
    mesh = needles(300, aspect)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    rng = np.random.default_rng(23)
    n = 1 << 19
    own = corners[rng.integers(0, 300, n)]
    origins = np.einsum("ij,ijk->ik", rng.dirichlet(np.ones(3), n), own).astype(np.float32)
    normal = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    side = np.sign(((origins - own[:, 0]) * normal).sum(axis=1))
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    away = np.sign((directions * normal).sum(axis=1)) * np.where(side == 0.0, 1.0, side)
    directions = (directions * away[:, None]).astype(np.float32)
    hits = wrt.Intersector(mesh, device=device).closest_hit(origins, directions)
    hit = hits.triangle >= 0
    exact, _ = exact_distances(mesh.vertices[mesh.faces[hits.triangle[hit]]], origins[hit], directions[hit], woop)
    report(f"aspect {aspect:g}: hits, those behind the origin", int(hit.sum()), int((exact <= 0.0).sum()))
    assert not (exact <= 0.0).any()


@pytest.mark.parametrize("aspect", [1e3, 1e6])
def test_nothing_slips_through_a_sheet_of_needles(aspect: float, device: str) -> None:
    """Half a million rays from all sides through a strip that consists of nothing else."""
    count = 2000
    x = np.arange(count + 1) / aspect
    rng = np.random.default_rng(14)
    bend = 1e-3 * np.sin(np.arange(count + 1))
    low, high = (np.stack([x, np.full_like(x, y), sign * bend], axis=1) for y, sign in ((-0.5, 1.0), (0.5, -1.0)))
    i = np.arange(count)
    faces = np.concatenate(
        [np.stack([i, i + 1, i + count + 1], axis=1), np.stack([i + 1, i + count + 2, i + count + 1], axis=1)]
    )
    mesh = wrt.Mesh(np.concatenate([low, high]), faces)
    n = 1 << 19
    targets = np.stack([rng.uniform(0.01, 0.99, n) * x[-1], rng.uniform(-0.45, 0.45, n), np.zeros(n)], axis=1)
    origins = targets + rng.normal(size=(n, 3)) * np.array([0.1 * x[-1], 0.01, 0.0])
    origins[:, 2] = rng.choice([-1.0, 1.0], n)
    tracer = wrt.Intersector(mesh, device=device)
    rays = origins.astype(np.float32), (targets - origins).astype(np.float32)
    assert tracer.any_hit(*rays).all()
    hits = tracer.closest_hit(*rays)
    assert (hits.triangle >= 0).all()
    assert_sane(hits)


# One triangle ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)], ids=["front", "back"])
@pytest.mark.parametrize("side", [24, 81], ids=["few", "many"])
def test_one_triangle_with_its_edges_and_corners(order: tuple[int, ...], side: int, device: str) -> None:
    """Where all arithmetic is exact, so are the hits: the border belongs to the triangle."""
    mesh = wrt.Mesh(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([order]))
    tracer = wrt.Intersector(mesh, device=device)
    y, x = (a.ravel() / 16.0 for a in np.mgrid[-2 : side - 2, -2 : side - 2])
    down = np.tile(np.float32([0.0, 0.0, -2.0]), (len(x), 1))
    hits = tracer.closest_hit(np.stack([x, y, np.ones_like(x)], axis=1), down)
    inside = (x >= 0.0) & (y >= 0.0) & (x + y <= 1.0)
    np.testing.assert_array_equal(hits.triangle, np.where(inside, 0, -1))
    np.testing.assert_array_equal(hits.t, np.where(inside, 0.5, np.inf))
    weights = np.stack([1.0 - x - y, x, y], axis=1)[:, order]
    np.testing.assert_array_equal(hits.u[inside], weights[inside, 1])
    np.testing.assert_array_equal(hits.v[inside], weights[inside, 2])
    assert tracer.triangles == 1
    # From behind as well, and not along the plane.
    up = tracer.closest_hit(np.stack([x, y, -np.ones_like(x)], axis=1), -down)
    np.testing.assert_array_equal(up.triangle, hits.triangle)
    along = tracer.closest_hit(np.stack([x - 9.0, y, np.zeros_like(x)], axis=1), np.tile([1.0, 0.0, 0.0], (len(x), 1)))
    assert (along.triangle == -1).all()


# What is refused -------------------------------------------------------------------------------------


TRIANGLE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
FACE = [[0, 1, 2]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([*TRIANGLE, [0.0, np.nan, 0.0]], FACE, r"blob: vertices must be finite; number 3 is \[0.0, nan, 0.0\]"),
        ([[np.inf, 0.0, 0.0], *TRIANGLE], FACE, r"blob: vertices must be finite; number 0 is \[inf, 0.0, 0.0\]"),
        ([*TRIANGLE, [0.0, 0.0, -1e39]], FACE, r"blob: vertices must be finite; number 3 is \[0.0, 0.0, -inf\]"),
        (TRIANGLE, [[0, 1, 3]], "blob: a face names vertex 3, but there are 3 vertices"),
        (TRIANGLE, [[0, 1, 2], [0, -1, 2]], "blob: a face names vertex -1, but there are 3 vertices"),
        (TRIANGLE, np.uint64([[0, 1, 2**63]]), f"blob: a face names vertex {2**63}, but"),
        (TRIANGLE, np.int64([[0, 1, 2**32]]), f"blob: a face names vertex {2**32}, but"),
        (TRIANGLE, np.zeros((0, 3), int), "blob: the mesh has no triangles"),
        (np.zeros((0, 3)), np.zeros((0, 3), int), "blob: the mesh has no triangles"),
        (np.zeros((0, 3)), FACE, "blob: a face names vertex 2, but there are 0 vertices"),
        (TRIANGLE, [[0, 1]], r"blob: faces must be \(M, 3\), not \(1, 2\)"),
        (TRIANGLE, [0, 1, 2], r"blob: faces must be \(M, 3\), not \(3,\)"),
        (TRIANGLE, [[0.0, 1.0, 2.0]], "blob: faces must be integers, not float64"),
        (TRIANGLE, [[False, True, True]], "blob: faces must be integers, not bool"),
        ([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], FACE, r"blob: vertices must be \(N, 3\), not \(3, 2\)"),
    ],
)
def test_what_is_no_mesh_is_refused_by_name(vertices: object, faces: object, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message) as error:
        wrt.Mesh(vertices, faces, name="blob")  # type: ignore[arg-type]
    assert "\n" not in str(error.value)


def test_what_holds_nothing_to_hit_is_refused() -> None:
    trimesh = pytest.importorskip("trimesh")
    with pytest.raises(wrt.InputError, match="no shapes"):
        wrt.Intersector(wrt.Scene())
    with pytest.raises(wrt.InputError, match="no triangles"):
        wrt.Intersector(trimesh.Trimesh())
    bad = trimesh.Trimesh([*TRIANGLE, [0.0, np.nan, 0.0]], [[0, 1, 3]], process=False)
    with pytest.raises(wrt.InputError, match="finite"):
        wrt.Intersector(bad)
    with pytest.raises(wrt.InputError) as error:
        wrt.Intersector(TRIANGLE)
    assert "\n" not in str(error.value)
