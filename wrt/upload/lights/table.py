"""Build the table of all lights: their records, bounds, and selection weights."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.backend import current_backend
from wrt.errors import InputError
from wrt.linalg import dot
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.quadrics import Quadrics
from wrt.scene.lights import Light
from wrt.scene.scene import Scene, Shape
from wrt.scene.textures import ImageTexture, shines
from wrt.upload.accel.instancing import Layout, is_moving
from wrt.upload.arrays import packed
from wrt.upload.lights.bounds import LightBounds
from wrt.upload.lights.boxes import light_boxes
from wrt.upload.lights.emission import mean_emissions
from wrt.upload.lights.environment import LUMINANCE, environment_kind, resolve_environment

SOLID, SUN = 0, 1
"""Values of `light_order` of `kernels/lights/shapes.py`: lights that rays can hit, and suns."""

Array = NDArray[np.float64]


def has_light(scene: Scene) -> bool:
    """Return whether anything in a scene emits light."""
    return (
        any(shines(shape.emission) for shape in scene.shapes)
        or any(light.shines for light in scene.lights)
        or environment_kind(resolve_environment(scene.environment)[0]) != "none"
        or any(any(medium.emission) for medium in scene.media)  # type: ignore[arg-type]
    )


def texture_of(light: Light) -> ImageTexture | None:
    """Return the image that multiplies a light, or None."""
    texture = getattr(light, "texture", None)
    return texture if isinstance(texture, ImageTexture) else None


class LightTable:
    """All lights of a scene.

    Finite lights are weighted by power, lights infinitely far away by irradiance. If a scene has both, each group gets
    half, because no length relates power to irradiance.

    Attributes:
        records: (N,) LightRecord, still without probabilities.
        shapes: (S,) LightShape: solid lights, which rays can hit, then suns, then spots.
        shape_models: names of the light models that the kernel needs.
        boxes: (B,) LightBox, the tree around the solid lights.
        solid_count, sun_count: number of solid lights and of suns.
        first_lights: (shapes,) number of each emitting mesh's first light, −1 for other meshes.
        environment: number of the environment's light, or −1.
        bounds: the bounds of the N lights.
        weights: (N,) selection weights, independent of position.
        groups: (N + 2,) number of the group, 0 for the rest: of what is no light of the table, as the emission of
            media, of each light, and of the environment.
    """

    def __init__(
        self,
        shapes: list[Shape],
        lights: list[Light],
        layout: Layout,
        first_triangles: NDArray[np.int64],
        environment_flux: float,
        texture_slots: dict[int, int],
        groups: tuple[str, ...] = (),
        environment_group: str | None = None,
    ) -> None:
        """List the lights of a scene.

        Args:
            shapes: shapes of the scene; each triangle of an emitting shape is a light.
            lights: all other lights.
            layout: the layout of the shapes.
            first_triangles: (shapes,) number of each shape's first triangle.
            environment_flux: luminance of the environment integrated over directions; 0 leaves it out.
            texture_slots: slot of a light's texture by the number of the light in `lights`.
            groups: names of the scene's light groups.
            environment_group: the environment's group.

        Raises:
            InputError: when a light's model is not registered.
        """
        k = current_backend().kernels("wrt.kernels.core.scene_data")
        records: list[NDArray[Any]] = [np.zeros(0, k.LightRecord.numpy_dtype())]
        bounds = [LightBounds.of(np.zeros((0, 1, 3)), np.zeros((0, 3)), np.zeros(0))]
        self.first_lights = np.full(len(shapes), -1, np.int32)
        numbers: dict[str | None, int] = {name: number for number, name in enumerate(groups, 1)}
        of_lights = [0]
        count = 0
        instances = layout.instance_numbers
        for i, shape in enumerate(shapes):
            if shape.emits:
                self.first_lights[i] = count
                record, extent = _emissive_mesh(shape, i, int(first_triangles[i]), layout.shutter)
                record["instance"] = instances.get(i, 0)
                records.append(record)
                bounds.append(extent)
                count += len(record)
                of_lights += [numbers.get(shape.group, 0)] * len(record)
        rows = self._list_lights(lights, count, texture_slots)
        bounds += [_extent(light) for light in lights]
        of_lights += [numbers.get(light.group, 0) for light in lights]
        self.environment = -1
        if environment_flux > 0.0:
            self.environment = count + len(lights)
            rows.append({"kind": k.LIGHT_ENVIRONMENT})
            bounds.append(_far((0.0, 1.0, 0.0), environment_flux))
            of_lights.append(numbers.get(environment_group, 0))
        self.groups = np.array([*of_lights, numbers.get(environment_group, 0)], np.int32)
        self.records: NDArray[Any] = np.concatenate([*records, packed(rows, k.LightRecord)])
        self.bounds = LightBounds.joined(bounds)
        self.weights = _shares(self.bounds)

    def _list_lights(self, lights: list[Light], first: int, texture_slots: dict[int, int]) -> list[dict[str, Any]]:
        """List the shapes of lights without triangles, numbered from `first` on, and return their records."""
        backend = current_backend()
        k = backend.kernels("wrt.kernels.core.scene_data")
        names, orders = _light_models(lights)
        order_of = [orders.get(name) for name in names]
        self.solid_count, self.sun_count = order_of.count(SOLID), order_of.count(SUN)
        built_in = backend.kernels("wrt.kernels.lights.shapes").BUILT_IN
        self.shape_models = (*built_in, *sorted(set(orders) - set(built_in))) if orders else ()
        kinds = {"point": int(k.LIGHT_POINT), "directional": int(k.LIGHT_DIRECTIONAL)}
        kinds |= {name: backend.call("wrt.kernels.lights.shapes", "light_kind", name) for name in self.shape_models}
        shaped = sorted((i for i, order in enumerate(order_of) if order is not None), key=lambda i: orders[names[i]])
        rows = [
            {"kind": kinds[names[i]], "light": first + i, "slot": texture_slots.get(i, -1), **(lights[i].shape() or {})}
            for i in shaped
        ]
        self.shapes = packed(rows, k.LightShape)
        self.boxes = light_boxes([lights[i].extent().corners for i in shaped[: self.solid_count]])
        numbers = {i: {"shape": number} for number, i in enumerate(shaped)}
        return [{**light.record(), **numbers.get(i, {}), "kind": kinds[names[i]]} for i, light in enumerate(lights)]


def _light_models(lights: list[Light]) -> tuple[list[str], dict[str, int]]:
    """Return the name of each light's model, and the order of the models that have a shape."""
    backend = current_backend()
    names, orders = [], {}
    for light in lights:
        name = light.model
        if light.shape() is not None:
            name = backend.call("wrt.kernels.lights.shapes", "current_name", light.model)
            try:
                orders[name] = backend.call("wrt.kernels.lights.shapes", "light_order", name)
            except KeyError:
                raise InputError(f"{type(light).__name__}: there is no light model {light.model!r}") from None
        names.append(name)
    return names, orders


def _shares(bounds: LightBounds) -> Array:
    far = bounds.is_far
    weights = bounds.power.copy()
    for group in (far, ~far):
        total = weights[group].sum()
        if total > 0.0:
            weights[group] /= total
    # If all lights are black, they still need records for the rays that hit them.
    return weights if weights.any() else np.ones_like(weights)


def _emissive_mesh(
    shape: Shape, number: int, first_triangle: int, shutter: tuple[float, float]
) -> tuple[NDArray[Any], LightBounds]:
    """Return one light for each triangle or exact shape, with the power π L A for each emitting side.

    The power of a moving shape is that in the middle of the exposure, and its normals may point anywhere.
    """
    k = current_backend().kernels("wrt.kernels.core.scene_data")
    mesh = shape.mesh_at(0.5 * sum(shutter))
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    means, luminance = mean_emissions(shape)
    records = np.zeros(len(corners), k.LightRecord.numpy_dtype())
    records["kind"] = k.LIGHT_TRIANGLE
    records["triangle"] = first_triangle + np.arange(len(corners))
    records["shape"] = number
    records["value"] = means
    records["two_sided"] = shape.two_sided_emission
    area, spread = 0.5 * length, 1.0
    axis = cross / np.maximum(length, 1e-300)[:, None]
    if isinstance(mesh, Analytic):
        area, spread = mesh.areas, -1.0
        axis = np.broadcast_to((0.0, 1.0, 0.0), axis.shape)
        if isinstance(mesh, Quadrics) and mesh.are_disks.all():
            axis, spread = mesh.fronts, 1.0
    power = area * np.pi * luminance * (2.0 if shape.two_sided_emission else 1.0)
    if is_moving(shape, shutter):
        corners, spread = _swept_corners(shape, shutter), -1.0
    extent = LightBounds.of(corners, axis, power, cos_spread=spread, two_sided=shape.two_sided_emission)
    return records, extent


def _swept_corners(shape: Shape, shutter: tuple[float, float]) -> Array:
    """Return (T, 2, 3) boxes around the paths of triangles.

    An arc of less than 180 degrees extends beyond the box around its ends by at most half its chord.
    """
    meshes = [shape.mesh_at(time) for time in np.linspace(*shutter, 33)]
    last = meshes[0].vertices[meshes[0].faces].astype(np.float64)
    low, high, step = last.min(axis=1), last.max(axis=1), 0.0
    for mesh in meshes[1:]:
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        step = max(step, float(np.linalg.norm(corners - last, axis=2).max()))
        low, high = np.minimum(low, corners.min(axis=1)), np.maximum(high, corners.max(axis=1))
        last = corners
    return np.stack([low - 0.5 * step, high + 0.5 * step], axis=1)


def _extent(light: Light) -> LightBounds:
    """Return the bounds of a light."""
    extent = light.extent()
    power = extent.power_over_amount * dot(extent.amount, LUMINANCE)
    if extent.corners is None:
        return _far(extent.axis, power)
    return LightBounds.of(
        [extent.corners],
        extent.axis,
        power,
        cos_spread=extent.cos_spread,
        cos_falloff=extent.cos_falloff,
        two_sided=extent.two_sided,
    )


def _far(axis: ArrayLike, irradiance: float) -> LightBounds:
    return LightBounds.of(np.full((1, 1, 3), np.nan), axis, irradiance)
