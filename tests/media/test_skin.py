"""The surface that a path in a medium has just left is found where the path left it."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

import wrt
from wrt.backend.device import Device
from wrt.kernels.accel.intersect import make_intersect
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.geometry.surface import leave, make_surface_at
from wrt.kernels.media.skin import make_skin_near
from wrt.upload.scene_data import SceneUpload


def make_enter(geometry: str) -> wp.Kernel:
    intersect, surface_at, skin_near = make_intersect(geometry), make_surface_at(geometry), make_skin_near(geometry)
    closest_hit = intersect.closest_hit

    @wp.kernel(module=wp.get_module(f"skins_{geometry}"), enable_backward=False)
    def enter(
        scene: SceneData,
        origins: wp.array(dtype=wp.vec3),
        directions: wp.array(dtype=wp.vec3),
        turns: wp.array(dtype=wp.vec3),
        share: float,
        met_out: wp.array(dtype=int),
        found_out: wp.array2d(dtype=wp.vec3),
    ):
        """Go in through the nearest surface in another direction, and a share of the way to the next: which skin?

        Out come where and with what normal the path went in, and the same of the skin.
        """
        i = wp.tid()
        ray = Ray()
        ray.origin = origins[i]
        ray.direction = directions[i]
        entry = closest_hit(scene, ray)
        met_out[i] = -2
        if entry.triangle >= 0:
            surface = surface_at(scene, ray, entry)
            into = wp.normalize(turns[i] - surface.normal * (wp.dot(turns[i], surface.normal) + 0.5))
            ray.origin = leave(surface, -1.0)
            ray.direction = into
            ahead = closest_hit(scene, ray)
            distance = wp.where(ahead.triangle >= 0, ahead.t * share, 0.0)
            skin = skin_near(scene, ray, distance, ahead, entry)
            met_out[i] = skin.hit.triangle
            found_out[i, 0] = surface.position
            found_out[i, 1] = surface.normal
            found_out[i, 2] = skin.point
            found_out[i, 3] = skin.normal

    return enter


ENDS = np.array([(0.2, -0.3, 0.1), (0.5, 0.8, 0.3)])
SHAPES: dict[str, list[wrt.Mesh]] = {
    "can": [
        wrt.cylinder(tuple(ENDS[0]), tuple(ENDS[1]), 0.5),
        wrt.disk(tuple(ENDS[0]), tuple(ENDS[0] - ENDS[1]), 0.5),
        wrt.disk(tuple(ENDS[1]), tuple(ENDS[1] - ENDS[0]), 0.5),
    ],
    "ball": [wrt.sphere((0.2, 0.1, 0.3), 0.6, exact=True)],
    "box": [wrt.box((-0.4, -0.3, -0.2), (0.6, 0.7, 0.5))],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_the_skin_behind_is_where_the_path_came_in(name: str, device: str) -> None:
    """Not on the far wall of the same can or ball, which the ray meets next."""
    rng, n = np.random.default_rng(6), 4000
    scene = wrt.Scene()
    for mesh in SHAPES[name]:
        scene.add(mesh)
    built = SceneUpload(scene, Device(device), texture_coordinates=True).finish()
    out = rng.standard_normal((n, 3))
    origins = (3.0 * out / np.linalg.norm(out, axis=1, keepdims=True)).astype(np.float32)
    directions = rng.uniform(-0.3, 0.6, (n, 3)) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turns = rng.standard_normal((n, 3))
    kernel = make_enter(built.features.geometry)

    def skins(share: float) -> tuple[NDArray, NDArray]:
        made = [wp.zeros(n, dtype=int, device=device), wp.zeros((n, 4), dtype=wp.vec3, device=device)]
        rays = [wp.array(values, dtype=wp.vec3, device=device) for values in (origins, directions, turns)]
        wp.launch(kernel, n, [built.data, *rays, share], made, device=device)
        return made[0].numpy(), made[1].numpy()

    triangles, found = skins(0.0)
    entered = triangles != -2
    assert entered.sum() > 1000
    assert (triangles[entered] >= 0).all()
    # The path begins a little behind the surface, from where it is looked back at.
    assert np.abs(found[entered, 2] - found[entered, 0]).max() < 3e-5
    assert np.abs(found[entered, 3] - found[entered, 1]).max() < 1e-4  # the side from which the path came
    # Half way across nothing is near.
    assert (skins(0.45)[0][entered] < 0).mean() > 0.9
