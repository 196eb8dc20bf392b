"""The light that glass, metal and water throw, for docs/caustics.md."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

import wrt
from wrt.scene.normals import with_normals
from wrt.values import Vec3

from .picture import Picture


def on_a_table(origin: Vec3, target: Vec3, sky: float = 0.1) -> wrt.Scene:
    """Return a table under a dim sky."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(origin, target, fov_degrees=38.0))
    table = wrt.quad((-6.0, 0.0, 6.0), (12.0, 0.0, 0.0), (0.0, 0.0, -12.0))
    scene.add(table, material=wrt.Diffuse((0.6, 0.57, 0.53)), name="table")
    scene.environment = wrt.ConstantEnvironment(sky)
    return scene


def turned(profile: ArrayLike, around: int = 160) -> wrt.Mesh:
    """Return the mesh that a profile, (N, 2) points of radius and height, draws around the axis y."""
    radius, height = np.asarray(profile, np.float64).T[:, :, None]
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    points = np.stack(np.broadcast_arrays(radius * np.cos(angle), height, radius * np.sin(angle)), -1)
    at = np.arange(radius.size * around).reshape(radius.size, around)
    return with_normals(wrt.Mesh(points.reshape(-1, 3), _faces(at, np.roll(at, -1, 1))))


def _faces(at: NDArray[np.intp], following: NDArray[np.intp]) -> NDArray[np.intp]:
    a, b, c, d = at[:-1], at[1:], following[1:], following[:-1]
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def pool() -> wrt.Scene:
    """Water with waves in the sun, over a tiled floor."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 3.4, 3.4), (0.0, 0.2, 0.0), fov_degrees=38.0))
    floor = wrt.quad((-2.5, 0.0, 2.5), (5.0, 0.0, 0.0), (0.0, 0.0, -5.0))
    scene.add(floor, material=wrt.Diffuse((0.25, 0.55, 0.65)), name="floor")
    side = np.linspace(-2.5, 2.5, 160)
    x, z = np.meshgrid(side, side)
    height = 0.9 + 0.03 * np.sin(4.0 * x + 1.3 * np.sin(3.0 * z)) * np.cos(4.0 * z + np.sin(2.0 * x))
    slope_z, slope_x = np.gradient(height, side, side)
    normals = np.stack([-slope_x, np.ones_like(x), -slope_z], axis=-1).reshape(-1, 3)
    at = np.arange(x.size).reshape(x.shape)
    points = np.stack([x, height, z], axis=-1).reshape(-1, 3)
    mesh = wrt.Mesh(points, _faces(at[:, :-1], at[:, 1:]), normals=normals)
    scene.add(mesh, material=wrt.Dielectric("water"), name="water")
    scene.add_light(wrt.DirectionalLight((0.3, -1.0, 0.2), 4.0))
    return scene


def wine_glass() -> wrt.Scene:
    """A glass of red wine in the light of a point behind it."""
    scene = on_a_table((0.75, 2.9, 4.3), (0.6, 0.55, 0.3))
    bend = np.linspace(0.0, 0.5 * np.pi, 24)
    bowl = np.stack([0.5 * np.sin(bend), 1.25 - 0.55 * np.cos(bend)], -1)
    up = np.linspace(0.03, 0.5, 12)
    wall = np.stack([0.5 - 0.14 * up**2 / 0.25 * 0.5, 1.25 + up], -1)
    outer = np.concatenate([bowl[3:], wall])
    inner = outer * (1.0, 1.0) - 0.025 * _outwards(outer)
    inner[0, 0] = 1e-4
    stem = np.array([(1e-4, 0.0), (0.42, 0.0), (0.42, 0.012), (0.3, 0.03), (0.09, 0.07), (0.04, 0.16), (0.035, 0.58)])
    scene.add(
        turned(np.concatenate([stem, outer, inner[::-1]])), material=wrt.Dielectric(1.5, priority=2), name="glass"
    )
    # It reaches a little into the glass, which counts where both are.
    wine = outer[outer[:, 1] < 1.3] - 0.012 * _outwards(outer)[outer[:, 1] < 1.3]
    wine = np.concatenate([[(1e-4, wine[0, 1])], wine, [(1e-4, wine[-1, 1])]])
    body = wrt.Dielectric(1.34, priority=1, interior=wrt.Medium(absorption=(0.5, 7.0, 6.0)))
    scene.add(turned(wine), material=body, name="wine")
    scene.add_light(wrt.PointLight((-2.0, 4.2, -1.6), intensity=50.0))
    return scene


def _outwards(profile: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit normals of a profile that runs upwards."""
    along = np.gradient(profile, axis=0)
    return np.stack([along[:, 1], -along[:, 0]], -1) / np.linalg.norm(along, axis=1, keepdims=True)


def ring() -> wrt.Scene:
    """A ring of gold in the light of a point."""
    scene = on_a_table((0.0, 2.3, 2.3), (0.0, 0.1, 0.05))
    angle = np.linspace(-np.pi, np.pi, 48)
    band = np.stack([0.8 + 0.03 * np.cos(angle), 0.15 * (1.0 + np.sin(angle))], -1)
    scene.add(turned(band, 256), material=wrt.Conductor(metal="gold"), name="ring")
    scene.add_light(wrt.PointLight((-1.8, 2.6, -1.0), intensity=24.0))
    return scene


def magnifying_glass() -> wrt.Scene:
    """A lens in a rim, a little too near to the table for its focus, in the sun."""
    scene = on_a_table((0.3, 1.9, 2.9), (0.15, 0.35, 0.1))
    edge = 0.55
    curve = 1.3
    radius = np.linspace(1e-4, edge, 40)
    sag = np.sqrt(curve**2 - radius**2) - np.sqrt(curve**2 - edge**2)
    lens = turned(np.concatenate([np.stack([radius, -sag], -1), np.stack([radius, sag], -1)[::-1]]))
    angle = np.linspace(-np.pi, np.pi, 24)
    rim = turned(np.stack([edge + 0.03 + 0.045 * np.cos(angle), 0.06 * np.sin(angle)], -1))
    handle = wrt.cylinder((edge + 0.05, 0.0, 0.0), (edge + 0.95, 0.0, 0.0), 0.06)
    tilt = 14.0
    for mesh, material, name in (
        (lens, wrt.Dielectric(1.52), "lens"),
        (rim, wrt.RoughConductor(0.25, metal="brass"), "rim"),
        (handle, wrt.Plastic((0.05, 0.04, 0.035)), "handle"),
    ):
        scene.add(mesh.rotated((0.0, 0.0, 1.0), tilt).translated((-0.2, 0.75, 0.0)), material=material, name=name)
    scene.add_light(wrt.DirectionalLight((0.25, -1.0, 0.1), 3.0))
    return scene


def prism() -> wrt.Scene:
    """A strip of sunlight through a slit, and a prism of glass with much dispersion."""
    scene = on_a_table((0.35, 2.4, 2.2), (0.35, 0.0, 0.15), sky=0.15)
    scene.settings.exposure = 0.0
    corners = 0.45 * np.array([(np.sin(a), np.cos(a)) for a in np.radians((180.0, 300.0, 60.0))])
    points = np.array([(x, y, z) for y in (0.002, 0.5) for x, z in corners])
    sides = [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5), (0, 2, 1), (3, 4, 5)]
    scene.add(wrt.Mesh(points, np.array(sides)), material=wrt.Dielectric(1.6, dispersion=1.2), name="prism")
    card = wrt.Diffuse((0.05, 0.05, 0.06))
    for low, high in ((-6.0, 0.065), (0.135, 6.0)):
        scene.add(wrt.box((-1.62, 0.0, low), (-1.6, 1.2, high)), material=card, name="card")
    scene.add_light(wrt.DirectionalLight((1.0, -0.16, -0.3), 25.0))
    return scene


WITH = {"caustics": True}

CLAMPED = {**WITH, "clamp_indirect": 2.0}

PICTURES = {
    "caustics-pool-path": Picture(pool, 400, 280),
    "caustics-pool": Picture(pool, 400, 280, 128, WITH),
    "caustics-wine-path": Picture(wine_glass, 400, 280, 64),
    "caustics-wine": Picture(wine_glass, 400, 280, 384, CLAMPED),
    "caustics-ring-path": Picture(ring, 400, 280, 64),
    "caustics-ring": Picture(ring, 400, 280, 144, CLAMPED),
    "caustics-lens-path": Picture(magnifying_glass, 400, 280, 64),
    "caustics-lens": Picture(magnifying_glass, 400, 280, 144, CLAMPED),
    "caustics-prism-path": Picture(prism, 400, 280, 64),
    "caustics-prism": Picture(prism, 400, 280, 256, CLAMPED),
}
