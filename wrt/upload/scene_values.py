"""Upload materials, media, lights and the environment of a scene, and change them later."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.errors import InputError
from wrt.scene.materials import Unlit
from wrt.scene.scene import Scene, Shape
from wrt.upload.bodies import BodyTable
from wrt.upload.lights.choice import upload_lights
from wrt.upload.lights.environment import environment_kind, upload_environment
from wrt.upload.lights.table import LightTable
from wrt.upload.materials import MaterialTable
from wrt.upload.prepare import PreparedScene

if TYPE_CHECKING:
    from wrt.kernels.core.features import Features

OF_MATERIALS = ("materials", "slots", "images", "texels", "texel_codes", "palettes", "normal_maps")
OF_BODIES = ("bodies", "media")
OF_LIGHTS = ("shapes", "lights", "light_thresholds", "light_aliases", "light_tree", "light_shapes", "light_boxes")
"""Fields of SceneData that materials, bodies and lights fill, as far as values of a scene change them."""


class SceneValues:
    """The materials, media, lights and environment of a scene on a device.

    Attributes:
        materials: the materials.
        bodies: the bodies and media.
        features: the features of the scene.
        light_counts: (shapes,) number of lights that each shape has.
    """

    def __init__(
        self,
        prepared: PreparedScene,
        first_triangles: NDArray[np.int64],
        data: Any,
        device: Device,
        light_choice: str,
    ) -> None:
        """Upload the values into a SceneData struct.

        Args:
            prepared: the scene.
            first_triangles: (shapes,) number of each shape's first triangle.
            data: the struct.
            device: the device.
            light_choice: one of `wrt.upload.lights.choice.LIGHT_CHOICES`.

        Raises:
            InputError: see `SceneUpload`.
        """
        from wrt.kernels.core.features import Features

        self._prepared, self._data, self._device = prepared.without_meshes(), data, device
        self._first_triangles, self._light_choice = first_triangles, light_choice
        self.light_counts = [len(shape.mesh.faces) if shape.emits else 0 for shape in prepared.scene.shapes]
        self.materials = materials = prepared.materials
        materials.upload(data, device)
        self.bodies = BodyTable(prepared.scene)
        self.bodies.upload(data, device)
        data.environment, self._flux = upload_environment(prepared.environment, device.name)
        self.features = Features(
            instances=prepared.layout.kind,
            tangents=materials.tangents,
            exact=prepared.exact,
            **self._features_of(prepared, self.bodies),
            **self._upload_lights(data, prepared, self.bodies, self._flux),
        )

    def change(self, scene: Scene) -> None:
        """Upload other values of the scene's shapes, lights, environment and media, as far as they differ.

        The texels of all images are then editable, as of a MaterialTable.

        Args:
            scene: the scene with these values; the objects that it shares with the one before are unchanged.

        Raises:
            InputError: when they need another kernel, or as `check_attributes` does; then nothing has changed.
            NotEnoughMemory: when the device lacks memory for the texels.
        """
        old, flux = self._prepared, self._flux
        if not self.materials.is_editable:
            size = 12 * self.materials.editable_texels
            what = "storing each texel of the images as a value that can change"
            self._device.require_memory(size, what, copies=0 if self._device.is_cpu else size)
        prepared = old.changed(scene)
        # Upload to a struct of its own, since the change may still be refused.
        data = current_backend().kernels("wrt.kernels.core.scene_data").SceneData()
        prepared.materials.upload(data, self._device)
        fields: list[str] = [*OF_MATERIALS]
        bodies = BodyTable(prepared.scene)
        if bodies.records != self.bodies.records or bodies.media != self.bodies.media:
            bodies.upload(data, self._device, grids_too=False)
            fields += OF_BODIES
        has_environment = prepared.environment is not old.environment
        if has_environment:
            data.environment, flux = upload_environment(prepared.environment, self._device.name)
            fields += ["environment"]
        features = self._features_of(prepared, bodies)
        if flux != self._flux or (has_environment and flux > 0.0) or not _same(_lights(prepared), _lights(old)):
            features |= self._upload_lights(data, prepared, bodies, flux)
            fields += OF_LIGHTS
        self._require(dataclasses.replace(self.features, tangents=prepared.materials.tangents, **features))
        for name in fields:
            setattr(self._data, name, getattr(data, name))
        self._prepared, self.materials, self.bodies, self._flux = prepared, prepared.materials, bodies, flux

    def _require(self, features: Features) -> None:
        """Raise InputError unless the scene's kernel renders these features."""
        pairs = ((name, getattr(self.features, name), value) for name, value in dataclasses.asdict(features).items())
        if different := [f"{name} {old!r} would be {new!r}" for name, old, new in pairs if old != new]:
            raise InputError(f"these values need another kernel ({'; '.join(different)}); make a new Renderer")

    def _upload_lights(self, data: Any, prepared: PreparedScene, bodies: BodyTable, flux: float) -> dict[str, Any]:
        """Upload the lights and the records of the shapes, and return their part of the features."""
        scene, materials = prepared.scene, prepared.materials
        slots = dict(zip(prepared.textures, materials.emission_slots[len(scene.shapes) :], strict=True))
        groups = scene.light_groups, None if scene.environment is None else scene.environment.group
        table = LightTable(scene.shapes, prepared.lights, prepared.layout, self._first_triangles, flux, slots, *groups)
        has_tree = upload_lights(data, table, self._device, self._light_choice)
        records = _shape_records(scene, materials, bodies, table, self._first_triangles)
        if data is not self._data:  # vertices may have got normals since
            records["smooth"] = current_backend().fetch(self._data.shapes)["smooth"]
        struct = current_backend().kernels("wrt.kernels.core.scene_data").ShapeRecord
        data.shapes = current_backend().array(records, struct, self._device.name)
        return {"light_shapes": table.shape_models, "light_tree": has_tree}

    @staticmethod
    def _features_of(prepared: PreparedScene, bodies: BodyTable) -> dict[str, Any]:
        """Return the part of the features that materials, bodies and the environment decide."""
        materials = prepared.materials
        single_sided, unlit = _sides(prepared.scene, materials)
        return {
            "models": materials.models,
            "textured": materials.textured,
            "environment": environment_kind(prepared.environment),
            # Shadow rays pass unlit surfaces from their front.
            "composite": "holes" if (single_sided & unlit).any() else materials.composite,
            "media": bodies.kind,
            "grid_media": bodies.has_grids,
            "nested": bodies.nested,
            "uv2_alpha": materials.uv2_alpha,
            "mipmapped": materials.mipmapped,
            "procedures": materials.procedures,
            "single_sided": bool((single_sided | unlit).any()),
        }


def _same(some: Sequence[object], others: Sequence[object]) -> bool:
    """Return whether two sequences hold the same objects."""
    return len(some) == len(others) and all(a is b for a, b in zip(some, others, strict=True))


def _lights(prepared: PreparedScene) -> list[object]:
    shapes = prepared.scene.shapes
    return [*(shape.emission for shape in shapes), *(shape.mesh for shape in shapes if shape.emits), *prepared.lights]


def _sides(scene: Scene, materials: MaterialTable) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return (shapes,) flags: whether only its front is seen, and whether it is unlit."""
    double_sided = np.array([shape.double_sided or shape.two_sided_emission for shape in scene.shapes])
    return ~(double_sided | materials.transmits), np.array(
        [isinstance(shape.material, Unlit) for shape in scene.shapes]
    )


def _shape_records(
    scene: Scene, materials: MaterialTable, bodies: BodyTable, lights: LightTable, first_triangles: NDArray[np.int64]
) -> NDArray[Any]:
    """Return a ShapeRecord for each shape."""
    record = current_backend().kernels("wrt.kernels.core.scene_data").ShapeRecord
    records = np.zeros(len(scene.shapes), record.numpy_dtype())
    records["material"] = materials.of_shapes
    records["first_triangle"] = first_triangles
    records["smooth"] = [_is_smooth(shape) for shape in scene.shapes]
    records["first_light"] = lights.first_lights
    records["emission_slot"] = materials.emission_slots[: len(scene.shapes)]
    for record, shape in zip(records, scene.shapes, strict=True):
        if record["emission_slot"] < 0:
            record["emission"] = shape.emission
    records["single_sided"], records["unlit"] = _, unlit = _sides(scene, materials)
    double_sided = np.array([shape.double_sided for shape in scene.shapes])
    emits_back = np.array([shape.two_sided_emission for shape in scene.shapes])
    records["two_sided"] = emits_back | (unlit & double_sided)
    records["edges"] = [shape.edges for shape in scene.shapes]
    records["body"] = bodies.of_shapes
    records["catches_shadows"] = [shape.shadow_catcher for shape in scene.shapes]
    return records


def _is_smooth(shape: Shape) -> bool:
    """Return whether a shape has vertex normals, at any time."""
    deforms = shape.deformation is not None and shape.deformation.normals is not None
    return deforms or shape.mesh.normals is not None
