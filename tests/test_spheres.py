"""Exact spheres: hits, normals and texture coordinates against closed forms in float64."""

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
from wrt.io.arrays import arrays_of_exact, read_spheres
from wrt.kernels.geometry.rays import Frame
from wrt.kernels.geometry.spheres import along_meridian, along_turn
from wrt.scene.exact.spheres import Spheres


def roots(center: NDArray, radius: NDArray, origins: NDArray, directions: NDArray) -> tuple[NDArray, NDArray]:
    """Return the distances to both intersections in float64, NaN for rays that miss, and the squared half chord."""
    o, d = origins.astype(np.float64) - center, directions.astype(np.float64)
    length = np.linalg.norm(d, axis=1)
    d = d / length[:, None]
    middle = -(o * d).sum(axis=1)
    half2 = radius**2 - np.linalg.norm(o + d * middle[:, None], axis=1) ** 2
    half = np.sqrt(np.where(half2 >= 0.0, half2, np.nan))
    return np.stack([middle - half, middle + half], axis=1) / length[:, None], half2


def rays_to(rng: np.random.Generator, center: NDArray, radius: float, n: int, distance: float) -> tuple:
    """Return rays from all around to points of a sphere's disk, as many near its limb as elsewhere."""
    out = rng.standard_normal((n, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    origins = (center + out * distance * radius).astype(np.float32)
    across = rng.standard_normal((n, 3))
    across -= out * (across * out).sum(axis=1, keepdims=True)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    share = np.where(np.arange(n) % 2, np.sqrt(rng.random(n)), 1.0 + 0.02 * rng.standard_normal(n))
    directions = center + across * (radius * share)[:, None] - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return origins, directions.astype(np.float32)


@pytest.mark.parametrize("distance", [1.5, 40.0, 1e4])
@pytest.mark.parametrize(("center", "radius"), [((0, 0, 0), 1.0), ((3, -2, 5), 1e-3), ((100, 2e5, -7), 1e6)])
def test_hits_agree_with_the_closed_form(center: tuple, radius: float, distance: float, device: str) -> None:
    """The error of a hit is that of a ray in float32: a few roundings of its length and of the coordinates."""
    rng = np.random.default_rng(7)
    ball = wrt.sphere(center, radius, exact=True)
    c, r = ball.centers[0], ball.radii[0]
    assert r == pytest.approx(radius, rel=3e-4)
    origins, directions = rays_to(rng, c, r, 20_000, distance)
    number, ts, position, normal, _, left = cast_rays([ball], origins, directions, device)
    expected, half2 = roots(c, r, origins, directions)
    eps = 2.0**-24
    error = 8.0 * eps * (distance * r + np.abs(c).max())  # of the line, across
    certain = np.abs(half2) > 2.0 * error * r
    assert ((number >= 0) == (half2 > 0.0))[certain].all()
    hit = (number >= 0) & certain
    assert hit.sum() > 5_000
    along = error * (1.0 + r / np.sqrt(half2[hit]))
    assert (np.abs(ts[hit] - expected[hit]) <= along[:, None]).all()
    out = normal[hit].astype(np.float64)
    assert np.abs(np.linalg.norm(out, axis=1) - 1.0).max() < 1e-6
    assert np.abs(position[hit, 0] - (c + r * out)).max() <= 4.0 * eps * (np.abs(c).max() + r)
    points = origins[hit] + directions[hit].astype(np.float64) * expected[hit, :1]
    assert (np.linalg.norm(points - (c + r * out), axis=1) <= along + 1e-6 * r).all()
    points = origins[hit] + directions[hit].astype(np.float64) * expected[hit, 1:]
    assert (np.linalg.norm(points - position[hit, 1], axis=1) <= along + 1e-6 * r).all()
    # What leaves a sphere does not meet it again, and what enters it does.
    hit = number >= 0
    assert (left[hit, 0] == 0).all()
    assert (left[hit, 1] == 0).all()
    assert (left[hit, 2] == -1).all()
    assert (left[hit, 3] == 0).all()


def test_many_spheres_and_triangles_in_one_tree(device: str, report: Report) -> None:
    """Of all that a ray meets the nearest is found, at its lowest number if there are several."""
    rng = np.random.default_rng(3)
    n = 3000
    centers, radii = rng.uniform(-1.0, 1.0, (n, 3)), rng.uniform(0.005, 0.08, n)
    balls = wrt.spheres(centers, radii)
    floor = wrt.quad((-2, -0.5, 2), (4, 0, 0), (0, 0, -4))
    origins = (3.0 * rng.standard_normal((4000, 3))).astype(np.float32)
    directions = rng.uniform(-1.0, 1.0, (4000, 3)) - origins
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    number, ts, *_ = cast_rays([floor, balls], origins, directions, device)
    best, which = np.full(len(origins), np.inf), np.full(len(origins), -1)
    t = (-0.5 - origins[:, 1].astype(np.float64)) / directions[:, 1]
    at = origins + directions * t[:, None]
    on_floor = (t > 0.0) & (np.abs(at[:, [0, 2]]) < 2.0).all(axis=1)
    best[on_floor] = t[on_floor]
    for i, (c, r) in enumerate(zip(balls.centers, balls.radii, strict=True)):
        both, _ = roots(c, r, origins, directions)
        first = np.where(both[:, 0] > 0.0, both[:, 0], both[:, 1])
        nearer = (first > 0.0) & (first < best)
        best[nearer], which[nearer] = first[nearer], 2 + i
    different = number != which
    different &= ~((number >= 0) & (number < 2) & on_floor & (best == t))
    report("rays that meet another sphere than in float64", int(different.sum()), f"of {len(origins)}")
    assert different.mean() < 0.002
    same = ~different & np.isfinite(best)
    assert np.abs(ts[same, 0] - best[same]).max() < 1e-4


def test_texture_coordinates_and_axes(device: str) -> None:
    """A turned and mirrored sphere keeps its coordinates: u about its third axis, v from it."""
    rng = np.random.default_rng(5)
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(rng.standard_normal((3, 3)))[0] * 0.7
    matrix[:3, :3] *= -np.sign(np.linalg.det(matrix[:3, :3]))
    matrix[:3, 3] = 0.3, -0.4, 2.0
    ball = wrt.sphere((0.5, 0.25, 0.0), 0.5, exact=True).transformed(matrix)
    assert isinstance(ball, Spheres)
    origins, directions = rays_to(rng, ball.centers[0], ball.radii[0], 5000, 4.0)
    number, _, position, normal, uv, _ = cast_rays([ball], origins, directions, device)
    hit = number == 0
    own = np.concatenate([position[hit, 0], np.ones((hit.sum(), 1))], axis=1) @ np.linalg.inv(matrix).T
    x, y, z = ((own[:, :3] - (0.5, 0.25, 0.0)) / 0.5).T
    turn = np.arctan2(y, x) / (2.0 * np.pi) % 1.0
    off = np.abs(uv[hit, 0] - turn)
    sine = np.hypot(x, y)
    assert (np.minimum(off, 1.0 - off) * sine).max() < 2e-6
    assert np.abs(uv[hit, 1] - np.arctan2(sine, z) / np.pi).max() < 2e-6
    assert ((normal[hit] * (position[hit, 0] - ball.centers[0])).sum(axis=1) > 0.0).all()
    turned = ball.turned_inside_out()
    normal = cast_rays([turned], origins, directions, device)[3]
    assert ((normal[hit] * (position[hit, 0] - ball.centers[0])).sum(axis=1) < 0.0).all()


@wp.kernel(enable_backward=False)
def differentiate(axes: Frame, radius: float, out: wp.array(dtype=wp.vec3), derivatives: wp.array2d(dtype=wp.vec3)):
    i = wp.tid()
    derivatives[i, 0] = along_turn(axes, out[i], radius)
    derivatives[i, 1] = along_meridian(axes, out[i], radius)


def test_derivatives_by_texture_coordinates_are_differences_of_points(device: str) -> None:
    rng = np.random.default_rng(8)
    own, radius, step = np.linalg.qr(rng.standard_normal((3, 3)))[0], 0.7, 1e-4
    axes = Frame()
    axes.s, axes.t, axes.n = (wp.vec3(*axis) for axis in own)
    uv = rng.random((1000, 2)) * (1.0, 0.96) + (0.0, 0.02)

    def points(u: NDArray, v: NDArray) -> NDArray:
        turn, sine = 2.0 * np.pi * u, np.sin(np.pi * v)
        return np.stack([sine * np.cos(turn), sine * np.sin(turn), np.cos(np.pi * v)], axis=1) @ own

    u, v = uv.T
    found = wp.zeros((len(uv), 2), dtype=wp.vec3, device=device)
    out = wp.array(points(u, v), dtype=wp.vec3, device=device)
    wp.launch(differentiate, len(uv), [axes, radius, out], [found], device=device)
    by_u = (points(u + step, v) - points(u - step, v)) * radius / (2.0 * step)
    by_v = (points(u, v + step) - points(u, v - step)) * radius / (2.0 * step)
    assert np.abs(found.numpy() - np.stack([by_u, by_v], axis=1)).max() < 1e-5


# --- As meshes ---------------------------------------------------------------------------------------


def test_scene_files_keep_spheres(tmp_path: Path) -> None:
    """To the bit: those of arrays, a turned one, and one whose front is inside."""
    rng = np.random.default_rng(2)
    scene = wrt.Scene()
    grains = wrt.spheres(rng.random((5, 3)), rng.uniform(0.1, 0.2, 5), colors=rng.random((5, 4)))
    one = wrt.sphere((1, 2, 3), 0.5, exact=True).rotated((1, 2, 3), 40.0)
    assert isinstance(one, Spheres)
    for mesh in (grains, one, one.turned_inside_out()):
        scene.add(mesh)
    wrt.save_scene(tmp_path / "scene.toml", scene)
    for shape, read in zip(scene.shapes, wrt.load(tmp_path / "scene.toml").shapes, strict=True):
        assert isinstance(read.mesh, Spheres)
        for name in ("vertices", "normals", "uvs", "colors"):
            ours, theirs = getattr(shape.mesh, name), getattr(read.mesh, name)
            assert (ours is None) == (theirs is None)
            assert ours is None or ours.tobytes() == theirs.tobytes()
    np.savez(tmp_path / "grains.npz", centers=rng.random((4, 3)), radii=[0.1, 0.2, 0.1, 0.3])
    (tmp_path / "own.toml").write_text(
        '[[shapes]]\ntype = "spheres"\nfile = "grains.npz"\nscale = 2\n\n[[shapes]]\ntype = "sphere"\nexact = true\n'
        '[[shapes]]\ntype = "sphere"\nexact = true\nscale = [1, 2, 1]\n'
    )
    first, second, third = (shape.mesh for shape in wrt.load(tmp_path / "own.toml").shapes)
    assert isinstance(first, Spheres)
    assert np.allclose(first.radii, [0.2, 0.4, 0.2, 0.6])
    assert isinstance(second, Spheres)
    assert not isinstance(third, Spheres)
    assert np.allclose(third.bounds, [[-1, -2, -1], [1, 2, 1]])


def test_triangles_in_place_of_spheres_face_alike() -> None:
    """Corners lie on the spheres, and faces turn to the front, also of mirrored and inverted ones."""
    balls = wrt.spheres([(0, 0, 0), (5, 0, 0)], [1.0, 2.0]).transformed(np.diag([-1.0, 1.0, 1.0, 1.0]))
    assert isinstance(balls, Spheres)
    for mesh, side in ((balls, 1.0), (balls.turned_inside_out(), -1.0)):
        cut = mesh.tessellated(32)
        half = len(cut.vertices) // 2
        for k, vertices in enumerate((cut.vertices[:half], cut.vertices[half:])):
            out = vertices - mesh.centers[k]
            assert np.allclose(np.linalg.norm(out, axis=1), mesh.radii[k], rtol=1e-6)
        a, b, c = (cut.vertices[cut.faces[:, k]].astype(np.float64) for k in range(3))
        normal = np.cross(b - a, c - a)
        center = np.where((cut.faces[:, :1] < half), mesh.centers[0], mesh.centers[1])
        assert (np.einsum("ij,ij->i", normal, a - center) * side > 0.0).all()
        assert cut.normals is not None
        assert (np.einsum("ij,ij->i", cut.normals[cut.faces[:, 0]], normal) > 0.0).all()


@pytest.mark.parametrize(
    ("centers", "radii", "colors", "message"),
    [
        ([(0, 0)], 1.0, None, "centers must be"),
        (np.zeros((0, 3)), 1.0, None, "spheres: there are no centers"),
        ([(0, 0, 0)], [1.0, 2.0], None, "radii must be one number or 1"),
        ([(0, 0, 0), (1, 0, np.nan)], 1.0, None, "sphere 1 is at"),
        ([(0, 0, 0), (1, 0, 0)], [1.0, 0.0], None, "sphere 1 is at .* radius 0"),
        ([(0, 0, 0)], 1.0, [(1, 1)], "colors must be"),
        ([(0, 0, 0)], 1.0, [(1, np.nan, 1)], r"colors must be finite; number 0 is \[1.0, nan, 1.0\]"),
        ([(0, 0, 0)], 1.0, np.uint8([(255, 0, 0)]), "spheres: colors must be linear numbers, not codes up to 255"),
        ([(1e6, 0, 0)], 1e-3, None, "less than float32 resolves"),
        ([(1e38, 0, 0)], 3e38, None, "finite"),
    ],
)
def test_mistakes(centers: Any, radii: Any, colors: Any, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.spheres(centers, radii, colors=colors)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"axes": 2.0 * np.eye(3)[None]}, r"axes\[0\]: rows must be perpendicular and of length 1"),
        ({"axes": np.full((1, 3, 3), np.nan)}, r"axes\[0\]: must be finite"),
        ({"boxes": [[(0, 0, 0), (1, 1, 2)]]}, r"boxes\[0\]: must be the lowest and the highest corner of a cube"),
        ({"boxes": [[(0, 0, 1), (1, 1, 0)]]}, r"boxes\[0\]: must be the lowest and the highest corner of a cube"),
        ({"boxes": [[(0, 0, 0), (0, 0, 0)]]}, r"boxes\[0\]: must have a size"),
    ],
)
def test_wrong_arrays_are_refused(change: dict[str, Any], cause: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "bad.npz", **{**arrays_of_exact(wrt.sphere(exact=True)), **change})  # type: ignore[arg-type]
    with pytest.raises(wrt.InputError, match=rf"bad\.npz: {cause}"):
        read_spheres(tmp_path / "bad.npz")


@pytest.mark.usefixtures("render_kernels_when_launched")
def test_what_takes_triangles_only_says_so() -> None:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    shape = scene.add(wrt.sphere(exact=True))
    with pytest.raises(wrt.InputError, match="tessellated"):
        wrt.Intersector(scene)
    with pytest.raises(wrt.InputError, match="tessellated"):
        wrt.Intersector.of_instances([shape.mesh], [0], np.eye(4)[None])
    renderer = wrt.Renderer(scene, width=8, height=8)
    with pytest.raises(wrt.InputError, match="make a new Renderer"):
        renderer.update_vertices(shape, shape.mesh.vertices)
    with pytest.raises(wrt.InputError, match="cannot be deformed"):
        wrt.Shape(shape.mesh, deformation=wrt.Deformation([0.0], shape.mesh.vertices[None]))


def test_no_triangle_is_taken_for_a_sphere(device: str) -> None:
    """One whose third corner is its first is never hit, beside spheres as without."""
    needle = wrt.Mesh([(-1, -1, 0), (1, 1, 0.5), (-1, -1, 0)], [[0, 1, 2]])
    ball = wrt.sphere((0, 0, -5), 0.1, exact=True)
    origins = np.array([(0, 0.1, 3), (0, 0, 3)], np.float32)
    directions = np.array([(0, 0, -1), (0, 0, -1)], np.float32)
    number = cast_rays([needle, ball], origins, directions, device)[0]
    assert number[1] == 1
    assert number[0] != 0
