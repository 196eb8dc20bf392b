"""Sizes, and rays, at the ends of float32: the same hits as anywhere, or none; never a crash or a made-up hit."""

from __future__ import annotations

import numpy as np
import pytest
from support.exact_rays import woop
from test_difficult_triangles import FEW, MANY, assert_sane, batches, mesh_of
from test_intersection import soup

import wrt
from wrt.kernels.native.constants import MAX_DEPTH

# Sizes -----------------------------------------------------------------------------------------------


def scaled(mesh: wrt.Mesh, exponent: int) -> tuple[wrt.Mesh, np.float32]:
    scale = np.float32(2.0**exponent)
    return wrt.Mesh(mesh.vertices * scale, mesh.faces), scale


@pytest.mark.parametrize("exponent", [-36, -20, -1, 1, 20, 40])
def test_hits_do_not_depend_on_the_unit_of_length(exponent: int, device: str) -> None:
    """A mesh and its rays, 10^-11 to 10^12 as large: bit for bit the same hits."""
    mesh = soup(15, 300)
    other, scale = scaled(mesh, exponent)
    tracer, small = wrt.Intersector(mesh, device=device), wrt.Intersector(other, device=device)
    for origins, directions in batches(mesh).values():
        expected, hits = tracer.closest_hit(origins, directions), small.closest_hit(origins * scale, directions)
        np.testing.assert_array_equal(hits.triangle, expected.triangle)
        np.testing.assert_array_equal(hits.t, expected.t * scale)
        np.testing.assert_array_equal(hits.u, expected.u)
        np.testing.assert_array_equal(hits.v, expected.v)


@pytest.mark.parametrize("exponent", [-50, -20, 20, 60, 100])
def test_hits_do_not_depend_on_the_length_of_directions(exponent: int, device: str) -> None:
    """Directions 10^-15 to 10^30 long: t is in units of them."""
    mesh = soup(16, 300)
    tracer, scale = wrt.Intersector(mesh, device=device), np.float32(2.0**exponent)
    for origins, directions in batches(mesh).values():
        expected, hits = tracer.closest_hit(origins, directions), tracer.closest_hit(origins, directions * scale)
        np.testing.assert_array_equal(hits.triangle, expected.triangle)
        np.testing.assert_array_equal(hits.t, expected.t / scale)


@pytest.mark.parametrize("exponent", [-126, -100, -64, -50, -44, 43, 44, 46, 50, 64, 100, 122])
def test_sizes_beyond_float32_arithmetic_give_no_made_up_hits(exponent: int, device: str) -> None:
    """From 10^-38 to 10^37: products of three coordinates vanish or overflow, and what is lost is a miss."""
    mesh = soup(17, 300)
    # At 2^-44 products of three coordinates are denormal: digits are lost, but not yet all.
    most = 1e-3 if exponent == -44 else 1e-6
    other, scale = scaled(mesh, exponent)
    tracer, beyond = wrt.Intersector(mesh, device=device), wrt.Intersector(other, device=device)
    for origins, directions in batches(mesh).values():
        expected, hits = tracer.closest_hit(origins, directions), beyond.closest_hit(origins * scale, directions)
        assert_sane(hits)
        hit = hits.triangle >= 0
        np.testing.assert_array_equal(beyond.any_hit(origins * scale, directions), hit)
        # A hit is one of a triangle that the ray meets, if maybe not the nearest, and where it meets it.
        assert not hit[expected.triangle < 0].any()
        corners = mesh.vertices[mesh.faces[hits.triangle[hit]]].astype(np.float64)
        met = woop(corners[:, None], origins[hit].astype(np.float64), directions[hit].astype(np.float64))
        assert met.perhaps.all()
        error = np.abs(hits.t[hit] / np.float64(scale) - met.t[:, 0])
        assert (error <= np.maximum(met.t_error[:, 0], most * met.t[:, 0])).all()


@pytest.mark.parametrize("size", [3e38, 1e30, 1e-30, 1e-40])
def test_any_finite_coordinates_build_a_tree(size: float, device: str) -> None:
    """Also where sums of two coordinates overflow, and where single ones are denormal."""
    rng = np.random.default_rng(18)
    corners = rng.uniform(-size, size, (2000, 3, 3)).astype(np.float32)
    tracer = wrt.Intersector(mesh_of(corners), device=device)
    assert tracer._built.depth <= MAX_DEPTH
    origins, directions = rng.uniform(-1.0, 1.0, (2, MANY, 3))
    assert_sane(tracer.closest_hit(origins * size, directions))


# Rays ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", ["single", "in turn", "packets", "instances"])
def test_rays_without_a_direction_or_a_place_hit_nothing_and_disturb_no_others(
    kind: str, bad: float, device: str
) -> None:
    """A number that is none in one component of the direction or the origin, in two, or in all."""
    mesh = soup(19, 300)
    if kind == "instances":
        tracer = wrt.Intersector.of_instances([mesh, mesh], [0, 1], np.stack([np.eye(4)] * 2), device=device)
    else:
        tracer = wrt.Intersector(mesh, device=device)
    origins, directions = batches(mesh)["single" if kind == "instances" else kind]
    expected = tracer.closest_hit(origins, directions)
    origins, directions = origins.copy(), directions.copy()
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
    for mine, others in zip(hits, expected, strict=True):
        np.testing.assert_array_equal(mine[good], others[good])


@pytest.mark.parametrize("size", [1e21, 1e30, 3e38])
def test_rays_from_anywhere_come_back(size: float, device: str) -> None:
    """Origins so far away that a distance to a box overflows, along axes and not."""
    mesh = soup(21, 300)
    tracer = wrt.Intersector(mesh, device=device)
    rng = np.random.default_rng(22)
    origins = (size * rng.choice([-1.0, 0.0, 1.0], (MANY, 3))).astype(np.float32)
    directions = rng.choice([-1.0, -1e-20, 0.0, 1e-20, 1.0], (MANY, 3)).astype(np.float32)
    for rays in (origins, directions), (origins[:FEW], directions[:FEW]), (origins, np.sort(directions, axis=0)):
        assert_sane(tracer.closest_hit(*rays))
        tracer.any_hit(*rays)
