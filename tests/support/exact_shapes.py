"""Rays to exact shapes: what they meet, the surface there, and what they meet that leave it."""

from __future__ import annotations

import functools

import warp as wp
from numpy.typing import NDArray

import wrt
from wrt.backend.device import Device
from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.geometry.rays import Ray
from wrt.kernels.geometry.surface import leave, make_add_texture_coordinates, make_surface_at
from wrt.kernels.scene.scene_data import SceneData
from wrt.upload.scene_data import build_scene


@functools.cache
def make_cast(geometry: str) -> wp.Kernel:
    intersect, surface_at = make_intersect(geometry), make_surface_at(geometry)
    closest_hit, next_hit, occluded = intersect.closest_hit, intersect.next_hit, intersect.occluded
    add_texture_coordinates = make_add_texture_coordinates(False, True)

    # A module of its own: what headers define for one geometry, another must not have.
    @wp.kernel(module=wp.get_module(f"exact_shapes_{geometry}"), enable_backward=False)
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
    ):
        """Write the nearest hit, the surface there, the next hit, and what rays meet that leave to both sides."""
        i = wp.tid()
        ray = Ray()
        ray.origin = origins[i]
        ray.direction = directions[i]
        hit = closest_hit(scene, ray)
        number_out[i] = hit.triangle
        if hit.triangle >= 0:
            after = next_hit(scene, ray, hit, 1.0e30)
            ts_out[i] = wp.vec2(hit.t, after.t)
            surface = surface_at(scene, ray, hit)
            position_out[i, 0] = surface.position
            if after.triangle >= 0:
                position_out[i, 1] = surface_at(scene, ray, after).position
            front = wp.where(surface.front, 1.0, -1.0)
            normal_out[i] = surface.normal * front
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
    """Return what the kernel above writes: number, distances, positions, front normals, coordinates, what leaves."""
    scene = wrt.Scene()
    for mesh in shapes:
        scene.add(mesh)
    built = build_scene(scene, Device(device), texture_coordinates=True)
    assert built.features.has_exact
    n = len(origins)
    made = [(int, n), (wp.vec2, n), (wp.vec3, (n, 2)), (wp.vec3, n), (wp.vec2, n), (int, (n, 4))]
    out = [wp.zeros(shape, dtype=dtype, device=device) for dtype, shape in made]
    rays = [wp.array(values, dtype=wp.vec3, device=device) for values in (origins, directions)]
    wp.launch(make_cast(built.features.geometry), n, [built.data, *rays], out, device=device)
    return [array.numpy() for array in out]
