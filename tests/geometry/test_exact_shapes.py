"""Exact spheres, disks and cylinders: hits, normals and texture coordinates against closed forms in float64."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.exact_shapes import QUADRICS, cast_rays, local
from support.ray_trees import unit

import wrt
from wrt.kernels.geometry.quadrics import CYLINDER, DISK, Quadric, by_coordinate, point_of
from wrt.kernels.geometry.rays import Frame
from wrt.kernels.geometry.spheres import along_meridian, along_turn
from wrt.scene.exact.quadrics import Quadrics, quadrics_of
from wrt.scene.exact.spheres import Spheres

EPS = 2.0**-24


def roots(center: NDArray, radius: NDArray, origins: NDArray, directions: NDArray) -> tuple[NDArray, NDArray]:
    """Return the distances to both intersections with a sphere, NaN for rays that miss, and the squared half chord."""
    o, d = origins.astype(np.float64) - center, directions.astype(np.float64)
    length = np.linalg.norm(d, axis=1)
    d = d / length[:, None]
    middle = -(o * d).sum(axis=1)
    half2 = radius**2 - np.linalg.norm(o + d * middle[:, None], axis=1) ** 2
    half = np.sqrt(np.where(half2 >= 0.0, half2, np.nan))
    return np.stack([middle - half, middle + half], axis=1) / length[:, None], half2


def rays_to_sphere(center: NDArray, radius: float, n: int, distance: float) -> tuple[NDArray, NDArray]:
    """Return rays from all around to points of a sphere's disk, as many near its limb as elsewhere."""
    rng = np.random.default_rng(7)
    out, across = unit(rng.standard_normal((n, 3))), rng.standard_normal((n, 3))
    origins = (center + out * distance * radius).astype(np.float32)
    across = unit(across - out * (across * out).sum(axis=1, keepdims=True))
    share = np.where(np.arange(n) % 2, np.sqrt(rng.random(n)), 1.0 + 0.02 * rng.standard_normal(n))
    return origins, unit(center + across * (radius * share)[:, None] - origins).astype(np.float32)


@pytest.mark.parametrize("distance", [1.5, 1e4])
@pytest.mark.parametrize(("center", "radius"), [((0, 0, 0), 1.0), ((3, -2, 5), 1e-3), ((100, 2e5, -7), 1e6)])
def test_hits_of_spheres_agree_with_the_closed_form(center: tuple, radius: float, distance: float, device: str) -> None:
    """The error of a hit is that of a ray in float32: a few roundings of its length and of the coordinates."""
    ball = wrt.sphere(center, radius, exact=True)
    c, r = ball.centers[0], ball.radii[0]
    assert r == pytest.approx(radius, rel=3e-4)
    origins, directions = rays_to_sphere(c, r, 20_000, distance)
    number, ts, position, normal, _, left = cast_rays([ball], origins, directions, device)
    expected, half2 = roots(c, r, origins, directions)
    error = 8.0 * EPS * (distance * r + np.abs(c).max())  # of the line, across
    certain = np.abs(half2) > 2.0 * error * r
    assert ((number >= 0) == (half2 > 0.0))[certain].all()
    hit = (number >= 0) & certain
    assert hit.sum() > 5_000
    along = error * (1.0 + r / np.sqrt(half2[hit]))
    assert (np.abs(ts[hit] - expected[hit]) <= along[:, None]).all()
    out = normal[hit].astype(np.float64)
    assert np.abs(np.linalg.norm(out, axis=1) - 1.0).max() < 1e-6
    assert np.abs(position[hit, 0] - (c + r * out)).max() <= 4.0 * EPS * (np.abs(c).max() + r)
    for k, found in enumerate((c + r * out, position[hit, 1])):
        points = origins[hit] + directions[hit].astype(np.float64) * expected[hit, k : k + 1]
        assert (np.linalg.norm(points - found, axis=1) <= along + 1e-6 * r).all()
    # What leaves a sphere does not meet it again, and what enters it does.
    np.testing.assert_array_equal(left[number >= 0], np.broadcast_to([0, 0, -1, 0], left[number >= 0].shape))


def exact_hits(mesh: Quadrics, origins: NDArray, directions: NDArray) -> tuple[NDArray, NDArray]:
    """Return both distances in order, NaN for none, and by how much the rays clear the outline or the ends, in radii.

    The second is near 0 for rays whose hits depend on rounding.
    """
    o, d = local(mesh, origins - mesh.centers[0]), local(mesh, directions)
    with np.errstate(all="ignore"):
        if mesh.are_disks[0]:
            t = -o[:, 2] / d[:, 2]
            at = o + t[:, None] * d
            margin = np.hypot(at[:, 0], at[:, 1]) - 1.0
            t[(margin > 0.0) | (t < 0.0)] = np.nan
            return np.stack([t, np.full_like(t, np.nan)], axis=1), margin
        square = (d[:, :2] ** 2).sum(axis=1)
        middle = -(o[:, :2] * d[:, :2]).sum(axis=1) / square
        left = 1.0 - ((o[:, :2] + middle[:, None] * d[:, :2]) ** 2).sum(axis=1)
        half = np.sqrt(np.where(left >= 0.0, left, np.nan) / square)
        ts = np.stack([middle - half, middle + half], axis=1)
        z = np.abs(o[:, 2:] + ts * d[:, 2:]) - 0.5
        length, radius = np.linalg.norm(mesh.axes[0, 2]), np.linalg.norm(mesh.axes[0, 0])
        margin = np.nanmin(np.abs(np.concatenate([left[:, None], z * length / radius], axis=1)), axis=1)
        ts[(z > 0.0) | (ts < 0.0)] = np.nan
    return np.sort(ts, axis=1), margin


def reach_of(mesh: Quadrics) -> float:
    """Return the longest of a shape's vectors, but for the unit normal of a disk."""
    return float(np.linalg.norm(mesh.axes[0, : 2 if mesh.are_disks[0] else 3], axis=1).max())


def rays_to(mesh: Quadrics, n: int, distance: float) -> tuple[NDArray, NDArray]:
    """Return rays from all around to places in and near a shape, half of them to its outline or its ends."""
    rng = np.random.default_rng(7)
    out = unit(rng.standard_normal((n, 3)))
    origins = (mesh.centers[0] + distance * reach_of(mesh) * out).astype(np.float32)
    place = rng.uniform(-1.1, 1.1, (n, 3))
    o = local(mesh, origins - mesh.centers[0])
    near = 1.0 + 0.02 * rng.standard_normal(n)
    turn, kind = rng.uniform(0.0, 2.0 * np.pi, n), np.arange(n) % 4
    if mesh.are_disks[0]:
        place[:, 2] = 0.0
    else:
        place[:, 2] *= 0.5
        turn[kind == 1] = np.arctan2(o[:, 0], -o[:, 1])[kind == 1]
        place[kind == 3, 2] = (0.5 * near * rng.choice([-1.0, 1.0], n))[kind == 3]
    rim = np.stack([near * np.cos(turn), near * np.sin(turn)], axis=1)
    place[kind % 2 == 1, :2] = rim[kind % 2 == 1]
    return origins, unit(mesh.centers[0] + place @ mesh.axes[0] - origins).astype(np.float32)


@pytest.mark.parametrize(
    ("name", "distance"),
    [
        *((name, distance) for distance in (0.6, 3.0) for name in QUADRICS),
        *(pytest.param(name, 100.0, marks=pytest.mark.slow) for name in QUADRICS),
        *(
            pytest.param(name, 1e4, marks=pytest.mark.slow)
            for name in ("disk", "ellipse", "cylinder", "greatest disk", "greatest cylinder")
        ),
    ],
)
def test_hits_of_quadrics_agree_with_the_closed_form(name: str, distance: float, device: str, report: Report) -> None:
    """The error of a hit is that of a ray in float32, as of spheres. From 0.6 many rays begin inside a cylinder."""
    mesh = QUADRICS[name]
    x, y, z = mesh.axes[0]
    c, radius = mesh.centers[0], min(np.linalg.norm(x), np.linalg.norm(y))
    reach, disk = reach_of(mesh), bool(mesh.are_disks[0])
    size = np.abs(c).max() + reach
    origins, directions = rays_to(mesh, 20_000, distance)
    number, ts, position, normal, _, left = cast_rays([mesh], origins, directions, device)
    expected, margin = exact_hits(mesh, origins, directions)
    error = 16.0 * EPS * (distance * reach + size)  # of the line, across
    o, d = local(mesh, origins - c), local(mesh, directions)
    out = normal.astype(np.float64)
    if disk:
        front = unit(np.cross(x, y))
        cosine = np.abs(directions @ front)
        across = error / np.maximum(cosine, 1e-9)
        certain = (np.abs(margin) * radius > across) & (cosine > 1e-6)
    else:
        sine = np.linalg.norm(np.cross(directions, z), axis=1) / np.linalg.norm(z)
        nearest = o[:, :2] - d[:, :2] * ((o * d)[:, :2].sum(axis=1) / (d[:, :2] ** 2).sum(axis=1))[:, None]
        chord = np.sqrt(np.maximum(1.0 - (nearest**2).sum(axis=1), 1e-12))
        across = error / np.maximum(sine * chord, 1e-9) * (1.0 + 1.0 / np.maximum(sine, 1e-6))
        certain = (margin * radius > across) & (sine > 1e-4)
        certain &= np.abs(np.hypot(o[:, 0], o[:, 1]) - 1.0) * radius > across
    assert certain.mean() > 0.3
    assert ((number >= 0) == np.isfinite(expected[:, 0]))[certain].all()
    hit = (number >= 0) & certain
    assert hit.sum() > 500
    report("error of distances in roundings", float(np.max(np.abs(ts[hit, 0] - expected[hit, 0]) / across[hit])), "< 1")
    assert (np.abs(ts[hit, 0] - expected[hit, 0]) <= across[hit]).all()
    both = hit & np.isfinite(expected[:, 1])
    assert (np.abs(ts[both, 1] - expected[both, 1]) <= across[both]).all()
    # Points lie on the shape, and normals are perpendicular to it.
    hit = number >= 0
    assert np.abs(np.linalg.norm(out[hit], axis=1) - 1.0).max() < 1e-6
    if disk:
        assert np.abs((position[hit, 0] - c) @ front).max() < 8.0 * EPS * size
        assert np.abs(out[hit] - mesh.fronts[0]).max() < 1e-6
        # What leaves it does not meet it again. (A direction along it is rounded, and may rightly meet it far away.)
        assert (left[hit][:, :3] == -1).all()
        return
    place, tolerance = local(mesh, position[hit, 0] - c)[:, :2], 8.0 * EPS * size / radius
    assert np.abs(np.linalg.norm(place, axis=1) - 1.0).max() < tolerance
    assert np.abs(out[hit] - unit(place @ mesh.axes[0, :2])).max() < 1e-5 + tolerance
    # What leaves it does not meet it again but on its other side; what goes in comes out there, or at an end.
    seen_front = (directions * out).sum(axis=1) < 0.0
    outside, inside = hit & seen_front, hit & ~seen_front
    assert (left[outside, 2] == -1).all()
    assert (left[outside, 3] == 0).all()
    assert (left[inside, :2] == -1).all()
    sure = outside & certain
    assert ((left[sure, 0] >= 0) == np.isfinite(expected[sure, 1])).all()


def test_many_shapes_in_one_tree(device: str, report: Report) -> None:
    """Among triangles, spheres, disks and cylinders the nearest that a ray meets is found, and the next after it."""
    rng = np.random.default_rng(3)
    n = 300
    disks = zip(rng.uniform(-1, 1, (n, 3)), rng.standard_normal((n, 3)), rng.uniform(0.02, 0.2, n), strict=True)
    made = [wrt.disk(tuple(c), tuple(m), r) for c, m, r in disks]
    ends = zip(rng.uniform(-1, 1, (n, 3)), 0.2 * rng.standard_normal((n, 3)), rng.uniform(0.01, 0.1, n), strict=True)
    made += [wrt.cylinder(tuple(a), tuple(a + b), r) for a, b, r in ends]
    made = [made[k] for k in rng.permutation(2 * n)]
    flags, centers, axes = (np.concatenate([getattr(m, k) for m in made]) for k in ("are_disks", "centers", "axes"))
    many = quadrics_of(flags, centers, axes, "many")
    balls = wrt.spheres(rng.uniform(-1.0, 1.0, (n, 3)), rng.uniform(0.01, 0.05, n))
    floor = wrt.quad((-2, -0.5, 2), (4, 0, 0), (0, 0, -4))
    origins = (3.0 * rng.standard_normal((3000, 3))).astype(np.float32)
    directions = unit(rng.uniform(-1.0, 1.0, (3000, 3)) - origins).astype(np.float32)
    t = (-0.5 - origins[:, 1].astype(np.float64)) / directions[:, 1]
    on_floor = (np.abs((origins + directions * t[:, None])[:, [0, 2]]) < 2.0).all(axis=1) & (t > 0.0)
    hits = [np.where(on_floor, t, np.nan)[:, None]]
    hits += [roots(c, r, origins, directions)[0] for c, r in zip(balls.centers, balls.radii, strict=True)]
    hits += [exact_hits(mesh, origins, directions)[0] for mesh in made]
    table = np.concatenate(hits, axis=1)
    table[~(table > 0.0)] = np.inf
    columns = np.array([0, *np.repeat(np.arange(3 * n), 2) + 2])
    for shapes, used in (([floor, balls, many], len(columns)), ([floor, balls], 1 + 2 * n)):
        some = np.where(np.arange(len(columns)) < used, table, np.inf)
        order = np.argsort(some, axis=1)[:, :2]
        first, second = np.take_along_axis(some, order, axis=1).T
        number, ts, *_ = cast_rays(shapes, origins, directions, device)
        with np.errstate(invalid="ignore"):
            found, after = (np.where(number >= 0, ts[:, k], np.inf) for k in range(2))
            different = ~((np.abs(found - first) < 1e-4) | (found == first))
            different |= np.isfinite(first) & (number > 1) & (number != columns[order[:, 0]])
            same = (np.abs(after - second) < 1e-4) | ~np.isfinite(second)
        report("rays that meet another shape than in float64", int(different.sum()), f"of {len(origins)}")
        assert different.mean() < 0.002
        assert (~same & ~different).mean() < 0.002


def turned_ball() -> tuple[Spheres, NDArray]:
    """Return a turned and mirrored sphere, and the matrix from the space of a unit sphere."""
    rng = np.random.default_rng(5)
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(rng.standard_normal((3, 3)))[0] * 0.7
    matrix[:3, :3] *= -np.sign(np.linalg.det(matrix[:3, :3]))
    matrix[:3, 3] = 0.3, -0.4, 2.0
    ball = wrt.sphere((0.5, 0.25, 0.0), 0.5, exact=True).transformed(matrix)
    assert isinstance(ball, Spheres)
    own = np.eye(4)
    own[:3, :3], own[:3, 3] = 0.5 * np.eye(3), (0.5, 0.25, 0.0)
    return ball, matrix @ own


@pytest.mark.parametrize("name", ["sphere", "ellipse", "cylinder"])
def test_texture_coordinates_and_front(name: str, device: str) -> None:
    """Those of Mitsuba, in the shape's own space; the front of the turned shape is the other side."""
    if name == "sphere":
        mesh, matrix = turned_ball()
        origins, directions = rays_to_sphere(mesh.centers[0], mesh.radii[0], 5000, 4.0)
    else:
        mesh, matrix = QUADRICS[name], np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = QUADRICS[name].axes[0].T, QUADRICS[name].centers[0]
        origins, directions = rays_to(mesh, 5000, 4.0)
    number, _, position, normal, uv, _ = cast_rays([mesh], origins, directions, device)
    hit = number == 0
    at = position[hit, 0].astype(np.float64)
    x, y, z = ((at - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T).T
    turn, r = np.arctan2(y, x) / (2.0 * np.pi) % 1.0, np.hypot(x, y)
    other = np.arctan2(r, z) / np.pi if name == "sphere" else r if name == "ellipse" else z + 0.5
    first = 1 if name == "ellipse" else 0
    off = np.abs(uv[hit, first] - turn)
    assert (np.minimum(off, 1.0 - off) * r).max() < (2e-6 if name == "sphere" else 1e-5)
    assert np.abs(uv[hit, 1 - first] - other).max() < (2e-6 if name == "sphere" else 1e-5)
    if name == "sphere":
        assert ((normal[hit] * (at - mesh.centers[0])).sum(axis=1) > 0.0).all()
    inverted = cast_rays([mesh.turned_inside_out()], origins, directions, device)[3]
    assert np.abs(normal[hit] + inverted[hit]).max() < 1e-6


@wp.kernel(enable_backward=False)
def differentiate_sphere(axes: Frame, radius: float, places: wp.array(dtype=wp.vec3), out: wp.array2d(dtype=wp.vec3)):
    i = wp.tid()
    out[i, 0] = places[i] * radius
    out[i, 1] = along_turn(axes, places[i], radius)
    out[i, 2] = along_meridian(axes, places[i], radius)


@wp.kernel(enable_backward=False)
def differentiate_quadric(quadric: Quadric, places: wp.array(dtype=wp.vec3), out: wp.array2d(dtype=wp.vec3)):
    i = wp.tid()
    out[i, 0] = point_of(quadric, places[i])
    out[i, 1] = by_coordinate(quadric, places[i], 0)
    out[i, 2] = by_coordinate(quadric, places[i], 1)


@pytest.mark.parametrize("name", ["sphere", "disk", "cylinder"])
def test_derivatives_by_texture_coordinates_are_differences_of_points(name: str, device: str) -> None:
    rng = np.random.default_rng(8)
    axes = rng.standard_normal((3, 3)) if name != "sphere" else np.linalg.qr(rng.standard_normal((3, 3)))[0]
    step = 1e-4
    u, v = (rng.random((1000, 2)) * 0.96 + 0.02).T

    def places(u: NDArray, v: NDArray) -> NDArray:
        turn = 2.0 * np.pi * (v if name == "disk" else u)
        r = {"sphere": np.sin(np.pi * v), "disk": u, "cylinder": 1.0}[name]
        z = {"sphere": np.cos(np.pi * v), "disk": 0.0 * u, "cylinder": v - 0.5}[name]
        return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)

    def points(u: NDArray, v: NDArray) -> NDArray:
        return places(u, v) @ axes * (0.7 if name == "sphere" else 1.0)

    found = wp.zeros((1000, 3), dtype=wp.vec3, device=device)
    vectors = (wp.vec3(*axis) for axis in axes)
    if name == "sphere":
        frame = Frame()
        frame.s, frame.t, frame.n = vectors
        given = wp.array(places(u, v) @ axes, dtype=wp.vec3, device=device)
        wp.launch(differentiate_sphere, 1000, [frame, 0.7, given], [found], device=device)
    else:
        quadric = Quadric()
        quadric.kind = int(DISK if name == "disk" else CYLINDER)
        quadric.x, quadric.y, quadric.z = vectors
        given = wp.array(places(u, v), dtype=wp.vec3, device=device)
        wp.launch(differentiate_quadric, 1000, [quadric, given], [found], device=device)
    by_u = (points(u + step, v) - points(u - step, v)) / (2.0 * step)
    by_v = (points(u, v + step) - points(u, v - step)) / (2.0 * step)
    point, found_u, found_v = np.moveaxis(found.numpy(), 1, 0)
    assert np.abs(point - points(u, v)).max() < 1e-5
    assert np.abs(found_u - by_u).max() < 1e-4
    assert np.abs(found_v - by_v).max() < 1e-4


def test_no_triangle_is_taken_for_a_sphere(device: str) -> None:
    """One whose third corner is its first is never hit, beside spheres as without."""
    needle = wrt.Mesh([(-1, -1, 0), (1, 1, 0.5), (-1, -1, 0)], [[0, 1, 2]])
    ball = wrt.sphere((0, 0, -5), 0.1, exact=True)
    origins, down = np.array([(0, 0.1, 3), (0, 0, 3)], np.float32), np.tile(np.float32([0, 0, -1]), (2, 1))
    number = cast_rays([needle, ball], origins, down, device)[0]
    assert number[1] == 1
    assert number[0] != 0
