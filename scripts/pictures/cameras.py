"""One place, seen by every camera, for docs/cameras.md.

Pillars stand around three balls, and strings of lights hang between them, at dusk. All pictures share one kernel.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt
from wrt.scene.mesh import merge

from .bodies import checkered
from .picture import Picture

PILLARS = 12
RING = 4.0
"""Radius of the circle of pillars, metres."""
TOP = 3.6
"""Height of the pillars."""


EYE = (-1.1, 1.55, 2.6)
LENS: dict[str, Any] = {"aperture_radius": 0.07, "aperture": "polygon", "aperture_blades": 5, "focus_distance": 1.85}
CLOSE: dict[str, Any] = {"origin": (-0.35, 0.62, 2.3), "target": (0.12, 0.95, 0.35), "fov_degrees": 34.0}
LEVEL: dict[str, Any] = {"origin": (0.0, 1.0, 8.2), "fov_degrees": 46.0}


def sky() -> wrt.ImageEnvironment:
    """Return a dusk: orange at the horizon of -z, deep blue above, dark below."""
    rows, columns = 64, 128
    up = np.cos(np.pi * (np.arange(rows) + 0.5) / rows)[:, None, None]
    ahead = np.cos(2.0 * np.pi * (np.arange(columns) + 0.5) / columns - np.pi)[None, :, None]
    band = np.exp(-(np.clip(up, 0.0, 1.0) / 0.22)) * (0.35 + 0.65 * (0.5 + 0.5 * ahead) ** 2)
    above = np.array([0.035, 0.06, 0.15]) + band * np.array([0.62, 0.30, 0.14])
    return wrt.ImageEnvironment(np.where(up < 0.0, [0.03, 0.03, 0.035], above).astype(np.float32), name="sky")


def pillar_places() -> NDArray[np.float64]:
    """Return (PILLARS, 2) where pillars stand, x and z, none of them straight before or behind the balls."""
    angle = 2.0 * np.pi * (np.arange(PILLARS) + 0.5) / PILLARS
    return RING * np.stack([np.sin(angle), np.cos(angle)], axis=1)


def pillars() -> wrt.Mesh:
    """Return pillars with a base and a capital, turned to the middle."""
    parts = []
    for x, z in pillar_places():
        for half, low, high in ((0.24, 0.0, 0.22), (0.16, 0.22, TOP - 0.18), (0.24, TOP - 0.18, TOP)):
            body = wrt.box((-half, low, -half), (half, high, half))
            parts.append(body.rotated((0, 1, 0), float(np.degrees(np.arctan2(x, z)))).translated((x, 0.0, z)))
    return merge(parts, "pillars")


def lamps(first: int) -> wrt.Mesh:
    """Return every third of the little lights that hang in bows from pillar to pillar, and in one across."""
    bead = wrt.sphere((0, 0, 0), 0.028, subdivisions=1)
    places = pillar_places()
    strings = [(places[k], places[(k + 1) % PILLARS], 1.0) for k in range(PILLARS)]
    strings += [(places[k], places[k + PILLARS // 2], 1.2) for k in (1, 4)]
    points = []
    for start, end, sag in strings:
        count = max(6, int(np.linalg.norm(end - start) / 0.33))
        for share in (np.arange(count) + 0.5) / count:
            x, z = start + share * (end - start)
            points.append((x, TOP - 0.3 - 4.0 * sag * share * (1.0 - share), z))
    return merge([bead.translated(point) for point in points[first::3]], "lamps")


def make_scene(camera: wrt.Camera) -> wrt.Scene:
    """Return the place as a camera sees it."""
    scene = wrt.Scene(camera=camera, environment=sky())
    scene.settings.max_depth = 12
    scene.settings.exposure = 0.7
    light, dark = checkered(range(-12, 12), range(-12, 12))
    scene.add(light, material=wrt.Diffuse((0.5, 0.46, 0.42)))
    scene.add(dark, material=wrt.RoughPlastic((0.05, 0.055, 0.06), alpha=0.15))
    ground = wrt.quad((-40, -0.01, 40), (80, 0, 0), (0, 0, -80))
    scene.add(ground, material=wrt.Diffuse((0.09, 0.1, 0.07)), name="ground")
    scene.add(pillars(), material=wrt.Diffuse((0.62, 0.56, 0.48)))
    for first, color in enumerate(((24.0, 13.0, 5.0), (24.0, 17.0, 10.0), (20.0, 8.0, 3.0))):
        scene.add(lamps(first), material=wrt.Diffuse(0.0), emission=color)
    plinth = wrt.box((-0.9, 0.0, -0.1), (0.9, 0.35, 0.8))
    scene.add(plinth, material=wrt.Diffuse((0.4, 0.38, 0.36)), name="plinth")
    for x, z, material in (
        (-0.55, 0.25, wrt.RoughConductor(0.12, metal="gold")),
        (0.05, 0.45, wrt.Dielectric()),
        (0.6, 0.15, wrt.RoughPlastic((0.45, 0.03, 0.02), alpha=0.05)),
    ):
        scene.add(wrt.sphere((x, 0.6, z), 0.25), material=material, name="ball")
    return scene


def seen_by(camera: wrt.Camera, width: int, height: int, spp: int = 1024) -> Picture:
    """Return what a camera sees."""
    return Picture(functools.partial(make_scene, camera), width, height, spp)


NEAR_SPP = 8192
"""Where the light that glass and gold throw onto the plinth is seen closely."""

PICTURES = {
    "camera-bokeh": seen_by(wrt.PerspectiveCamera(**CLOSE, **LENS), 640, 360, NEAR_SPP),
    "camera-panorama": seen_by(wrt.PanoramaCamera(EYE, (EYE[0] + 0.35, EYE[1], EYE[2] - 1.0)), 720, 360),
    "camera-fisheye": seen_by(wrt.FisheyeCamera((0.0, 0.25, 1.3), (0.0, 1.1, 0.9), fov_degrees=180.0), 400, 400),
    "camera-orthographic": seen_by(wrt.OrthographicCamera((4.6, 6.4, 8.0), (0, 0.9, 0), view_height=10.5), 400, 400),
    "camera-tilted": seen_by(wrt.PerspectiveCamera(target=(0.0, 2.95, 0.0), **LEVEL), 320, 400),
    "camera-shifted": seen_by(wrt.PerspectiveCamera(target=(0.0, 1.0, 0.0), **LEVEL, shift_y=0.28), 320, 400),
    "camera-moving": seen_by(
        wrt.PerspectiveCamera(
            EYE,
            (0.0, 0.9, 0.0),
            fov_degrees=48.0,
            shutter_close=0.125,
            shutter_ramp=0.2,
            motion=wrt.Motion.rotation((0, 1, 0), 24.0, center=(0.0, 0.0, 0.35), times=(0.0, 0.125)),
        ),
        400,
        400,
        NEAR_SPP,
    ),
}
