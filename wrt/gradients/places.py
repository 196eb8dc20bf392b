"""The places of parameters in a scene: their values, how to change them, and the derivatives by them.

A kernel differentiates by the values that it reads from the device (`DeviceSums`). Values that the upload computes,
such as the ratio of two indices, are differentiated here, on the host.
"""

from __future__ import annotations

import copy
import dataclasses
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.gradients.edits import Edits, amount_changes
from wrt.gradients.sums import DeviceSums
from wrt.linalg import product
from wrt.scene.environment import SphericalHarmonicsEnvironment, harmonics, image_directions
from wrt.scene.exact.analytic import Analytic
from wrt.scene.materials import Material
from wrt.scene.medium import Medium
from wrt.scene.mesh import LARGEST, Mesh
from wrt.scene.normals import through_normals
from wrt.scene.scene import Shape
from wrt.scene.textures import CHANNELS
from wrt.values import color

Floats = NDArray[np.float64]

STEP, SMALLEST = 1e-5, 1e-3
"""Relative step of central differences, and the least size that it is relative to: for smooth functions in double
precision an error of 1e-10 or less."""


class Place(Protocol):
    """Where a parameter is in a scene."""

    @property
    def value(self) -> NDArray[np.float32]:
        """Its value."""

    def edit(self, name: str, value: Floats, edits: Edits) -> None:
        """Add the change to a value of the same shape, in which all numbers are finite; `name` is for messages."""

    def gradient(self, sums: DeviceSums) -> Floats:
        """Return the derivative of the loss by the value."""


def plain(value: Floats) -> Any:
    """Return a number, or numbers as a tuple, as fields of descriptions hold them."""
    return float(value) if value.ndim == 0 else tuple(float(x) for x in value)


@dataclass(frozen=True)
class MaterialField:
    """A number, or a few, of a material that its slots depend on."""

    material: Material
    field: str

    @property
    def value(self) -> NDArray[np.float32]:
        return np.asarray(getattr(self.material, self.field), np.float32)

    def edit(self, name: str, value: Floats, edits: Edits) -> None:
        edits.materials.setdefault(id(self.material), {})[self.field] = plain(value)
        edits.name(id(self.material), name)

    def with_value(self, value: Floats) -> Material:
        """Return the material with another value, unchecked: differences step across the ends of its range."""
        changed = copy.copy(self.material)
        object.__setattr__(changed, self.field, plain(value))
        return changed

    def derivative(self, index: tuple[int, ...]) -> Floats:
        """Return the derivative of the slots, (S, 3), by one of the numbers."""
        value = np.asarray(getattr(self.material, self.field), np.float64)
        step = np.zeros_like(value)
        step[index] = STEP * max(abs(float(value[index])), SMALLEST)
        above, below = (slot_values(self.with_value(value + sign * step)) for sign in (1.0, -1.0))
        return np.asarray((above - below) / (2.0 * step[index]))

    def gradient(self, sums: DeviceSums) -> Floats:
        result = np.zeros(self.value.shape)
        by_slots = sums.of_material(self.material)
        for index in np.ndindex(result.shape):
            result[index] = np.sum(self.derivative(index) * by_slots)
        return result


@dataclass(frozen=True)
class BendingIndex(MaterialField):
    """An index of smooth glass, on either side of it, which also bends light; `slot`: that of their ratio."""

    slot: int

    def gradient(self, sums: DeviceSums) -> Floats:
        return np.asarray(self.derivative(())[self.slot, 0] * sums.of_index(self.material))


def slot_values(material: Material) -> Floats:
    """Return the constants of a material's slots, (S, 3): the factors of textures."""
    values = [np.broadcast_to(np.asarray(getattr(slot, "factor", slot), np.float64), 3) for slot in material.slots]
    return np.array(values).reshape(-1, 3)


@dataclass(frozen=True)
class Texels:
    """The pixels of an image, or one of their channels.

    Attributes:
        pixels: (H, W, 3).
        channel: the number of the channel; None for all, and −1 where the three are one number.
        user: what reads it: a material and the number of its slot, or the number of an emission.
    """

    pixels: NDArray[np.float32]
    channel: int | None
    user: tuple[Material, int] | int

    @property
    def value(self) -> NDArray[np.float32]:
        return (self.pixels if self.channel is None else self.pixels[..., self.channel]).copy()

    def edit(self, name: str, value: Floats, edits: Edits) -> None:
        pixels = edits.pixels.setdefault(id(self.pixels), self.pixels.copy())
        if self.channel is None:
            pixels[...] = value
        elif self.channel < 0:
            pixels[...] = value[..., None]
        else:
            pixels[..., self.channel] = value
        edits.name(id(self.pixels), name)

    def gradient(self, sums: DeviceSums) -> Floats:
        by_texels = sums.of_texels(self.user)
        if self.channel is None:
            return by_texels
        return np.asarray(by_texels.sum(axis=2) if self.channel < 0 else by_texels[..., self.channel])


def can_move(shape: Shape) -> bool:
    """Return whether the vertices of a shape are parameters, as they are in the world."""
    fixed = shape.transform is not None or shape.deformation is not None or shape.shadow_catcher
    return not (fixed or isinstance(shape.mesh, Analytic) or shape.mesh.tangents is not None)


@dataclass(frozen=True)
class Points:
    """The vertices of a shape, or their normals.

    Attributes:
        number: the number of the shape.
        mesh: its mesh.
        field: "vertices" or "normals".
        normals_follow: whether normals depend on vertices.
    """

    number: int
    mesh: Mesh
    field: str
    normals_follow: bool = True

    @property
    def value(self) -> NDArray[np.float32]:
        return np.array(getattr(self.mesh, self.field))

    def edit(self, name: str, value: Floats, edits: Edits) -> None:
        if (largest := float(np.abs(value).max())) > LARGEST:
            raise InputError(f"{name}: a number is {largest:g}; rays reach to {LARGEST:g}")
        getattr(edits, self.field)[self.number] = value.astype(np.float32)
        edits.name(("mesh", self.number), name)

    def gradient(self, sums: DeviceSums) -> Floats:
        found = sums.of_points(self.field, self.number, len(self.mesh.vertices))
        if self.field == "vertices" and self.mesh.normals is not None and self.normals_follow:
            found = found + through_normals(self.mesh, sums.of_points("normals", self.number, len(found)))
        return found


@dataclass(frozen=True)
class Emission:
    """The emission of a shape, where it is one colour."""

    number: int
    emission: Any

    @property
    def value(self) -> NDArray[np.float32]:
        return np.asarray(self.emission, np.float32)

    def edit(self, name: str, value: Floats, edits: Edits) -> None:
        edits.emissions[self.number] = emission = color(value, name)
        if not np.any(np.asarray(emission, np.float32)):
            raise InputError(f"{name} must stay above 0 in a channel: without any the shape would be no light")
        edits.name(("emission", self.number), name)

    def gradient(self, sums: DeviceSums) -> Floats:
        return sums.of_emission(self.number)


@dataclass(frozen=True)
class UnlitColor:
    """The colour of an unlit material, which is the emission of shapes; `numbers`: their numbers."""

    material: Material
    numbers: list[int]

    @property
    def value(self) -> NDArray[np.float32]:
        return np.asarray(self.material.emission, np.float32)

    def edit(self, name: str, value: Floats, edits: Edits) -> None:
        new = color(value, name)
        edits.materials.setdefault(id(self.material), {})["color"] = new
        for number in self.numbers:
            edits.emissions[number] = new

    def gradient(self, sums: DeviceSums) -> Floats:
        return np.asarray(sum(sums.of_emission(number) for number in self.numbers))


@dataclass(frozen=True)
class LightAmount:
    """The amount of a light without a mesh, such as its intensity or power."""

    number: int
    light: Any
    field: str

    @property
    def value(self) -> NDArray[np.float32]:
        return np.asarray(getattr(self.light, self.field), np.float32)

    def edit(self, name: str, value: Floats, edits: Edits) -> None:
        edits.lights[self.number] = (self.field, color(value, name))
        edits.name(("light", self.number), name)

    def gradient(self, sums: DeviceSums) -> Floats:
        # What kernels read is proportional to it.
        one = dataclasses.replace(self.light, **amount_changes(self.light, self.field, 1.0))
        return sums.of_light(self.number) * np.asarray(one.record()["value"], np.float64)


@dataclass(frozen=True)
class EnvironmentField:
    """The radiance, pixels or coefficients of an environment."""

    environment: Any
    field: str

    @property
    def value(self) -> NDArray[np.float32]:
        return np.array(getattr(self.environment, self.field), np.float32)

    def edit(self, name: str, value: Floats, edits: Edits) -> None:
        edits.environment[self.field] = color(value, name) if value.ndim == 1 else value
        edits.name("environment", name)

    def gradient(self, sums: DeviceSums) -> Floats:
        if self.field == "radiance":
            return sums["environment"].reshape(3)
        by_texels: Floats = sums["environment_texels"] * self.environment.scale
        if not isinstance(self.environment, SphericalHarmonicsEnvironment):
            return by_texels.reshape(self.environment.pixels.shape)
        image = self.environment.image()
        directions = image_directions(*image.pixels.shape[:2]).reshape(-1, 3)
        # Negative sums count as 0, with a derivative of 0.
        by_sums = np.where(image.pixels.reshape(-1, 3) > 0.0, by_texels, 0.0)
        return product(harmonics(self.environment.degree, directions).T, by_sums)


@dataclass(frozen=True)
class Coefficient:
    """The absorption, the scattering or the emission of a homogeneous medium."""

    medium: Medium
    field: str

    @property
    def value(self) -> NDArray[np.float32]:
        return np.asarray(getattr(self.medium, self.field), np.float32)

    def edit(self, name: str, value: Floats, edits: Edits) -> None:
        edits.media.setdefault(self.medium, {})[self.field] = color(value, name)
        edits.name(self.medium, name)

    def gradient(self, sums: DeviceSums) -> Floats:
        return sums.of_medium(self.medium, self.field)


def channel_of(texture: Any, *, is_number: bool) -> int | None:
    """Return the channel of a texture's pixels that is its parameter, as `Texels.channel` has it."""
    if texture.channel is not None:
        return CHANNELS.index(texture.channel)
    pixels = texture.pixels
    grey = is_number and bool((pixels[..., :1] == pixels).all())
    return -1 if grey else None
