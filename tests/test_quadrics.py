"""Exact disks and cylinders: hits, normals and texture coordinates against closed forms in float64."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.exact_shapes import cast_rays

import wrt
from wrt.backend.device import Device
from wrt.io.arrays import arrays_of_exact
from wrt.kernels.geometry.quadrics import CYLINDER, DISK, Quadric, by_coordinate, point_of
from wrt.scene.exact.quadrics import Quadrics, quadrics_of
from wrt.upload.scene_data import build_scene

EPS = 2.0**-24


def local(mesh: Quadrics, v: NDArray) -> NDArray:
    """Return vectors, as the shape's own vectors map to them, in float64."""
    return v.astype(np.float64) @ np.linalg.inv(mesh.axes[0])


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


def rays_to(mesh: Quadrics, n: int, distance: float, seed: int = 7) -> tuple[NDArray, NDArray]:
    """Return rays from all around to places in and near a shape, half of them to its outline or its ends."""
    rng = np.random.default_rng(seed)
    reach = reach_of(mesh)
    out = rng.standard_normal((n, 3))
    origins = mesh.centers[0] + distance * reach * out / np.linalg.norm(out, axis=1, keepdims=True)
    origins = origins.astype(np.float32)
    place = rng.uniform(-1.1, 1.1, (n, 3))
    o = local(mesh, origins - mesh.centers[0])
    near = 1.0 + 0.02 * rng.standard_normal(n)
    turn = rng.uniform(0.0, 2.0 * np.pi, n)
    some = np.arange(n) % 4 == 1
    if mesh.are_disks[0]:
        place[:, 2] = 0.0
    else:
        place[:, 2] *= 0.5
        turn[some] = np.arctan2(o[:, 0], -o[:, 1])[some]
    rim = np.stack([near * np.cos(turn), near * np.sin(turn), place[:, 2]], axis=1)
    odd = np.arange(n) % 2 == 1
    place[odd] = rim[odd]
    if not mesh.are_disks[0]:
        ends = np.arange(n) % 4 == 3
        place[ends, 2] = (0.5 * near * rng.choice([-1.0, 1.0], n))[ends]
    directions = mesh.centers[0] + place @ mesh.axes[0] - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return origins, directions.astype(np.float32)


def ellipse() -> Quadrics:
    made = wrt.disk((0.4, 0.1, -0.2), (1, 2, 3), 0.7).transformed(
        [[1.5, 0.3, 0, 1], [-0.2, 0.4, 0.5, 2], [0.1, 0.6, -0.9, -1], [0, 0, 0, 1]]
    )
    assert isinstance(made, Quadrics)
    return made


SHAPES: dict[str, Quadrics] = {
    "disk": wrt.disk((0, 0, 0), (0, 1, 0), 1.0),
    "tilted disk": wrt.disk((3, -2, 5), (1, -2, 0.5), 0.3),
    "ellipse": ellipse(),
    "small disk far away": wrt.disk((40, 30, -20), (0.3, 1, 0.2), 0.02),
    "large disk": wrt.disk((10, 20, -7), (0.1, 3, 0.2), 1e5),
    "cylinder": wrt.cylinder((0, 0, 0), (0, 1, 0), 1.0),
    "tilted cylinder": wrt.cylinder((3, -2, 5), (4, -1.5, 7), 0.4),
    "thin cylinder": wrt.cylinder((1, 2, 3), (2, 5, -1), 0.01),
    "flat cylinder": wrt.cylinder((1, 2, 3), (1.01, 2.02, 3.02), 2.0),
    "large cylinder": wrt.cylinder((-5e4, 3e4, 1e4), (5e4, -2e4, 1e4), 2e4),
    "least disk": wrt.disk((0, 0, 0), (1, -2, 0.5), 5e-12),
    "greatest disk": wrt.disk((1e11, 0, 0), (1, -2, 0.5), 8e11),
    "least cylinder": wrt.cylinder((0, 0, 0), (2e-12, 1e-12, 8e-12), 4e-12),
    "greatest cylinder": wrt.cylinder((0, 0, 0), (3e11, 1e11, 5e11), 3e11),
}
"""The last four as small and as large as scenes may be, in metres."""


@pytest.mark.parametrize(
    ("name", "distance"),
    [
        *((name, distance) for distance in (0.6, 3.0, 100.0) for name in SHAPES),
        *((name, 1e4) for name in ("disk", "tilted disk", "ellipse", "cylinder", "tilted cylinder")),
    ],
)
def test_hits_agree_with_the_closed_form(name: str, distance: float, device: str, report: Report) -> None:
    """The error of a hit is that of a ray in float32: a few roundings of its length and of the coordinates.

    From 0.6 many rays begin inside a cylinder.
    """
    mesh = SHAPES[name]
    x, y, z = mesh.axes[0]
    c, radius = mesh.centers[0], min(np.linalg.norm(x), np.linalg.norm(y))
    reach = reach_of(mesh)
    size = np.abs(c).max() + reach
    origins, directions = rays_to(mesh, 20_000, distance)
    number, ts, position, normal, _, left = cast_rays([mesh], origins, directions, device)
    expected, margin = exact_hits(mesh, origins, directions)
    error = 16.0 * EPS * (distance * reach + size)  # of the line, across
    o, d = local(mesh, origins - c), local(mesh, directions)
    unit = normal.astype(np.float64)
    disk = bool(mesh.are_disks[0])
    if disk:
        cosine = np.abs(directions @ np.cross(x, y)) / np.linalg.norm(np.cross(x, y))
        across = error / np.maximum(cosine, 1e-9)
        sideways = np.abs(margin) * radius
        certain = (sideways > across) & (cosine > 1e-6)
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
    place = local(mesh, position[:, 0] - c)
    hit = number >= 0
    tolerance = 8.0 * EPS * size / radius
    if disk:
        assert np.abs((position[hit, 0] - c) @ np.cross(x, y) / np.linalg.norm(np.cross(x, y))).max() < 8.0 * EPS * size
        assert np.abs(unit[hit] - mesh.fronts[0]).max() < 1e-6
    else:
        assert np.abs(np.hypot(place[hit, 0], place[hit, 1]) - 1.0).max() < tolerance
        out = place[hit, :2] @ mesh.axes[0, :2]
        assert np.abs(unit[hit] - out / np.linalg.norm(out, axis=1, keepdims=True)).max() < 1e-5 + tolerance
    assert np.abs(np.linalg.norm(unit[hit], axis=1) - 1.0).max() < 1e-6
    # What leaves a shape does not meet it again, but for the other side of a cylinder.
    seen_front = (directions * unit).sum(axis=1) < 0.0
    if disk:
        # (A direction along a disk is rounded, and rightly meets it far away if that tilts it to the disk.)
        assert (left[hit][:, :3] == -1).all()
    else:
        outside, inside = hit & seen_front, hit & ~seen_front
        assert (left[outside, 2] == -1).all()
        assert (left[outside, 3] == 0).all()
        assert (left[inside, 0] == -1).all()
        assert (left[inside, 1] == -1).all()
        # What goes in through the side comes out there, or at an end.
        sure = outside & certain
        assert ((left[sure, 0] >= 0) == np.isfinite(expected[sure, 1])).all()


def test_many_shapes_in_one_tree(device: str, report: Report) -> None:
    """Among triangles and spheres, of all that a ray meets the nearest is found, and the next after it."""
    rng = np.random.default_rng(3)
    n = 300
    disks = [
        wrt.disk(tuple(c), tuple(m), r)
        for c, m, r in zip(
            rng.uniform(-1, 1, (n, 3)), rng.standard_normal((n, 3)), rng.uniform(0.02, 0.2, n), strict=True
        )
    ]
    ends = rng.uniform(-1, 1, (n, 3))
    tubes = [
        wrt.cylinder(tuple(a), tuple(a + b), r)
        for a, b, r in zip(ends, 0.2 * rng.standard_normal((n, 3)), rng.uniform(0.01, 0.1, n), strict=True)
    ]
    made = [*disks, *tubes]
    flags = np.array([True] * n + [False] * n)
    order = rng.permutation(2 * n)
    all_axes = np.concatenate([mesh.axes for mesh in made])[order]
    centers = np.concatenate([mesh.centers for mesh in made])[order]
    many = quadrics_of(flags[order], centers, all_axes, "many")
    balls = wrt.spheres(rng.uniform(-1.0, 1.0, (n, 3)), rng.uniform(0.01, 0.05, n))
    floor = wrt.quad((-2, -0.5, 2), (4, 0, 0), (0, 0, -4))
    origins = (3.0 * rng.standard_normal((3000, 3))).astype(np.float32)
    directions = rng.uniform(-1.0, 1.0, (3000, 3)) - origins
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    number, ts, *_ = cast_rays([floor, balls, many], origins, directions, device)
    hits = []
    t = (-0.5 - origins[:, 1].astype(np.float64)) / directions[:, 1]
    on_floor = (np.abs((origins + directions * t[:, None])[:, [0, 2]]) < 2.0).all(axis=1) & (t > 0.0)
    hits.append(np.where(on_floor, t, np.nan))
    for c, r in zip(balls.centers, balls.radii, strict=True):
        o = origins - c
        middle = -(o * directions).sum(axis=1)
        half2 = r**2 - ((o + middle[:, None] * directions) ** 2).sum(axis=1)
        half = np.sqrt(np.where(half2 > 0.0, half2, np.nan))
        hits += [middle - half, middle + half]
    for k in range(2 * n):
        one = quadrics_of(many.are_disks[k : k + 1], many.centers[k : k + 1], many.axes[k : k + 1], "one")
        both, _ = exact_hits(one, origins, directions)
        hits += [both[:, 0], both[:, 1]]
    table = np.stack(hits, axis=1)
    table[~(table > 0.0)] = np.inf
    ordered = np.sort(table, axis=1)
    found = np.where(number >= 0, ts[:, 0], np.inf)
    with np.errstate(invalid="ignore"):
        different = ~((np.abs(found - ordered[:, 0]) < 1e-4) | (found == ordered[:, 0]))
    report("rays that meet another shape than in float64", int(different.sum()), f"of {len(origins)}")
    assert different.mean() < 0.002
    with np.errstate(invalid="ignore"):
        after = np.where(number >= 0, ts[:, 1], np.inf)
        same = (np.abs(after - ordered[:, 1]) < 1e-4) | ~np.isfinite(ordered[:, 1])
    assert (~same & ~different).mean() < 0.002


@pytest.mark.parametrize("name", ["ellipse", "tilted cylinder"])
def test_texture_coordinates_and_front(name: str, device: str) -> None:
    """Those of Mitsuba, in the shape's own space; the front of the turned shape is the other side."""
    mesh = SHAPES[name]
    origins, directions = rays_to(mesh, 5000, 4.0)
    number, _, position, normal, uv, _ = cast_rays([mesh], origins, directions, device)
    hit = number == 0
    x, y, z = local(mesh, position[hit, 0] - mesh.centers[0]).T
    turn, r = np.arctan2(y, x) / (2.0 * np.pi) % 1.0, np.hypot(x, y)
    first, second = (r, turn) if mesh.are_disks[0] else (turn, z + 0.5)
    for ours, own, scale in ((first, uv[hit, 0], 1.0), (second, uv[hit, 1], 1.0)):
        off = np.abs(own - ours)
        of_turn = ours is turn
        off = np.minimum(off, 1.0 - off) * r if of_turn else off
        assert (off * scale).max() < 1e-5
    turned = mesh.turned_inside_out()
    other = cast_rays([turned], origins, directions, device)[3]
    assert np.abs(normal[hit] + other[hit]).max() < 1e-6


@wp.kernel(enable_backward=False)
def differentiate(
    quadric: Quadric, places: wp.array(dtype=wp.vec3), points: wp.array(dtype=wp.vec3), out: wp.array2d(dtype=wp.vec3)
):
    i = wp.tid()
    points[i] = point_of(quadric, places[i])
    out[i, 0] = by_coordinate(quadric, places[i], 0)
    out[i, 1] = by_coordinate(quadric, places[i], 1)


@pytest.mark.parametrize("kind", [DISK, CYLINDER])
def test_derivatives_by_texture_coordinates_are_differences_of_points(kind: int, device: str) -> None:
    rng = np.random.default_rng(8)
    quadric = Quadric()
    quadric.kind = int(kind)
    axes = rng.standard_normal((3, 3))
    quadric.x, quadric.y, quadric.z = (wp.vec3(*axis) for axis in axes)
    quadric.center = wp.vec3(0.1, 0.2, 0.3)
    uv, step = rng.random((1000, 2)) * 0.96 + 0.02, 1e-4

    def places(u: NDArray, v: NDArray) -> NDArray:
        if kind == DISK:
            return np.stack([u * np.cos(2 * np.pi * v), u * np.sin(2 * np.pi * v), 0.0 * u], axis=1)
        return np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), v - 0.5], axis=1)

    u, v = uv.T
    given = wp.array(places(u, v), dtype=wp.vec3, device=device)
    points = wp.zeros(len(uv), dtype=wp.vec3, device=device)
    found = wp.zeros((len(uv), 2), dtype=wp.vec3, device=device)
    wp.launch(differentiate, len(uv), [quadric, given], [points, found], device=device)
    by_u = (places(u + step, v) - places(u - step, v)) @ axes / (2.0 * step)
    by_v = (places(u, v + step) - places(u, v - step)) @ axes / (2.0 * step)
    assert np.abs(points.numpy() - (places(u, v) @ axes + (0.1, 0.2, 0.3))).max() < 1e-5
    assert np.abs(found.numpy() - np.stack([by_u, by_v], axis=1)).max() < 1e-4


# --- As meshes ---------------------------------------------------------------------------------------


def test_scene_files_keep_them(tmp_path: Path) -> None:
    """To the bit, turned and inverted ones too; and their own types of shape make them."""
    scene = wrt.Scene()
    tube = wrt.cylinder((1, 2, 3), (2, 2, 5), 0.5)
    for mesh in (ellipse(), tube, tube.turned_inside_out(), ellipse().turned_inside_out()):
        scene.add(mesh)
    wrt.save_scene(tmp_path / "scene.toml", scene)
    for shape, read in zip(scene.shapes, wrt.load(tmp_path / "scene.toml").shapes, strict=True):
        assert isinstance(read.mesh, Quadrics)
        for name in ("vertices", "normals", "uvs"):
            assert getattr(shape.mesh, name).tobytes() == getattr(read.mesh, name).tobytes()
    (tmp_path / "own.toml").write_text(
        '[[shapes]]\ntype = "disk"\ncenter = [1, 2, 3]\nnormal = [0, 0, 2]\nradius = 0.5\n\n'
        '[[shapes]]\ntype = "cylinder"\nstart = [0, 0, 0]\nend = [0, 2, 0]\nradius = 0.5\nscale = [2, 1, 2]\n'
        '[[shapes]]\ntype = "cylinder"\nscale = [1, 2, 3]\n'
    )
    first, second, third = (shape.mesh for shape in wrt.load(tmp_path / "own.toml").shapes)
    assert isinstance(first, Quadrics)
    assert first.areas == pytest.approx(np.pi * 0.25)
    assert first.fronts[0] == pytest.approx((0, 0, 1))
    assert isinstance(second, Quadrics)
    assert second.areas == pytest.approx(2 * np.pi * 1.0 * 2.0)
    assert not isinstance(third, Quadrics)
    assert np.allclose(third.bounds, [[-1, 0, -3], [1, 2, 3]], atol=2e-3)


def with_normal(normal: Any) -> dict[str, Any]:
    """Return the arrays of two disks, the second of which has another normal."""
    arrays = [arrays_of_exact(mesh) for mesh in (wrt.disk((1, 2, 3), (1, 2, 2), 0.5), wrt.disk((0, 0, 1), (0, 0, 1)))]
    joined = {key: np.concatenate([each[key] for each in arrays]) for key in ("boxes", "axes")}
    joined["axes"][1, 2] = normal
    return joined


TUBE = arrays_of_exact(wrt.cylinder((1, 2, 3), (2, 2, 5), 0.5))


@pytest.mark.parametrize(
    ("arrays", "cause"),
    [
        (with_normal((0, 0, 0)), r"axes\[1\]: a disk's normal, its third row, must have length 1, not"),
        (with_normal((0, 0, np.nan)), r"axes\[1\]: must be finite, not"),
        (with_normal((0, 0, 2)), r"axes\[1\]: a disk's normal, its third row, must have length 1, not"),
        (with_normal((0, 0.6, 0.8)), r"axes\[1\]: a disk's normal, its third row, must be perpendicular"),
        ({**TUBE, "axes": np.ones((1, 3, 3))}, r"axes\[0\]: a cylinder's rows must be perpendicular"),
        ({**TUBE, "axes": 2.0 * TUBE["axes"]}, r"boxes\[0\]: must be opposite corners of the box around the shape"),
        ({**TUBE, "boxes": np.sort(TUBE["boxes"], axis=1)}, r"boxes\[0\]: corners must be in the order"),
    ],
)
def test_wrong_arrays_are_refused(arrays: dict[str, Any], cause: str, tmp_path: Path) -> None:
    """By their file, the key in the scene, the array and what is wrong with it."""
    np.savez(tmp_path / "bad.npz", **arrays)
    (tmp_path / "bad.toml").write_text('[[shapes]]\ntype = "quadrics"\nfile = "bad.npz"\n')
    with pytest.raises(wrt.InputError, match=rf"bad\.toml: shapes\[0\]\.file: .*bad\.npz: {cause}"):
        wrt.load(tmp_path / "bad.toml")


def test_features_name_what_rays_meet() -> None:
    for mesh, exact in ((wrt.disk(), "quadrics"), (wrt.sphere(exact=True), "spheres"), (wrt.box(), "none")):
        scene = wrt.Scene()
        scene.add(mesh)
        assert build_scene(scene, Device("cpu")).features.exact == exact


def test_triangles_in_their_place_face_alike() -> None:
    """Corners lie on the shapes, and faces and normals turn to the front, also of mirrored and inverted ones."""
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    for whole in (SHAPES["tilted disk"], ellipse(), SHAPES["tilted cylinder"]):
        for one in (whole, whole.transformed(mirror)):
            assert isinstance(one, Quadrics)
            for mesh in (one, one.turned_inside_out()):
                cut = mesh.tessellated(256)
                place = local(mesh, cut.vertices - mesh.centers[0])
                a, b, c = (cut.vertices[cut.faces[:, k]].astype(np.float64) for k in range(3))
                normal = np.cross(b - a, c - a)
                assert 0.5 * np.linalg.norm(normal, axis=1).sum() == pytest.approx(mesh.areas[0], rel=2e-4)
                assert cut.normals is not None
                assert (np.einsum("ij,ij->i", cut.normals[cut.faces[:, 0]], normal) > 0.0).all()
                if mesh.are_disks[0]:
                    assert np.abs(place[:, 2]).max() < 1e-5
                    assert (normal @ mesh.fronts[0] > 0.0).all()
                else:
                    assert np.abs(np.hypot(place[:, 0], place[:, 1]) - 1.0).max() < 1e-5
                    side = -1.0 if mesh.inside_out[0] else 1.0
                    out = a - mesh.centers[0] - np.outer((a - mesh.centers[0]) @ mesh.fronts[0], mesh.fronts[0])
                    assert (np.einsum("ij,ij->i", normal, out) * side > 0.0).all()


def test_the_front_of_a_mapped_disk_is_that_of_its_triangles() -> None:
    """Under any map, mirrored ones too."""
    rng = np.random.default_rng(11)
    whole = wrt.disk((0.1, 0.2, 0.3), (1, 2, -1), 0.8)
    for _ in range(20):
        matrix = np.eye(4)
        matrix[:3] = rng.standard_normal((3, 4))
        mapped = whole.transformed(matrix)
        assert isinstance(mapped, Quadrics)
        cut = whole.tessellated(64).transformed(matrix)
        a, b, c = (cut.vertices[cut.faces[:, k]].astype(np.float64) for k in range(3))
        normal = np.cross(b - a, c - a)
        assert (normal @ mapped.fronts[0] > (1.0 - 1e-4) * np.linalg.norm(normal, axis=1)).all()
        low, high = mapped.bounds
        assert (cut.vertices >= low).all()
        assert (cut.vertices <= high).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: wrt.disk(radius=0.0), "radius"),
        (lambda: wrt.disk(normal=(0, 0, 0)), "normal must have a length"),
        (lambda: wrt.disk((1e6, 0, 0), radius=1e-3), "float32 does not resolve"),
        (lambda: wrt.cylinder((1, 1, 1), (1, 1, 1)), "start and end must differ"),
        (lambda: wrt.cylinder((1e6, 0, 0), (1e6, 5, 0), radius=1e-3), "float32 does not resolve"),
        (lambda: wrt.cylinder((0, -500, 0), (0, 500, 0), 1e-4), "float32 does not resolve"),
        (lambda: wrt.cylinder(radius=np.nan), "radius"),
    ],
)
def test_mistakes(make: Any, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        make()


@pytest.mark.parametrize("make", [wrt.disk, wrt.cylinder])
def test_what_float32_does_not_resolve_where_it_is_moved_is_triangles(make: Any) -> None:
    """In meshes and in scenes; one that emits has a light for each triangle."""
    far = np.eye(4)
    far[0, 3] = 3e5
    mesh = make(radius=0.1)
    assert isinstance(mesh.transformed(np.eye(4)), Quadrics)
    assert not isinstance(mesh.transformed(far), Quadrics)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((3e5, 0.5, 3), target=(3e5, 0.5, 0)))
    scene.shapes += [wrt.Shape(mesh, emission=2.0, two_sided_emission=True, transform=far)]
    built = build_scene(scene, Device("cpu"))
    assert built.features.exact == "none"
    assert len(built.data.lights) == len(mesh.tessellated().faces)


def test_a_motion_keeps_all_that_its_keys_keep() -> None:
    """A shear that one key bears and a motion does not would make lights of other shapes' triangles."""
    sheared = np.eye(4)
    sheared[0, 1] = 0.8e-5
    mesh = wrt.cylinder(radius=0.5)
    assert mesh.keeps(sheared[None])
    assert not mesh.keeps(np.stack([np.eye(4), sheared]))
    for matrix in (np.eye(4), sheared):
        assert isinstance(mesh.transformed(matrix), Quadrics)


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_what_takes_triangles_only_says_so() -> None:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    shape = scene.add(wrt.disk())
    with pytest.raises(wrt.InputError, match="tessellated"):
        wrt.Intersector(scene)
    renderer = wrt.Renderer(scene, width=8, height=8)
    with pytest.raises(wrt.InputError, match="make a new Renderer"):
        renderer.update_vertices(shape, shape.mesh.vertices)
    with pytest.raises(wrt.InputError, match="cannot be deformed"):
        wrt.Shape(shape.mesh, deformation=wrt.Deformation([0.0], shape.mesh.vertices[None]))
