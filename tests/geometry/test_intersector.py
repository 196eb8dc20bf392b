"""The nearest hit, and whether a segment is blocked, against all triangles in float64, however rays are traced."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from support.exact_rays import Reason, exact_distances, explain, woop
from support.kernels import upload
from support.ray_trees import assert_same, camera_rays, inner_rays, mesh_of, random_rays, slivers, soup_mesh

import wrt
from wrt.backend.device import Device
from wrt.kernels.accel.intersect import closest_hit, occluded
from wrt.kernels.geometry.rays import Ray
from wrt.kernels.scene.scene_data import SceneData
from wrt.rendering import intersector as module
from wrt.upload.scene_data import build_scene


@wp.kernel(enable_backward=False)
def cast(
    scene: SceneData,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    shares: wp.array(dtype=float),
    triangle_out: wp.array(dtype=int),
    tuv_out: wp.array(dtype=wp.vec3),
    blocked_out: wp.array2d(dtype=int),
):
    """Write the nearest hit, and whether segments are blocked that are as long as its distance times each share."""
    i = wp.tid()
    ray = Ray()
    ray.origin = origins[i]
    ray.direction = directions[i]
    hit = closest_hit(scene, ray)
    triangle_out[i] = hit.triangle
    tuv_out[i] = wp.vec3(hit.t, hit.u, hit.v)
    for k in range(shares.shape[0]):
        blocked_out[i, k] = int(occluded(scene, ray, wp.where(hit.triangle < 0, 1.0e30, hit.t * shares[k])))


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
    """Of rays in a scene, and of the same ones by an intersector."""
    mesh = MESHES[name]
    scene = wrt.Scene()
    scene.add(mesh)
    rays = random_rays(mesh.bounds, 2000, seed=2)
    out = [wp.zeros(2000, dtype=dtype, device=device) for dtype in (int, wp.vec3)]
    out.append(wp.zeros((2000, 2), dtype=int, device=device))
    inputs = [build_scene(scene, Device(device)).data, *(upload(each, wp.vec3, device) for each in rays)]
    wp.launch(cast, 2000, [*inputs, upload([0.999, 1.001], float, device)], out, device=device)
    triangle, tuv, blocked = (array.numpy() for array in out)
    hit = triangle >= 0
    assert hit.sum() > 0
    corners = mesh.vertices[mesh.faces]
    found = explain(corners, *rays, triangle, woop)
    assert not (found.reason == Reason.NONE).any()
    assert (found.reason == Reason.SAME).mean() > 0.99
    exact, error = exact_distances(corners[triangle[hit]], rays[0][hit], rays[1][hit], woop)
    assert (np.abs(tuv[hit, 0] - exact) <= error).all()
    assert not blocked[:, 0].any()
    np.testing.assert_array_equal(blocked[:, 1], hit)
    u, v = tuv[hit, 1:2].astype(np.float64), tuv[hit, 2:3].astype(np.float64)
    own = corners[triangle[hit]].astype(np.float64)
    point = (1.0 - u - v) * own[:, 0] + u * own[:, 1] + v * own[:, 2]
    size = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))
    np.testing.assert_allclose(point, rays[0][hit] + exact[:, None] * rays[1][hit], atol=2e-5 * size)
    tracer = wrt.Intersector(mesh, device=device)
    hits = tracer.closest_hit(*rays)
    np.testing.assert_array_equal(hits.triangle, triangle)
    np.testing.assert_array_equal(hits.t, np.where(hit, tuv[:, 0], np.inf).astype(np.float32))
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


@pytest.mark.parametrize("count", [10, 5000])
@pytest.mark.parametrize("kind", ["coherent", "incoherent"])
def test_limits(mesh: wrt.Mesh, kind: str, count: int, device: str) -> None:
    """A ray through a ball meets it twice; limits choose between the two, and each ray may have its own."""
    tracer = wrt.Intersector(mesh, device=device)
    rays = random_rays(mesh.bounds, count, seed=8) if kind == "incoherent" else camera_rays(count)
    near = tracer.closest_hit(*rays)
    hit, even = near.triangle >= 0, np.arange(len(near.triangle)) % 2 == 0
    assert hit.any()
    far = tracer.closest_hit(*rays, t_min=float(near.t[hit].max()) * 1.001)
    assert not np.isin(far.t[np.isfinite(far.t)], near.t).any()
    assert (tracer.closest_hit(*rays, t_max=near.t.min() * 0.999).triangle == -1).all()
    own = np.where(hit, np.where(even, near.t * 1.001, near.t * 0.999), 1.0).astype(np.float32)
    alternate = tracer.closest_hit(*rays, t_max=own)
    np.testing.assert_array_equal(alternate.triangle[hit & even], near.triangle[hit & even])
    assert (alternate.triangle[hit & ~even] == -1).all()
    np.testing.assert_array_equal(tracer.any_hit(*rays, t_max=own)[hit], even[hit])


@pytest.mark.not_emulated
def test_warp_arrays_come_back_as_warp_arrays(mesh: wrt.Mesh, device: str) -> None:
    tracer = wrt.Intersector(mesh, device=device)
    rays = camera_rays(80**2)
    expected = tracer.closest_hit(*rays)
    arrays = [wp.array(a, dtype=wp.vec3, device=device) for a in rays]
    for got, wanted in zip(
        (*tracer.closest_hit(*arrays), tracer.any_hit(*arrays)), (*expected, expected.triangle >= 0), strict=True
    ):
        assert isinstance(got, wp.array)
        assert str(got.device) == device
        np.testing.assert_array_equal(got.numpy(), wanted)


@pytest.mark.not_emulated
def test_limits_in_a_warp_array(mesh: wrt.Mesh, device: str) -> None:
    tracer = wrt.Intersector(mesh, device=device)
    rays = camera_rays(80**2)
    near = tracer.closest_hit(*rays)
    limits = np.where(np.isfinite(near.t), near.t * 0.999, 1.0).astype(np.float32)
    hits = tracer.closest_hit(*rays, t_max=wp.array(limits, dtype=float, device=device))
    assert (hits.triangle == -1).all()
    with pytest.raises(wrt.InputError, match="t_max must be a Warp array"):
        tracer.closest_hit(*rays, t_max=wp.array(limits[:-1], dtype=float, device=device))


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


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (1e-3, 0.0), (1e6, 0.0), (1.0, 1e4)])
def test_nothing_escapes_a_closed_mesh(scale: float, offset: float, device: str) -> None:
    """A quarter of a million rays from inside, at faces, edges and corners, however large or far away the mesh is."""
    ball = wrt.sphere(subdivisions=6)
    p = ball.vertices.astype(np.float64)
    p *= 1.0 + 0.15 * (np.sin(9.0 * p[:, :1]) * np.sin(11.0 * p[:, 1:2]) * np.sin(7.0 * p[:, 2:]))
    mesh = wrt.Mesh((scale * (p + offset)).astype(np.float32), ball.faces)
    inside = scale * (0.4 * (np.random.default_rng(9).random((1 << 18, 3)) - 0.5) + offset)
    rays = inner_rays(mesh, inside, seed=10)
    tracer = wrt.Intersector(mesh, device=device)
    hits = tracer.closest_hit(*rays)
    assert (hits.triangle >= 0).all()
    assert tracer.any_hit(*rays).all()


TWO = np.zeros((2, 3))


@pytest.mark.parametrize(
    ("origins", "directions", "limits", "message"),
    [
        (np.zeros((2, 2)), TWO, {}, "origins must be"),
        (TWO, np.zeros((3, 3)), {}, "2 origins but 3 directions"),
        (TWO, TWO + 1.0, {"t_min": -1.0}, "t_min must be at least 0"),
        (TWO, TWO + 1.0, {"t_max": np.nan}, "t_max must be"),
    ],
)
def test_what_cannot_be_traced(
    mesh: wrt.Mesh, origins: NDArray, directions: NDArray, limits: dict, message: str
) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.Intersector(mesh).closest_hit(origins, directions, **limits)


TRIANGLE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
FACE = [[0, 1, 2]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([*TRIANGLE, [0.0, np.nan, 0.0]], FACE, r"blob: vertices must be finite; number 3 is \[0.0, nan, 0.0\]"),
        (TRIANGLE, [[0, 1, 2], [0, -1, 2]], "blob: a face names vertex -1, but there are 3 vertices"),
        (TRIANGLE, np.uint64([[0, 1, 2**63]]), f"blob: a face names vertex {2**63}, but"),
        (TRIANGLE, np.int64([[0, 1, 2**32]]), f"blob: a face names vertex {2**32}, but"),
        (TRIANGLE, np.zeros((0, 3), int), "blob: the mesh has no triangles"),
        (TRIANGLE, [[0, 1]], r"blob: faces must be \(M, 3\), not \(1, 2\)"),
        (TRIANGLE, [[0.0, 1.0, 2.0]], "blob: faces must be integers, not float64"),
        ([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], FACE, r"blob: vertices must be \(N, 3\), not \(3, 2\)"),
    ],
)
def test_what_is_no_mesh_is_refused_by_name(vertices: object, faces: object, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message) as error:
        wrt.Mesh(vertices, faces, name="blob")  # type: ignore[arg-type]
    assert "\n" not in str(error.value)


def test_what_holds_nothing_to_hit_is_refused() -> None:
    trimesh = pytest.importorskip("trimesh")
    bad = trimesh.Trimesh([*TRIANGLE, [0.0, np.nan, 0.0]], [[0, 1, 3]], process=False)
    for what, message in (
        (wrt.Scene(), "no shapes"),
        (trimesh.Trimesh(), "no triangles"),
        (bad, "finite"),
        (TRIANGLE, "not list; wrt.Mesh takes arrays"),
        ("bunny.obj", r"^an intersector needs .*, not a path; wrt\.load_mesh reads files$"),
    ):
        with pytest.raises(wrt.InputError, match=message) as error:
            wrt.Intersector(what)
        assert "\n" not in str(error.value)
    with pytest.raises(wrt.InputError, match=r"not tuple; wrt\.Mesh takes arrays$"):
        wrt.render((np.eye(3), FACE))  # type: ignore[arg-type]
