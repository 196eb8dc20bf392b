"""Instances answer as the one mesh that they make up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest
from conftest import Report
from numpy.typing import NDArray
from support.ray_trees import affine, assert_same, inner_rays, mesh_of, random_rays, rotation, unit

import wrt


class Placed(NamedTuple):
    """Meshes, which of them each instance is, and its (4, 4) transform to the world."""

    meshes: Sequence[wrt.Mesh]
    numbers: NDArray[np.integer]
    transforms: NDArray[np.float64]

    def flattened(self) -> wrt.Mesh:
        """Return all instances as one mesh in the world, its vertices rounded to float32."""
        placed = zip((self.meshes[number] for number in self.numbers), self.transforms, strict=True)
        corners = [(mesh.vertices.astype(np.float64) @ m[:3, :3].T + m[:3, 3])[mesh.faces] for mesh, m in placed]
        return mesh_of(np.concatenate(corners).astype(np.float32))


MESHES = (wrt.sphere(subdivisions=1), wrt.box(), wrt.sphere(subdivisions=0))
KINDS = ("turned", "mirrored", "scaled", "sheared")


def linear_part(kind: str, rng: np.random.Generator) -> NDArray[np.float64]:
    if kind == "scaled":
        return np.diag(10.0 ** rng.uniform(-1.0, 0.5, 3))
    if kind == "sheared":
        return rotation(rng) @ (np.eye(3) + np.triu(rng.uniform(-2.0, 2.0, (3, 3)), 1)) @ rotation(rng)
    return rotation(rng) @ np.diag([1.0, -1.0 if kind == "mirrored" else 1.0, 1.0])


def scene_of(kind: str, count: int, seed: int = 1) -> Placed:
    """Return instances of a ball, a box and a smaller ball, about one in a unit of volume."""
    rng = np.random.default_rng(seed)
    side = 2.0 * count ** (1.0 / 3.0)
    transforms = [affine(linear_part(kind, rng), rng.uniform(-side, side, 3)) for _ in range(count)]
    return Placed(MESHES, rng.integers(0, len(MESHES), count), np.stack(transforms))


def tracer_of(scene: Placed, device: str = "cpu") -> wrt.Intersector:
    return wrt.Intersector.of_instances(scene.meshes, scene.numbers, scene.transforms, device=device)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("count", "scale", "distance"), [(1, 1.0, 0.0), (9, 1e-12, 0.0), (9, 1e12, 1e2), (3000, 1.0, 0.0)]
)
def test_instances_answer_as_one_mesh(
    count: int, scale: float, distance: float, kind: str, device: str, report: Report
) -> None:
    """Except for a ray in a thousand, which passes an edge, and the rounding of the ray that is moved to the mesh."""
    scene = scene_of(kind, count)
    flattened = scene.flattened()
    origins, directions = random_rays(flattened.bounds, 30_000, seed=5)
    rays = (origins - distance * directions).astype(np.float32), directions
    scene = scene._replace(transforms=scene.transforms * np.array([[scale], [scale], [scale], [1.0]]))
    tracer, far = tracer_of(scene, device), (scale * rays[0].astype(np.float64)).astype(np.float32)
    assert tracer.triangles == len(flattened.faces)
    hits, expected = tracer.closest_hit(far, directions), wrt.Intersector(flattened, device=device).closest_hit(*rays)
    np.testing.assert_array_equal(tracer.any_hit(far, directions), hits.triangle >= 0)
    differ = hits.triangle != expected.triangle
    report("answers that differ", int(differ.sum()), f"of {len(differ)}")
    assert differ.mean() < (1e-3 if distance == 0.0 else 1e-2)
    same = ~differ & (hits.triangle >= 0)
    assert same.mean() > 0.05
    # As near as the ray's place is rounded, on a surface that it may graze.
    t = hits.t[same] / np.float64(scale)
    assert np.quantile(np.abs(t / expected.t[same] - 1.0), 0.99) < 1e-5
    np.testing.assert_allclose(t, expected.t[same], rtol=1e-3)
    for ours, theirs in ((hits.u[same], expected.u[same]), (hits.v[same], expected.v[same])):
        assert np.quantile(np.abs(ours - theirs), 0.99) < (1e-4 if distance == 0.0 else 1e-3)


@pytest.mark.parametrize(("kind", "scale"), [("turned", 1.0), ("mirrored", 1e3), ("scaled", 1e-3), ("sheared", 1.0)])
def test_nothing_escapes_a_closed_mesh(kind: str, scale: float, device: str) -> None:
    """A hundred thousand rays from inside a transformed ball, at faces, edges and corners."""
    ball = wrt.sphere(subdivisions=4)
    rng = np.random.default_rng(11)
    linear, offset = scale * linear_part(kind, rng), scale * np.array([3.0, -2.0, 5.0])
    # Other instances around it and across it, which rays may meet first.
    transforms = np.stack([affine(linear, k * offset) for k in (1.0, 0.9, 1.3, 2.0)])
    inside = 0.8 * rng.random((100_000, 1)) * unit(rng.normal(size=(100_000, 3)))
    world = wrt.Mesh(ball.vertices.astype(np.float64) @ linear.T + offset, ball.faces)
    rays = inner_rays(world, inside @ linear.T + offset, seed=12)
    for count in (4, 1):
        tracer = wrt.Intersector.of_instances([ball], np.zeros(count, int), transforms[:count], device=device)
        hits = tracer.closest_hit(*rays)
        assert (hits.triangle >= 0).all()
        assert tracer.any_hit(*rays).all()


def test_moved_instances_answer_as_if_they_had_always_been_there(device: str) -> None:
    start = scene_of("turned", 30, seed=16)
    end = start._replace(transforms=scene_of("sheared", 30, seed=17).transforms)
    rays = random_rays(end.flattened().bounds, 5000, seed=18)
    tracer = tracer_of(start, device)
    old, expected = tracer.closest_hit(*rays), tracer_of(end, device).closest_hit(*rays)
    assert not np.array_equal(old.triangle, expected.triangle)
    for transforms, hits in ((end.transforms, expected), (start.transforms[:, :3], old)):
        tracer.move(transforms)
        assert_same(tracer.closest_hit(*rays), hits)
    with pytest.raises(wrt.InputError, match="only instances can be moved"):
        wrt.Intersector(wrt.box()).move(np.eye(4)[None])


EYES = np.stack([np.eye(4)] * 2)


def changed(row: int, column: int, value: float) -> NDArray[np.float64]:
    m = EYES.copy()
    m[1, row, column] = value
    return m


@pytest.mark.parametrize(
    ("transforms", "message"),
    [
        (changed(2, 2, 0.0), "the transform of instance 1 is not invertible"),
        (changed(0, 0, np.nan), "transforms must be .* finite"),
        (changed(3, 2, 1.0), "the transform of instance 1 must be affine: its last row must be 0 0 0 1"),
        ([np.eye(4).tolist(), [[1.0]]], "transforms must be an array of numbers with rows of equal length"),
        (EYES[:1], r"transforms must be \(2, 4, 4\)"),
    ],
)
def test_transforms_that_are_refused(transforms: object, message: str) -> None:
    """By the constructor and by `move`, which then changes nothing."""
    tracer, rays = wrt.Intersector.of_instances(MESHES, [0, 1], EYES), random_rays(2.0 * MESHES[0].bounds, 500, seed=19)
    before = tracer.closest_hit(*rays)
    for refuse in (tracer.move, lambda places: wrt.Intersector.of_instances(MESHES, [0, 1], places)):
        with pytest.raises(wrt.InputError, match=rf"^[^\n]*{message}[^\n]*$"):
            refuse(transforms)
    assert_same(tracer.closest_hit(*rays), before)


@pytest.mark.parametrize(
    ("numbers", "message"), [([], "at least one"), ([0.0, 1.0], "mesh numbers"), ([0, 3], "must be 0 to 2")]
)
def test_mesh_numbers_that_are_refused(numbers: list[float], message: str) -> None:
    with pytest.raises(wrt.InputError, match=message):
        wrt.Intersector.of_instances(MESHES, numbers, EYES)


def test_more_triangles_than_have_numbers_are_refused() -> None:
    mesh, places = wrt.Mesh(np.eye(3), np.tile(np.arange(3), (1 << 20, 1))), np.broadcast_to(np.eye(4), (2048, 4, 4))
    with pytest.raises(wrt.InputError, match="2147483648 triangles in all instances"):
        wrt.Intersector.of_instances([mesh], np.zeros(2048, int), places)
