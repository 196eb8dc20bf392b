"""Exact shapes of many sizes; what rays to them meet, the surface there, and what rays meet that leave it."""

from __future__ import annotations

import functools

import numpy as np
import warp as wp
from numpy.typing import NDArray

import wrt
from wrt.backend.device import Device
from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.core.features import identifier
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.geometry.surface import leave, make_add_texture_coordinates, make_surface_at
from wrt.scene.exact.quadrics import Quadrics
from wrt.upload.scene_data import SceneUpload


def local(mesh: Quadrics, v: NDArray) -> NDArray:
    """Return vectors, as the shape's own vectors map to them, in float64."""
    return v.astype(np.float64) @ np.linalg.inv(mesh.axes[0])


def ellipse() -> Quadrics:
    made = wrt.disk((0.4, 0.1, -0.2), (1, 2, 3), 0.7).transformed(
        [[1.5, 0.3, 0, 1], [-0.2, 0.4, 0.5, 2], [0.1, 0.6, -0.9, -1], [0, 0, 0, 1]]
    )
    assert isinstance(made, Quadrics)
    return made


QUADRICS: dict[str, Quadrics] = {
    "disk": wrt.disk((3, -2, 5), (1, -2, 0.5), 0.3),
    "ellipse": ellipse(),
    "small disk far away": wrt.disk((40, 30, -20), (0.3, 1, 0.2), 0.02),
    "large disk": wrt.disk((10, 20, -7), (0.1, 3, 0.2), 1e5),
    "cylinder": wrt.cylinder((3, -2, 5), (4, -1.5, 7), 0.4),
    "thin cylinder": wrt.cylinder((1, 2, 3), (2, 5, -1), 0.01),
    "flat cylinder": wrt.cylinder((1, 2, 3), (1.01, 2.02, 3.02), 2.0),
    "large cylinder": wrt.cylinder((-5e4, 3e4, 1e4), (5e4, -2e4, 1e4), 2e4),
    "least disk": wrt.disk((0, 0, 0), (1, -2, 0.5), 5e-12),
    "greatest disk": wrt.disk((1e11, 0, 0), (1, -2, 0.5), 8e11),
    "least cylinder": wrt.cylinder((0, 0, 0), (2e-12, 1e-12, 8e-12), 4e-12),
    "greatest cylinder": wrt.cylinder((0, 0, 0), (3e11, 1e11, 5e11), 3e11),
}
"""The last four as small and as large as scenes may be, in metres."""


@functools.cache
def make_cast(geometry: str) -> wp.Kernel:
    intersect, surface_at = make_intersect(geometry), make_surface_at(geometry)
    closest_hit, next_hit, occluded = intersect.closest_hit, intersect.next_hit, intersect.occluded
    add_texture_coordinates = make_add_texture_coordinates(False, True)

    # A module of its own: what headers define for one geometry, another must not have.
    @wp.kernel(module=wp.get_module(f"exact_shapes_{identifier([geometry])}"), enable_backward=False)
    def cast(
        scene: SceneData,
        origins: wp.array(dtype=wp.vec3),
        directions: wp.array(dtype=wp.vec3),
        number_out: wp.array(dtype=int),
        ts_out: wp.array(dtype=wp.vec2),
        position_out: wp.array2d(dtype=wp.vec3),
        normal_out: wp.array(dtype=wp.vec3),
        uv_out: wp.array(dtype=wp.vec2),
        left_out: wp.array2d(dtype=int),
        edges_out: wp.array2d(dtype=wp.vec3),
    ):
        """Write the nearest hit, the surface there, the next hit, and what rays meet that leave to both sides."""
        i = wp.tid()
        ray = Ray()
        ray.origin = origins[i]
        ray.direction = directions[i]
        hit = closest_hit(scene, ray)
        number_out[i] = hit.triangle
        if hit.triangle >= 0:
            following = next_hit(scene, ray, hit, 1.0e30)
            ts_out[i] = wp.vec2(hit.t, following.t)
            surface = surface_at(scene, ray, hit)
            position_out[i, 0] = surface.position
            if following.triangle >= 0:
                position_out[i, 1] = surface_at(scene, ray, following).position
            front = wp.where(surface.front, 1.0, -1.0)
            normal_out[i] = surface.normal * front
            edges_out[i, 0] = surface.e1
            edges_out[i, 1] = surface.e2
            uv_out[i] = add_texture_coordinates(scene, hit, surface).uv
            # Straight on from behind, mirrored in front, and nearly along the surface on both sides
            mirrored = ray.direction - surface.normal * (2.0 * wp.dot(ray.direction, surface.normal))
            along = wp.normalize(mirrored - surface.normal * wp.dot(mirrored, surface.normal))
            ray.origin = leave(surface, -1.0)
            left_out[i, 0] = closest_hit(scene, ray).triangle
            ray.direction = wp.normalize(along - surface.normal * 1.0e-3)
            left_out[i, 1] = closest_hit(scene, ray).triangle
            ray.origin = leave(surface, 1.0)
            ray.direction = mirrored
            left_out[i, 2] = closest_hit(scene, ray).triangle
            ray.direction = along
            left_out[i, 3] = int(occluded(scene, ray, 1.0e30))

    return cast


def cast_rays(shapes: list[wrt.Mesh], origins: NDArray, directions: NDArray, device: str) -> list[NDArray]:
    """Return what the kernel above writes, array by array."""
    scene = wrt.Scene()
    for mesh in shapes:
        scene.add(mesh)
    built = SceneUpload(scene, Device(device), texture_coordinates=True).finish()
    assert built.features.has_exact
    n = len(origins)
    made = [(int, n), (wp.vec2, n), (wp.vec3, (n, 2)), (wp.vec3, n), (wp.vec2, n), (int, (n, 4)), (wp.vec3, (n, 2))]
    out = [wp.zeros(shape, dtype=dtype, device=device) for dtype, shape in made]
    rays = [wp.array(values, dtype=wp.vec3, device=device) for values in (origins, directions)]
    wp.launch(make_cast(built.features.geometry), n, [built.data, *rays], out, device=device)
    return [array.numpy() for array in out]
