"""Traversal: one answer among equal ones, children in any order, the stack, and sides of boxes."""

from __future__ import annotations

import functools
import re

import numpy as np
import pytest
import warp as wp
from support.kernels import upload
from support.ray_trees import HARD, OCTANTS, affine, mesh_of, random_rays, unit

import wrt
from wrt.backend.device import Device
from wrt.kernels.accel.ray_batch import RayBatch, trace_interleaved, trace_packets, trace_rays
from wrt.kernels.core.ray_tree import Bvh
from wrt.kernels.native import at_file_level, text_of
from wrt.kernels.native import constants as sizes

# --- Another order of children -----------------------------------------------------------------------


def sorted_text() -> str:
    """Return the traversal for processors without AVX2, which sorts the children that it meets."""
    branch = "#if defined(__AVX2__)\n    const i8 order"
    assert branch in text_of("traversal.h")
    return text_of("traversal.h").replace(branch, "#if 0\n    const i8 order")


HEADER = at_file_level(sorted_text(), "sorted_traversal")


@wp.func_native("return wrt::closest_hit(bvh, wrt::Axes(), origin, direction, 1.0e30f, any_hit);")
def traverse(bvh: Bvh, origin: wp.vec3, direction: wp.vec3, any_hit: bool) -> wp.vec4:
    HEADER()


@wp.kernel(enable_backward=False, module="test_tree_layout.sorted")
def cast_sorted(
    tree: Bvh,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    found_out: wp.array2d(dtype=wp.vec4),
):
    """Write triangle, t, u and v of the nearest hit and of any."""
    i = wp.tid()
    found_out[0, i] = traverse(tree, origins[i], directions[i], False)
    found_out[1, i] = traverse(tree, origins[i], directions[i], True)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["soup", "large triangles", "coincident pairs", "coplanar", "needles"])
def test_the_order_of_children_changes_no_hit(name: str) -> None:
    """To the bit: the order of boxes decides the speed, not the hit."""
    mesh = mesh_of(HARD[name]())
    tracer = wrt.Intersector(mesh, device="cpu")
    origins, directions = random_rays(mesh.bounds, 50_000, seed=14)
    # Also along axes, and in the planes of boxes' sides.
    directions[:5000, 0] = 0.0
    directions[:2500, 1] = 0.0
    hits = tracer.closest_hit(origins, directions)
    found = wp.empty((2, len(origins)), dtype=wp.vec4, device="cpu")
    rays = [upload(each, wp.vec3, "cpu") for each in (origins, directions)]
    wp.launch(cast_sorted, len(origins), [tracer._built.data, *rays, found], device="cpu")
    nearest, any_hit = found.numpy()
    hit = hits.triangle >= 0
    assert hit.any()
    np.testing.assert_array_equal(nearest[:, 0].copy().view(np.int32), hits.triangle)
    np.testing.assert_array_equal(any_hit[:, 0].copy().view(np.int32) >= 0, hit)
    np.testing.assert_array_equal(nearest[hit, 1:], np.stack([hits.t, hits.u, hits.v], axis=1)[hit])


# --- The stack ---------------------------------------------------------------------------------------


@functools.cache
def deepest_tree(octant: int, device: str) -> tuple[Bvh, int]:
    """Return a tree of MAX_DEPTH levels in which a ray of an octant leaves seven children waiting on each.

    A node's first child for such rays is the next node, its others are leaves of one triangle. All boxes
    hold the ray's origin, so no box is left out; each leaf is nearer than the one before it.
    """
    nodes, order = np.zeros((sizes.MAX_DEPTH, sizes.NODE_FLOATS), np.float32), octant ^ np.arange(sizes.WIDTH)
    children, below = nodes.view(np.int32)[:, 48:], np.arange(sizes.MAX_DEPTH)[::-1]
    nodes[:, :24], nodes[:, 24:48] = -2.0, 2.0
    # Leaves are numbered from the deepest node up, in each in the order of the octant.
    children[:, order] = -1 - ((sizes.WIDTH - 1) * below[:, None] + np.arange(sizes.WIDTH))
    children[:-1, octant] = np.arange(1, sizes.MAX_DEPTH)
    # For those who sort by distance: the next node begins a little earlier than the leaves.
    for axis in range(3):
        nodes[:-1, (0 if OCTANTS[octant, axis] > 0 else 24) + 8 * axis + octant] *= 1.5
    count, s = (sizes.WIDTH - 1) * sizes.MAX_DEPTH + 1, OCTANTS[octant]
    leaves = np.zeros((count, sizes.LEAF_FLOATS), np.float32)
    # Farthest the one that is come to first, all in front of the boxes' middle.
    away = 1.0 - 0.9 * np.arange(count) / count
    corners = away[:, None, None] * s + 4.0 * np.array([(1, -1, 0), (0, 1, -1), (-1, 0, 1)]) * s
    places = leaves[:, : 9 * sizes.LEAF_SIZE].reshape(count, 3, 3, sizes.LEAF_SIZE)
    places[:] = corners[:, :1, :, None]
    places[..., 0] = corners
    leaves[:, : 9 * sizes.LEAF_SIZE] = places.reshape(count, -1)
    leaves.view(np.int32)[:, 9 * sizes.LEAF_SIZE :] = np.arange(count)[:, None]
    data = Bvh()
    data.nodes = upload(nodes.ravel(), float, device)
    data.leaves = upload(leaves.ravel(), float, device)
    return data, count


KERNELS = {
    "single": (trace_rays, 1),
    "in turn": (trace_interleaved, sizes.RAYS_PER_THREAD),
    "packets": (trace_packets, sizes.PACKET),
}


@pytest.mark.parametrize("octant", [0, 3])
@pytest.mark.parametrize("kind", KERNELS)
def test_all_kernels_follow_the_deepest_tree(kind: str, octant: int, device: str) -> None:
    """On every level all children but the entered one wait; eight are written beyond the top."""
    assert sizes.STACK_SIZE >= (sizes.WIDTH - 1) * sizes.MAX_DEPTH + 1
    assert re.findall(r"\b(begins|waiting)\[STACK_SIZE \+ 8\]", text_of("traversal.h")) == ["begins", "waiting"]
    tree, count = deepest_tree(octant, device)
    kernel, rays_per_thread = KERNELS[kind]
    n = 203
    batch = RayBatch()
    directions = OCTANTS[octant] * np.random.default_rng(5).uniform(0.9, 1.0, (n, 3))
    batch.origins, batch.directions = upload(np.zeros((n, 3)), wp.vec3, device), upload(directions, wp.vec3, device)
    batch.t_min, batch.t_max = 0.0, upload([np.inf], float, device)
    batch.triangle_out = wp.empty(n, dtype=int, device=device)
    batch.t_out, batch.uv_out = wp.empty(n, dtype=float, device=device), wp.empty(n, dtype=wp.vec2, device=device)
    for any_hit in (0, 1):
        batch.any_hit = any_hit
        Device(device).launch(kernel, -(-n // rays_per_thread), [tree, batch])
        triangle = batch.triangle_out.numpy()
        assert (triangle >= 0).all() if any_hit else (triangle == count - 1).all()


# --- Sides of boxes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [32, 5000])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("place", [-0.0, 0.75])
def test_rays_along_the_side_of_a_box_meet_what_it_holds(
    place: float, side: float, axis: int, count: int, device: str
) -> None:
    """A border belongs to its triangle, on either side of a plane parallel to the ray."""
    corners = np.array([[place, -1.0, 0.0], [place, 1.0, 0.0], [place + side, 0.0, 0.0]], np.float32)
    mesh = wrt.Mesh(np.roll(corners, axis, axis=1), np.array([[0, 1, 2]]))
    origin, direction = np.roll([place, 0.25, 1.0], axis), np.roll([0.0, 0.0, -1.0], axis)
    for sign in (1.0, -1.0):
        rays = np.tile(origin - 2.0 * (sign < 0.0) * np.roll([0.0, 0.0, 1.0], axis), (count, 1)), sign * direction
        hits = wrt.Intersector(mesh, device=device).closest_hit(rays[0], np.tile(rays[1], (count, 1)))
        assert (hits.triangle == 0).all()
        np.testing.assert_array_equal(hits.t, 1.0)


@pytest.mark.parametrize(("axis", "distance"), [(0, 1.0), (1, 100.0), (2, 1.0)])
@pytest.mark.parametrize("kind", ["mesh", "instances"])
def test_of_flat_things_in_one_place_the_lowest_is_hit(kind: str, axis: int, distance: float, device: str) -> None:
    """Their boxes have no depth, and begin where the triangles are: rounding must not hide the lowest behind others.

    One ray in ten thousand may hit another if it is moved to the mesh of an instance.
    """
    square = wrt.quad((-0.5, -0.5, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    linear = np.roll(np.eye(3), axis, axis=0) @ np.diag([2.98, 0.115, 0.17])
    place = affine(linear, (310.1, -200.3, 100.7) if kind == "instances" else (11.859, 2.09, -0.717))
    if kind == "mesh":
        one = square.transformed(place)
        tracer = wrt.Intersector(wrt.Mesh(one.vertices, np.tile(one.faces, (40, 1))), device=device)
    else:
        tracer = wrt.Intersector.of_instances([square], np.zeros(20, int), np.tile(place, (20, 1, 1)), device=device)
    rng = np.random.default_rng(6)
    targets = rng.uniform(-0.4, 0.4, (50_000, 3)) * [1.0, 1.0, 0.0] @ linear.T + place[:3, 3]
    directions = unit(rng.normal(size=targets.shape))
    hits = tracer.closest_hit(targets - distance * rng.uniform(0.1, 1.0, (50_000, 1)) * directions, directions)
    assert (hits.triangle >= 0).mean() > 0.99
    assert (hits.triangle >= 2).mean() <= (1e-4 if kind == "instances" else 0.0)
