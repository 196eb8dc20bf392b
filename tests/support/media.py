"""Scenes with media whose light is known, and few kernels for all of them."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

import wrt
from support.small_scenes import finish
from wrt.kernels.features import Features

FAR = 1000.0
"""The place of things that are present only for their materials, out of sight."""

MODELS = ("dielectric", "diffuse", "mirror", "null", "thin_dielectric")
KERNELS = [
    Features(MODELS, False, "image", light_tree=True, media=m, grid_media=g, nested=n)
    for m, g, n in itertools.product(("none", "absorbing", "scattering"), (False, True), (False, True))
]
"""Features of kernels for scenes like those of `stage`, by the sampler "independent": see `covering_kernels.py`."""


def stage(
    *, sky: float | tuple[float, float, float] = 0.0, medium: wrt.Medium | None = None, **camera: object
) -> wrt.Scene:
    """Return a scene with a camera at z = 3 that looks along −z, and specks of all materials out of sight."""
    view = {"origin": (0.0, 0.0, 3.0), "target": (0.0, 0.0, 0.0), "fov_degrees": 1e-5} | camera
    scene = wrt.Scene(camera=wrt.PerspectiveCamera(**view), medium=medium)  # type: ignore[arg-type]
    scene.environment = wrt.ConstantEnvironment(sky)
    for i, material in enumerate((wrt.Diffuse(), wrt.Dielectric(), wrt.ThinDielectric(), wrt.Null())):
        scene.add(wrt.box((FAR, i, 0.0), (FAR + 0.5, i + 0.5, 0.5)), material=material)
    return scene


def render(scene: wrt.Scene, device: str, *, size: tuple[int, int] = (2, 2), spp: int = 1, **options: object):
    """Return a renderer that has rendered independent samples, so that its variance is known."""
    options = {"sampler": "independent", "filter": "box", "device": device, **options}
    return finish(wrt.Renderer(scene, width=size[0], height=size[1], **options), spp)  # type: ignore[arg-type]


def mean_and_error(renderer: wrt.Renderer) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean of all pixels, and its standard error, per channel."""
    image = renderer.image().astype(np.float64)
    pixels = image.shape[0] * image.shape[1]
    return image.mean(axis=(0, 1)), np.sqrt(renderer.variance().sum(axis=(0, 1))) / pixels
