"""No path leaves a closed room, however near an edge it hits a wall: lit only from outside, a room is black."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from support.ray_trees import affine, rotation
from support.small_scenes import image_of

import wrt

WALLS = wrt.Diffuse(0.9)


def room(*meshes: wrt.Mesh) -> wrt.Scene:
    """Return closed walls around the camera, under a bright sky."""
    center = np.mean([mesh.vertices.mean(axis=0) for mesh in meshes], axis=0)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1000.0))
    scene.camera = wrt.PerspectiveCamera(tuple(center), tuple(center + [0.1, 0.3, -1.0]), fov_degrees=130)
    for mesh in meshes:
        scene.add(mesh, material=WALLS)
    return scene


def turned(mesh: wrt.Mesh, seed: int, offset: tuple[float, float, float] = (0, 0, 0)) -> wrt.Mesh:
    return wrt.Mesh(mesh.vertices @ rotation(np.random.default_rng(seed)) + offset, mesh.faces)


def box(far: float = 0.0) -> wrt.Scene:
    return room(turned(wrt.box((-1, -1, -1), (1, 1, 1)), 1, (0.6 * far, -0.4 * far, far)))


def wedge() -> wrt.Scene:
    """Two walls that meet at 10 degrees."""
    y = 2.0 * np.tan(np.radians(5.0))
    vertices = [(-1.4, 0, z) if k == 0 else (0.6, k * y, z) for z in (-1, 1) for k in (0, 1, -1)]
    faces = [[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [0, 2, 5], [0, 5, 3], [1, 4, 5], [1, 5, 2]]
    return room(turned(wrt.Mesh(np.array(vertices), np.array(faces)), 2))


def crossing_walls() -> wrt.Scene:
    """Six walls that intersect one another, beyond their common edges."""
    walls = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corner, u, v = np.full(3, -1.3), np.zeros(3), np.zeros(3)
            corner[axis], u[axis - 2], v[axis - 1] = side, 2.6, 2.6
            walls.append(turned(wrt.quad(tuple(corner), tuple(u), tuple(v)), 3))
    return room(*walls)


def can() -> wrt.Scene:
    """An exact cylinder between disks."""
    ends = [tuple(map(float, sign * rotation(np.random.default_rng(4))[0])) for sign in (-1, 1)]
    scene = room(wrt.cylinder(*ends, 1.0), wrt.disk(ends[0], ends[0], 1.0), wrt.disk(ends[1], ends[1], 1.0))
    scene.camera = wrt.PerspectiveCamera((0.01, 0.02, 0.03), (0.1, 0.3, -1.0), fov_degrees=130)
    return scene


def placed(scale: float, motion: bool) -> wrt.Scene:
    """A box that is stretched and turned by an instance, or that flies along."""
    scene = box()
    scene.shapes.clear()
    mesh, rng = wrt.box((-1, -1, -1), (1, 1, 1)), np.random.default_rng(5)
    linear = scale * rotation(rng) @ np.diag([1.0, 0.6, 1.4])
    scene.camera = wrt.PerspectiveCamera((0, 0, 0), (0.1, 0.3, -1.0), fov_degrees=130, shutter_close=1.0)
    if motion:
        keys = np.stack([affine(linear, (x, 0, 0)) for x in (-0.1 * scale, 0.1 * scale)])
        scene.add(mesh, material=WALLS, transform=wrt.Motion((0.0, 1.0), keys))
    else:
        scene.add_instances(mesh, [affine(linear, (x, 0, 0)) for x in (0, 9 * scale)], material=WALLS)
    return scene


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("build", "spp", "settings"),
    [
        pytest.param(box, 64, {}, id="box"),
        pytest.param(lambda: box(50.0), 64, {}, id="far away"),
        # A sampler gives 0 now and then, and so a direction in the plane of the wall: in 10 million paths five times.
        pytest.param(wedge, 64, {}, id="wedge"),
        pytest.param(wedge, 2560, {}, id="wedge, many paths", marks=SLOW),
        pytest.param(crossing_walls, 64, {}, id="crossing walls"),
        pytest.param(box, 64, {"integrator": "ao"}, id="occlusion", marks=SLOW),
        pytest.param(can, 64, {}, id="can", marks=SLOW),
        *(
            pytest.param(partial(placed, scale, motion), 64, {}, id=f"{kind}, scale {scale:g}", marks=SLOW)
            for kind, motion in (("instance", False), ("motion", True))
            for scale in (1e-3, 1.0, 1e3)
        ),
    ],
)
def test_a_closed_room_is_black(build: Callable[[], wrt.Scene], spp: int, settings: dict, device: str) -> None:
    """A dozen of 260,000 paths escaped when hits beside an edge were dropped as within their error."""
    renderer = wrt.Renderer(build(), width=64, height=64, device=device, **settings)
    assert image_of(renderer, spp).max() == 0.0


@pytest.mark.parametrize("scale", [1e-11, 1e11])
def test_a_white_body_of_any_size_is_invisible_in_a_white_sky(scale: float, device: str) -> None:
    """The products of its edges overflow or vanish in float32."""
    ball = wrt.sphere(subdivisions=3)
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera((0, 0, 5 * scale), (0, 0, 0), fov_degrees=30)
    scene.add(wrt.Mesh(ball.vertices * scale, ball.faces), material=wrt.Diffuse(1.0))
    renderer = wrt.Renderer(scene, width=24, height=24, max_depth=32, device=device)
    np.testing.assert_allclose(image_of(renderer, 4), 1.0, rtol=1e-5)


@pytest.mark.slow
def test_clear_glass_loses_nothing_to_roulette(device: str) -> None:
    """Twenty shells of glass in a white sky: each path that has lost no energy reaches the sky."""
    ball, n = wrt.sphere(subdivisions=3), 20
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera((0, 0, 5), (0, 0, 0), fov_degrees=2)
    for k in range(n):
        scene.add(wrt.Mesh(ball.vertices * (1 - k / (n + 1)), ball.faces), material=wrt.Dielectric(ior=1.01 + 0.01 * k))
    renderer = wrt.Renderer(scene, width=8, height=8, max_depth=1024, device=device)
    np.testing.assert_allclose(image_of(renderer, 16), 1.0, rtol=1e-3)
