"""Registration of custom cameras, integrators, lights, materials, shapes and textures by name, for scene files."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from wrt.errors import InputError
from wrt.scene.camera import CAMERAS, Camera
from wrt.scene.exact.distances import SHAPES, DistanceShape
from wrt.scene.integrators import INTEGRATORS, Integrator, kinds_of
from wrt.scene.lights import LIGHTS, Light
from wrt.scene.materials import MATERIALS, Material
from wrt.scene.procedural import TEXTURES
from wrt.scene.textures import Texture

if TYPE_CHECKING:
    from warp import Function

    from wrt.kernels.camera.camera import CameraModel
    from wrt.kernels.core.bsdf import Model
    from wrt.kernels.lights.record import LightModel

_BUILT_IN = "wrt."
"""Prefix of the modules of built-in classes."""


def register_camera(cls: type[Camera], model: CameraModel) -> None:
    """Make a custom camera known to scenes and scene files.

    A class of the same name from the same module replaces the one registered before, as when a notebook cell runs
    again. Existing renderers are not affected.

    Args:
        cls: the description, with a `type_name` and a `film`.
        model: its device functions.

    Raises:
        InputError: if `type_name` is empty or taken by another camera.
    """
    from wrt.kernels.camera.models import CAMERA_MODELS

    _register(CAMERAS, cls, lambda name, owner: CAMERA_MODELS.register(name, model, owner))


def register_integrator(cls: type[Integrator]) -> None:
    """Make a custom integrator known by its name; registering it again is as for `register_camera`.

    Args:
        cls: a dataclass of its numbers, with a `type_name` and a `make_trace`.

    Raises:
        InputError: if `type_name` is empty or taken, a field is no number, or there is no such function.
    """
    if not (isinstance(cls, type) and issubclass(cls, Integrator)):
        raise InputError(f"an integrator must be a class based on wrt.Integrator, not {cls!r}")
    if cls.make_trace is Integrator.make_trace:
        raise InputError(f"{cls.__name__} lacks the static method make_trace, which returns its device function")
    if "__dataclass_fields__" not in vars(cls):
        raise InputError(f"{cls.__name__} must be a @dataclass(frozen=True)")
    from wrt.kernels.integrators.own import OWN_INTEGRATORS, own_integrator

    def register(name: str, owner: str) -> None:
        OWN_INTEGRATORS.register(name, own_integrator(name, cls.make_trace, kinds_of(cls)), owner)

    _register(INTEGRATORS, cls, register)


def register_light(cls: type[Light], model: LightModel) -> None:
    """Make a custom light known to scenes and scene files; registering it again is as for `register_camera`.

    Args:
        cls: the description, with a `type_name`.
        model: its device functions.

    Raises:
        InputError: if `type_name` is empty or taken by another light, or the model lacks a function.
    """
    from wrt.kernels.lights.shapes import LIGHT_SHAPES

    _register(LIGHTS, cls, lambda name, owner: LIGHT_SHAPES.register(name, model, owner))


def register_material(cls: type[Material], model: Model | None = None) -> None:
    """Make a custom material known to scene files and `wrt materials`; see `register_camera` for registering it again.

    Args:
        cls: the description, with a `type_name`.
        model: its device functions, unless it uses the model of another material.

    Raises:
        InputError: if `type_name` is empty or taken by another material, or the model is invalid.
    """
    if model is None:
        _register(MATERIALS, cls, lambda name, owner: None)
        return
    from wrt.kernels.bsdf import register_model

    _register(MATERIALS, cls, lambda name, owner: register_model(name, model, owner))


def register_shape(cls: type[DistanceShape], distance: Function) -> None:
    """Make a custom shape known to scenes and scene files; registering it again is as for `register_camera`.

    Args:
        cls: the description, with a `type_name` and `bounds`.
        distance: its signed distance function (point: wp.vec3, number: float, ...) -> float, a Warp function.

    Raises:
        InputError: if `type_name` is empty or taken by another shape, or the function has other arguments.
    """
    from wrt.io.toml import scene_keys
    from wrt.io.toml.reader import shape_makers
    from wrt.kernels.geometry.distances import DISTANCES, distance_model

    def register(name: str, owner: str) -> None:
        DISTANCES.register(name, distance_model(name, distance), owner)

    if taken := scene_keys.SHAPE.keys() & {each.name for each in dataclasses.fields(cls)}:  # type: ignore[arg-type]
        raise InputError(
            f"{cls.__name__}: {', '.join(sorted(taken))} is a key of all shapes in scene files; rename the field"
        )
    if cls.type_name in shape_makers() and cls.type_name not in SHAPES:
        raise InputError(f"{cls.__name__}: type_name {cls.type_name!r} is empty or taken")
    _register(SHAPES, cls, register)


def register_texture(cls: type[Texture], evaluate: Function) -> None:
    """Make a procedural texture known to scenes and scene files; registering it again is as for `register_camera`.

    Args:
        cls: the description, with a `type_name` and `slot_names`.
        evaluate: the device function (values, surface) -> vec3; row k of `values` is that of name k.

    Raises:
        InputError: if `type_name` is empty or taken by another texture, or there are more than 16 values.
    """
    from wrt.kernels.textures.procedures import Procedure, register_procedure

    procedure = Procedure(evaluate, len(cls.slot_names))
    _register(TEXTURES, cls, lambda name, owner: register_procedure(name, procedure, owner))


def _register(registered: dict[str, Any], cls: Any, register_model: Callable[[str, str], None]) -> None:
    """Add a class to those registered, and its device functions by the name and the origin of the class."""
    previous = registered.get(cls.type_name, cls)
    is_taken = previous is None or previous.__module__.startswith(_BUILT_IN) or _origin(previous) != _origin(cls)
    if not cls.type_name or is_taken:
        raise InputError(f"{cls.__name__}: type_name {cls.type_name!r} is empty or taken")
    try:
        register_model(cls.type_name.replace("-", "_"), _origin(cls))
    except ValueError as error:
        raise InputError(f"{cls.__name__}: {error}") from None
    registered[cls.type_name] = cls


def _origin(cls: type) -> str:
    """Return the qualified name of a class, which identifies it when it is registered again."""
    return f"{cls.__module__}.{cls.__qualname__}"
