"""One small set under each kind of light, for docs/lights.md.

Three balls, matt, metal and glass, stand before a wall; in the open the last one is plastic.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

import wrt
from wrt.scene.lights.punctual import FALLOFFS

from .picture import Picture


def stage(last: wrt.Material | None = None) -> wrt.Scene:
    """Return floor, wall and balls, without light; the last ball is glass if nothing else."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.3, 1.3, 5.2), (0.0, 0.75, 0.0), fov_degrees=30.0))
    scene.settings.max_depth = 16
    scene.add(wrt.quad((-9, 0, 9), (18, 0, 0), (0, 0, -10.4)), material=wrt.Diffuse((0.55, 0.53, 0.5)))
    scene.add(wrt.quad((-9, 0, -1.4), (18, 0, 0), (0, 7, 0)), material=wrt.Diffuse((0.6, 0.6, 0.62)))
    scene.add(wrt.sphere((-1.15, 0.45, 0.1), 0.45, subdivisions=6), material=wrt.Diffuse((0.7, 0.25, 0.15)))
    scene.add(wrt.sphere((0.0, 0.45, -0.3), 0.45, subdivisions=6), material=wrt.RoughConductor(0.15, metal="copper"))
    scene.add(wrt.sphere((1.05, 0.45, 0.3), 0.45, subdivisions=6), material=last or wrt.Dielectric())
    return scene


def spots() -> wrt.Scene:
    """Three spots, each with another way to fade."""
    scene = stage()
    colors = ((1.0, 0.85, 0.7), (0.75, 1.0, 0.8), (0.7, 0.85, 1.0))
    for x, falloff, color in zip((-1.35, 0.0, 1.35), FALLOFFS, colors, strict=True):
        color = tuple(26.0 * c for c in color)
        cone = {"inner_degrees": 2.5, "outer_degrees": 9.0}
        scene.add_light(wrt.SpotLight((x, 1.3, 2.8), (0.0, 0.05, -4.2), color=color, falloff=falloff, **cone))
    scene.environment = wrt.ConstantEnvironment(0.14)
    return scene


def shapes() -> wrt.Scene:
    """A rectangle, a disk and a ball, exact, and no triangle among them."""
    scene = stage()
    scene.add_light(
        wrt.RectangleLight((-2.0, 0.55, -0.9), (0.5, 0.0, -0.35), (0.0, 1.25, 0.0), radiance=(3.0, 4.0, 6.5))
    )
    scene.add_light(wrt.DiskLight((0.0, 1.75, -0.8), (0.0, -0.5, 1.0), 0.35, radiance=(7.0, 6.5, 6.0)))
    scene.add_light(wrt.SphereLight((1.75, 0.3, -0.6), 0.3, radiance=(7.0, 4.2, 1.8)))
    return scene


def color_bars(height: int = 180, width: int = 320) -> NDArray[np.float32]:
    """Return bars of colour over a ramp, round a ring: what a screen may show."""
    v, u = np.meshgrid(np.linspace(0, 1, height), np.linspace(0, 1, width), indexing="ij")
    bar = np.minimum((u * 7.0).astype(int), 6)
    pixels = np.stack([(bar >> k & 1) ^ 1 for k in (1, 2, 0)], axis=-1).astype(np.float32)
    pixels[v > 0.78] = u[v > 0.78][:, None]
    ring = np.abs(np.hypot((u - 0.5) * width, (v - 0.42) * height) - 0.3 * height) < 0.04 * height
    pixels[ring] = 1.0
    return pixels


def screen() -> wrt.Scene:
    """A screen that emits an image."""
    scene = stage()
    image = wrt.ImageTexture(color_bars(), factor=1.6)
    pane = wrt.quad((-1.5, 1.0, -1.3), (3.0, 0.0, 0.0), (0.0, 1.05, 0.0))
    scene.add(pane, material=wrt.Diffuse(0.0), emission=image)
    scene.environment = wrt.ConstantEnvironment(0.09)
    return scene


def sky(elevation: float, turbidity: float, exposure: float | None) -> wrt.Scene:
    """The balls in the open, under sun and sky, the last one without the noise of the sun's light through glass."""
    scene = stage(wrt.RoughPlastic((0.04, 0.12, 0.3), alpha=0.08))
    del scene.shapes[1]
    ground = (0.3, 0.28, 0.25)
    scene.shapes[0] = wrt.Shape(wrt.quad((-60, 0, 60), (120, 0, 0), (0, 0, -120)), wrt.Diffuse(ground), name="ground")
    scene.environment = wrt.SunSkyEnvironment(elevation, 32.0, turbidity=turbidity, ground_albedo=ground)
    scene.settings.exposure = exposure
    return scene


PICTURES = {
    "light-spots": Picture(spots, spp=2048),
    "light-shapes": Picture(shapes, spp=2048),
    "light-screen": Picture(screen, spp=2048),
    "light-sky-noon": Picture(functools.partial(sky, 48.0, 2.5, -5.4), spp=1024),
    "light-sky-evening": Picture(functools.partial(sky, 7.0, 3.0, -4.9), spp=1024),
}
