"""The parameters of a scene by name: which there are, their values, and a scene with other ones."""

from __future__ import annotations

import dataclasses
import itertools
import weakref
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.errors import InputError, did_you_mean
from wrt.gradients.edits import AMOUNTS, Edits
from wrt.gradients.places import (
    BendingIndex,
    Coefficient,
    Emission,
    EnvironmentField,
    LightAmount,
    MaterialField,
    Place,
    Points,
    Texels,
    UnlitColor,
    can_move,
    channel_of,
    slot_values,
)
from wrt.scene.environment import ConstantEnvironment, ImageEnvironment, SphericalHarmonicsEnvironment
from wrt.scene.materials import Material, Unlit
from wrt.scene.materials.body import Body, bodies_of
from wrt.scene.medium import Medium
from wrt.scene.scene import Scene, Shape
from wrt.scene.textures import ImageTexture, VertexColor
from wrt.upload.lights.environment import environment_kind, resolve_environment
from wrt.upload.materials import model_name
from wrt.values import array

OF_ENVIRONMENTS = {
    ConstantEnvironment: ("environment.radiance", "radiance"),
    ImageEnvironment: ("environment.texels", "pixels"),
    SphericalHarmonicsEnvironment: ("environment.coefficients", "coefficients"),
}
"""The name of an environment's parameter, and its field."""

_FIELDS: dict[tuple[int, bool], tuple[weakref.ref[Material], tuple[str, ...]]] = {}
"""What `_fields_of` has found of materials that there still are: 1.4 ms each for one of many fields."""


def parameters(scene: Any) -> dict[str, NDArray[np.float32]]:
    """Return what `Renderer.set_parameters` can set and `Renderer.gradients` differentiates by, with their values.

    A name is the shape's name and a path of attributes: "floor.reflectance", "teapot.roughness",
    "floor.reflectance.texels" for the pixels of an image, "lamp.emission", "floor.first.alpha" of a Mix,
    "jar.interior.absorption"; of a light without a mesh its name or else its type, and the amount that it was given, as
    "point.intensity" or "point.power"; and "environment.radiance", "environment.texels", "environment.coefficients",
    "medium.absorption"; "teapot.vertices", and "teapot.normals" where the mesh has any, of shapes without a transform,
    a deformation or tangents. Normals follow vertices that are set, or differentiated by, without them, as in
    `Renderer.update_vertices`. The second of a name has "#2" after it, as "quad#2.emission". What several shapes share
    has the name of the first.

    A number has the shape (), a colour (3,), vertices (N, 3), an image (H, W, 3), or (H, W) where one channel of it is
    read or a grey image is the number. Colours and pixels are linear.

    Not among them are values whose derivative a kernel does not have: opacity and masks, weights of a Mix,
    normal maps, vertex colours, suns and skies, grids of densities, indices with dispersion; values that choose
    another kernel, such as a coat of 0; and those from which tables are made, such as `alpha` of a RoughPlastic.

    Args:
        scene: a Scene, or a Renderer for those of its scene as it is now.

    Raises:
        InputError: if it is neither.
    """
    described = getattr(scene, "scene", scene)
    if not isinstance(described, Scene):
        raise InputError(f"parameters are those of a wrt.Scene or a wrt.Renderer, not of a {type(scene).__name__}")
    return {name: place.value for name, place in places_of(described).items()}


def edited(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """Return a scene with other values of its parameters.

    Raises:
        InputError: when there is no such parameter, or a value has another shape, is not finite or out of range.
    """
    places, edits = places_of(scene), Edits()
    for name, value in mapping_of(values).items():
        place = places[known(name, places)]
        now = place.value
        new = array(value, name, np.float64)
        require_shape(name, place, new.shape)
        with np.errstate(over="ignore"):
            rounded = new.astype(np.float32)
        if not np.isfinite(rounded).all():
            raise InputError(f"{name} must be finite")
        if not np.array_equal(rounded, now):
            place.edit(name, new, edits)
    return edits.applied(scene)


def mapping_of(values: object) -> Mapping[str, Any]:
    """Return values by the names of parameters, or raise InputError if they are something else."""
    if not isinstance(values, Mapping):
        raise InputError(f"values must be a dictionary by the names of parameters, not a {type(values).__name__}")
    return values


def require_shape(name: str, place: Place, shape: tuple[int, ...]) -> None:
    """Raise InputError if a value has another shape than its parameter."""
    if shape != place.value.shape:
        raise InputError(f"{name} must have the shape {place.value.shape}, not {shape}")


def known(name: object, names: Iterable[str]) -> str:
    """Return the name of a parameter, or raise InputError if there is none of it."""
    names = list(names)
    if isinstance(name, str) and name in names:
        return name
    hint = did_you_mean(name, names) if names else "; the scene has none"
    raise InputError(f"there is no parameter {name!r}{hint}; wrt.parameters lists them")


def places_of(scene: Scene) -> dict[str, Place]:
    """Return the places of a scene's parameters by name."""
    return _Names(scene).places


class _Names:
    """Collects the parameters of a scene.

    Attributes:
        places: their places by name.
    """

    def __init__(self, scene: Scene) -> None:
        self.places: dict[str, Place] = {}
        self._used = {"environment", "medium"}
        self._seen: set[int] = set()
        self._media: set[Medium] = set()
        self._unlit: dict[int, UnlitColor] = {}
        self._images: dict[int, list[tuple[str, Texels, ImageTexture]]] = {}
        self._is_nested = any(body.priority for shape in scene.shapes for body in bodies_of(shape.material))
        meshes: dict[str, Place] = {}
        for number, shape in enumerate(scene.shapes):
            name = self._unused(shape.name)
            self._add_material(name, shape.material)
            if isinstance(shape.material, Unlit):
                self._add_unlit(name, number, shape)
            elif shape.emits and isinstance(shape.emission, ImageTexture):
                self._add_image(f"{name}.emission", shape.emission, number, is_number=False)
            elif shape.emits and not isinstance(shape.emission, VertexColor):
                self.places[f"{name}.emission"] = Emission(number, shape.emission)
            if can_move(shape):
                meshes[f"{name}.vertices"] = Points(number, shape.mesh, "vertices")
                if shape.mesh.normals is not None:
                    meshes[f"{name}.normals"] = Points(number, shape.mesh, "normals")
        self._add_lights(scene)
        self._add_images()
        if scene.medium is not None:
            self._add_medium("medium", scene.medium)
        environment = scene.environment
        if type(environment) in OF_ENVIRONMENTS and environment_kind(resolve_environment(environment)[0]) != "none":
            name, field = OF_ENVIRONMENTS[type(environment)]
            self.places[name] = EnvironmentField(environment, field)
        self.places |= meshes

    def _unused(self, name: str) -> str:
        """Return a name that nothing else has."""
        names = itertools.chain([name], (f"{name}#{number}" for number in itertools.count(2)))
        found = next(each for each in names if each not in self._used)
        self._used.add(found)
        return found

    def _add_lights(self, scene: Scene) -> None:
        textures = len(scene.shapes)
        for number, light in enumerate(scene.lights):
            name = self._unused(light.name or light.type_name)
            # The first of several follows from the one that was given.
            if amounts := [each for each in AMOUNTS if getattr(light, each, None) is not None]:
                self.places[f"{name}.{amounts[-1]}"] = LightAmount(number, light, amounts[-1])
            if isinstance(texture := getattr(light, "texture", None), ImageTexture):
                self._add_image(f"{name}.texture", texture, textures, is_number=False)
                textures += 1

    def _add_material(self, owner: str, material: Material) -> None:
        """Add what there is of a material that is not added yet, and of its parts."""
        if id(material) in self._seen:
            return
        self._seen.add(id(material))
        for field in dataclasses.fields(material):
            name, value = f"{owner}.{field.name}", getattr(material, field.name)
            if isinstance(value, Material):
                self._add_material(name, value)
            elif isinstance(value, Medium) and isinstance(material, Body) and material.is_body:
                self._add_medium(name, value)
            elif material.parts or field.name == "opacity":
                continue
            elif isinstance(value, ImageTexture):
                without = _slots_without_derivative(material)
                for slot, each in enumerate(material.slots):
                    if (
                        slot not in without
                        and isinstance(each, ImageTexture)
                        and each.pixels is value.pixels
                        and each.cutoff is None
                    ):
                        self._add_image(name, value, (material, slot), is_number=_is_number(material, field.name))
                        break
            elif field.name in _fields_of(material, self._is_nested):
                self.places[name] = _place_of(material, field.name)

    def _add_unlit(self, owner: str, number: int, shape: Shape) -> None:
        """Add the colour of an unlit material, or one more shape that it has, unless the shape has an emission."""
        color = shape.material.emission
        if isinstance(color, ImageTexture):
            if shape.emission is color:
                self._add_image(f"{owner}.color", color, number, is_number=False)
        elif not isinstance(color, VertexColor) and shape.emission == color:
            key = id(shape.material)
            if key not in self._unlit:
                self._unlit[key] = self.places[f"{owner}.color"] = UnlitColor(shape.material, [])
            self._unlit[key].numbers.append(number)

    def _add_image(
        self, name: str, texture: ImageTexture, user: tuple[Material, int] | int, *, is_number: bool
    ) -> None:
        if texture.cutoff is None:
            place = Texels(texture.pixels, channel_of(texture, is_number=is_number), user)
            self._images.setdefault(id(texture.pixels), []).append((f"{name}.texels", place, texture))

    def _add_images(self) -> None:
        """Add each image, or each of its channels, under the name of its first use."""
        for uses in self._images.values():
            # Of images with the same pixels one may have mip levels.
            user = next((place.user for _, place, texture in uses if texture.has_levels), uses[0][1].user)
            channels = {place.channel for _, place, _ in uses}
            overlap = len(channels) > 1 and not channels <= {0, 1, 2}
            for name, place, _ in uses[:1] if overlap else uses:
                channel = None if overlap else place.channel
                if channel in channels or overlap:
                    channels.discard(channel)
                    self.places[name] = Texels(place.pixels, channel, user)

    def _add_medium(self, owner: str, medium: Medium) -> None:
        if medium in self._media or medium.density is not None or medium.is_clear:
            return
        self._media.add(medium)
        self.places[f"{owner}.absorption"] = Coefficient(medium, "absorption")
        if medium.scatters:
            self.places[f"{owner}.scattering"] = Coefficient(medium, "scattering")
        if any(medium.emission):  # type: ignore[arg-type]
            self.places[f"{owner}.emission"] = Coefficient(medium, "emission")


def _fields_of(material: Material, is_nested: bool) -> tuple[str, ...]:
    """Return the fields of a material that are parameters; `is_nested`: where bodies have priorities."""
    key = id(material), is_nested
    found = _FIELDS.get(key)
    if found is None or found[0]() is not material:
        names = (each.name for each in dataclasses.fields(material))
        fields = tuple(name for name in names if _is_differentiable(MaterialField(material, name), is_nested))
        found = _FIELDS[key] = weakref.ref(material, lambda _: _FIELDS.pop(key, None)), fields
    return found[1]


def _is_differentiable(place: MaterialField, is_nested: bool) -> bool:
    """Return whether a field's value changes the slots of its material, and nothing else that kernels read."""
    material, value = place.material, getattr(place.material, place.field)
    if isinstance(value, (bool, int)) or not isinstance(value, (float, tuple)):
        return False
    changed = place.with_value(np.asarray(value, np.float64) * 1.001 + 1e-4)
    before, after = slot_values(material), slot_values(changed)
    if before.shape != after.shape or (before == after).all():
        return False
    # Nested bodies have their indices not from slots alone.
    same_indices = not is_nested or _indices(material) == _indices(changed)
    without = _slots_without_derivative(material)
    return (
        same_indices and _beside_slots(material) == _beside_slots(changed) and (before[without] == after[without]).all()
    )


def _place_of(material: Material, field: str) -> MaterialField:
    """Return the place of a field that is a parameter."""
    call = "wrt.kernels.gradients.bsdf", "bending_slot", model_name(material)
    place, slot = MaterialField(material, field), int(current_backend().call(*call))
    if slot >= 0 and place.value.ndim == 0 and place.derivative(())[slot].any():
        return BendingIndex(material, field, slot)
    return place


def _beside_slots(material: Material) -> tuple[Any, ...]:
    """Return what a kernel knows of a material besides its slots."""
    return material.model, material.table_key, material.needs_tangents


def _slots_without_derivative(material: Material) -> list[int]:
    call = "wrt.kernels.gradients.bsdf", "slots_without_derivative", model_name(material)
    return list(current_backend().call(*call))


def _indices(material: Material) -> tuple[Any, ...]:
    """Return the indices that nested bodies have beside the slots."""
    return tuple(getattr(material, name, None) for name in ("interior_ior", "interior_spread", "exterior_ior"))


def _is_number(material: Material, field: str) -> bool:
    """Return whether a field that has a texture would otherwise be a number, not a colour."""
    try:
        changes: dict[str, Any] = {field: 0.5}
        return not isinstance(getattr(dataclasses.replace(material, **changes), field), tuple)
    except InputError:
        return False
