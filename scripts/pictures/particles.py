"""Grains of sand that were poured on a heap, as exact spheres, for docs/simulations.md."""

from __future__ import annotations

import numpy as np

import wrt

from .picture import Picture

GRAINS = 200_000


def heap() -> wrt.Scene:
    """Return a cone of grains, a thin stream that falls on it, and some that have rolled away."""
    rng = np.random.default_rng(6)
    camera = wrt.PerspectiveCamera((0.0, 0.9, 3.6), (0.0, 0.42, 0.0), fov_degrees=34.0)
    scene = wrt.Scene(camera=camera, environment=wrt.SunSkyEnvironment(elevation_degrees=35.0, azimuth_degrees=-60.0))
    scene.add(wrt.quad((-90, 0, 5), (180, 0, 0), (0, 0, -180)), material=wrt.Diffuse((0.25, 0.23, 0.21)))
    radii = rng.uniform(0.004, 0.008, GRAINS)
    turn = rng.uniform(0.0, 2.0 * np.pi, GRAINS)
    # The cone has grains near its surface only, each at a random depth below it.
    out = 1.05 * np.sqrt(rng.random(GRAINS))
    high = 0.62 * (1.05 - out) - rng.uniform(0.0, 0.02, GRAINS)
    kind = rng.random(GRAINS)
    far = kind < 0.02
    out[far], high[far] = 1.03 + rng.exponential(0.12, far.sum()), 0.0
    falls = kind > 0.998
    out[falls] = 0.009 * np.sqrt(rng.random(falls.sum()))
    high[falls] = rng.uniform(0.64, 1.2, falls.sum())
    centers = np.stack([out * np.cos(turn), np.maximum(high, radii), out * np.sin(turn)], axis=1)
    sand, dark = np.array([0.62, 0.43, 0.22]), np.array([0.28, 0.12, 0.06])
    layer = (np.sin(60.0 * out + 2.0 * np.sin(3.0 * turn)) > 0.55)[:, None]
    colors = np.where(layer, dark, sand) * rng.uniform(0.6, 1.2, (GRAINS, 1))
    scene.add(wrt.spheres(centers, radii, colors=colors), material=wrt.Diffuse(wrt.VertexColor()), name="grains")
    return scene


PICTURES = {"particles": Picture(heap, 640, 360, 256)}
