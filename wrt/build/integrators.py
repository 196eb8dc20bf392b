"""What an integrator needs of a scene: its settings, and what its kernel contains."""

from __future__ import annotations

import dataclasses
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.build.environment import resolve_environment
from wrt.environment import ConstantEnvironment, ImageEnvironment
from wrt.errors import InputError
from wrt.scene import RenderSettings, Scene

if TYPE_CHECKING:
    from wrt.kernels.features import Features

WITHOUT_LIGHT = ("ao", "aov")
"""Integrators that show something of a scene without any light."""

DIRECT_DEPTH = 2
"""Segments of a path that sees light which came straight from a lamp to a surface."""

DEEPEST_WHOLE_TREE = 20
WHOLE_TREE_ATTENUATION = 1e-6
"""A ray tree that attenuation does not cut may have 2^depth rays: this deep they are still counted in millions."""


def choose_integrator(scene: Scene, settings: RenderSettings) -> str:
    """Return the integrator's name, by default "volpath" where media scatter, else "path".

    Raises:
        InputError: for a ray tree without limits.
    """
    scatters = any(medium.scatters for medium in scene.media)
    name = settings.integrator or ("volpath" if scatters else "path")
    if name in ("path", "direct") and scatters:
        warnings.warn(f"integrator {name!r} lets media only absorb and emit; 'volpath' has them scatter", stacklevel=4)
    elif name == "whitted" and any(not medium.is_clear for medium in scene.media):
        warnings.warn("integrator 'whitted' leaves out what is inside of bodies", stacklevel=4)
    endless = settings.max_depth > DEEPEST_WHOLE_TREE and settings.min_attenuation < WHOLE_TREE_ATTENUATION
    if name == "whitted" and endless:
        raise InputError(
            f"a ray tree of max_depth {settings.max_depth} and min_attenuation {settings.min_attenuation:g} may have "
            f"2^{settings.max_depth} rays; set max_depth to at most {DEEPEST_WHOLE_TREE}, or min_attenuation to at "
            f"least {WHOLE_TREE_ATTENUATION:g}"
        )
    return name


def integrator_features(features: Features, integrator: str, settings: RenderSettings) -> Features:
    """Return what the kernel of a scene with `features` contains: less where the integrator does not ask for it."""
    if settings.layers:
        features = dataclasses.replace(features, layers=True)
    if integrator in ("path", "direct") and features.media == "scattering":
        features = dataclasses.replace(features, media="absorbing")
    if integrator == "direct":
        return features
    if integrator in ("path", "volpath"):
        clamped, regularized = settings.clamp_indirect is not None, settings.regularization > 0.0
        return dataclasses.replace(features, clamped=clamped, regularized=regularized)
    features = dataclasses.replace(features, media="none", nested=False)
    if integrator in WITHOUT_LIGHT and "albedo" not in settings.layers:
        features = dataclasses.replace(features, models=())
    if integrator in WITHOUT_LIGHT:
        features = dataclasses.replace(features, environment="none", light_shapes=False)
    return dataclasses.replace(features, integrator=integrator)


def path_settings(scene: Scene, settings: RenderSettings, integrator: str) -> Any:
    """Return the kernels' PathSettings, but for the strategy."""
    import warp as wp

    from wrt.kernels.intersect import INFINITE_DISTANCE
    from wrt.kernels.path import PathSettings

    path = PathSettings()
    path.max_depth = min(settings.max_depth, DIRECT_DEPTH) if integrator == "direct" else settings.max_depth
    path.max_scatterings = settings.max_scatterings
    path.min_attenuation = settings.min_attenuation
    path.ambient = wp.vec3(*mean_radiance(scene))
    path.ao_distance = INFINITE_DISTANCE if settings.ao_distance is None else settings.ao_distance
    path.clamp_indirect = 0.0 if settings.clamp_indirect is None else settings.clamp_indirect
    path.widening = 0.5 * settings.regularization**2  # α² of a slope's variance σ² is 2σ²
    return path


def mean_radiance(scene: Scene) -> NDArray[np.float64]:
    """Return the environment's radiance, averaged over all directions, without a sun."""
    environment, _ = resolve_environment(scene.environment)
    if isinstance(environment, ConstantEnvironment):
        return np.asarray(environment.radiance, np.float64)
    if isinstance(environment, ImageEnvironment):
        edges = np.cos(np.linspace(0.0, np.pi, len(environment.pixels) + 1))
        rows = environment.pixels.astype(np.float64).mean(axis=1)
        mean: NDArray[np.float64] = environment.scale * 0.5 * ((edges[:-1] - edges[1:]) @ rows)
        return mean
    return np.zeros(3)
