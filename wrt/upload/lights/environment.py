"""Upload the environment: its texels, and the tables for sampling it."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.backend import current_backend
from wrt.linalg import weighted_sum
from wrt.scene.environment import (
    ConstantEnvironment,
    Environment,
    ImageEnvironment,
    SphericalHarmonicsEnvironment,
    SunSkyEnvironment,
)
from wrt.scene.lights import DirectionalLight
from wrt.scene.motion import rotation_matrix
from wrt.upload.arrays import require_countable
from wrt.upload.lights.environment_sampling import EnvironmentTables

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear Rec. 709 RGB in luminance."""


def resolve_environment(
    environment: Environment | None,
) -> tuple[ConstantEnvironment | ImageEnvironment | None, list[DirectionalLight]]:
    """Convert an environment to a type that kernels have, and a sun, if any, to a light."""
    if isinstance(environment, SphericalHarmonicsEnvironment):
        return environment.image(), []
    if isinstance(environment, SunSkyEnvironment):
        image, sun = environment.image_and_sun()
        return image, [] if sun is None else [sun]
    return environment, []


def environment_kind(environment: ConstantEnvironment | ImageEnvironment | None) -> str:
    """Return "none", which includes black ones, "constant" or "image"."""
    if environment is None:
        return "none"
    if isinstance(environment, ConstantEnvironment):
        return "constant" if any(environment.radiance) else "none"  # type: ignore[arg-type]
    return "image" if environment.scale > 0.0 and environment.pixels.any() else "none"


def upload_environment(environment: ConstantEnvironment | ImageEnvironment | None, device: str) -> tuple[Any, float]:
    """Return the EnvironmentData struct, and the integral of luminance over all directions.

    The integral is 0 for constant environments, which are best sampled by the BSDF alone.
    """
    backend = current_backend()
    k = backend.kernels("wrt.kernels.core.scene_data")
    data = k.EnvironmentData()
    data.rotation = np.eye(3)
    data.light = -1
    kind = environment_kind(environment)
    if kind == "none":
        return data, 0.0
    if isinstance(environment, ConstantEnvironment):
        data.radiance = environment.radiance
        return data, 0.0
    assert isinstance(environment, ImageEnvironment)
    require_countable(environment.pixels.shape[0] * environment.pixels.shape[1], "texels of the environment")
    pixels = environment.pixels * np.float32(environment.scale)
    image_to_world = rotation_matrix(environment.rotation_axis, environment.rotation_degrees)
    tables = EnvironmentTables(weighted_sum(pixels, LUMINANCE), image_to_world)
    data.height, data.width = pixels.shape[:2]
    data.texels = backend.array(pixels.reshape(-1, 3), "vec3", device)
    data.rotation = image_to_world.T
    data.cells = backend.array(tables.cells.ravel(), "uint16", device)
    data.bins = backend.array(tables.bins.ravel(), "uint16", device)
    data.side = tables.side
    return data, tables.flux
