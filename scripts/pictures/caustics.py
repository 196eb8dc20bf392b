"""The light that glass, metal and water throw, for docs/caustics.md."""

from __future__ import annotations

import numpy as np

import wrt

from .picture import Picture


def glass_and_ring() -> wrt.Scene:
    """A glass ball and a ring of copper on a table, in the light of a point."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 2.6, 4.0), (0.05, 0.3, 0.0), fov_degrees=38.0))
    table = wrt.quad((-4.0, 0.0, 4.0), (8.0, 0.0, 0.0), (0.0, 0.0, -8.0))
    scene.add(table, material=wrt.Diffuse((0.6, 0.57, 0.53)), name="table")
    scene.add(wrt.sphere((-0.7, 0.7, 0.0), 0.6, exact=True), material=wrt.Dielectric(), name="ball")
    scene.add(wrt.cylinder((0.8, 0.0, 0.0), (0.8, 0.45, 0.0), 0.6), material=wrt.Conductor(metal="copper"), name="ring")
    scene.add_light(wrt.PointLight((-2.0, 3.5, -1.5), intensity=45.0))
    return scene


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
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    points = np.stack([x, height, z], axis=-1).reshape(-1, 3)
    scene.add(wrt.Mesh(points, faces, normals=normals), material=wrt.Dielectric("water"), name="water")
    scene.add_light(wrt.DirectionalLight((0.3, -1.0, 0.2), 4.0))
    return scene


WITH = {"caustics": True}

PICTURES = {
    "caustics-glass-path": Picture(glass_and_ring, 400, 280),
    "caustics-glass": Picture(glass_and_ring, 400, 280, 256, WITH),
    "caustics-pool-path": Picture(pool, 400, 280),
    "caustics-pool": Picture(pool, 400, 280, 128, WITH),
}
