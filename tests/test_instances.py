"""Meshes that stand in many places answer as the one mesh that they make up, and take memory once."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from conftest import Report
from numpy.typing import NDArray
from support.exact_instances import Placed, explain_instances, own_triangle
from support.exact_rays import EPSILON, Reason
from test_intersection import random_rays

import wrt

Rays = tuple[NDArray[np.float32], NDArray[np.float32]]

MESHES = (wrt.sphere(subdivisions=1), wrt.box(), wrt.sphere(subdivisions=0))


def rotation(rng: np.random.Generator) -> NDArray[np.float64]:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def affine(linear: NDArray, offset: NDArray | tuple[float, ...] = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = linear, offset
    return m


def linear_part(kind: str, rng: np.random.Generator) -> NDArray[np.float64]:
    if kind == "turned":
        return rotation(rng)
    if kind == "mirrored":
        return rotation(rng) @ np.diag([1.0, -1.0, 1.0])
    if kind == "scaled":
        return np.diag(10.0 ** rng.uniform(-1.0, 0.5, 3))
    assert kind == "sheared"
    return rotation(rng) @ (np.eye(3) + np.triu(rng.uniform(-2.0, 2.0, (3, 3)), 1)) @ rotation(rng)


KINDS = ("turned", "mirrored", "scaled", "sheared")


def scene_of(kind: str, count: int, seed: int = 1, spread: float = 2.0) -> Placed:
    """Return instances of a ball, a box and a smaller ball in a cube of half `spread` cube roots of their number."""
    rng = np.random.default_rng(seed)
    side = spread * count ** (1.0 / 3.0)
    transforms = [affine(linear_part(kind, rng), rng.uniform(-side, side, 3)) for _ in range(count)]
    return Placed(MESHES, rng.integers(0, len(MESHES), count), np.stack(transforms))


def tracer_of(scene: Placed, device: str = "cpu", threads: int | None = None) -> wrt.Intersector:
    return wrt.Intersector.of_instances(scene.meshes, scene.numbers, scene.transforms, device=device, threads=threads)


def judge(scene: Placed, rays: Rays, triangle: NDArray, report: Report) -> float:
    """Assert that all answers can be right; return the share of rays that have more than one right answer."""
    found = explain_instances(scene, *rays, triangle)
    report("answers", ", ".join(f"{n} {reason.value}" for reason, n in found.counts().items() if n))
    assert not (found.reason == Reason.NONE).any()
    return float(found.open.mean())


def judge_hits(scene: Placed, rays: Rays, hits: wrt.Hits) -> None:
    """Assert that t, u and v of the triangles that are hit are as near to the exact ones as rounding lets them be."""
    hit = hits.triangle >= 0
    assert np.isinf(hits.t[~hit]).all()
    own = own_triangle(scene, rays[0][hit], rays[1][hit], hits.triangle[hit])
    assert (np.abs(hits.t[hit] - own.t[:, 0]) <= own.t_error[:, 0]).all()
    det, det_error = own.det[:, 0], own.edge_error[:, 0].sum(axis=1)
    # An edge function over their sum, both wrong; then the division, in two steps, and the product.
    clear = det > det_error
    assert clear.mean() > 0.99
    for corner, weight in ((1, hits.u[hit]), (2, hits.v[hit])):
        exact = own.edges[:, 0, corner] / det
        bound = (own.edge_error[:, 0, corner] + np.abs(exact) * det_error) / (det - det_error) + 4.0 * EPSILON
        assert (np.abs(weight - exact) <= bound)[clear].all()


@pytest.mark.parametrize("count", [1, 8, 9])
@pytest.mark.parametrize("kind", KINDS)
def test_every_answer_is_right_within_rounding(kind: str, count: int, device: str, report: Report) -> None:
    """Of float64 arithmetic over all triangles, with the rounding of the ray that is moved to the mesh."""
    scene = scene_of(kind, count)
    rays = random_rays(scene.flattened().bounds, 1000, seed=2)
    tracer = tracer_of(scene, device)
    hits = tracer.closest_hit(*rays)
    assert (hits.triangle >= 0).mean() > 0.1
    # The bounds excuse few rays: they are bounds, not a blank cheque.
    assert judge(scene, rays, hits.triangle, report) < 0.01
    judge_hits(scene, rays, hits)
    np.testing.assert_array_equal(tracer.any_hit(*rays), hits.triangle >= 0)


@pytest.mark.parametrize("distance", [1e2, 1e3])
@pytest.mark.parametrize("kind", KINDS)
def test_from_far_away(kind: str, distance: float, device: str, report: Report) -> None:
    """Where rounding the origin moves a ray by as much as triangles are large, answers are wrong by no more."""
    scene = scene_of(kind, 8)
    _, directions = random_rays(scene.flattened().bounds, 1000, seed=3)
    targets = np.random.default_rng(4).uniform(-3.0, 3.0, directions.shape)
    rays = (targets - distance * directions).astype(np.float32), directions
    tracer = tracer_of(scene, device)
    hits = tracer.closest_hit(*rays)
    assert (hits.triangle >= 0).mean() > 0.1
    report("share with several right answers", judge(scene, rays, hits.triangle, report))
    hit = hits.triangle >= 0
    own = own_triangle(scene, rays[0][hit], rays[1][hit], hits.triangle[hit])
    assert (np.abs(hits.t[hit] - own.t[:, 0]) <= own.t_error[:, 0]).all()
    np.testing.assert_array_equal(tracer.any_hit(*rays), hit)


@pytest.mark.parametrize("kind", KINDS)
def test_thousands_of_instances_answer_as_one_mesh(kind: str, device: str, report: Report) -> None:
    """Where the two differ, both are right within rounding."""
    scene = scene_of(kind, 3000)
    flattened = scene.flattened()
    rays = random_rays(flattened.bounds, 30_000, seed=5)
    tracer = tracer_of(scene, device)
    assert tracer.triangles == len(flattened.faces)
    hits, expected = tracer.closest_hit(*rays), wrt.Intersector(flattened, device=device).closest_hit(*rays)
    np.testing.assert_array_equal(tracer.any_hit(*rays), hits.triangle >= 0)
    judge_hits(scene, rays, hits)
    differ = np.flatnonzero(hits.triangle != expected.triangle)
    report("answers that differ", len(differ), f"of {len(rays[0])}")
    assert len(differ) < 1e-3 * len(rays[0])
    # Each such ray against the instances that it comes near.
    centers, sizes = scene.transforms[:, :3, 3], np.linalg.norm(scene.transforms[:, :3, :3], axis=(1, 2))
    for ray in differ:
        o, d = rays[0][ray].astype(np.float64), rays[1][ray].astype(np.float64)
        near = np.linalg.norm(np.cross(centers - o, d), axis=1) < 1.8 * np.linalg.norm(d) * sizes
        numbers = np.flatnonzero(near)
        part = Placed(scene.meshes, scene.numbers[numbers], scene.transforms[numbers])
        for answer in hits.triangle[ray], expected.triangle[ray]:
            local = -1
            if answer >= 0:
                instance = scene.instance_of(answer)
                assert near[instance]
                place = np.searchsorted(numbers, instance)
                local = part.first_triangles[place] + answer - scene.first_triangles[instance]
            found = explain_instances(part, rays[0][ray : ray + 1], rays[1][ray : ray + 1], [local])
            assert found.reason[0] != Reason.NONE


def test_wrong_answers_are_not_explained(report: Report) -> None:
    """A hit kept silent, one made up, or the same triangle of another instance: the tests above can fail."""
    scene = scene_of("sheared", 8)
    rays = random_rays(scene.flattened().bounds, 600, seed=6)
    right = explain_instances(scene, *rays, np.full(600, -1)).nearest
    hit = right >= 0
    instance = scene.instance_of(right)
    twin = np.array([np.flatnonzero(scene.numbers == n)[-1] for n in scene.numbers])
    first = scene.first_triangles
    wrong = {
        "silent": np.where(hit, -1, right),
        "made up": np.where(hit, right, 0),
        "of another instance": np.where(hit, right - first[instance] + first[twin[instance]], right),
    }
    for name, answers in wrong.items():
        changed = answers != right
        assert changed.sum() > 20
        found = explain_instances(scene, *rays, answers)
        report(f"{name}: not explained", int((found.reason == Reason.NONE).sum()), int(changed.sum()))
        np.testing.assert_array_equal(found.reason, np.where(changed, Reason.NONE, Reason.SAME))


def strewn_copies(copies: int, kind: str, seed: int) -> tuple[Placed, NDArray[np.int64]]:
    """Return instances of which several stand in one place, in any order, and which place each one has."""
    single = scene_of(kind, 40, seed)
    rng = np.random.default_rng(seed)
    which = rng.permutation(np.repeat(np.arange(40), copies))
    return Placed(single.meshes, single.numbers[which], single.transforms[which]), which


@pytest.mark.parametrize("distance", [0.0, 1e2, 1e4])
@pytest.mark.parametrize("kind", KINDS)
def test_of_instances_in_one_place_the_lowest_is_hit(kind: str, distance: float, device: str) -> None:
    """But for a ray in ten thousand at most, of which rounding puts the hit before the box that it is in."""
    for copies in (2, 9):
        scene, which = strewn_copies(copies, kind, seed=7)
        lowest = np.array([np.flatnonzero(which == place)[0] for place in range(40)])
        origins, directions = random_rays(scene.flattened().bounds, 20_000, seed=8)
        origins = (origins - distance * directions).astype(np.float32)
        hits = tracer_of(scene, device).closest_hit(origins, directions)
        instance = scene.instance_of(hits.triangle[hits.triangle >= 0])
        assert len(instance) > 1000
        assert (instance != lowest[which[instance]]).mean() <= 1e-4


@pytest.mark.parametrize("distance", [1.0, 1e2])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_flat_meshes_in_one_place(axis: int, distance: float, device: str) -> None:
    """A box without depth begins where the triangles are: rounding must not hide the lower number behind it."""
    square = wrt.quad((-0.5, -0.5, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    linear = np.roll(np.eye(3), axis, axis=0) @ np.diag([0.31, 2.3, 0.17])
    place = np.tile(affine(linear, (310.1, -200.3, 100.7)), (20, 1, 1))
    tracer = wrt.Intersector.of_instances([square], np.zeros(20, int), place, device=device)
    rng = np.random.default_rng(1)
    targets = rng.uniform(-0.4, 0.4, (20_000, 3)) * np.array([1.0, 1.0, 0.0]) @ linear.T + place[0, :3, 3]
    directions = rng.normal(size=targets.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = tracer.closest_hit(targets - distance * directions, directions)
    assert (hits.triangle >= 0).mean() > 0.99
    # Of twenty squares of two triangles.
    assert (hits.triangle >= 2).mean() <= 1e-4


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_escapes_a_closed_mesh(kind: str, scale: float, device: str, report: Report) -> None:
    """A hundred thousand rays from inside a ball that is turned, flattened and moved, at faces, edges and corners."""
    ball = wrt.sphere(subdivisions=4)
    rng = np.random.default_rng(11)
    linear = scale * linear_part(kind, rng)
    offset = scale * np.array([3.0, -2.0, 5.0])
    # Other instances around it and across it, which rays may meet first.
    transforms = np.stack([affine(linear, offset)] + [affine(linear, k * offset) for k in (0.9, 1.3, 2.0)])
    tracer = wrt.Intersector.of_instances([ball], np.zeros(4, int), transforms, device=device)
    alone = wrt.Intersector.of_instances([ball], [0], transforms[:1], device=device)
    count = 100_000
    weights = rng.random((count, 3))
    along = rng.integers(0, 3, count)
    weights[along == 1, 2] = 0.0
    weights[along == 2, 1:] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    corners = ball.vertices.astype(np.float64)[ball.faces[rng.integers(0, len(ball.faces), count)]]
    targets = np.einsum("ij,ijk->ik", weights, corners) @ linear.T + offset
    inside = rng.normal(size=(count, 3))
    inside *= 0.8 * rng.random((count, 1)) / np.linalg.norm(inside, axis=1, keepdims=True)
    origins = (inside @ linear.T + offset).astype(np.float32)
    directions = (targets - origins).astype(np.float32)
    for tree in (tracer, alone):
        hits = tree.closest_hit(origins, directions)
        report(f"{kind}, scale {scale:g}: rays that escape", int((hits.triangle < 0).sum()), 0)
        assert (hits.triangle >= 0).all()
        assert tree.any_hit(origins, directions).all()


def test_limits(device: str) -> None:
    """t counts in units of the direction in the world, whatever the instance's scale."""
    scene = scene_of("scaled", 9)
    tracer = tracer_of(scene, device)
    origins, directions = random_rays(scene.flattened().bounds, 3000, seed=12)
    near = tracer.closest_hit(origins, directions)
    hit = near.triangle >= 0
    own = np.where(np.arange(len(hit)) % 2 == 0, near.t * 1.0001, near.t * 0.9999).astype(np.float32)
    own[~hit] = 1.0
    even = np.arange(len(hit)) % 2 == 0
    limited = tracer.closest_hit(origins, directions, t_max=own)
    np.testing.assert_array_equal(limited.triangle[hit & even], near.triangle[hit & even])
    assert (limited.triangle[hit & ~even] == -1).all()
    np.testing.assert_array_equal(tracer.any_hit(origins, directions, t_max=own)[hit], even[hit])
    # Through the nearest hit, the next one; limits are part of the range.
    least = float(np.quantile(near.t[hit], 0.5))
    far = tracer.closest_hit(origins, directions, t_min=least)
    assert (far.t >= least).all()
    beyond = hit & (near.t >= least)
    np.testing.assert_array_equal(far.triangle[beyond], near.triangle[beyond])
    assert (far.triangle[hit & ~beyond] >= 0).any()
    exact = tracer.closest_hit(origins, directions, t_max=np.where(hit, near.t, 1.0).astype(np.float32))
    np.testing.assert_array_equal(exact.triangle[hit], near.triangle[hit])
    longer = tracer.closest_hit(origins, 4.0 * directions)
    np.testing.assert_array_equal(longer.triangle, near.triangle)
    np.testing.assert_array_equal(longer.t, near.t / 4.0)


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_sizes_of_instances(scale: float, device: str, report: Report) -> None:
    scene = scene_of("sheared", 9)
    large = Placed(scene.meshes, scene.numbers, scene.transforms * np.array([[scale], [scale], [scale], [1.0]]))
    origins, directions = random_rays(scene.flattened().bounds, 1000, seed=20)
    rays = (scale * origins.astype(np.float64)).astype(np.float32), directions
    hits = tracer_of(large, device).closest_hit(*rays)
    assert (hits.triangle >= 0).mean() > 0.1
    assert judge(large, rays, hits.triangle, report) < 0.01
    judge_hits(large, rays, hits)


def test_warp_arrays(device: str) -> None:
    scene = scene_of("mirrored", 9)
    tracer = tracer_of(scene, device)
    rays = random_rays(scene.flattened().bounds, 3000, seed=13)
    expected = tracer.closest_hit(*rays)
    arrays = [wp.array(a, dtype=wp.vec3, device=device) for a in rays]
    limits = wp.array(np.where(np.isfinite(expected.t), expected.t, 1.0), dtype=float, device=device)
    for hits in (tracer.closest_hit(*arrays), tracer.closest_hit(*arrays, t_max=limits)):
        for got, wanted in zip(hits, expected, strict=True):
            assert isinstance(got, wp.array)
            assert str(got.device) == device
            np.testing.assert_array_equal(got.numpy(), wanted)
    np.testing.assert_array_equal(tracer.any_hit(*arrays).numpy(), expected.triangle >= 0)


def test_a_mesh_takes_memory_once(report: Report) -> None:
    mesh = wrt.sphere(subdivisions=5)
    once = wrt.Intersector(mesh)
    rng = np.random.default_rng(14)
    count = 4000
    transforms = np.stack([affine(rotation(rng), rng.uniform(-50.0, 50.0, 3)) for _ in range(count)])
    many = wrt.Intersector.of_instances([mesh], np.zeros(count, int), transforms)
    assert many.triangles == count * len(mesh.faces)
    alone, together = (t.bytes_per_triangle * t.triangles for t in (once, many))
    each = (together - alone) / count
    report("bytes of one mesh, of each instance", f"{alone:.0f}, {each:.0f}", "< 256")
    # A record of 56 bytes, and its share of nodes of 224 bytes for eight.
    assert 56 <= each < 256
    assert many.bytes_per_triangle < 0.01 * once.bytes_per_triangle


def test_hits_do_not_depend_on_threads() -> None:
    scene = scene_of("sheared", 500)
    rays = random_rays(scene.flattened().bounds, 5000, seed=15)
    first, other = (tracer_of(scene, threads=threads).closest_hit(*rays) for threads in (1, 3))
    for a, b in zip(first, other, strict=True):
        np.testing.assert_array_equal(a, b)


def test_moved_instances_answer_as_if_they_had_always_been_there(device: str) -> None:
    before, after = scene_of("turned", 30, seed=16), scene_of("sheared", 30, seed=17)
    after = Placed(before.meshes, before.numbers, after.transforms)
    rays = random_rays(after.flattened().bounds, 5000, seed=18)
    tracer = tracer_of(before, device)
    old = tracer.closest_hit(*rays)
    expected = tracer_of(after, device).closest_hit(*rays)
    assert not np.array_equal(old.triangle, expected.triangle)
    for transforms, wanted in ((after.transforms, expected), (before.transforms, old), (after.transforms, expected)):
        tracer.move(transforms[:, :3] if wanted is old else transforms)
        for a, b in zip(tracer.closest_hit(*rays), wanted, strict=True):
            np.testing.assert_array_equal(a, b)


EYES = np.stack([np.eye(4)] * 2)


def changed(row: int, column: int, value: float) -> NDArray[np.float64]:
    m = EYES.copy()
    m[1, row, column] = value
    return m


REFUSED = {
    "a flat matrix": (changed(2, 2, 0.0), "the transform of instance 1 is not invertible"),
    "NaN": (changed(0, 0, np.nan), "transforms must be .* finite"),
    "infinite": (changed(0, 3, np.inf), "transforms must be .* finite"),
    "vanishing": (EYES * [[1e-39], [1e-39], [1e-39], [1.0]], "the transform of instance 0 scales by over"),
    "overflowing": (EYES * [[1e39], [1e39], [1e39], [1.0]], "the transform of instance 0 scales by over"),
    "a projection": (changed(3, 2, 1.0), "the transform of instance 1 must be affine: its last row must be 0 0 0 1"),
    "ragged": ([np.eye(4).tolist(), [[1.0]]], "transforms must be an array of numbers with rows of equal length"),
    "words": ("turned", "transforms must be an array of numbers"),
    "too few": (EYES[:1], r"transforms must be \(2, 4, 4\)"),
    "no matrices": (np.eye(3), r"transforms must be \(2, 4, 4\)"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_transforms_that_are_refused(name: str) -> None:
    """By the constructor and by `move`, which then leaves everything where it was."""
    transforms, message = REFUSED[name]
    with pytest.raises(wrt.InputError, match=message) as error:
        wrt.Intersector.of_instances(MESHES, [0, 1], transforms)
    assert "\n" not in str(error.value)
    tracer = wrt.Intersector.of_instances(MESHES, [0, 1], EYES)
    rays = random_rays(np.array([[-1.0] * 3, [1.0] * 3]), 500, seed=19)
    before = tracer.closest_hit(*rays)
    with pytest.raises(wrt.InputError, match=message):
        tracer.move(transforms)
    for a, b in zip(tracer.closest_hit(*rays), before, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([], "at least one"),
        ([[0], [1]], "one an instance"),
        ([0, [1]], "numbers must be an array of numbers with rows of equal length"),
        ([0.0, 1.0], "mesh numbers"),
        ([0, 3], "must be 0 to 2"),
        ([-1, 0], "must be 0 to 2"),
    ],
)
def test_mesh_numbers_that_are_refused(numbers: list, message: str) -> None:
    with pytest.raises(wrt.InputError, match=message) as error:
        wrt.Intersector.of_instances(MESHES, numbers, EYES)
    assert "\n" not in str(error.value)


def test_more_triangles_than_an_int_counts_are_refused() -> None:
    faces = np.tile(np.arange(3), (1 << 20, 1))
    with pytest.raises(wrt.InputError, match="2147483648 triangles in all instances"):
        wrt.Intersector.of_instances(
            [wrt.Mesh(np.eye(3), faces)], np.zeros(2048, int), np.broadcast_to(np.eye(4), (2048, 4, 4))
        )


def test_only_instances_move() -> None:
    with pytest.raises(wrt.InputError, match="only instances can be moved"):
        wrt.Intersector(wrt.box()).move(np.eye(4)[None])
