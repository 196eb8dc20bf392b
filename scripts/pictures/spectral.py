"""What treats each colour in its own way, for docs/shading.md: thin films, and glass that disperses light."""

from __future__ import annotations

import wrt

from .bodies import ball, brilliant
from .materials import speck, stage
from .picture import Picture

THICKNESSES = (0.0, 35.0, 55.0, 90.0, 140.0)
"""Of oxides on titanium, nm."""

OXIDE = 2.4
"""Refractive index of the oxide."""


def titanium(thickness: float) -> wrt.Material:
    """Return titanium under its oxide."""
    return wrt.RoughConductor(0.15, metal="titanium", film_thickness=thickness, film_ior=OXIDE)


MATERIALS = (
    *(titanium(thickness) for thickness in THICKNESSES),
    wrt.Dielectric("diamond"),
    wrt.Dielectric("diamond", dispersion="diamond"),
    wrt.Dielectric("diamond", dispersion=2.0),
)


def with_all_materials(scene: wrt.Scene) -> wrt.Scene:
    """Return a scene that has the materials of both pictures, and with them the same kernel."""
    for material in MATERIALS:
        scene.add(speck(), material=material)
    return scene


def films() -> wrt.Scene:
    """Return balls of titanium, from left to right under more and more oxide."""
    scene = stage()
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 2.6, 14.0), target=(0.0, 0.72, 0.0), fov_degrees=11.4)
    for k, material in enumerate(MATERIALS[: len(THICKNESSES)]):
        scene.add(ball().scaled(0.7).translated((1.52 * (k - 2), 0.0, 0.0)), material=material)
    return with_all_materials(scene)


def stones() -> wrt.Scene:
    """Return three cut diamonds: without dispersion, with their own, and with that of rutile."""
    scene = stage()
    scene.camera = wrt.PerspectiveCamera(origin=(0.0, 3.2, 11.0), target=(0.0, 0.55, 0.0), fov_degrees=13.5)
    # Fire needs lights that are small.
    for x, y, z in ((-3.0, 5.0, 3.0), (1.0, 6.0, 2.0), (3.5, 4.0, 3.5), (0.0, 4.5, 6.0)):
        scene.add(wrt.sphere((x, y, z), 0.12), material=wrt.Diffuse(0.0), emission=120.0)
    for k, material in enumerate(MATERIALS[len(THICKNESSES) :]):
        scene.add(brilliant().translated((2.5 * (k - 1), 0.0, 0.0)), material=material)
    return with_all_materials(scene)


PICTURES = {
    "thin-films": Picture(films, 720, 240, 160),
    "dispersion": Picture(stones, 720, 260, 384),
}
