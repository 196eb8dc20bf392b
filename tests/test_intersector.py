"""Rays by the million: however they are traced, the hits are those of single rays."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from test_intersection import brute_force, random_rays, soup

import wrt
from wrt.rendering import intersector as module

Rays = tuple[NDArray[np.float32], NDArray[np.float32]]


@pytest.fixture(scope="module")
def mesh() -> wrt.Mesh:
    return wrt.sphere(subdivisions=4)


def camera_rays(side: int) -> Rays:
    y, x = np.mgrid[0:side, 0:side] / side - 0.5
    directions = np.stack([x, y, np.full_like(x, -1.0)], axis=2).reshape(-1, 3).astype(np.float32)
    return np.tile(np.float32([0.0, 0.0, 3.0]), (len(directions), 1)), directions


def one_by_one(tracer: wrt.Intersector, rays: Rays, monkeypatch: pytest.MonkeyPatch, **limits: object) -> wrt.Hits:
    with monkeypatch.context() as patch:
        patch.setattr(module, "SMALL_BATCH", 10**9)
        return tracer.closest_hit(*rays, **limits)


def assert_same(a: wrt.Hits, b: wrt.Hits) -> None:
    for name, left, right in zip(a._fields, a, b, strict=True):
        np.testing.assert_array_equal(left, right, err_msg=name)


def test_nearest_hits_equal_brute_force(device: str) -> None:
    mesh = soup(5, 300)
    tracer = wrt.Intersector(mesh, device=device)
    origins, directions = random_rays(mesh.bounds, 2000, seed=6)
    hits = tracer.closest_hit(origins, directions)
    t, triangle, margin = brute_force(mesh, origins, directions)
    sure = margin > 1e-3
    np.testing.assert_array_equal(hits.triangle[sure], triangle[sure])
    np.testing.assert_allclose(hits.t[sure], t[sure], rtol=2e-5)
    assert np.isinf(hits.t[hits.triangle < 0]).all()
    np.testing.assert_array_equal(tracer.any_hit(origins, directions), hits.triangle >= 0)


def test_packets_find_what_single_rays_find(mesh: wrt.Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    tracer = wrt.Intersector(mesh)
    rays = camera_rays(101)  # not a multiple of a packet
    assert tracer._coherent(*tracer._rays(*rays)[0])
    single = one_by_one(tracer, rays, monkeypatch)
    assert_same(tracer.closest_hit(*rays), single)
    np.testing.assert_array_equal(tracer.any_hit(*rays), single.triangle >= 0)
    assert 0.2 < (single.triangle >= 0).mean() < 0.9


@pytest.mark.parametrize("threads", [1, 3])
def test_sorted_rays_find_what_single_rays_find(mesh: wrt.Mesh, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    tracer = wrt.Intersector(mesh, threads=threads)
    rays = random_rays(mesh.bounds, 50_001, seed=7)
    assert not tracer._coherent(*tracer._rays(*rays)[0])
    single = one_by_one(tracer, rays, monkeypatch)
    assert_same(tracer.closest_hit(*rays), single)
    np.testing.assert_array_equal(tracer.any_hit(*rays), single.triangle >= 0)


@pytest.mark.parametrize("count", [10, 5000])
@pytest.mark.parametrize("kind", ["coherent", "incoherent"])
def test_limits(mesh: wrt.Mesh, kind: str, count: int, device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ray through a ball meets it twice; limits choose between the two, and each ray may have its own."""
    tracer = wrt.Intersector(mesh, device=device)
    rays = random_rays(mesh.bounds, count, seed=8) if kind == "incoherent" else camera_rays(int(count**0.5))
    near = tracer.closest_hit(*rays)
    hit = near.triangle >= 0
    assert hit.any()
    far = tracer.closest_hit(*rays, t_min=float(near.t[hit].max()) * 1.001)
    assert not np.isin(far.t[np.isfinite(far.t)], near.t).any()
    short = tracer.closest_hit(*rays, t_max=near.t.min() * 0.999)
    assert (short.triangle == -1).all()
    own = np.where(np.arange(len(hit)) % 2 == 0, near.t * 1.001, near.t * 0.999).astype(np.float32)
    own = np.where(np.isfinite(own), own, 1.0).astype(np.float32)
    alternate = tracer.closest_hit(*rays, t_max=own)
    even = np.arange(len(hit)) % 2 == 0
    np.testing.assert_array_equal(alternate.triangle[hit & even], near.triangle[hit & even])
    assert (alternate.triangle[hit & ~even] == -1).all()
    np.testing.assert_array_equal(tracer.any_hit(*rays, t_max=own)[hit], even[hit])


@pytest.mark.parametrize("count", [16, 6000])
def test_no_direction_hits_nothing(mesh: wrt.Mesh, count: int, device: str) -> None:
    tracer = wrt.Intersector(mesh, device=device)
    origins = np.zeros((count, 3), np.float32)
    directions = np.tile(np.float32([0.0, 0.0, 1.0]), (count, 1))
    directions[1], directions[2] = 0.0, np.nan
    hits = tracer.closest_hit(origins, directions)
    assert (hits.triangle[[1, 2]] == -1).all()
    assert np.isinf(hits.t[[1, 2]]).all()
    assert (hits.triangle[3:] >= 0).all()
    assert tracer.any_hit(origins, directions)[3:].all()
    assert not tracer.any_hit(origins, directions)[[1, 2]].any()


def test_distance_is_in_units_of_the_direction(mesh: wrt.Mesh, device: str) -> None:
    tracer = wrt.Intersector(mesh, device=device)
    hits = tracer.closest_hit([[0.1, 0.2, 3.0]], [[0.0, 0.0, -4.0]])
    longer = tracer.closest_hit([[0.1, 0.2, 3.0]], [[0.0, 0.0, -1.0]])
    np.testing.assert_allclose(4.0 * hits.t, longer.t, rtol=1e-6)


def test_warp_arrays_come_back_as_warp_arrays(mesh: wrt.Mesh, device: str) -> None:
    tracer = wrt.Intersector(mesh, device=device)
    rays = camera_rays(80)
    expected = tracer.closest_hit(*rays)
    arrays = [wp.array(a, dtype=wp.vec3, device=device) for a in rays]
    hits = tracer.closest_hit(*arrays)
    for got, wanted in zip(hits, expected, strict=True):
        assert isinstance(got, wp.array)
        assert str(got.device) == device
        np.testing.assert_array_equal(got.numpy(), wanted)
    any_hit = tracer.any_hit(*arrays)
    assert isinstance(any_hit, wp.array)
    np.testing.assert_array_equal(any_hit.numpy(), expected.triangle >= 0)


def test_limits_in_a_warp_array(mesh: wrt.Mesh, device: str) -> None:
    tracer = wrt.Intersector(mesh, device=device)
    rays = camera_rays(80)
    near = tracer.closest_hit(*rays)
    limits = np.where(np.isfinite(near.t), near.t * 0.999, 1.0).astype(np.float32)
    hits = tracer.closest_hit(*rays, t_max=wp.array(limits, dtype=float, device=device))
    assert (hits.triangle == -1).all()
    with pytest.raises(wrt.InputError, match="t_max must be a Warp array"):
        tracer.closest_hit(*rays, t_max=wp.array(limits[:-1], dtype=float, device=device))


def test_triangles_of_a_scene_are_numbered_through(device: str) -> None:
    scene = wrt.Scene()
    scene.add(wrt.quad((-1.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)))
    scene.add(wrt.quad((-1.0, -1.0, -1.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)))
    tracer = wrt.Intersector(scene, device=device)
    hits = tracer.closest_hit([[0.5, -0.5, 1.0], [0.5, -0.5, -2.0]], [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(hits.triangle, [0, 2])
    assert tracer.triangles == 4


def test_trimesh_objects(mesh: wrt.Mesh) -> None:
    trimesh = pytest.importorskip("trimesh")
    tracer = wrt.Intersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    assert_same(tracer.closest_hit(*camera_rays(20)), wrt.Intersector(mesh).closest_hit(*camera_rays(20)))


def test_no_rays(mesh: wrt.Mesh) -> None:
    hits = wrt.Intersector(mesh).closest_hit(np.zeros((0, 3)), np.zeros((0, 3)))
    assert [len(a) for a in hits] == [0, 0, 0, 0]


@pytest.mark.parametrize(
    ("origins", "directions", "limits", "message"),
    [
        (np.zeros((2, 2)), np.zeros((2, 3)), {}, "origins must be"),
        (np.zeros((2, 3)), np.zeros((3, 3)), {}, "2 origins but 3 directions"),
        (np.zeros((2, 3)), np.ones((2, 3)), {"t_min": -1.0}, "t_min must be at least 0"),
        (np.zeros((2, 3)), np.ones((2, 3)), {"t_max": [1.0, 2.0, 3.0]}, "t_max must be"),
        (np.zeros((2, 3)), np.ones((2, 3)), {"t_max": np.nan}, "t_max must be"),
    ],
)
def test_what_cannot_be_traced(
    mesh: wrt.Mesh, origins: NDArray, directions: NDArray, limits: dict, message: str
) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.Intersector(mesh).closest_hit(origins, directions, **limits)


def test_where_a_mesh_is_needed_what_makes_one_is_named() -> None:
    with pytest.raises(wrt.InputError, match=r"^an intersector needs .*, not a path; wrt\.load_mesh reads files$"):
        wrt.Intersector("bunny.obj")
    with pytest.raises(wrt.InputError, match=r"not tuple; wrt\.Mesh takes arrays$"):
        wrt.render((np.eye(3), [[0, 1, 2]]))  # type: ignore[arg-type]


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (1e-3, 0.0), (1e6, 0.0), (1.0, 1e4)])
def test_nothing_escapes_a_closed_mesh(scale: float, offset: float, device: str, report: Report) -> None:
    """Half a million rays from inside, at faces, edges and corners, however large or far away the mesh is."""
    ball = wrt.sphere(subdivisions=6)
    p = ball.vertices.astype(np.float64)
    p *= 1.0 + 0.15 * (np.sin(9.0 * p[:, :1]) * np.sin(11.0 * p[:, 1:2]) * np.sin(7.0 * p[:, 2:]))
    mesh = wrt.Mesh((scale * (p + offset)).astype(np.float32), ball.faces)
    rng = np.random.default_rng(9)
    count = 1 << 19
    weights = rng.random((count, 3))
    kind = rng.integers(0, 3, count)
    weights[kind == 1, 2] = 0.0
    weights[kind == 2, 1:] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    corners = mesh.vertices.astype(np.float64)[mesh.faces[rng.integers(0, len(mesh.faces), count)]]
    targets = (corners * weights[:, :, None]).sum(axis=1)
    origins = (scale * (0.4 * (rng.random((count, 3)) - 0.5) + offset)).astype(np.float32)
    directions = targets - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    tracer = wrt.Intersector(mesh, device=device)
    hits = tracer.closest_hit(origins, directions)
    report(f"scale {scale:g}, offset {offset:g}: rays that escape", int((hits.triangle < 0).sum()), 0)
    assert (hits.triangle >= 0).all()
    assert tracer.any_hit(origins, directions).all()
