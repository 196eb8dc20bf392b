"""The environment's texels and the table that samples them by brightness."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.build.alias import make_alias_table
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


def texel_weights(pixels: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return (H, W) luminance times solid angle of each texel, as bilinear interpolation spreads it.

    The mean of the interpolated image over one texel is its texels weighted 1/8, 3/4, 1/8 along
    each axis, so no texel that receives light from a neighbour is left with a density of zero.
    """
    luminance = pixels.astype(np.float64) @ LUMINANCE
    rows = np.pad(luminance, ((1, 1), (0, 0)), mode="edge")
    luminance = 0.125 * rows[:-2] + 0.75 * rows[1:-1] + 0.125 * rows[2:]
    columns = np.pad(luminance, ((0, 0), (1, 1)), mode="wrap")
    luminance = 0.125 * columns[:, :-2] + 0.75 * columns[:, 1:-1] + 0.125 * columns[:, 2:]
    height, width = luminance.shape
    edges = np.cos(np.linspace(0.0, math.pi, height + 1))
    solid_angle = (edges[:-1] - edges[1:]) * (2.0 * math.pi / width)
    weights: NDArray[np.float64] = luminance * solid_angle[:, None]
    return weights


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
    weights = texel_weights(pixels)
    table = make_alias_table(weights.ravel())
    data.height, data.width = pixels.shape[:2]
    data.texels = wp.array(pixels.reshape(-1, 3), dtype=wp.vec3, device=device)
    data.rotation = wp.mat33(*rotation_matrix(environment.rotation_axis, environment.rotation_degrees).T.ravel())
    data.thresholds = wp.array(table.thresholds, dtype=float, device=device)
    data.aliases = wp.array(table.aliases, dtype=int, device=device)
    data.probabilities = wp.array(table.probabilities.astype(np.float32), dtype=float, device=device)
    return data, float(weights.sum())
