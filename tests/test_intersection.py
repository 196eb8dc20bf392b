"""The nearest hit, and whether a segment is blocked, against testing every triangle in float64."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray

import wrt
from wrt.backend.device import Device
from wrt.kernels.accel.intersect import closest_hit, occluded
from wrt.kernels.geometry.rays import Ray
from wrt.kernels.scene.scene_data import SceneData
from wrt.upload.scene_data import build_scene


@wp.kernel(enable_backward=False)
def cast(
    scene: SceneData,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    reach: wp.array(dtype=float),
    triangle_out: wp.array(dtype=int),
    tuv_out: wp.array(dtype=wp.vec3),
    blocked_out: wp.array(dtype=int),
):
    i = wp.tid()
    ray = Ray()
    ray.origin = origins[i]
    ray.direction = directions[i]
    hit = closest_hit(scene, ray)
    triangle_out[i] = hit.triangle
    tuv_out[i] = wp.vec3(hit.t, hit.u, hit.v)
    blocked_out[i] = int(occluded(scene, ray, reach[i]))


def cast_rays(scene: wrt.Scene, origins: NDArray, directions: NDArray, reach: NDArray, device: str) -> tuple:
    built = build_scene(scene, Device(device))
    n = len(origins)
    triangle = wp.zeros(n, dtype=int, device=device)
    tuv = wp.zeros(n, dtype=wp.vec3, device=device)
    blocked = wp.zeros(n, dtype=int, device=device)
    inputs = [
        built.data,
        wp.array(origins, dtype=wp.vec3, device=device),
        wp.array(directions, dtype=wp.vec3, device=device),
        wp.array(reach, dtype=float, device=device),
    ]
    wp.launch(cast, n, inputs, [triangle, tuv, blocked], device=device)
    return triangle.numpy(), tuv.numpy().astype(np.float64), blocked.numpy().astype(bool)


def brute_force(mesh: wrt.Mesh, origins: NDArray, directions: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return nearest distance and triangle (Möller and Trumbore 1997), and the nearest edge's barycentric."""
    p = mesh.vertices[mesh.faces].astype(np.float64)
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    best_t = np.full(len(origins), np.inf)
    best = np.full(len(origins), -1)
    margin = np.full(len(origins), np.inf)
    for i, (o, d) in enumerate(zip(origins.astype(np.float64), directions.astype(np.float64), strict=True)):
        q = np.cross(d, e2)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / np.einsum("ij,ij->i", e1, q)
            s = o - p[:, 0]
            u = np.einsum("ij,ij->i", s, q) * inverse
            r = np.cross(s, e1)
            v = r @ d * inverse
            t = np.einsum("ij,ij->i", e2, r) * inverse
            inside = np.minimum(np.minimum(u, v), 1.0 - u - v)
        front = t > 0.0
        # How far the ray is from changing its mind, in barycentric units.
        margin[i] = np.nanmin(np.abs(inside[front])) if front.any() else np.inf
        t = np.where(front & (inside >= 0.0), t, np.inf)
        best[i] = int(np.argmin(t))
        best_t[i] = t[best[i]]
        if not np.isfinite(best_t[i]):
            best[i] = -1
    return best_t, best, margin


def random_rays(bounds: NDArray, n: int, seed: int) -> tuple[NDArray, NDArray]:
    rng = np.random.default_rng(seed)
    center, radius = bounds.mean(axis=0), 0.5 * np.linalg.norm(bounds[1] - bounds[0])
    a, b = rng.normal(size=(2, n, 3))
    origins = center + 2.0 * radius * a / np.linalg.norm(a, axis=1, keepdims=True)
    targets = center + radius * rng.random((n, 1)) * b / np.linalg.norm(b, axis=1, keepdims=True)
    directions = targets - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return origins.astype(np.float32), directions.astype(np.float32)


def soup(seed: int, n: int) -> wrt.Mesh:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.0, 1.0, (n, 1, 3)) + 0.3 * rng.normal(size=(n, 3, 3))
    return wrt.Mesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))


MESHES = {
    "sphere": wrt.sphere(subdivisions=3),
    "box": wrt.box(),
    "soup": soup(0, 500),
    "one triangle": soup(1, 1),
    "millimetres": wrt.sphere(subdivisions=3).scaled(1e-3),
    "megametres": wrt.sphere(subdivisions=3).scaled(1e6),
    "far away": wrt.sphere(subdivisions=3).translated((1e3, -2e3, 5e2)),
}


@pytest.mark.parametrize("name", MESHES)
def test_hits_equal_brute_force(name: str, device: str, report: Report) -> None:
    mesh = MESHES[name]
    scene = wrt.Scene()
    scene.add(mesh)
    origins, directions = random_rays(mesh.bounds, 3000, seed=2)
    expected_t, expected, margin = brute_force(mesh, origins, directions)
    size = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))
    # A ray nearer to an edge than float32 arithmetic resolves may fall on either side. Corners are
    # taken relative to the ray's origin first, so it does not matter how far away both are.
    certain = margin > 64.0 * np.finfo(np.float32).eps * len(mesh.faces) ** 0.5
    reach = np.where(np.isfinite(expected_t), 0.999 * expected_t, 3e38).astype(np.float32)
    triangle, tuv, blocked = cast_rays(scene, origins, directions, reach, device)

    wrong = certain & (triangle != expected)
    # Two triangles at one distance are a tie.
    tie = np.isclose(tuv[:, 0], expected_t, rtol=1e-5) & (triangle >= 0)
    report(f"{name}: rays certain, of {len(origins)}", int(certain.sum()))
    assert certain.mean() > 0.9
    assert not (wrong & ~tie).any()
    hit = certain & (expected >= 0)
    assert hit.any()
    np.testing.assert_allclose(tuv[hit, 0], expected_t[hit], rtol=2e-5, atol=1e-5 * size)
    assert not blocked[certain].any()

    corners = mesh.vertices[mesh.faces[triangle[hit]]].astype(np.float64)
    u, v = tuv[hit, 1:2], tuv[hit, 2:3]
    point = (1.0 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]
    along = origins[hit] + expected_t[hit, None] * directions[hit].astype(np.float64)
    np.testing.assert_allclose(point, along, atol=2e-5 * size)


def test_a_hit_within_reach_blocks(device: str) -> None:
    mesh = wrt.sphere(subdivisions=3)
    scene = wrt.Scene()
    scene.add(mesh)
    origins, directions = random_rays(mesh.bounds, 2000, seed=3)
    t, _, margin = brute_force(mesh, origins, directions)
    sure = np.isfinite(t) & (margin > 1e-4)
    reach = np.where(np.isfinite(t), 1.001 * t, 1e30).astype(np.float32)
    _, _, blocked = cast_rays(scene, origins, directions, reach, device)
    assert blocked[sure].all()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_nothing_escapes_a_closed_mesh(scale: float, device: str) -> None:
    """From inside, every ray meets a wall, through edges and corners too."""
    mesh = wrt.sphere(subdivisions=4).scaled(scale)
    scene = wrt.Scene()
    scene.add(mesh)
    rng = np.random.default_rng(4)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    edges = 0.5 * (corners[:, 0] + corners[:, 1])
    targets = np.concatenate([mesh.vertices.astype(np.float64), edges, scale * rng.normal(size=(200_000, 3))])
    origins = 0.5 * scale * rng.uniform(-1.0, 1.0, (len(targets), 3)) / 3**0.5
    directions = targets - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    triangle, _, _ = cast_rays(
        scene, origins.astype(np.float32), directions.astype(np.float32), np.ones(len(targets), np.float32), device
    )
    assert (triangle >= 0).all()
