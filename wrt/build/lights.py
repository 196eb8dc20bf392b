"""The table of all lights: their records, what a tree over them must know, and how often each is chosen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.build.emission import mean_emissions
from wrt.build.environment import LUMINANCE, environment_kind, resolve_environment
from wrt.build.layout import Layout, is_moving
from wrt.build.light_bounds import LightBounds
from wrt.errors import InputError
from wrt.lights import FALLOFFS, DirectionalLight, DiskLight, Light, PointLight, RectangleLight, SphereLight, SpotLight
from wrt.scene import Scene, Shape

MOST_SOLID_LIGHTS = 64
"""Rectangles, disks and spheres in a scene: every ray is held against each of them."""

Array = NDArray[np.float64]


def has_light(scene: Scene) -> bool:
    """Return whether anything in a scene emits light."""
    return (
        any(shape.emits for shape in scene.shapes)
        or bool(scene.lights)
        or environment_kind(resolve_environment(scene.environment)[0]) != "none"
        or any(any(medium.emission) for medium in scene.media)  # type: ignore[arg-type]
    )


@dataclass(frozen=True)
class LightTable:
    """All lights of a scene.

    Attributes:
        records: (N,) LightRecord; probabilities are not yet filled in.
        shapes: (S,) LightShape: those that rays can hit first, then suns, then spots.
        solid_count, sun_count: of the shapes.
        first_lights: (shapes,) number of each emitting mesh's first light, −1 for the others.
        environment: number of the environment's light, or −1.
        weights: (N,) in proportion to how often each is chosen where nothing is known of the place.
        bounds: of the N lights.
    """

    records: NDArray[Any]
    shapes: NDArray[Any]
    solid_count: int
    sun_count: int
    first_lights: NDArray[np.int32]
    environment: int
    weights: Array
    bounds: LightBounds


def light_table(
    shapes: list[Shape],
    lights: list[Light],
    layout: Layout,
    first_triangles: NDArray[np.int64],
    environment_flux: float,
) -> LightTable:
    """Return the table of a scene's lights.

    Lights that are somewhere are chosen by power, lights infinitely far away by the irradiance they
    give; where a scene has both, each group gets half, since no length compares the two.

    Args:
        shapes: of the scene; those that emit are lights, one a triangle.
        lights: all that are no meshes.
        layout: where the shapes are kept.
        first_triangles: (shapes,) number of each shape's first triangle.
        environment_flux: luminance of the environment integrated over directions; 0 leaves it out.

    Raises:
        InputError: where there are more solid lights than MOST_SOLID_LIGHTS.
    """
    from wrt.kernels.scene_data import LIGHT_ENVIRONMENT, LightRecord, LightShape

    records: list[NDArray[Any]] = []
    bounds: list[LightBounds] = []
    first_lights = np.full(len(shapes), -1, np.int32)
    count = 0
    instances = layout.instance_numbers
    for i, shape in enumerate(shapes):
        if shape.emits:
            first_lights[i] = count
            record, extent = _emissive_mesh(shape, i, int(first_triangles[i]), layout.shutter)
            record["instance"] = instances.get(i, 0)
            records.append(record)
            bounds.append(extent)
            count += len(record)

    # Light shapes are sorted by what rays do with them; the lights themselves stay in their order.
    shaped = [i for i in sorted(range(len(lights)), key=lambda i: _order(lights[i])) if _light_shape(lights[i])]
    light_shapes = np.zeros(len(shaped), LightShape.numpy_dtype())
    solid_count = sum(_order(lights[i]) == 0 for i in shaped)
    if solid_count > MOST_SOLID_LIGHTS:
        raise InputError(
            f"the scene has {solid_count} rectangle, disk and sphere lights, and each ray is held against every one; "
            f"make all but {MOST_SOLID_LIGHTS} of them shapes with an emission"
        )
    for row, i in zip(light_shapes, shaped, strict=True):
        row["light"] = count + i
        for key, value in (_light_shape(lights[i]) or {}).items():
            row[key] = value
    for i, light in enumerate(lights):
        record, extent = _record(light)
        if i in shaped:
            record["shape"] = shaped.index(i)
        records.append(record)
        bounds.append(extent)
        count += 1
    environment = -1
    if environment_flux > 0.0:
        record = np.zeros(1, LightRecord.numpy_dtype())
        record["kind"] = LIGHT_ENVIRONMENT
        environment = count
        records.append(record)
        bounds.append(_far((0.0, 1.0, 0.0), environment_flux))
    if not records:
        records.append(np.zeros(0, LightRecord.numpy_dtype()))
        bounds.append(LightBounds.of(np.zeros((0, 1, 3)), np.zeros((0, 3)), np.zeros(0)))
    joined = LightBounds.joined(bounds)
    return LightTable(
        np.concatenate(records),
        light_shapes,
        solid_count,
        sum(_order(lights[i]) == 1 for i in shaped),
        first_lights,
        environment,
        _shares(joined),
        joined,
    )


def _shares(bounds: LightBounds) -> Array:
    far = bounds.is_far
    weights = bounds.power.copy()
    for group in (far, ~far):
        total = weights[group].sum()
        if total > 0.0:
            weights[group] /= total
    # Black lights all: what is seen of them must be known all the same.
    return weights if weights.any() else np.ones_like(weights)


# --- Each kind -------------------------------------------------------------------------------------


def _emissive_mesh(
    shape: Shape, number: int, first_triangle: int, shutter: tuple[float, float]
) -> tuple[NDArray[Any], LightBounds]:
    """One light a triangle. Normals are one; the power is π L A, on both sides where it has two.

    Of a shape that moves, power is that in the middle of the time, normals may point anywhere.
    """
    from wrt.kernels.scene_data import LIGHT_TRIANGLE, LightRecord

    mesh = shape.mesh_at(0.5 * sum(shutter))
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    means, luminance = mean_emissions(shape)
    records = np.zeros(len(corners), LightRecord.numpy_dtype())
    records["kind"] = LIGHT_TRIANGLE
    records["triangle"] = first_triangle + np.arange(len(corners))
    records["shape"] = number
    records["value"] = means
    records["two_sided"] = shape.two_sided_emission
    power = 0.5 * length * np.pi * luminance * (2.0 if shape.two_sided_emission else 1.0)
    axis = cross / np.maximum(length, 1e-300)[:, None]
    spread = 1.0
    if is_moving(shape, shutter):
        corners, spread = _way_of_corners(shape, shutter), -1.0
    extent = LightBounds.of(corners, axis, power, cos_spread=spread, two_sided=shape.two_sided_emission)
    return records, extent


def _way_of_corners(shape: Shape, shutter: tuple[float, float]) -> Array:
    """Return (T, 2, 3) boxes around the ways of triangles.

    The arc of a turn of less than 180 degrees lies no further from the box around its ends than half its chord.
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


def _record(light: Light) -> tuple[NDArray[Any], LightBounds]:
    """Return a light's record, its probability and its shape's number left open, and its extent."""
    from wrt.kernels.scene_data import (
        LIGHT_DIRECTIONAL,
        LIGHT_DISK,
        LIGHT_POINT,
        LIGHT_RECTANGLE,
        LIGHT_SPHERE,
        LIGHT_SPOT,
        LIGHT_SUN,
        LightRecord,
    )

    record = np.zeros(1, LightRecord.numpy_dtype())
    up = (0.0, 1.0, 0.0)
    if isinstance(light, PointLight):
        record["kind"], record["place"], record["value"] = LIGHT_POINT, light.position, light.intensity
        power = 4.0 * math.pi * _luminance(light.intensity)
        extent = LightBounds.of([[light.position]], up, power, cos_spread=-1.0)
    elif isinstance(light, SpotLight):
        record["kind"], record["place"], record["value"] = LIGHT_SPOT, light.position, light.intensity
        power = light.power_over_intensity * _luminance(light.intensity)
        # As one point of a surface that faces along the axis and shines no further than the outer cone.
        extent = LightBounds.of(
            [[light.position]], light.direction, power, cos_falloff=math.cos(math.radians(light.outer_degrees))
        )
    elif isinstance(light, DirectionalLight):
        toward = np.negative(light.direction)
        record["place"] = toward
        if light.angle_degrees > 0.0:
            sine = math.sin(math.radians(0.5 * light.angle_degrees))
            record["kind"] = LIGHT_SUN
            record["value"] = np.asarray(light.irradiance) / (math.pi * sine * sine)
        else:
            record["kind"], record["value"] = LIGHT_DIRECTIONAL, light.irradiance
        extent = _far(light.direction, _luminance(light.irradiance))
    elif isinstance(light, SphereLight):
        record["kind"], record["value"] = LIGHT_SPHERE, light.radiance
        center = np.array(light.center)
        power = 4.0 * math.pi**2 * light.radius**2 * _luminance(light.radiance)
        extent = LightBounds.of([[center - light.radius, center + light.radius]], up, power, cos_spread=-1.0)
    else:
        record["value"], record["two_sided"] = light.radiance, light.two_sided
        sides = 2.0 if light.two_sided else 1.0
        if isinstance(light, RectangleLight):
            record["kind"] = LIGHT_RECTANGLE
            o, u, v = np.array(light.origin), np.array(light.edge_u), np.array(light.edge_v)
            corners, normal = [o, o + u, o + v, o + u + v], np.cross(u, v)
            area = float(np.linalg.norm(normal))
            normal = normal / area
        else:
            record["kind"] = LIGHT_DISK
            normal, area = np.array(light.normal), math.pi * light.radius**2
            reach = light.radius * np.sqrt(np.maximum(1.0 - normal**2, 0.0))
            corners = [np.array(light.center) - reach, np.array(light.center) + reach]
        power = sides * math.pi * area * _luminance(light.radiance)
        extent = LightBounds.of([corners], normal, power, two_sided=light.two_sided)
    return record, extent


def _far(axis: ArrayLike, irradiance: float) -> LightBounds:
    return LightBounds.of(np.full((1, 1, 3), np.nan), axis, irradiance)


def _luminance(value: Any) -> float:
    return float(np.dot(value, LUMINANCE))


def _order(light: Light) -> int:
    """Return 0 for lights that rays can hit, 1 for suns, 2 for the others."""
    if isinstance(light, (RectangleLight, DiskLight, SphereLight)):
        return 0
    return 1 if isinstance(light, DirectionalLight) and light.angle_degrees > 0.0 else 2


def _light_shape(light: Light) -> dict[str, Any] | None:
    """Return the fields of a light's LightShape, its light's number left open; None where it has none."""
    from wrt.kernels.scene_data import LIGHT_DISK, LIGHT_RECTANGLE, LIGHT_SPHERE, LIGHT_SPOT, LIGHT_SUN

    if isinstance(light, RectangleLight):
        size = np.linalg.norm([light.edge_u, light.edge_v], axis=1)
        x, y = np.array(light.edge_u) / size[0], np.array(light.edge_v) / size[1]
        y = y - x * np.dot(x, y)
        y /= np.linalg.norm(y)
        return {"kind": LIGHT_RECTANGLE, "place": light.origin, "x": x, "y": y, "normal": np.cross(x, y), "size": size}
    if isinstance(light, DiskLight):
        return {"kind": LIGHT_DISK, "place": light.center, "normal": light.normal, "size": (light.radius,) * 2}
    if isinstance(light, SphereLight):
        return {"kind": LIGHT_SPHERE, "place": light.center, "size": (light.radius,) * 2}
    if isinstance(light, SpotLight):
        cosines = [math.cos(math.radians(angle)) for angle in (light.inner_degrees, light.outer_degrees)]
        falloff = FALLOFFS.index(light.falloff)
        return {"kind": LIGHT_SPOT, "normal": light.direction, "size": cosines, "falloff": falloff}
    if isinstance(light, DirectionalLight) and light.angle_degrees > 0.0:
        half = math.radians(0.5 * light.angle_degrees)
        size = (2.0 * math.sin(0.5 * half) ** 2, math.sin(half) ** 2)
        return {"kind": LIGHT_SUN, "normal": np.negative(light.direction), "size": size}
    return None
