"""Exact spheres, disks and cylinders: hits, normals, texture coordinates and tangents against closed forms."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.exact_shapes import QUADRICS, cast_rays
from support.ray_trees import unit

import wrt
from wrt.scene.exact.quadrics import Quadrics, quadrics_of
from wrt.scene.exact.spheres import Spheres

EPS = 2.0**-24


class Place(NamedTuple):
    """A sphere, disk or cylinder: its centre, and the images of the unit vectors as rows."""

    kind: str
    center: NDArray
    axes: NDArray

    @staticmethod
    def of(mesh: wrt.Mesh) -> Place:
        if isinstance(mesh, Spheres):
            return Place("sphere", mesh.centers[0], mesh.radii[0] * np.eye(3))
        assert isinstance(mesh, Quadrics)
        return Place("disk" if mesh.are_disks[0] else "cylinder", mesh.centers[0], mesh.axes[0])

    def local(self, v: NDArray) -> NDArray:
        return np.asarray(v.astype(np.float64) @ np.linalg.inv(self.axes))

    @property
    def reach(self) -> float:
        """The length of its longest vector, without the unit normal of a disk."""
        return float(np.linalg.norm(self.axes[: 2 if self.kind == "disk" else 3], axis=1).max())

    def hits(self, origins: NDArray, directions: NDArray) -> NDArray:
        """Return both distances in order, NaN for none."""
        o, d = self.local(origins - self.center), self.local(directions)
        with np.errstate(all="ignore"):
            if self.kind == "disk":
                t = -o[:, 2] / d[:, 2]
                t[(np.hypot(*(o + t[:, None] * d)[:, :2].T) > 1.0) | (t < 0.0)] = np.nan
                return np.stack([t, np.full_like(t, np.nan)], axis=1)
            n = 3 if self.kind == "sphere" else 2
            square = (d[:, :n] ** 2).sum(axis=1)
            middle = -(o[:, :n] * d[:, :n]).sum(axis=1) / square
            inside = 1.0 - ((o[:, :n] + middle[:, None] * d[:, :n]) ** 2).sum(axis=1)
            half = np.sqrt(np.where(inside >= 0.0, inside, np.nan) / square)
            ts = np.stack([middle - half, middle + half], axis=1)
            beyond = n == 2 and np.abs(o[:, 2:] + ts * d[:, 2:]) > 0.5
            ts[beyond | (ts < 0.0)] = np.nan
        return np.sort(ts, axis=1)

    def hits_of_moved(self, origins: NDArray, directions: NDArray, step: float) -> tuple[NDArray, NDArray]:
        """Return by how much distances differ for rays that begin `step` aside, and which rays hit as often there.

        Some rays along a disk, or along the axis of a cylinder, hit though their moved copies miss.
        """
        expected = self.hits(origins, directions)
        steps = step * np.concatenate([np.eye(3), -np.eye(3)])
        moved = np.stack([self.hits(origins.astype(np.float64) + each, directions) for each in steps])
        certain = (np.isfinite(moved) == np.isfinite(expected)).all(axis=(0, 2))
        if self.kind != "sphere":
            cosine = np.abs(directions @ unit(self.axes[2]))
            slant = cosine if self.kind == "disk" else np.sqrt(1.0 - cosine**2)
            certain &= slant > 4.0 * step / np.linalg.norm(self.axes[:2], axis=1).min()
        return np.abs(moved - expected).max(axis=0), certain

    def point(self, turn: NDArray, second: NDArray) -> NDArray:
        """Return the points, from the centre, of texture coordinates, the first in turns."""
        r = {"sphere": np.sin(np.pi * second), "disk": second, "cylinder": np.ones_like(second)}[self.kind]
        z = {"sphere": np.cos(np.pi * second), "disk": np.zeros_like(second), "cylinder": second - 0.5}[self.kind]
        angle = 2.0 * np.pi * turn
        return np.asarray(np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1) @ self.axes)

    def rays(self, n: int, distance: float) -> tuple[NDArray, NDArray]:
        """Return rays from all around to points in and near the shape, half of them near its outline or ends."""
        rng = np.random.default_rng(7)
        out = unit(rng.standard_normal((n, 3)))
        origins = (self.center + distance * self.reach * out).astype(np.float32)
        kind, near = np.arange(n) % 4, 1.0 + 0.02 * rng.standard_normal(n)
        if self.kind == "sphere":
            across = unit(np.cross(out, rng.standard_normal((n, 3))))
            place = across * np.where(kind % 2, np.sqrt(rng.random(n)), near)[:, None]
        else:
            r, turn = np.where(kind % 2, near, 1.1 * np.sqrt(rng.random(n))), rng.uniform(0.0, 2.0 * np.pi, n)
            z = np.where(kind == 3, 0.5 * near * rng.choice([-1.0, 1.0], n), rng.uniform(-0.55, 0.55, n))
            if self.kind == "cylinder":
                o = self.local(origins - self.center)
                turn = np.where(kind == 1, np.arctan2(o[:, 0], -o[:, 1]), turn)
            place = np.stack([r * np.cos(turn), r * np.sin(turn), z * (self.kind == "cylinder")], axis=1)
        return origins, unit(self.center + place @ self.axes - origins).astype(np.float32)


def turned_ball() -> tuple[wrt.Mesh, Place]:
    """Return a turned and mirrored sphere."""
    matrix = np.eye(4)
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]
    turn *= -np.sign(np.linalg.det(turn))
    matrix[:3, :3], matrix[:3, 3] = 0.7 * turn, (0.3, -0.4, 2.0)
    ball = wrt.sphere((0.5, 0.25, 0.0), 0.5, exact=True).transformed(matrix)
    assert isinstance(ball, Spheres)
    return ball, Place("sphere", ball.centers[0], ball.radii[0] * turn.T)


BALLS = {
    f"spheres of radius {radius:g}": wrt.sphere(center, radius, exact=True)
    for center, radius in (((0, 0, 0), 1.0), ((3, -2, 5), 1e-3), ((100, 2e5, -7), 1e6))
}
SHAPES = {name: (mesh, Place.of(mesh)) for name, mesh in BALLS.items()} | {"spheres, turned": turned_ball()}
SHAPES |= {f"quadrics: {name}": (mesh, Place.of(mesh)) for name, mesh in QUADRICS.items()}
FAR = [name for name in SHAPES if name.split()[1] in ("disk", "ellipse", "cylinder", "greatest")]
CASES = [
    *((name, 0.6 if "quadrics" in name else 1e4) for name in SHAPES),
    *((name, 3.0 if "quadrics" in name else 1.5) for name in SHAPES),
    *(pytest.param(name, 1e4, marks=pytest.mark.slow) for name in FAR),
]


@pytest.mark.parametrize(("name", "distance"), CASES)
def test_hits_agree_with_the_closed_form(name: str, distance: float, device: str, report: Report) -> None:
    """The error of a hit is a few roundings of the ray's length and of the coordinates in float32.

    From 0.6 many rays begin inside a cylinder.
    """
    mesh, place = SHAPES[name]
    c, reach, axes = place.center, place.reach, place.axes
    size = np.abs(c).max() + reach
    origins, directions = place.rays(20_000, distance)
    number, ts, position, normal, uv, leaving, edges = cast_rays([mesh], origins, directions, device)
    expected = place.hits(origins, directions)
    aside = 4.0 * EPS * (distance * reach + size)
    error, certain = place.hits_of_moved(origins, directions, aside)
    assert certain.mean() > 0.3
    assert ((number >= 0) == np.isfinite(expected[:, 0]))[certain].all()
    hit, sure_hit = number >= 0, (number >= 0) & certain
    assert sure_hit.sum() > 500
    for k in range(2):
        compared = sure_hit & np.isfinite(expected[:, k])
        off = np.abs(ts[compared, k] - expected[compared, k]) / (error[compared, k] + aside)
        report(f"error of distance {k} in what it may be", float(off.max(initial=0.0)), "< 1")
        assert (off <= 1.0).all()
    # Points lie on the shape, and normals are perpendicular to it.
    out, at = normal[hit].astype(np.float64), place.local(position[hit, 0] - c)
    roundings, along = 8.0 * EPS * size / np.linalg.norm(axes[:2], axis=1).min(), 8.0 * EPS * size
    assert np.abs(np.linalg.norm(out, axis=1) - 1.0).max() < 1e-6
    inverted = cast_rays([mesh.turned_inside_out()], origins, directions, device)[3]
    assert np.abs(normal[hit] + inverted[hit]).max() < 1e-6
    # Texture coordinates are those of Mitsuba, in the shape's own space.
    turn, r, z = np.arctan2(at[:, 1], at[:, 0]) / (2.0 * np.pi) % 1.0, np.hypot(at[:, 0], at[:, 1]), at[:, 2]
    order = [1, 0] if place.kind == "disk" else [0, 1]
    turn_found, second_found = uv[hit][:, order].T
    second = {"sphere": np.arctan2(r, z) / np.pi, "disk": r, "cylinder": z + 0.5}[place.kind]
    tolerance, off = 2e-6 if place.kind == "sphere" else 1e-5, np.abs(turn_found - turn)
    assert (np.minimum(off, 1.0 - off) * r).max() < tolerance + roundings
    in_length = along / np.linalg.norm(axes[2]) if place.kind == "cylinder" else roundings
    assert np.abs(second_found - second).max() < tolerance + in_length
    # Tangents are the derivatives by them.
    clear, step = r > 0.05, 1e-4
    for k, (by_turn, by_second) in zip(order, ((step, 0.0), (0.0, step)), strict=True):
        change = place.point(turn + by_turn, second + by_second) - place.point(turn - by_turn, second - by_second)
        off = np.linalg.norm(edges[hit, k] - change / (2.0 * step), axis=1)[clear]
        assert off.max() < (1e-4 + 20.0 * roundings) * reach
    if place.kind == "disk":
        assert np.abs(at[:, 2]).max() < along
        assert np.abs(out - mesh.fronts[0]).max() < 1e-6
        # What leaves it does not meet it again. (A direction along it is rounded, and may rightly meet it far away.)
        assert (leaving[hit][:, :3] == -1).all()
        return
    n = 3 if place.kind == "sphere" else 2
    assert np.abs(np.linalg.norm(at[:, :n], axis=1) - 1.0).max() < roundings
    assert np.abs(out - unit(at[:, :n] @ axes[:n])).max() < 1e-5 + roundings
    # What leaves it does not meet it again but on its other side; what goes in comes out there, or at an end.
    seen_front = (directions * normal).sum(axis=1) < 0.0
    outside, inside, sure = hit & seen_front, hit & ~seen_front, hit & seen_front & certain
    assert (leaving[outside, 2] == -1).all()
    assert (leaving[outside, 3] == 0).all()
    assert (leaving[inside, :2] == -1).all()
    assert ((leaving[sure, 0] >= 0) == np.isfinite(expected[sure, 1])).all()
    if place.kind == "sphere":
        assert outside[hit].all()
        assert (leaving[outside, :2] == 0).all()
        assert np.abs(position[hit, 0] - (c + reach * out)).max() <= 4.0 * EPS * size
        for k in range(2):
            points = origins[sure_hit] + directions[sure_hit].astype(np.float64) * expected[sure_hit, k : k + 1]
            assert (
                np.linalg.norm(points - position[sure_hit, k], axis=1) <= error[sure_hit, k] + aside + 1e-6 * reach
            ).all()


def test_many_shapes_in_one_tree(device: str, report: Report) -> None:
    """Rays find the nearest and the second nearest of triangles, spheres, disks and cylinders."""
    rng = np.random.default_rng(3)
    n = 300
    places, axes = rng.uniform(-1, 1, (2 * n, 3)), rng.standard_normal((2 * n, 3))
    made = [
        wrt.disk(tuple(a), tuple(b), r) for a, b, r in zip(places[:n], axes, rng.uniform(0.02, 0.2, n), strict=False)
    ]
    ends = zip(places[n:], places[n:] + 0.2 * axes[n:], rng.uniform(0.01, 0.1, n), strict=True)
    made += [wrt.cylinder(tuple(a), tuple(b), r) for a, b, r in ends]
    made = [made[k] for k in rng.permutation(2 * n)]
    quadrics = quadrics_of(
        *(np.concatenate([getattr(m, k) for m in made]) for k in ("are_disks", "centers", "axes")), "many"
    )
    balls = wrt.spheres(rng.uniform(-1.0, 1.0, (n, 3)), rng.uniform(0.01, 0.05, n))
    floor = wrt.quad((-2, -0.5, 2), (4, 0, 0), (0, 0, -4))
    origins = (3.0 * rng.standard_normal((3000, 3))).astype(np.float32)
    directions = unit(rng.uniform(-1.0, 1.0, (3000, 3)) - origins).astype(np.float32)
    t = (-0.5 - origins[:, 1].astype(np.float64)) / directions[:, 1]
    on_floor = (np.abs((origins + directions * t[:, None])[:, [0, 2]]) < 2.0).all(axis=1) & (t > 0.0)
    exact = [Place("sphere", c, r * np.eye(3)) for c, r in zip(balls.centers, balls.radii, strict=True)]
    hits = [place.hits(origins, directions) for place in (*exact, *map(Place.of, made))]
    table = np.concatenate([np.where(on_floor, t, np.nan)[:, None], *hits], axis=1)
    table[~(table > 0.0)] = np.inf
    columns = np.array([0, *np.repeat(np.arange(3 * n), 2) + 2])
    for shapes, used in (([floor, balls, quadrics], len(columns)), ([floor, balls], 1 + 2 * n)):
        some = np.where(np.arange(len(columns)) < used, table, np.inf)
        order = np.argsort(some, axis=1)[:, :2]
        first, second = np.take_along_axis(some, order, axis=1).T
        number, ts, *_ = cast_rays(shapes, origins, directions, device)
        with np.errstate(invalid="ignore"):
            found, following = (np.where(number >= 0, ts[:, k], np.inf) for k in range(2))
            different = ~((np.abs(found - first) < 1e-4) | (found == first))
            different |= np.isfinite(first) & (number > 1) & (number != columns[order[:, 0]])
            same = (np.abs(following - second) < 1e-4) | ~np.isfinite(second)
        report("rays that meet another shape than in float64", int(different.sum()), f"of {len(origins)}")
        assert different.mean() < 0.002
        assert (~same & ~different).mean() < 0.002


def test_no_triangle_is_taken_for_a_sphere(device: str) -> None:
    """A triangle whose third corner is its first is never hit, also beside spheres."""
    needle = wrt.Mesh([(-1, -1, 0), (1, 1, 0.5), (-1, -1, 0)], [[0, 1, 2]])
    ball = wrt.sphere((0, 0, -5), 0.1, exact=True)
    origins, down = np.array([(0, 0.1, 3), (0, 0, 3)], np.float32), np.tile(np.float32([0, 0, -1]), (2, 1))
    number = cast_rays([needle, ball], origins, down, device)[0]
    assert number[1] == 1
    assert number[0] != 0
