"""Triangles, sizes and rays that break ray tracers: hits are right, or missed, and never invented."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.exact_rays import exact_distances, woop
from support.ray_trees import (
    FEW,
    MANY,
    Rays,
    assert_same,
    assert_sane,
    batches,
    camera_rays,
    mesh_of,
    slivers,
    soup_mesh,
    unit,
)

import wrt

Array = NDArray[np.float32]

# --- Triangles without area --------------------------------------------------------------------------


def at_degenerate(corners: Array, seed: int) -> Rays:
    """Return a ray through the middle of two sides of each triangle, and through one of its corners."""
    middle = corners[:, [0, 1]].mean(axis=1), corners[:, [1, 2]].mean(axis=1), corners[:, 0]
    targets = np.concatenate(middle).astype(np.float64)
    origins = 3.0 * unit(np.random.default_rng(seed).normal(size=targets.shape))
    return origins.astype(np.float32), (targets - origins).astype(np.float32)


def test_points_and_segments_are_never_hit_and_change_nothing_among_others(device: str) -> None:
    a, b = np.random.default_rng(3).uniform(-1.0, 1.0, (2, 600, 3))
    kinds = [(a, a, a), (a, a, b), (a, b, a), (b, a, a)]
    sound, flat = soup_mesh(5, 300), np.concatenate([np.stack(kind, axis=1) for kind in kinds]).astype(np.float32)
    at_flat = at_degenerate(flat, seed=4)
    assert len(at_flat[0]) > MANY
    only = wrt.Intersector(mesh_of(flat), device=device)
    for rays in at_flat, (at_flat[0][:FEW], at_flat[1][:FEW]), camera_rays(MANY):
        assert (only.closest_hit(*rays).triangle == -1).all()
        assert not only.any_hit(*rays).any()
    corners = np.concatenate([sound.vertices[sound.faces], flat])
    order = np.random.default_rng(6).permutation(len(corners))
    single = wrt.Intersector(sound, device=device)
    mixed = wrt.Intersector(mesh_of(corners[order]), device=device)
    for rays in [*batches(sound).values(), at_flat]:
        expected, hits = single.closest_hit(*rays), mixed.closest_hit(*rays)
        np.testing.assert_array_equal(hits.t, expected.t)
        hit = expected.triangle >= 0
        assert hit.any()
        np.testing.assert_array_equal(order[hits.triangle[hit]], expected.triangle[hit])


# --- Triangles in the same place ---------------------------------------------------------------------


@pytest.mark.parametrize("copies", [2, 40])
def test_of_duplicates_the_lowest_number_is_hit_however_rays_are_traced(copies: int, device: str) -> None:
    """Wherever the copies are among the other triangles, and so in the leaves; t, u and v are those without copies."""
    sound = soup_mesh(10, 300)
    which = np.tile(np.arange(300), copies)
    np.random.default_rng(11).shuffle(which)
    lowest = np.full(300, len(which))
    np.minimum.at(lowest, which, np.arange(len(which)))
    single = wrt.Intersector(sound, device=device)
    repeated = wrt.Intersector(wrt.Mesh(sound.vertices, sound.faces[which]), device=device)
    for rays in batches(sound).values():
        expected = single.closest_hit(*rays)
        hit = expected.triangle >= 0
        assert hit.any()
        assert_same(
            repeated.closest_hit(*rays), expected._replace(triangle=np.where(hit, lowest[expected.triangle], -1))
        )


# --- Needles and borders -----------------------------------------------------------------------------


@pytest.mark.parametrize("aspect", [10.0, 1e3, 1e5])
def test_a_ray_that_leaves_a_needle_does_not_hit_it(aspect: float, device: str) -> None:
    """Rays from points of needles, each to the side of the plane on which its rounded origin is."""
    mesh = mesh_of(slivers(300, 1.0, 1.0 / aspect))
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    rng = np.random.default_rng(23)
    n = 1 << 18
    needle = corners[rng.integers(0, 300, n)]
    origins = np.einsum("ij,ijk->ik", rng.dirichlet(np.ones(3), n), needle).astype(np.float32)
    normal = unit(np.cross(needle[:, 1] - needle[:, 0], needle[:, 2] - needle[:, 0]))
    side = np.sign(((origins - needle[:, 0]) * normal).sum(axis=1))
    directions = unit(rng.normal(size=(n, 3)))
    away = np.sign((directions * normal).sum(axis=1)) * np.where(side == 0.0, 1.0, side)
    directions = (directions * away[:, None]).astype(np.float32)
    hits = wrt.Intersector(mesh, device=device).closest_hit(origins, directions)
    hit = hits.triangle >= 0
    exact, _ = exact_distances(mesh.vertices[mesh.faces[hits.triangle[hit]]], origins[hit], directions[hit])
    assert not (exact <= 0.0).any()


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)], ids=["front", "back"])
@pytest.mark.parametrize("side", [24, 81], ids=["few", "many"])
def test_one_triangle_with_its_edges_and_corners(order: tuple[int, ...], side: int, device: str) -> None:
    """All arithmetic is exact here: the border belongs to the triangle."""
    mesh = wrt.Mesh(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([order]))
    tracer = wrt.Intersector(mesh, device=device)
    y, x = (a.ravel() / 16.0 for a in np.mgrid[-2 : side - 2, -2 : side - 2])
    down = np.tile(np.float32([0.0, 0.0, -2.0]), (len(x), 1))
    hits = tracer.closest_hit(np.stack([x, y, np.ones_like(x)], axis=1), down)
    inside = (x >= 0.0) & (y >= 0.0) & (x + y <= 1.0)
    np.testing.assert_array_equal(hits.triangle, np.where(inside, 0, -1))
    np.testing.assert_array_equal(hits.t, np.where(inside, 0.5, np.inf))
    weights = np.stack([1.0 - x - y, x, y], axis=1)[:, order]
    np.testing.assert_array_equal(np.stack([hits.u, hits.v], axis=1)[inside], weights[inside, 1:])
    # From behind as well, and not along the plane.
    up = tracer.closest_hit(np.stack([x, y, -np.ones_like(x)], axis=1), -down)
    np.testing.assert_array_equal(up.triangle, hits.triangle)
    along = tracer.closest_hit(np.stack([x - 9.0, y, np.zeros_like(x)], axis=1), np.tile([1.0, 0.0, 0.0], (len(x), 1)))
    assert (along.triangle == -1).all()


# --- Sizes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "length"), [(-36, 0), (40, 0), (0, -50), (0, 100)])
def test_hits_do_not_depend_on_the_unit_of_length(size: int, length: int, device: str) -> None:
    """Scaled by 10^-11 to 10^12, with directions of length 10^-15 to 10^30: the same hits to the bit."""
    mesh, scale, along = soup_mesh(15, 300), np.float32(2.0**size), np.float32(2.0**length)
    tracer = wrt.Intersector(mesh, device=device)
    scaled = wrt.Intersector(wrt.Mesh(mesh.vertices * scale, mesh.faces), device=device)
    for origins, directions in batches(mesh).values():
        expected = tracer.closest_hit(origins, directions)
        hits = scaled.closest_hit(origins * scale, directions * along)
        assert_same(hits, expected._replace(t=expected.t * scale / along))


@pytest.mark.parametrize("exponent", [-126, -50, -44, 46, 122])
def test_sizes_beyond_float32_arithmetic_give_no_made_up_hits(exponent: int, device: str) -> None:
    """From 10^-38 to 10^37: products of three coordinates vanish or overflow, and turn hits into misses only."""
    mesh = soup_mesh(17, 300)
    # At 2^-44 products of three coordinates are denormal: digits are lost, but not yet all.
    most = 1e-3 if exponent == -44 else 1e-6
    scale = np.float32(2.0**exponent)
    tracer = wrt.Intersector(mesh, device=device)
    beyond = wrt.Intersector(wrt.Mesh(mesh.vertices * scale, mesh.faces), device=device)
    for origins, directions in batches(mesh).values():
        expected, hits = tracer.closest_hit(origins, directions), beyond.closest_hit(origins * scale, directions)
        assert_sane(hits)
        hit = hits.triangle >= 0
        np.testing.assert_array_equal(beyond.any_hit(origins * scale, directions), hit)
        # A hit is one of a triangle that the ray meets, if maybe not the nearest, and where it meets it.
        assert not hit[expected.triangle < 0].any()
        corners = mesh.vertices[mesh.faces[hits.triangle[hit]]].astype(np.float64)
        tested = woop(corners[:, None], origins[hit].astype(np.float64), directions[hit].astype(np.float64))
        assert tested.perhaps.all()
        error = np.abs(hits.t[hit] / np.float64(scale) - tested.t[:, 0])
        assert (error <= np.maximum(tested.t_error[:, 0], most * tested.t[:, 0])).all()


# --- Rays --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
@pytest.mark.parametrize("kind", ["single", "in turn", "packets", "instances"])
def test_rays_without_a_direction_or_a_place_hit_nothing_and_disturb_no_others(
    kind: str, bad: float, device: str
) -> None:
    """A NaN, an infinity or a zero in one, two or all components of the direction or the origin."""
    mesh = soup_mesh(19, 300)
    if kind == "instances":
        tracer = wrt.Intersector.of_instances([mesh, mesh], [0, 1], np.stack([np.eye(4)] * 2), device=device)
    else:
        tracer = wrt.Intersector(mesh, device=device)
    origins, directions = batches(mesh)["single" if kind == "instances" else kind]
    expected = tracer.closest_hit(origins, directions)
    rng = np.random.default_rng(20)
    broken = rng.permutation(len(origins))[: len(origins) // 10]
    for number, ray in enumerate(broken):
        which = origins if number % 2 and bad != 0.0 else directions
        count = 3 if bad == 0.0 else 1 + number // 2 % 3
        which[ray, rng.permutation(3)[:count]] = bad
    hits = tracer.closest_hit(origins, directions)
    assert (hits.triangle[broken] == -1).all()
    assert np.isinf(hits.t[broken]).all()
    assert not tracer.any_hit(origins, directions)[broken].any()
    good = np.setdiff1d(np.arange(len(origins)), broken)
    for found, undisturbed in zip(hits, expected, strict=True):
        np.testing.assert_array_equal(found[good], undisturbed[good])


@pytest.mark.parametrize("size", [1e21, 3e38])
def test_rays_from_anywhere_come_back(size: float, device: str) -> None:
    """Origins so far away that a distance to a box overflows, along axes and not."""
    tracer = wrt.Intersector(soup_mesh(21, 300), device=device)
    rng = np.random.default_rng(22)
    origins = (size * rng.choice([-1.0, 0.0, 1.0], (MANY, 3))).astype(np.float32)
    directions = rng.choice([-1.0, -1e-20, 0.0, 1e-20, 1.0], (MANY, 3)).astype(np.float32)
    for rays in (origins, directions), (origins[:FEW], directions[:FEW]), (origins, np.sort(directions, axis=0)):
        assert_sane(tracer.closest_hit(*rays))
        tracer.any_hit(*rays)
