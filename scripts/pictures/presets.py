"""A swatch of every named optical constant, for docs/shading.md, on the set of the materials' pictures."""

from __future__ import annotations

import functools

import wrt
from wrt.scene.materials.presets import ALIASES, DIELECTRIC_F0, DIELECTRIC_IOR, METAL_F0, METAL_IOR, SEMICONDUCTOR_F0

from .bodies import ball
from .materials import speck, stage
from .picture import Picture, Sheet

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


def pictures() -> dict[str, tuple[Picture, tuple[str, str]]]:
    """Return the picture of each swatch, with its name and the key that takes it."""
    return {
        name: (
            Picture(functools.partial(make_scene, name), SIZE, SIZE, SPP * (2 if key == "ior" else 1)),
            (name.partition("-")[2].replace("-", " "), key),
        )
        for name, (key, _) in swatches().items()
    }


PICTURES = {"presets": Sheet(pictures, columns=7)}
