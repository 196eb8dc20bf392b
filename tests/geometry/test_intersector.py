"""The nearest hit, and whether a segment is blocked, against all triangles in float64, however rays are traced."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
import warp as wp
from support.exact_rays import Reason, exact_distances, explain
from support.ray_trees import assert_same, camera_rays, inner_rays, mesh_of, random_rays, slivers, soup_mesh

import wrt
from wrt.rendering import intersector as module

MESHES = {
    "sphere": wrt.sphere(subdivisions=2),
    "box": wrt.box(),
    "soup": soup_mesh(0, 250),
    "one triangle": soup_mesh(1, 1),
    "needles": mesh_of(slivers(250, 2.0, 0.01)),
    "megametres": wrt.sphere(subdivisions=2).scaled(1e6),
    "far away": wrt.sphere(subdivisions=2).translated((1e3, -2e3, 5e2)),
}


@pytest.mark.parametrize("name", MESHES)
def test_every_answer_is_right_within_rounding(name: str, device: str) -> None:
    mesh = MESHES[name]
    rays = random_rays(mesh.bounds, 2000, seed=2)
    tracer = wrt.Intersector(mesh, device=device)
    hits = tracer.closest_hit(*rays)
    hit = hits.triangle >= 0
    assert hit.any()
    corners = mesh.vertices[mesh.faces]
    found = explain(corners, *rays, hits.triangle)
    assert not (found.reason == Reason.NONE).any()
    assert (found.reason == Reason.SAME).mean() > 0.99
    hit_corners = corners[hits.triangle[hit]].astype(np.float64)
    exact, error = exact_distances(hit_corners, rays[0][hit], rays[1][hit])
    assert (np.abs(hits.t[hit] - exact) <= error).all()
    u, v = hits.u[hit, None].astype(np.float64), hits.v[hit, None].astype(np.float64)
    point = (1.0 - u - v) * hit_corners[:, 0] + u * hit_corners[:, 1] + v * hit_corners[:, 2]
    size = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))
    np.testing.assert_allclose(point, rays[0][hit] + exact[:, None] * rays[1][hit], atol=2e-5 * size)
    for share, blocked in ((0.999, False), (1.001, True)):
        limits = np.where(hit, hits.t * share, 1.0).astype(np.float32)
        np.testing.assert_array_equal(tracer.any_hit(*rays, t_max=limits)[hit], blocked)
    np.testing.assert_array_equal(tracer.any_hit(*rays), hit)


@pytest.fixture(scope="module")
def mesh() -> wrt.Mesh:
    return wrt.sphere(subdivisions=4)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("kind", ["packets", "sorted"])
def test_packets_and_sorted_rays_find_what_single_rays_find(
    mesh: wrt.Mesh, kind: str, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracer = wrt.Intersector(mesh, threads=threads)
    # Neither is a multiple of a packet.
    rays = camera_rays(101**2) if kind == "packets" else random_rays(mesh.bounds, 50_001, seed=7)
    assert tracer._coherent(*tracer._rays(*rays)[0]) == (kind == "packets")
    hits, any_hit = tracer.closest_hit(*rays), tracer.any_hit(*rays)
    monkeypatch.setattr(module, "SMALL_BATCH", 10**9)
    single = tracer.closest_hit(*rays)
    assert_same(hits, single)
    np.testing.assert_array_equal(any_hit, single.triangle >= 0)
    assert 0.2 < (single.triangle >= 0).mean() < 0.9


def tracer_of(kind: str, mesh: wrt.Mesh, device: str) -> wrt.Intersector:
    """Return an intersector of a mesh, or of two instances of it scaled down, one of them out of reach."""
    if kind != "instances":
        return wrt.Intersector(mesh, device=device)
    places = np.stack([np.diag([2.0, 2.0, 2.0, 1.0])] * 2)
    places[1, :3, 3] = 1e3
    return wrt.Intersector.of_instances([mesh.scaled(0.5)], [0, 0], places, device=device)


@pytest.mark.parametrize("kind", ["single", "incoherent", "coherent", "instances"])
def test_limits(mesh: wrt.Mesh, kind: str, device: str) -> None:
    """A ray through a ball meets it twice; limits choose between the two, belong to the range, and may be each ray's.

    t counts in units of the direction in the world, whatever the instance's scale.
    """
    tracer = tracer_of(kind, mesh, device)
    rays = camera_rays(5000) if kind == "coherent" else random_rays(mesh.bounds, 10 if kind == "single" else 5000, 8)
    near = tracer.closest_hit(*rays)
    hit, even = near.triangle >= 0, np.arange(len(near.triangle)) % 2 == 0
    assert hit.any()
    far = tracer.closest_hit(*rays, t_min=float(near.t[hit].max()) * 1.001)
    assert not np.isin(far.t[np.isfinite(far.t)], near.t).any()
    least = float(np.median(near.t[hit]))
    assert (tracer.closest_hit(*rays, t_min=least).t >= least).all()
    assert (tracer.closest_hit(*rays, t_max=near.t.min() * 0.999).triangle == -1).all()
    limits = np.where(hit, np.where(even, near.t, near.t * 0.9999), 1.0).astype(np.float32)
    alternate = tracer.closest_hit(*rays, t_max=limits)
    np.testing.assert_array_equal(alternate.triangle[hit & even], near.triangle[hit & even])
    assert (alternate.triangle[hit & ~even] == -1).all()
    np.testing.assert_array_equal(tracer.any_hit(*rays, t_max=limits)[hit], even[hit])
    assert_same(tracer.closest_hit(rays[0], 4.0 * rays[1]), near._replace(t=near.t / np.float32(4.0)))


@pytest.mark.not_emulated
@pytest.mark.parametrize("kind", ["mesh", "instances"])
def test_warp_arrays_come_back_as_warp_arrays(mesh: wrt.Mesh, kind: str, device: str) -> None:
    tracer, rays = tracer_of(kind, mesh, device), camera_rays(80**2)
    expected = tracer.closest_hit(*rays)
    arrays = [wp.array(a, dtype=wp.vec3, device=device) for a in rays]
    limits = wp.array(np.where(np.isfinite(expected.t), expected.t, 1.0), dtype=float, device=device)
    for hits in (tracer.closest_hit(*arrays), tracer.closest_hit(*arrays, t_max=limits)):
        assert {str(array.device) for array in hits} == {device}
        assert_same(wrt.Hits(*(array.numpy() for array in hits)), expected)
    np.testing.assert_array_equal(tracer.any_hit(*arrays).numpy(), expected.triangle >= 0)
    with pytest.raises(wrt.InputError, match="t_max must be a Warp array"):
        tracer.closest_hit(*rays, t_max=wp.array(np.ones(3), dtype=float, device=device))


def test_triangles_of_a_scene_are_numbered_through(device: str) -> None:
    scene = wrt.Scene()
    for z in (0.0, -1.0):
        scene.add(wrt.quad((-1.0, -1.0, z), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)))
    tracer = wrt.Intersector(scene, device=device)
    hits = tracer.closest_hit([[0.5, -0.5, 1.0], [0.5, -0.5, -2.0]], [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(hits.triangle, [0, 2])
    assert tracer.triangles == 4
    assert [len(a) for a in tracer.closest_hit(np.zeros((0, 3)), np.zeros((0, 3)))] == [0, 0, 0, 0]


def test_trimesh_objects(mesh: wrt.Mesh) -> None:
    trimesh = pytest.importorskip("trimesh")
    tracer = wrt.Intersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    assert_same(tracer.closest_hit(*camera_rays(400)), wrt.Intersector(mesh).closest_hit(*camera_rays(400)))
    with pytest.raises(wrt.InputError, match="no triangles"):
        wrt.Intersector(trimesh.Trimesh())


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (1e-3, 0.0), (1e6, 0.0), (1.0, 1e4)])
def test_nothing_escapes_a_closed_mesh(scale: float, offset: float, device: str) -> None:
    """A quarter of a million rays from inside, at faces, edges and corners, at any scale and distance."""
    ball = wrt.sphere(subdivisions=6)
    p = ball.vertices.astype(np.float64)
    p *= 1.0 + 0.15 * (np.sin(9.0 * p[:, :1]) * np.sin(11.0 * p[:, 1:2]) * np.sin(7.0 * p[:, 2:]))
    mesh = wrt.Mesh((scale * (p + offset)).astype(np.float32), ball.faces)
    inside = scale * (0.4 * (np.random.default_rng(9).random((1 << 18, 3)) - 0.5) + offset)
    rays = inner_rays(mesh, inside, seed=10)
    tracer = wrt.Intersector(mesh, device=device)
    assert (tracer.closest_hit(*rays).triangle >= 0).all()
    assert tracer.any_hit(*rays).all()


TWO = np.zeros((2, 3))
TRIANGLE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
FACE = [[0, 1, 2]]


def trace(origins: Any, directions: Any, **limits: float) -> Any:
    return wrt.Intersector(wrt.box()).closest_hit(origins, directions, **limits)


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (trace, (np.zeros((2, 2)), TWO), "origins must be"),
        (trace, (TWO, np.zeros((3, 3))), "2 origins but 3 directions"),
        (functools.partial(trace, t_min=-1.0), (TWO, TWO), "t_min must be at least 0"),
        (functools.partial(trace, t_max=np.nan), (TWO, TWO), "t_max must be"),
        (wrt.Intersector, (wrt.Scene(),), "no shapes"),
        (wrt.Intersector, (TRIANGLE,), r"not list; wrt\.Mesh takes arrays"),
        (wrt.Intersector, ("bunny.obj",), r"an intersector needs .*, not a path; wrt\.load_mesh reads files"),
        (wrt.render, ((np.eye(3), FACE),), r"not tuple; wrt\.Mesh takes arrays"),
    ],
)
def test_what_cannot_be_traced_is_refused_by_name(function: Any, arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(wrt.InputError, match=message) as error:
        function(*arguments)
    assert "\n" not in str(error.value)
