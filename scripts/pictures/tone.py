"""Pictures of docs/tone.md: two scenes, each developed by every tone curve."""

from __future__ import annotations

import wrt
from wrt.develop.picture import develop

from .lights import sky
from .picture import DevelopedSheet, Picture, Pixels

TONES = ("none", "soft", "neutral", "agx", "aces", "ocio")


def developed(name: str, renderer: wrt.Renderer) -> list[tuple[Pixels, tuple[str, str]]]:
    """Return a picture by every tone curve with automatic exposure, and labels."""
    tiles = []
    for tone in TONES:
        result = develop(renderer.image(), tone=tone, exposure="auto")
        tiles.append((result.codes, (tone, f"{name}, {result.stops:+.1f} stops")))
    return tiles


def day() -> wrt.Scene:
    """Two balls in the open under a sun that is not high."""
    return sky(30.0, 2.5, 0.0)


def room() -> wrt.Scene:
    """A room with a coloured wall, a ball of each primary and a lamp that is seen."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 1.4, 2.9), (0, 1.15, 0), fov_degrees=52))
    white = wrt.Diffuse(0.7)
    scene.add(wrt.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=wrt.Diffuse((0.4, 0.25, 0.15)))
    scene.add(wrt.quad((-3, 3, -3), (6, 0, 0), (0, 0, 6)), material=white)
    scene.add(wrt.quad((-3, 0, -3), (6, 0, 0), (0, 3, 0)), material=white)
    scene.add(wrt.quad((-3, 0, 3), (0, 0, -6), (0, 3, 0)), material=wrt.Diffuse((0.6, 0.55, 0.2)))
    scene.add(wrt.quad((3, 0, -3), (0, 0, 6), (0, 3, 0)), material=white)
    scene.add(wrt.quad((3, 0, 3), (-6, 0, 0), (0, 3, 0)), material=white)
    for x, color in ((-1.2, (0.75, 0.03, 0.03)), (0.0, (0.05, 0.5, 0.05)), (1.2, (0.04, 0.08, 0.75))):
        scene.add(wrt.sphere((x, 0.45, -0.9), 0.45), material=wrt.Plastic(color))
    scene.add_light(wrt.SphereLight((0.5, 1.75, -1.6), 0.18, radiance=(80, 62, 40)))
    return scene


SCENES = {"a day": Picture(day, 400, 225, 256), "a room": Picture(room, 400, 225, 512)}
PICTURES = {"tone-curves": DevelopedSheet(SCENES, developed, 3)}
