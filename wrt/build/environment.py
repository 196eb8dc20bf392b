"""The environment on the device: its texels, and the tables that they are sampled by."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.build.environment_sampling import environment_tables
from wrt.environment import (
    ConstantEnvironment,
    Environment,
    ImageEnvironment,
    SphericalHarmonicsEnvironment,
    SunSkyEnvironment,
)
from wrt.lights import DirectionalLight
from wrt.motion import rotation_matrix

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear Rec. 709 RGB in the luminance Y."""


def resolve_environment(
    environment: Environment | None,
) -> tuple[ConstantEnvironment | ImageEnvironment | None, list[DirectionalLight]]:
    """Return what kernels know of for an environment that is described in another way: an image, and the sun."""
    if isinstance(environment, SphericalHarmonicsEnvironment):
        return environment.image(), []
    if isinstance(environment, SunSkyEnvironment):
        image, sun = environment.image_and_sun()
        return image, [] if sun is None else [sun]
    return environment, []


def environment_kind(environment: ConstantEnvironment | ImageEnvironment | None) -> str:
    """Return "none", "constant" or "image"; what is black is none."""
    if environment is None:
        return "none"
    if isinstance(environment, ConstantEnvironment):
        return "constant" if any(environment.radiance) else "none"  # type: ignore[arg-type]
    return "image" if environment.scale > 0.0 and environment.pixels.any() else "none"


def upload_environment(environment: ConstantEnvironment | ImageEnvironment | None, device: str) -> tuple[Any, float]:
    """Return the device's EnvironmentData and the integral of luminance over all directions.

    The integral is 0 for environments that are sampled by the BSDF alone: a constant one is found
    best by following the surface's own lobe.
    """
    import warp as wp

    from wrt.kernels.scene_data import EnvironmentData

    data = EnvironmentData()
    data.rotation = wp.mat33(*np.eye(3).ravel())
    data.light = -1
    kind = environment_kind(environment)
    if kind == "none":
        return data, 0.0
    if isinstance(environment, ConstantEnvironment):
        data.radiance = wp.vec3(*environment.radiance)  # type: ignore[misc]
        return data, 0.0
    assert isinstance(environment, ImageEnvironment)
    pixels = environment.pixels * np.float32(environment.scale)
    image_to_world = rotation_matrix(environment.rotation_axis, environment.rotation_degrees)
    tables = environment_tables(pixels @ LUMINANCE.astype(np.float32), image_to_world)
    data.height, data.width = pixels.shape[:2]
    data.texels = wp.array(pixels.reshape(-1, 3), dtype=wp.vec3, device=device)
    data.rotation = wp.mat33(*image_to_world.T.ravel())
    data.cells = wp.array(tables.cells.ravel(), dtype=wp.uint16, device=device)
    data.bins = wp.array(tables.bins.ravel(), dtype=wp.uint16, device=device)
    data.side = tables.side
    return data, tables.flux
