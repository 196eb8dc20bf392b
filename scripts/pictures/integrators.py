"""One scene as each integrator shows it, and its layers, for docs/integrators.md.

Balls of glass and mirror float over a checkered floor, as in the picture by which ray trees became known.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np

import wrt
from wrt.develop.picture import develop_image
from wrt.rendering.picture import layer_colors
from wrt.scene.layers import LAYERS

from .bodies import checkered
from .picture import DevelopedSheet, Drawing, Picture, Pixels, Sheet, Tiles


def sky() -> wrt.ImageEnvironment:
    """Return a blue that is paler towards the horizon, and a dim ground."""
    height = np.cos(np.pi * (np.arange(64) + 0.5) / 64.0)[:, None]
    up = np.clip(height, 0.0, 1.0) ** 0.6
    row = np.where(height < 0.0, [0.12, 0.1, 0.08], [0.62, 0.72, 0.85] - up * np.array([0.5, 0.45, 0.25]))
    return wrt.ImageEnvironment(np.repeat(row[:, None], 128, axis=1).astype(np.float32), name="sky")


def make_scene(*, moving: bool = False) -> wrt.Scene:
    """Return the scene, in which one ball may roll to the right while the shutter is open."""
    camera = wrt.PerspectiveCamera(
        (0.3, 1.25, 4.4), (0.0, 0.78, 0.0), fov_degrees=38.0, shutter_close=1.0 if moving else 0.0
    )
    scene = wrt.Scene(camera=camera, environment=sky())
    light, dark = checkered(range(-9, 8), range(-14, 6))
    scene.add(light, material=wrt.Diffuse((0.75, 0.62, 0.12)), name="light squares")
    scene.add(dark, material=wrt.Diffuse((0.5, 0.06, 0.05)), name="dark squares")
    scene.add(wrt.sphere((-0.35, 1.05, 0.9), 0.55, subdivisions=5), material=wrt.Dielectric(ior=1.45), name="glass")
    scene.add(wrt.sphere((0.7, 0.72, -0.3), 0.6, subdivisions=5), material=wrt.Mirror(0.85), name="mirror")
    blue = wrt.Diffuse((0.2, 0.35, 0.5))
    scene.add(wrt.box((-1.75, 0.0, -1.6), (-1.0, 1.5, -0.85)), material=blue, name="block")
    scene.add(wrt.sphere((-1.25, 0.22, 1.1), 0.22, subdivisions=5), material=blue, name="blue ball")
    ball = wrt.sphere((1.35, 0.28, 1.0), 0.28, subdivisions=5)
    rolls = wrt.Motion.translation((0.1, 0.0, 0.0)) if moving else None
    scene.shapes.append(wrt.Shape(ball, wrt.Plastic((0.05, 0.3, 0.08)), name="ball", transform=rolls))
    scene.add_light(wrt.PointLight((-2.5, 5.0, 3.5), intensity=62.0))
    return scene


def layers_of(name: str, renderer: wrt.Renderer) -> list[tuple[Pixels, tuple[str]]]:
    """Return all layers of a picture, and their names."""
    del name
    return [
        (develop_image(layer_colors(layer, values), tone="none", exposure=0.0), (layer,))
        for layer, values in renderer.layers().items()
    ]


def shown_by(integrator: str, spp: int, **options: Any) -> Picture:
    """Return the scene as an integrator shows it."""
    return Picture(make_scene, 480, 288, spp, {"integrator": integrator, **options})


def make_sketched() -> wrt.Scene:
    """Return the scene, for one of the integrators of scripts/sketches.py."""
    wrt.load_models(Path(__file__).parents[1] / "sketches.py")
    return make_scene()


def own() -> Tiles:
    """Return the scene as the integrators of scripts/sketches.py show it."""
    options: dict[str, Any] = {"tone": "none", "exposure": 0.0}
    names = {"heat-map": "HeatMap", "depth-cue": "DepthCue", "toon": "Toon"}
    return {
        name: (Picture(make_sketched, 320, 192, 256, {"integrator": name, **options}), (label,))
        for name, label in names.items()
    }


ALL_LAYERS = {
    "integrator": "aov",
    "layers": tuple(name for name in LAYERS if name not in ("z", "edges")),
}  # z looks like depth
PICTURES: dict[str, Drawing] = {
    "integrator-whitted": shown_by("whitted", 128, max_depth=12),
    "integrator-path": shown_by("path", 256, max_depth=32),
    "integrator-direct": shown_by("direct", 256),
    "integrator-ao": shown_by("ao", 512, ao_distance=2.0),
    "own-integrators": Sheet(own, 3),
    "layers": DevelopedSheet(
        {"layers": Picture(functools.partial(make_scene, moving=True), 320, 192, 32, ALL_LAYERS)}, layers_of, 5
    ),
}
