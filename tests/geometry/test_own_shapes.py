"""Shapes by distance functions: hits against closed forms, pictures against exact shapes and triangles, and files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import warp as wp
from benchmarks.own import OwnBall, ball
from conftest import Report
from numpy.typing import NDArray
from support.exact_shapes import cast_rays
from support.pages import definitions, program_of
from support.ray_trees import unit
from support.small_scenes import rendered
from support.statistics import image_z_test, t_test_mean
from support.wide_scenes import differences, needs_lanes

import wrt
from wrt.kernels.geometry.distances import DISTANCES
from wrt.scene.exact.distances import SHAPES


@wp.func
def odd(point: wp.vec3, kind: float) -> float:
    """A ball by thrice its distance, and functions that are no distances: NaN, 0, infinite, and with 10^6 signs.

    The last kind is thrice the distance to a small ball before a thin plate.
    """
    value = 3.0 * (wp.length(point) - 1.0)
    if kind == 1.0:
        value = 0.0 / (kind - 1.0)
    elif kind == 2.0:
        value = 0.0
    elif kind == 3.0:
        value = 1.0 / (kind - 3.0)
    elif kind == 4.0:
        value = 1.0e-9 * wp.sin(1.0e6 * point[0])
    elif kind == 5.0:
        value = 3.0 * wp.min(wp.length(point) - 0.2, wp.abs(point[0] - 0.7) - 0.001)
    return value


@dataclass(frozen=True)
class Odd(wrt.DistanceShape):
    kind: float = 0.0

    type_name: ClassVar[str] = "odd"
    lipschitz: ClassVar[float] = 3.0

    def bounds(self) -> tuple[Any, Any]:
        return (-1.0,) * 3, (1.0,) * 3


SHAPES_OF_TESTS = ((OwnBall, ball), (Odd, odd))


@pytest.fixture(scope="module", autouse=True)
def pebble(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Register the shapes, return the documentation's rounded box, and leave the register as it was."""
    code = program_of("own", "pebble.py")
    made = definitions(code, tmp_path_factory.mktemp("own") / "pebble.py")["Pebble"]
    for cls, function in SHAPES_OF_TESTS:
        wrt.register_shape(cls, function)
    yield made
    for cls in (made, *(cls for cls, _ in SHAPES_OF_TESTS)):
        del SHAPES[cls.type_name]
        DISTANCES.forget(cls.type_name.replace("-", "_"))


def placed(*rows: Any, at: Any = (0.0, 0.0, 0.0)) -> NDArray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.array(rows or np.eye(3)), at
    return matrix


TURNED = placed((0.8, 0.1, 0.3), (-0.2, 1.1, 0.4), (0.1, -0.5, 0.7), at=(0.3, -0.4, 0.2))
MIRRORED = placed((-0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.5), at=(40.0, -30.0, 20.0))


# --- Hits --------------------------------------------------------------------------------------------


def rays(matrix: NDArray, count: int, distance: float, seed: int = 7) -> tuple[NDArray, NDArray]:
    """Return rays that begin on an ellipsoid around a place, and lead to points within it."""
    rng = np.random.default_rng(seed)
    origins = (distance * unit(rng.standard_normal((count, 3)))) @ matrix[:3, :3].T + matrix[:3, 3]
    targets = rng.uniform(-1.0, 1.0, (count, 3)) @ matrix[:3, :3].T + matrix[:3, 3]
    return origins.astype(np.float32), unit(targets - origins).astype(np.float32)


def local(matrix: NDArray, origins: NDArray, directions: NDArray) -> tuple[NDArray, NDArray]:
    back = np.linalg.inv(matrix)
    return origins @ back[:3, :3].T + back[:3, 3], directions.astype(np.float64) @ back[:3, :3].T


def of_ball(o: NDArray, d: NDArray, radius: float) -> NDArray:
    """Return both distances to a sphere around the origin, infinite for none."""
    a, b = (d * d).sum(axis=-1), (o * d).sum(axis=-1)
    c = (o * o).sum(axis=-1) - radius**2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    ts = np.where((b * b > a * c)[..., None], np.stack([-b - root, -b + root], axis=-1) / a[..., None], np.inf)
    return np.sort(np.where(ts > 0.0, ts, np.inf), axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("distance", [0.5, 3.0, 1000.0])
@pytest.mark.parametrize("matrix", [np.eye(4), TURNED, MIRRORED], ids=["plain", "turned", "mirrored"])
def test_hits_of_a_ball(matrix: NDArray, distance: float, device: str, report: Report) -> None:
    """From within, from near and from afar; what leaves it does not meet it again, what enters finds the far wall."""
    shape = OwnBall(1.0).mesh.transformed(matrix)
    origins, directions = rays(matrix, 20_000, distance)
    number, ts, position, normal, _, leaving, _ = cast_rays([shape], origins, directions, device)
    o, d = local(matrix, origins, directions)
    expected = of_ball(o, d, 1.0)
    # A miss is no difference where a ray hardly touches the ball, or the rounding of a far origin decides.
    middle = o - d * ((o * d).sum(axis=1) / (d * d).sum(axis=1))[:, None]
    certain = np.abs(np.linalg.norm(middle, axis=1) - 1.0) > 1e-3
    hit = number >= 0
    assert (hit == np.isfinite(expected[:, 0]))[certain].all()
    sure = hit & certain
    # Eight roundings of the origin shift the line, which moves the hits of rays that graze the ball most.
    aside = 8.0 * 2.0**-24 * np.abs(origins).max()
    steps = aside * np.concatenate([np.eye(3), -np.eye(3)])
    shifted = [of_ball(*local(matrix, origins + step, directions), 1.0) for step in steps]
    for k in range(2):
        there = sure & np.isfinite(expected[:, k])
        bound = 1e-4 + aside + np.max([np.abs(each[there, k] - expected[there, k]) for each in shifted], axis=0)
        off = np.abs(ts[there, k] - expected[there, k]) / bound
        report(f"error of distance {k} in what it may be", float(off.max(initial=0.0)), "< 1")
        assert off.max(initial=0.0) < 1.0
    at, out = local(matrix, position[hit, 0], normal[hit])[0], normal[hit] @ matrix[:3, :3]
    assert np.abs(np.linalg.norm(at, axis=1) - 1.0).max() < 1e-5
    assert np.abs(unit(out) - at).max() < 5e-4
    from_outside = hit & ((directions * normal).sum(axis=1) < 0.0)
    assert (from_outside == (hit & (np.linalg.norm(o, axis=1) > 1.0)))[sure].all()
    assert (leaving[from_outside, 2] == -1).all()
    assert (leaving[from_outside, 3] == 0).all()
    assert (leaving[from_outside, 0] == 0)[certain[from_outside]].all()
    assert (leaving[hit & ~from_outside][:, :2] == -1).all()


def of_rounded_box(o: NDArray, d: NDArray, half: NDArray, radius: float) -> NDArray:
    """Return the first distance from outside: to the nearest of the three boxes, twelve cylinders and eight balls."""
    inner, first = half - radius, []
    with np.errstate(all="ignore"):
        for axis in range(3):
            size = inner + radius * (np.arange(3) == axis)
            ts = np.stack([(-size - o) / d, (size - o) / d])
            begin, end = ts.min(axis=0).max(axis=1), ts.max(axis=0).min(axis=1)
            first.append(np.where((begin <= end) & (begin > 0.0), begin, np.inf))
        for signs in np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T:
            first.append(of_ball(o - signs * inner, d, radius)[:, 0])
            for axis in range(3):
                across = [k for k in range(3) if k != axis]
                t = of_ball(o[:, across] - (signs * inner)[across], d[:, across], radius)[:, 0]
                first.append(np.where(np.abs(o[:, axis] + t * d[:, axis]) <= inner[axis], t, np.inf))
    return np.min(first, axis=0)


@pytest.mark.slow
def test_hits_of_a_rounded_box(pebble: Any, device: str, report: Report) -> None:
    shape = pebble((0.8, 0.5, 0.6), 0.15)
    origins, directions = rays(TURNED, 20_000, 3.0)
    number, ts, *_ = cast_rays([shape.mesh.transformed(TURNED)], origins, directions, device)
    o, d = local(TURNED, origins, directions)
    expected = of_rounded_box(o, d, np.array(shape.half), shape.radius)
    wider, narrower = (of_rounded_box(o, d, np.array(shape.half) + s, shape.radius + s) for s in (1e-3, -1e-3))
    certain = np.isfinite(wider) == np.isfinite(narrower)
    assert ((number >= 0) == np.isfinite(expected))[certain].all()
    sure = certain & np.isfinite(expected)
    assert 0.3 < sure.mean() < 0.9
    off = np.abs(ts[sure, 0] - expected[sure])
    report("distance is off by at most, metres", float(off.max()), "< 1e-4")
    assert off.max() < 1e-4


@pytest.mark.slow
def test_functions_that_are_no_distances(device: str) -> None:
    """The Lipschitz constant divides the steps; every ray ends, and what is nowhere positive or NaN is not met."""
    origins, directions = rays(np.eye(4), 2000, 3.0)
    number, ts, *_ = cast_rays([Odd(0.0).mesh], origins, directions, device)
    expected = of_ball(origins.astype(np.float64), directions.astype(np.float64), 1.0)[:, 0]
    both = (number >= 0) & np.isfinite(expected)
    assert ((number >= 0) != np.isfinite(expected)).mean() < 2e-3
    assert np.abs(ts[both, 0] - expected[both]).max() < 1e-4
    for kind in (1.0, 2.0, 3.0):
        assert (cast_rays([Odd(kind).mesh], origins, directions, device)[0] == -1).all(), kind
    assert (cast_rays([Odd(4.0).mesh], origins, directions, device)[0] >= 0).any()


def test_long_steps_skip_nothing(device: str, report: Report) -> None:
    """Beside a ball steps are longer than the distance to it, and would lead beyond a plate behind it."""
    beside = np.stack(np.meshgrid(np.linspace(-0.8, 0.8, 60), np.linspace(-0.8, 0.8, 60)), axis=-1).reshape(-1, 2)
    beside = beside[np.linalg.norm(beside, axis=1) > 0.21]
    origins = np.insert(beside, 0, -0.9, axis=1).astype(np.float32)
    directions = np.tile(np.float32([1.0, 0.0, 0.0]), (len(origins), 1))
    number, ts, *_ = cast_rays([Odd(5.0).mesh], origins, directions, device)
    report("rays that miss the plate", int((number < 0).sum()), 0)
    assert (number >= 0).all()
    assert np.abs(ts[:, 0] - 1.599).max() < 1e-4


@pytest.mark.slow
def test_many_shapes_whose_boxes_overlap(device: str, report: Report) -> None:
    """Rays find the nearest and the second nearest surface, among exact spheres and a floor, too."""
    rng = np.random.default_rng(3)
    centers, radii = rng.uniform(-1.0, 1.0, (60, 3)), rng.uniform(0.05, 0.3, 60)
    shapes: list[wrt.Mesh] = [wrt.quad((-2, -0.5, 2), (4, 0, 0), (0, 0, -4))]
    shapes += [OwnBall(r).mesh.transformed(placed(at=c)) for c, r in zip(centers[:40], radii, strict=False)]
    shapes.append(wrt.spheres(centers[40:], radii[40:]))
    origins = (3.0 * rng.standard_normal((4000, 3))).astype(np.float32)
    directions = unit(rng.uniform(-1.0, 1.0, (4000, 3)) - origins).astype(np.float32)
    number, ts, *_ = cast_rays(shapes, origins, directions, device)
    t = (-0.5 - origins[:, 1].astype(np.float64)) / directions[:, 1]
    on_floor = (np.abs((origins + directions * t[:, None])[:, [0, 2]]) < 2.0).all(axis=1) & (t > 0.0)
    all_hits = [np.where(on_floor, t, np.inf)[:, None]]
    all_hits += [of_ball(origins - c, directions.astype(np.float64), r) for c, r in zip(centers, radii, strict=True)]
    table = np.concatenate(all_hits, axis=1)
    order = np.sort(table, axis=1)[:, :2]
    found = np.where((number >= 0)[:, None], ts, np.inf)
    with np.errstate(invalid="ignore"):
        same = (np.abs(found - order) < 1e-4) | ~np.isfinite(order) & ~(found < 1e29)
    report("rays that meet another surface than in float64", int((~same.all(axis=1)).sum()), f"of {len(origins)}")
    assert np.isfinite(order).all(axis=1).mean() > 0.3
    assert (~same[:, 0]).mean() < 0.002
    assert (~same.all(axis=1)).mean() < 0.004


# --- Pictures ----------------------------------------------------------------------------------------


def room(*shapes: tuple[Any, dict[str, Any]]) -> wrt.Scene:
    camera = wrt.PerspectiveCamera((0.0, 1.0, 4.5), (0.0, 0.2, 0.0), shutter_open=0.0, shutter_close=1.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.3))
    scene.add(wrt.quad((-4, -1, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse((0.6, 0.4, 0.2)))
    scene.add_light(wrt.SphereLight((1.0, 3.0, 2.0), 0.5, radiance=9.0))
    for shape, how in shapes:
        scene.add(shape, **how)
    return scene


def rounded_box_of_triangles(shape: Any) -> wrt.Mesh:
    """Return the points at the radius around the inner box: a ball whose eight parts are moved apart."""
    made = wrt.sphere(subdivisions=6)
    out = made.vertices.astype(np.float64)
    inner = np.array(shape.half) - shape.radius
    # Vertices between two parts belong to the middle of a side, which is flat.
    return wrt.Mesh(np.sign(np.round(out, 6)) * inner + shape.radius * out, made.faces, normals=made.vertices)


LOOKS: dict[str, Callable[[wrt.Mesh, wrt.Mesh], list[tuple[Any, dict[str, Any]]]]] = {
    "matt, glass and metal": lambda one, other: [
        (one, {"material": wrt.Diffuse(0.7), "transform": placed(at=(-1.3, -0.4, 0.0))}),
        (one, {"material": wrt.Dielectric(), "transform": placed(at=(0.0, -0.3, 0.6))}),
        (other, {"material": wrt.RoughConductor(0.2), "transform": placed(at=(1.3, -0.4, 0.0))}),
    ],
    "lamps, with motion": lambda one, other: [
        (one, {"emission": 3.0, "transform": wrt.Motion.translation((0.6, 0.3, 0.0))}),
        (other, {"emission": (1.0, 2.0, 4.0), "transform": placed(at=(1.3, 0.4, 0.0))}),
    ],
    "wine": lambda one, other: [
        (one, {"material": wrt.Dielectric(interior=wrt.Medium(absorption=(0.5, 2.0, 3.0)))}),
        (other, {"material": wrt.Diffuse(0.5, opacity=0.5), "transform": placed(at=(1.2, 0.3, 0.4))}),
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("looks", LOOKS)
def test_balls_look_as_exact_spheres_do(looks: str, device: str, report: Report) -> None:
    exact, small = wrt.sphere((0, 0, 0), 0.6, exact=True), wrt.sphere((0, 0, 0), 0.3, exact=True)
    scenes = room(*LOOKS[looks](OwnBall(0.6).mesh, OwnBall(0.3).mesh)), room(*LOOKS[looks](exact, small))
    a, b = (rendered(scene, 512, seed=k, max_depth=12, device=device) for k, scene in enumerate(scenes))
    result = image_z_test(a.image(), a.variance(), b.image(), b.variance(), n_a=512, n_b=512)
    report(f"{looks}: against exact spheres, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0)
    assert result.agrees(), result.message


@pytest.mark.slow
def test_a_rounded_box_looks_as_fine_triangles_do(pebble: Any, device: str, report: Report) -> None:
    shape = pebble((0.9, 0.6, 0.7), 0.25)
    looks = {"material": wrt.Diffuse((0.2, 0.5, 0.7)), "transform": TURNED}
    scenes = room((shape, looks)), room((rounded_box_of_triangles(shape), looks))
    a, b = (rendered(scene, 512, seed=k, device=device) for k, scene in enumerate(scenes))
    result = image_z_test(a.image(), a.variance(), b.image(), b.variance(), n_a=512, n_b=512)
    report("against triangles, per cent", f"{100.0 * result.relative_difference[1]:+.3f}", 0)
    assert result.agrees(), result.message


@pytest.mark.slow
def test_no_light_leaks_out_of_a_closed_shape(device: str, report: Report) -> None:
    """Within a ball of albedo 0.8 that emits 1 the radiance is 5; the camera is in its box."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.3, -0.2, 0.5), (-0.4, 0.3, -1.0), fov_degrees=90))
    scene.add(OwnBall(1.0).mesh.turned_inside_out(), material=wrt.Diffuse(0.8), emission=1.0)
    renderer = rendered(scene, 256, width=32, height=32, seed=1, max_depth=1000, device=device)
    mean = float(renderer.image().astype(np.float64).mean())
    error = float(np.sqrt(renderer.variance()[..., 0].sum())) / (32 * 32)
    report("radiance within", mean, 5.0, p=t_test_mean(mean, error**2, 32 * 32 * 256, 5.0))
    assert abs(mean - 5.0) < 3.0 * error


@needs_lanes
@pytest.mark.slow
@pytest.mark.parametrize("lanes", [8, 16])
def test_both_kernels_have_the_same_bits(pebble: Any, lanes: int) -> None:
    balls = [part for looks in LOOKS.values() for part in looks(OwnBall(0.5).mesh, pebble((0.3, 0.4, 0.2), 0.1).mesh)]
    layers = ("normal", "depth", "motion")
    assert differences(room(*balls), lanes=lanes, layers=layers) == []


@needs_lanes
@pytest.mark.slow
def test_both_kernels_have_the_same_bits_among_instances() -> None:
    """Groups of rays go through the boxes and through instances that do not move; lone rays do, too."""
    triangles = wrt.sphere((0, 0, 0), 0.4, subdivisions=4)
    parts: list[tuple[Any, dict[str, Any]]] = []
    for k in range(6):
        at = np.array((0.9 * (k % 3) - 1.0, 0.7 * (k // 3), 0.3 * (k % 2)))
        parts.append((OwnBall(0.5), {"material": wrt.Dielectric(), "transform": placed(at=at)}))
        parts.append((triangles, {"material": wrt.Diffuse(0.7), "transform": placed(at=at + (0.2, 0.4, 0.3))}))
    scene = room(*parts)
    assert rendered(scene, 1, width=4, height=4)._kernel.features.instances == "still"
    assert differences(scene) == []


# --- Scenes and files --------------------------------------------------------------------------------


def test_scene_files(pebble: Any, tmp_path: Path) -> None:
    shape = 'type = "pebble"\nhalf = [0.5, 0.25, 1.0]\nname = "chest"\ntranslate = [1.0, 2.0, 3.0]\n'
    (tmp_path / "scene.toml").write_text(f"[[shapes]]\n{shape}")
    scene = wrt.load(tmp_path / "scene.toml")
    (chest,) = scene.shapes
    assert chest.mesh.description == pebble((0.5, 0.25, 1.0))
    assert np.allclose(scene.bounds, [[0.5, 1.75, 2.0], [1.5, 2.25, 4.0]], atol=3e-3)
    wrt.save_scene(tmp_path / "again.toml", scene)
    (again,) = wrt.load(tmp_path / "again.toml").shapes
    assert (again.mesh.description, again.name) == (chest.mesh.description, "chest")
    assert np.allclose(again.bounds, chest.bounds)
    (tmp_path / "scene.toml").write_text('[[shapes]]\ntype = "pebble"\nhalf = [1, 2]\n')
    with pytest.raises(wrt.InputError, match=r"scene\.toml: shapes\[0\].*half"):
        wrt.load(tmp_path / "scene.toml")


@wp.func
def of_two(point: wp.vec3, number: int) -> float:
    return point[0]


@wp.func
def of_no_point(number: float) -> float:
    return number


@wp.func
def of_vectors(point: wp.vec3) -> wp.vec3:
    return point


def test_what_cannot_be_registered_is_refused() -> None:
    before = dict(SHAPES)
    for name, function, message in (
        ("sphere", ball, "type_name 'sphere' is empty or taken"),
        ("mine", of_two, r".*; number is not a float"),
        ("mine", of_no_point, r".*; its first argument is not a wp.vec3"),
        ("mine", of_vectors, r".*; it returns something else"),
        ("mine", len, r".*, not builtin_function_or_method"),
    ):
        cls = dataclass(frozen=True)(type("Mine", (wrt.DistanceShape,), {"type_name": name}))
        with pytest.raises(wrt.InputError, match=f"Mine: {message}"):
            wrt.register_shape(cls, function)
    assert before == SHAPES


@dataclass(frozen=True)
class Wrong(OwnBall):
    """A ball with any box."""

    low: Any = (-1.0, -1.0, -1.0)

    type_name: ClassVar[str] = "own-ball"

    def bounds(self) -> Any:
        return self.low, (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("low", "message"),
    [
        ((-1.0, 2.0, -1.0), r"Wrong: bounds \[-1\.0, 2\.0, -1\.0\] must be below"),
        ((float("-inf"), 0.0, 0.0), "Wrong: a corner of bounds"),
        ((-1e30, 0.0, 0.0), "Wrong: bounds reach farther than"),
        (None, "Wrong: a corner of bounds"),
    ],
)
def test_boxes_are_checked(low: Any, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.Scene().add(Wrong(low=low))


def test_numbers_are_counted() -> None:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.add(Wrong())
    with pytest.raises(wrt.InputError, match="its distance function takes 1 numbers, but the shape has 4"):
        wrt.Renderer(scene)


def test_what_needs_triangles_is_refused(tmp_path: Path) -> None:
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.add(OwnBall(), material=wrt.Dielectric(), name="drop")
    scene.add_light(wrt.SphereLight((0.0, 3.0, 0.0), 0.1, radiance=1.0))
    with pytest.raises(wrt.InputError, match="has no triangles"):
        wrt.save_scene(tmp_path / "scene.glb", scene)
    with pytest.raises(wrt.InputError, match="an intersector has triangles only"):
        wrt.Intersector(scene)
    with pytest.raises(wrt.InputError, match="drop: photons cannot be aimed at shapes by distance functions"):
        wrt.Renderer(scene, width=8, height=8, caustics=True).render(spp=1)
