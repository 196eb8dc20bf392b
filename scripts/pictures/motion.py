"""A forest of instances, and things that move while the shutter is open, for docs/motion.md."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import wrt
from wrt.scene.mesh import merge

from .picture import Picture

TREES = 6000
NEEDLES = 2500
"""Triangles of a tree are twice as many."""

Array = NDArray[np.float64]


def tree(seed: int, color: tuple[float, float, float]) -> wrt.Mesh:
    """Return a conifer a metre high: twigs of two triangles around a stem, longer below."""
    rng = np.random.default_rng(seed)
    up = rng.random(NEEDLES) ** 1.6 * 0.92 + 0.06
    turn = rng.uniform(0.0, 2.0 * np.pi, NEEDLES)
    reach = 0.26 * (1.0 - up) * rng.uniform(0.75, 1.1, NEEDLES) + 0.015
    out = np.stack([np.cos(turn), np.zeros(NEEDLES), np.sin(turn)], axis=1)
    side = np.stack([-out[:, 2], out[:, 1], out[:, 0]], axis=1)
    droop = np.array([0.0, -0.35, 0.0])
    foot = up[:, None] * np.array([0.0, 1.0, 0.0])
    tip = foot + reach[:, None] * (out + droop)
    middle = foot + 0.55 * reach[:, None] * (out + 0.6 * droop)
    half = 0.16 * reach[:, None] * side + rng.normal(0.0, 0.006, (NEEDLES, 3))
    corners = np.stack([foot, middle - half, middle + half, tip], axis=1).reshape(-1, 3)
    first = 4 * np.arange(NEEDLES)[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [1, 3, 2]])
    shade = rng.uniform(0.6, 1.3, (NEEDLES, 1)) * np.array(color)
    twigs = wrt.Mesh(corners, faces, colors=np.repeat(shade, 4, axis=0))
    angles = np.linspace(0.0, 2.0 * np.pi, 7)[:-1]
    ring = 0.018 * np.stack([np.cos(angles), np.zeros(6), np.sin(angles)], axis=1)
    stem = wrt.Mesh(
        np.concatenate([ring, [[0.0, 0.95, 0.0]]]),
        np.array([[6, (k + 1) % 6, k] for k in range(6)]),
        colors=np.tile([0.12, 0.08, 0.05], (7, 1)),
    )
    return merge([twigs, stem], "tree")


def hills(x: Array, z: Array) -> Array:
    """Return the height of the ground."""
    rise = 0.9 * np.sin(0.13 * x + 1.0) * np.cos(0.11 * z) + 0.35 * np.sin(0.31 * x - 0.23 * z)
    return np.asarray(rise + 0.0016 * np.maximum(-z, 0.0) ** 1.7)


def ground() -> wrt.Mesh:
    """Return the hills as a mesh."""
    x, z = np.meshgrid(np.linspace(-60.0, 60.0, 241), np.linspace(-110.0, 12.0, 241), indexing="ij")
    points = np.stack([x, hills(x, z), z], axis=2).reshape(-1, 3)
    i = (np.arange(240)[:, None] * 241 + np.arange(240)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + 241], 1), np.stack([i + 1, i + 242, i + 241], 1)])
    return wrt.Mesh(points, faces)


def forest() -> wrt.Scene:
    """Return thousands of trees of three kinds on hills."""
    rng = np.random.default_rng(4)
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 4.2, 11.0), (0.0, 1.8, -8.0), fov_degrees=38.0))
    scene.environment = wrt.SunSkyEnvironment(elevation_degrees=24.0, azimuth_degrees=-75.0, turbidity=3.5)
    scene.settings.exposure = -4.2
    scene.add(ground(), material=wrt.Diffuse((0.10, 0.12, 0.045)))
    needles = wrt.Diffuse(wrt.VertexColor())
    kinds = [tree(k, color) for k, color in enumerate([(0.05, 0.11, 0.03), (0.035, 0.09, 0.045), (0.11, 0.13, 0.03)])]
    x, z = rng.uniform(-55.0, 55.0, TREES), 4.0 - 105.0 * rng.random(TREES) ** 0.8
    for kind, at_x, at_z in zip(rng.integers(0, 3, TREES), x, z, strict=True):
        turned = wrt.Motion.rotation((0, 1, 0), rng.uniform(0, 360)).transforms[-1]
        place = turned @ np.diag([*rng.uniform(0.9, 1.2, 1).repeat(3) * rng.uniform(1.2, 2.6), 1.0])
        place[:3, 3] = at_x, float(hills(at_x, at_z)) - 0.05, at_z
        scene.add(kinds[kind], material=needles, transform=place)
    return scene


def pinwheel() -> wrt.Mesh:
    """Return six blades around the origin, in the plane of x and y."""
    blades = []
    for k in range(6):
        color = [(0.75, 0.08, 0.05), (0.85, 0.8, 0.7)][k % 2]
        blade = wrt.polygon([(0.0, 0.0, 0.02), (0.34, 0.05, 0.1), (0.68, 0.3, 0.02), (0.3, 0.24, -0.02)])
        painted = wrt.Mesh(blade.vertices, blade.faces, colors=np.tile(color, (len(blade.vertices), 1)))
        blades.append(painted.rotated((0, 0, 1), 60.0 * k))
    return merge(blades, "pinwheel")


def toys() -> wrt.Scene:
    """Return a pinwheel that turns, a ball that falls, and a soft one that hits the floor."""
    camera = wrt.PerspectiveCamera((0.0, 1.25, 5.4), (0.0, 0.85, 0.0), fov_degrees=32.0, shutter_close=1.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment((0.32, 0.37, 0.45)))
    scene.settings.exposure = 0.3
    scene.add(wrt.quad((-9, 0, 5), (18, 0, 0), (0, 0, -12)), material=wrt.Diffuse((0.42, 0.4, 0.38)), name="floor")
    lamp = wrt.quad((-3.0, 4.5, 0.5), (2.0, 0.0, 0.0), (0.0, 0.3, 2.0))
    scene.add(lamp, emission=14.0, name="lamp")
    painted = wrt.TwoSided(wrt.Diffuse(wrt.VertexColor()))
    for x, z, degrees in ((-1.75, 0.0, 45.0), (-0.85, -1.3, 0.0)):
        hub = np.array([x, 1.0, z])
        spin = wrt.Motion.rotation((0, 0, 1), degrees, center=hub).after(np.array(_at(hub)))
        scene.add(pinwheel(), material=painted, transform=spin, name="pinwheel")
        stick = wrt.box((x - 0.015, 0.0, z - 0.05), (x + 0.015, 1.0, z - 0.02))
        scene.add(stick, material=wrt.Diffuse((0.5, 0.35, 0.2)))
    falling = np.tile(np.eye(4), (9, 1, 1))
    times = np.linspace(0.0, 1.0, 9)
    falling[:, :3, 3] = np.stack([0.3 + 0.12 * times, 1.6 - 0.2 * times - 0.22 * times**2, 0.0 * times], axis=1)
    marked = wrt.Mix(wrt.Plastic((0.02, 0.12, 0.5)), wrt.Plastic((0.8, 0.5, 0.05)), 0.25)
    scene.add(wrt.sphere(radius=0.2, subdivisions=4), material=marked, transform=wrt.Motion(times, falling))
    ball = wrt.sphere(radius=0.36, subdivisions=5)
    shapes = []
    for height, squeeze in ((0.52, 0.0), (0.42, 0.05), (0.30, 0.22), (0.22, 0.42)):
        wide = (1.0 + squeeze) * (1.0 + 0.25 * squeeze * (ball.vertices[:, 1] < 0.0))
        high = ball.vertices[:, 1] * (1.0 - squeeze) + height
        moved = np.stack([ball.vertices[:, 0] * wide, np.maximum(high, 0.004), ball.vertices[:, 2] * wide], axis=1)
        shapes.append(moved + [1.45, 0.0, 0.0])
    soft = wrt.Deformation((0.0, 0.3, 0.65, 1.0), np.stack(shapes))
    scene.add(ball, material=wrt.RoughPlastic((0.05, 0.4, 0.12), alpha=0.15), deformation=soft, name="soft")
    return scene


def _at(place: Array) -> Array:
    m = np.eye(4)
    m[:3, 3] = place
    return m


PICTURES = {"motion-forest": Picture(forest, 720, 405, 576), "motion-toys": Picture(toys, 640, 360, 512)}
