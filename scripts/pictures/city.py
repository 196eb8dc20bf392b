"""A city at night, lit by a hundred thousand small lights, for docs/lights.md: lamps, garlands of bulbs, windows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import wrt
from wrt.scene.mesh import merge

from .picture import Picture

Array = NDArray[np.float64]

LIGHTS = 100_000
"""Emissive triangles, about."""

BLOCKS = 10
"""Buildings in each direction: so few that each has many lights."""

PITCH = 22.0
STREET = 9.0
"""Distance from one building to the next, and the width of the street between, metres."""

FLOOR = 3.1
WINDOW = 2.1
"""Height of a floor and distance of windows, metres."""

POWER = 1.5e6
"""Power of all lights together, about W per channel, so that brightness does not depend on their number."""

PALETTE = {
    "lamp": (1.0, 0.62, 0.28),
    "warm": (1.0, 0.66, 0.34),
    "tungsten": (1.0, 0.5, 0.2),
    "cold": (0.62, 0.8, 1.0),
    "red": (1.0, 0.08, 0.05),
    "green": (0.08, 1.0, 0.2),
    "blue": (0.1, 0.25, 1.0),
    "amber": (1.0, 0.45, 0.02),
}

RADIANCE = {
    "lamp": 1100.0,
    "warm": 1.0,
    "tungsten": 1.2,
    "cold": 0.9,
    "red": 45.0,
    "green": 25.0,
    "blue": 45.0,
    "amber": 30.0,
}
"""Relative radiance of the kinds of lights, before scaling to POWER."""


def city() -> wrt.Scene:
    """Return a street between houses, under lamps, garlands of bulbs and windows.

    A lamp has two triangles, a window of two panes four, a bulb eight. Lamps get seven tenths of the triangles, as far
    as there are kerbs for them; bulbs get seven tenths of what remains, windows all other triangles.
    """
    rng = np.random.default_rng(0)
    blocks = np.arange(BLOCKS)
    low = PITCH * (np.stack(np.meshgrid(blocks, blocks, indexing="ij"), axis=2) - BLOCKS / 2)
    low = low.reshape(-1, 2) + 0.5 * STREET
    sides = np.full((len(low), 2), PITCH - STREET)
    center = low + 0.5 * sides
    heights = FLOOR * rng.integers(3, 6 + (np.abs(center[:, 0]) > 15.0) * 9, len(low))
    scene = wrt.Scene()
    scene.settings.max_depth = 6
    scene.settings.exposure = -1.8
    x = 0.5 * BLOCKS * PITCH
    scene.add(
        wrt.quad((-x, 0.0, x), (2.0 * x, 0.0, 0.0), (0.0, 0.0, -2.0 * x)),
        material=wrt.RoughPlastic((0.06, 0.06, 0.065), alpha=0.18),
        name="streets",
    )
    shades = [(0.42, 0.38, 0.34), (0.3, 0.3, 0.33), (0.36, 0.24, 0.19)]
    shade = rng.integers(0, len(shades), len(low))
    for k, reflectance in enumerate(shades):
        chosen = np.flatnonzero(shade == k)
        boxes = [
            wrt.box((a[0], 0.0, a[1]), (a[0] + s[0], h, a[1] + s[1]))
            for a, s, h in zip(low[chosen], sides[chosen], heights[chosen], strict=True)
        ]
        scene.add(merge(boxes, ""), material=wrt.Diffuse(reflectance), name=f"houses {k}")

    lamps = lamp_quads()
    lamps = lamps[rng.permutation(len(lamps))][: 7 * LIGHTS // 20]
    triangles_left = LIGHTS - 2 * len(lamps)
    bulbs = bulb_triangles(int(0.7 * triangles_left) // 8, rng)
    panes = window_quads(low, sides, heights, rng)[: (triangles_left - 8 * len(bulbs)) // 4].reshape(-1, 4, 3)
    parts: dict[str, Array] = {"lamp": quad_triangles(lamps)}
    for name, group in zip(("warm", "tungsten", "cold"), np.array_split(panes, 3), strict=True):
        parts[name] = quad_triangles(group)
    for name, group in zip(("red", "green", "blue", "amber"), np.array_split(bulbs, 4), strict=True):
        parts[name] = group.reshape(-1, 3, 3)
    area = {name: areas(triangles).sum() for name, triangles in parts.items()}
    scale = POWER / (np.pi * sum(area[name] * RADIANCE[name] for name in parts))
    for name, triangles in parts.items():
        emission = tuple(float(scale * RADIANCE[name] * c) for c in PALETTE[name])
        mesh = wrt.Mesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), name=name)
        scene.add(mesh, material=wrt.Diffuse(0.0), emission=emission, name=name)
    scene.camera = wrt.PerspectiveCamera(origin=(-0.8, 9.0, 100.0), target=(0.0, 7.0, 0.0), fov_degrees=48.0)
    return scene


def quad_triangles(quads: Array) -> Array:
    """Return (2 N, 3, 3) triangles of (N, 4, 3) corners."""
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)


def areas(triangles: Array) -> Array:
    """Return the areas of triangles."""
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return 0.5 * np.linalg.norm(cross, axis=1)


def rectangles(center: Array, u: Array, v: Array) -> Array:
    """Return (N, 4, 3) corners of rectangles that face u × v; u and v are half their sides."""
    return np.stack([center - u - v, center + u - v, center + u + v, center - u + v], axis=1)


def lamp_quads() -> Array:
    """Return the lamps of all streets, LED panels of 10 cm that face down from above both kerbs."""
    along = np.arange(-0.5 * BLOCKS * PITCH + 5.0, 0.5 * BLOCKS * PITCH, 11.0)
    street = PITCH * (np.arange(BLOCKS) - 0.5 * BLOCKS)
    s, a, side = (g.ravel() for g in np.meshgrid(street, along, [-3.0, 3.0]))
    along_z = np.stack([s + side, np.full_like(s, 6.0), a], axis=1)
    along_x = np.stack([a, np.full_like(s, 6.0), s + side], axis=1)
    center = np.concatenate([along_z, along_x])
    return rectangles(center, np.tile([0.05, 0.0, 0.0], (len(center), 1)), np.tile([0.0, 0.0, 0.05], (len(center), 1)))


def bulb_triangles(count: int, rng: np.random.Generator) -> Array:
    """Return (count, 8, 3, 3) octahedra that hang in garlands across the streets."""
    across = np.linspace(-0.5 * STREET, 0.5 * STREET, 18)[1:-1]
    sag = 1.2 * (1.0 - (2.0 * across / STREET) ** 2)
    along = np.arange(-0.5 * BLOCKS * PITCH + 6.0, 0.5 * BLOCKS * PITCH, 3.4)
    street = PITCH * (np.arange(BLOCKS) - 0.5 * BLOCKS)
    s, a, k = (g.ravel() for g in np.meshgrid(street, along, np.arange(len(across)), indexing="ij"))
    center = np.stack([s + across[k], 7.6 - sag[k] + 0.3 * np.sin(a), a], axis=1)
    garlands = center.reshape(-1, len(across), 3)
    center = garlands[rng.permutation(len(garlands))].reshape(-1, 3)[:count]
    corners = 0.045 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return center[:, None, None] + corners[faces]


def window_quads(low: Array, sides: Array, heights: Array, rng: np.random.Generator) -> Array:
    """Return (N, 2, 4, 3) both panes of all windows, in random order."""
    found = []
    for a, side, height in zip(low, sides, heights, strict=True):
        floors = np.arange(1.2 + FLOOR, height - 1.0, FLOOR)
        places = np.arange(1.3, side[0] - 1.0, WINDOW)
        y, p = (g.ravel() for g in np.meshgrid(floors, places))
        for normal in ([0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0]):
            n = np.array(normal, np.float64)
            u = np.cross([0.0, 1.0, 0.0], n)
            middle = np.array([a[0] + 0.5 * side[0], 0.0, a[1] + 0.5 * side[1]])
            wall = middle + n * (0.5 * side[0] + 0.02)
            center = wall + u * (p - 0.5 * side[0])[:, None] + np.array([0.0, 1.0, 0.0]) * y[:, None]
            half_u, half_v = np.broadcast_to(0.3 * u, center.shape), np.broadcast_to([0.0, 0.75, 0.0], center.shape)
            panes = [rectangles(center + shift * u, half_u, half_v) for shift in (-0.34, 0.34)]
            found.append(np.stack(panes, axis=1))
    windows = np.concatenate(found)
    rng.shuffle(windows)
    return windows


PICTURES = {"city": Picture(city, spp=1024)}
