"""A city at night, lit by a hundred thousand small lights, for docs/lights.md."""

from __future__ import annotations

from night_city import night_city

import wrt

from .picture import Picture

LIGHTS = 100_000
"""Emissive triangles."""

BLOCKS = 10
"""Houses either way: so few that each has many lights."""


def city() -> wrt.Scene:
    """Return a street between houses, under lamps, garlands of bulbs and windows."""
    scene = night_city(LIGHTS, blocks=BLOCKS)
    scene.settings.exposure = -1.8
    return scene


PICTURES = {"city": Picture(city, spp=1024)}
