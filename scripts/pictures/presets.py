"""Optical constants, for docs/shading.md: swatches of all that have names, thin films, glass that disperses light."""

from __future__ import annotations

import functools

import wrt
from wrt.scene.materials.presets import ALIASES, DIELECTRIC_F0, DIELECTRIC_IOR, METAL_F0, METAL_IOR, SEMICONDUCTOR_F0

from .bodies import ball, brilliant
from .materials import speck, stage
from .picture import Drawing, Picture, Sheet, Tiles

SIZE = 120
"""Pixels of a swatch, either way."""

SPP = 256


@functools.cache
def swatches() -> dict[str, tuple[str, wrt.Material]]:
    """Return the label and the material of each swatch, by a name for the command line.

    A metal of two tables has two swatches: by its index, and by its printed reflectance.
    """
    dielectrics = [*DIELECTRIC_IOR, *(name for name in DIELECTRIC_F0 if ALIASES.get(name, name) not in DIELECTRIC_IOR)]
    found: dict[str, tuple[str, wrt.Material]] = {
        **{f"metal-{name}": ("metal", wrt.Conductor(metal=name)) for name in METAL_IOR},
        **{f"f0-{name}": ("f0", wrt.Conductor(f0=name)) for name in (*METAL_F0, *SEMICONDUCTOR_F0)},
        **{f"ior-{name}": ("ior", wrt.Dielectric(name)) for name in dielectrics},
    }
    return {name.replace(" ", "-"): swatch for name, swatch in found.items()}


def make_scene(name: str) -> wrt.Scene:
    """Return the set with a ball of one swatch; a speck of each kind makes all share a kernel."""
    scene = stage()
    scene.add(ball(), material=swatches()[name][1], name=name)
    for material in (wrt.Conductor(metal="gold"), wrt.Conductor(f0="gold"), wrt.Dielectric("water")):
        scene.add(speck(), material=material)
    return scene


def swatch_tiles() -> Tiles:
    """Return the picture of each swatch, with its name and the key that takes it."""
    return {
        name: (
            Picture(functools.partial(make_scene, name), SIZE, SIZE, SPP * (2 if key == "ior" else 1)),
            (name.partition("-")[2].replace("-", " "), key),
        )
        for name, (key, _) in swatches().items()
    }


# --- Thin films and dispersion ---------------------------------------------------------------------

THICKNESSES = (0.0, 35.0, 55.0, 90.0, 140.0)
"""Of oxides of index 2.4 on titanium, nm."""

MATERIALS = (
    *(wrt.RoughConductor(0.15, metal="titanium", film_thickness=t, film_ior=2.4) for t in THICKNESSES),
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


PICTURES: dict[str, Drawing] = {
    "presets": Sheet(swatch_tiles, columns=7),
    "thin-films": Picture(films, 720, 240, 160),
    "dispersion": Picture(stones, 720, 260, 384),
}
