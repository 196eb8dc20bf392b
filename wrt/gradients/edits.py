"""A scene with other values: its objects are replaced, and what shared an object shares the new one."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.scene.environment import Environment
from wrt.scene.materials import Material
from wrt.scene.medium import Medium
from wrt.scene.mesh import Mesh
from wrt.scene.normals import following_normals
from wrt.scene.scene import Scene, Shape
from wrt.scene.textures import ImageTexture
from wrt.values import Vec3, sealed

T = TypeVar("T")

AMOUNTS = ("intensity", "irradiance", "radiance", "power", "color")
"""Attributes of lights for the amount of light; setting one clears the others."""


@dataclass
class Edits:
    """Changes of a scene.

    Attributes:
        materials: new values of fields, by the `id` of the material.
        pixels: new pixels, by the `id` of the old ones.
        emissions: new emissions, by the number of the shape.
        vertices, normals: those of its mesh, likewise. Normals follow vertices that are given alone.
        lights: the field and its new value, by the number of the light.
        media: new values of fields, by the medium; equal media are one.
        environment: new values of the environment's fields.
        names: names of the parameters, for messages, by the key of the change in these.
    """

    materials: dict[int, dict[str, Any]] = field(default_factory=dict)
    pixels: dict[int, NDArray[np.float32]] = field(default_factory=dict)
    emissions: dict[int, Vec3] = field(default_factory=dict)
    vertices: dict[int, NDArray[np.float32]] = field(default_factory=dict)
    normals: dict[int, NDArray[np.float32]] = field(default_factory=dict)
    lights: dict[int, tuple[str, Any]] = field(default_factory=dict)
    media: dict[Medium, dict[str, Any]] = field(default_factory=dict)
    environment: dict[str, Any] = field(default_factory=dict)
    names: dict[Any, list[str]] = field(default_factory=dict)

    def name(self, key: Any, name: str) -> None:
        """Remember the name of a parameter that changes something."""
        self.names.setdefault(key, []).append(name)

    def applied(self, scene: Scene) -> Scene:
        """Return the changed scene; what is not changed is shared with the old one.

        Raises:
            InputError: when a value is out of range; it names the parameters.
        """
        return _Edited(self, scene).scene


def amount_changes(light: Any, field: str, value: Any) -> dict[str, Any]:
    """Return the fields to change so that a light has another amount, given in one of AMOUNTS."""
    return {each.name: None for each in dataclasses.fields(light) if each.name in AMOUNTS} | {field: value}


class _Edited:
    """Applies edits to a scene, to each object once."""

    def __init__(self, edits: Edits, scene: Scene) -> None:
        self._edits = edits
        self._done: dict[int, tuple[Any, Any]] = {}
        self._pixels = {key: sealed(pixels) for key, pixels in edits.pixels.items()}
        self.scene = dataclasses.replace(
            scene,
            shapes=[self._shape(i, shape) for i, shape in enumerate(scene.shapes)],
            lights=[self._light(i, light) for i, light in enumerate(scene.lights)],
            environment=self._environment(scene.environment),
            medium=None if scene.medium is None else self._medium(scene.medium),
        )

    def _once(self, old: T, make: Callable[[], T]) -> T:
        """Return what is made of an object, the same at each call."""
        if id(old) not in self._done:
            self._done[id(old)] = (old, make())
        new: T = self._done[id(old)][1]
        return new

    def _replaced(self, old: Any, changes: dict[str, Any], key: Any) -> Any:
        """Return an object with those fields that really change."""
        changes = {name: value for name, value in changes.items() if value is not getattr(old, name)}
        if not changes:
            return old
        try:
            return dataclasses.replace(old, **changes)
        except InputError as error:
            raise InputError(f"{', '.join(self._edits.names.get(key, [])) or type(old).__name__}: {error}") from None

    def _shape(self, number: int, shape: Shape) -> Shape:
        changes = {"material": self._material(shape.material), "emission": self._value(shape.emission)}
        if number in self._edits.emissions:
            changes["emission"] = self._edits.emissions[number]
        if number in self._edits.vertices or number in self._edits.normals:
            changes["mesh"] = self._mesh(number, shape.mesh)
        new: Shape = self._replaced(shape, changes, ("emission", number))
        return new

    def _mesh(self, number: int, mesh: Mesh) -> Mesh:
        vertices = self._edits.vertices.get(number, mesh.vertices)
        normals = self._edits.normals.get(number)
        if normals is None and mesh.normals is not None:
            normals = following_normals(mesh, vertices)
        return dataclasses.replace(mesh, vertices=vertices, normals=normals)

    def _value(self, value: Any) -> Any:
        """Return the value of a field of a material, or an emission, with its textures, media and parts changed."""
        if isinstance(value, ImageTexture):
            return self._once(value, lambda: self._texture(value))
        if isinstance(value, Material):
            return self._material(value)
        return self._medium(value) if isinstance(value, Medium) else value

    def _texture(self, texture: ImageTexture) -> ImageTexture:
        key = id(texture.pixels)
        new: ImageTexture = self._replaced(texture, {"pixels": self._pixels.get(key, texture.pixels)}, key)
        return new

    def _material(self, material: Material) -> Material:
        def make() -> Any:
            names = [each.name for each in dataclasses.fields(material)]
            changes = {name: self._value(getattr(material, name)) for name in names}
            return self._replaced(material, changes | self._edits.materials.get(id(material), {}), id(material))

        return self._once(material, make)

    def _light(self, number: int, light: Any) -> Any:
        changes = {"texture": self._value(light.texture)} if getattr(light, "texture", None) is not None else {}
        if number in self._edits.lights:
            changes |= amount_changes(light, *self._edits.lights[number])
        return self._replaced(light, changes, ("light", number))

    def _medium(self, medium: Medium) -> Medium:
        if medium not in self._edits.media:
            return medium
        new: Medium = self._once(medium, lambda: self._replaced(medium, self._edits.media[medium], medium))
        return new

    def _environment(self, environment: Environment | None) -> Environment | None:
        changes = dict(self._edits.environment)
        new: Environment | None = environment if not changes else self._replaced(environment, changes, "environment")
        return new
