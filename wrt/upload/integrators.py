"""Choose the integrator, its settings, and the features of its kernel."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.errors import Hint, InputError, warn
from wrt.linalg import product
from wrt.scene.environment import ConstantEnvironment, ImageEnvironment
from wrt.scene.integrators import INTEGRATORS, Integrator, integrator_name
from wrt.scene.layers import LIGHT_GROUPS
from wrt.scene.materials import ThinDielectric
from wrt.scene.materials.body import bodies_of
from wrt.scene.scene import RenderSettings, Scene
from wrt.upload.accel.instancing import is_moving
from wrt.upload.casters import share_of_smooth
from wrt.upload.lights.environment import resolve_environment

if TYPE_CHECKING:
    from wrt.kernels.core.features import Features

WITHOUT_LIGHT = ("ao", "aov")
"""Built-in integrators that can render a scene without light."""

WITH_PHOTONS = ("path", "volpath")
"""Integrators whose paths gather photons."""

WITH_GROUPS = ("path", "volpath", "direct")
"""Integrators that tell groups of lights apart."""

DIRECT_DEPTH = 2
"""Segments of a path with direct lighting only."""

DEEPEST_WHOLE_TREE = 20
WHOLE_TREE_ATTENUATION = 1e-6
"""A ray tree that attenuation does not prune may have 2^depth rays, a million at this depth."""


def needs_light(integrator: str) -> bool:
    """Return whether a picture is black if the scene has no light."""
    return integrator not in WITHOUT_LIGHT and INTEGRATORS[integrator] is None


def choose_integrator(scene: Scene, settings: RenderSettings) -> str:
    """Return the integrator's name, by default "volpath" if media scatter, otherwise "path".

    Raises:
        InputError: for an unlimited ray tree, for layers of light groups that cannot be rendered, and for caustics that
            cannot.
    """
    scatters = any(medium.scatters for medium in scene.media)
    name = integrator_name(settings.integrator) or ("volpath" if scatters else "path")
    if settings.wireframe:
        name = "aov"  # there is no light to show
    if settings.caustics and (obstacle := _obstacle_to_photons(scene, settings, name)):
        raise InputError(obstacle)
    if LIGHT_GROUPS in settings.layers:
        if name not in WITH_GROUPS:
            raise InputError(f"integrator {name!r} has no layers of light groups; use 'path' or 'volpath' for them")
        kernels = current_backend().kernels
        groups, most = scene.light_groups, kernels("wrt.kernels.integrators.light_groups").GROUPS - 1
        if len(groups) > most:
            raise InputError(f"the scene has {len(groups)} light groups, and a picture at most {most}; join some")
    if settings.wireframe:
        return name
    if name in ("path", "direct", "whitted") and scatters:
        warn(f"integrator {name!r} ignores scattering in media; use 'volpath' for it", UserWarning)
    if INTEGRATORS[name] is not None and scene.media:
        warn(f"integrator {name!r} ignores media; use 'volpath' for them", UserWarning)
    bodies = (body for shape in scene.shapes for body in bodies_of(shape.material))
    if name == "whitted" and any(getattr(body, "dispersion", 0.0) for body in bodies):
        what = "ignores dispersion and refracts all colours as green"
        warn(f"integrator 'whitted' {what}; use 'path' for it", UserWarning)
    if name == "whitted" and any(medium.density is not None for medium in scene.media):
        raise InputError("integrator 'whitted' cannot render media whose density varies; use 'path' or 'volpath'")
    endless = settings.max_depth > DEEPEST_WHOLE_TREE and settings.min_attenuation < WHOLE_TREE_ATTENUATION
    if name == "whitted" and endless:
        raise InputError(
            f"a ray tree of max_depth {settings.max_depth} and min_attenuation {settings.min_attenuation:g} may have "
            f"2^{settings.max_depth} rays; set max_depth to at most {DEEPEST_WHOLE_TREE}, or min_attenuation to at "
            f"least {WHOLE_TREE_ATTENUATION:g}"
        )
    return name


def _obstacle_to_photons(scene: Scene, settings: RenderSettings, integrator: str) -> str:
    """Return the message about what keeps photons from bringing caustics, or ""."""
    if integrator not in WITH_PHOTONS:
        return f"integrator {integrator!r} cannot render caustics by photons; use 'path' or 'volpath'"
    shutter = (0.0, 0.0) if scene.camera is None else (scene.camera.shutter_open, scene.camera.shutter_close)
    catches = any(shape.shadow_catcher for shape in scene.shapes)
    if catches and any(is_moving(shape, shutter) for shape in scene.shapes):
        # The picture without the other shapes would have other times.
        return "caustics on shadow catchers have no motion blur; leave one of the three out"
    return ""


def hint_at_caustics(scene: Scene, settings: RenderSettings, integrator: str) -> None:
    """Hint at `caustics` if glass or mirrors throw light that paths cannot find, as lights have no size."""
    if settings.caustics or not any(light.shape() is None and light.shines for light in scene.lights):
        return
    throwers = (shape.material for shape in scene.shapes if not isinstance(shape.material, ThinDielectric))
    if not _obstacle_to_photons(scene, settings, integrator) and 1.0 in map(share_of_smooth, throwers):
        what = "lights without a size throw no light through glass or off mirrors"
        warn(f"{what}; --caustics (in Python caustics=True) adds it", Hint)


def integrator_features(features: Features, integrator: str, settings: RenderSettings) -> Features:
    """Return the features of a scene as an integrator and the settings need them."""
    grouped = LIGHT_GROUPS in settings.layers
    features = dataclasses.replace(features, aovs=len(settings.film_layers) > grouped, light_groups=grouped)
    if "edges" in settings.film_layers:
        features = dataclasses.replace(features, edges="wires" if settings.wireframe else "surfaces")
    if features.caustics and not (settings.caustics and integrator in WITH_PHOTONS):
        features = dataclasses.replace(features, caustics=False)
    if integrator in ("path", "direct", "whitted") and features.media == "scattering":
        features = dataclasses.replace(features, media="unscattered")
    if integrator == "direct":
        return features
    if integrator in ("path", "volpath"):
        clamped, regularized = settings.clamp_indirect is not None, settings.regularization > 0.0
        return dataclasses.replace(features, clamped=clamped, regularized=regularized)
    if integrator != "whitted":
        features = dataclasses.replace(features, media="none", grid_media=False, nested=False)
    if integrator in WITHOUT_LIGHT:
        features = dataclasses.replace(features, environment="none", light_shapes=())
        if "albedo" not in settings.layers:
            features = dataclasses.replace(features, models=())
    if (cls := INTEGRATORS[integrator]) is not None:
        from wrt.kernels.integrators.own import OWN_INTEGRATORS

        integrator = OWN_INTEGRATORS.current_name(cls.type_name.replace("-", "_"))
    return dataclasses.replace(features, integrator=integrator)


def path_settings(scene: Scene, settings: RenderSettings, integrator: str, device: str) -> Any:
    """Return the kernels' PathSettings for a device, except for the strategy."""
    backend = current_backend()
    intersect = backend.kernels("wrt.kernels.core.ray_tree")
    path = backend.kernels("wrt.kernels.integrators.path_state").PathSettings()
    path.max_depth = min(settings.max_depth, DIRECT_DEPTH) if integrator == "direct" else settings.max_depth
    path.max_scatterings = settings.max_scatterings
    path.min_attenuation = settings.min_attenuation
    path.jittered_rays = settings.jittered_rays
    if integrator == "whitted":  # no other reads it, and a sky takes a tenth of a second
        path.ambient = mean_radiance(scene)
    path.ao_distance = intersect.INFINITE_DISTANCE if settings.ao_distance is None else settings.ao_distance
    path.clamp_indirect = math.inf if settings.clamp_indirect is None else settings.clamp_indirect
    path.is_sobol = int(settings.sampler == "sobol")
    path.hides_lights = int(settings.transparent)
    if isinstance(settings.integrator, Integrator):
        path.own = backend.array(_packed(settings.integrator), float, device)
    path.widening = 0.5 * settings.regularization**2  # α² of a slope's variance σ² is 2σ²
    return path


def _packed(integrator: Integrator) -> NDArray[np.float32]:
    """Return the numbers of an integrator in the memory of its kernels' struct."""
    from wrt.kernels.integrators.own import OWN_INTEGRATORS

    record = OWN_INTEGRATORS.model_of(OWN_INTEGRATORS.current_name(integrator.model)).Numbers.ctype()
    for name, value in dataclasses.asdict(integrator).items():
        setattr(record, name, value)
    memory = bytes(record)
    return np.frombuffer(memory.ljust(-(-len(memory) // 4) * 4, bytes(1)), np.float32)


def mean_radiance(scene: Scene) -> NDArray[np.float64]:
    """Return the mean radiance of the environment over all directions, without a sun."""
    environment, _ = resolve_environment(scene.environment)
    if isinstance(environment, ConstantEnvironment):
        return np.asarray(environment.radiance, np.float64)
    if isinstance(environment, ImageEnvironment):
        edges = np.cos(np.linspace(0.0, np.pi, len(environment.pixels) + 1))
        rows = environment.pixels.astype(np.float64).mean(axis=1)
        mean: NDArray[np.float64] = environment.scale * 0.5 * product(edges[:-1] - edges[1:], rows)
        return mean
    return np.zeros(3)
