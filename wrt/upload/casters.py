"""What photons are aimed at: the triangles and exact shapes that reflect or refract light in one direction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.errors import InputError
from wrt.linalg import norm
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.distances import Distances
from wrt.scene.materials import Material
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Scene
from wrt.upload.accel.instancing import Layout, is_moving
from wrt.upload.lights.choice import make_alias_table
from wrt.upload.materials import model_name

AIMED_AT = {"all": 1.0, "some": 0.1, "none": 0.0}
"""Photons by area for the `smooth_lobes` of a material: a coat reflects a few percent of the light."""

_MARGIN = 1e-3
"""By what share of its size the box exceeds the scene, as photons start on it."""


@dataclass(frozen=True)
class CasterTable:
    """The surfaces that throw caustics.

    Attributes:
        data: the Casters struct that the photon kernel takes.
        center: (3,) centre of the box around them.
        size: its diagonal, metres.
    """

    data: Any
    center: NDArray[np.float64]
    size: float

    def enclose(self, points: NDArray[np.float32]) -> None:
        """Extend the box of the scene to (N, 3) points that have moved: photons from far away must start outside."""
        low, high = _padded(points.min(axis=0), points.max(axis=0))
        self.data.low, self.data.high = np.minimum(self.data.low, low), np.maximum(self.data.high, high)


def share_of_photons(material: Material) -> float:
    """Return how many photons a material gets by its area, relative to glass."""
    return max(share_of_smooth(material), *map(share_of_photons, material.parts), float(material.is_nearly_smooth))


def share_of_smooth(material: Material) -> float:
    """Return the same for a material without what is nearly smooth, whose light lamps without a size find."""
    if material.parts:
        return max(share_of_smooth(part) for part in material.parts)
    lobes: str = current_backend().call("wrt.kernels.bsdf", "smooth_lobes", model_name(material))
    return AIMED_AT[lobes]


def upload_casters(scene: Scene, layout: Layout, first_triangles: NDArray[np.int64], device: str) -> CasterTable | None:
    """Return the casters of a scene, or None if nothing throws caustics.

    Of shapes that move, areas are means of those when the shutter opens, half way and when it closes.

    Args:
        scene: the scene.
        layout: the layout of its shapes.
        first_triangles: (shapes,) number of each shape's first triangle.
        device: the name of the device.
    """
    places: list[tuple[int, int, list[Mesh]]] = [
        (number, 0, [mesh]) for number, mesh in zip(layout.world_shapes, layout.world_meshes, strict=True)
    ]
    for each in layout.instances:
        moves = is_moving(scene.shapes[each.shape], layout.shutter)
        times = layout.times if moves else layout.times[:1]
        meshes = [scene.shapes[each.shape].mesh_at(time) for time in times]
        places.append((each.shape, layout.instance_numbers[each.shape], meshes))
    k = current_backend().kernels("wrt.kernels.integrators.photons")
    records, weights, corners = [], [], []
    for shape, instance, meshes in places:
        share = share_of_photons(scene.shapes[shape].material)
        if share == 0.0:
            continue
        if isinstance(meshes[0], Distances):
            raise InputError(f"{scene.shapes[shape].name}: photons cannot be aimed at shapes by distance functions")
        rows = np.zeros(len(meshes[0].faces), k.Caster.numpy_dtype())
        rows["triangle"] = first_triangles[shape] + np.arange(len(rows))
        rows["instance"], rows["shape"] = instance, shape
        records.append(rows)
        weights.append(share * np.mean([_areas(mesh) for mesh in meshes], axis=0))
        corners.append(meshes[len(meshes) // 2].bounds)
    if not records or not sum(each.sum() for each in weights) > 0.0:
        return None
    table = make_alias_table(np.concatenate(weights))
    joined = np.concatenate(records)
    joined["probability"] = table.probabilities
    backend, data = current_backend(), k.Casters()
    data.records = backend.array(joined, k.Caster, device)
    data.thresholds = backend.array(table.thresholds, float, device)
    data.aliases = backend.array(table.aliases, int, device)
    data.low, data.high = _padded(*scene.bounds)
    box = np.concatenate(corners)
    low, high = box.min(axis=0), box.max(axis=0)
    return CasterTable(data, 0.5 * (low + high), norm(high - low))


def light_places(scene: Scene, time: float) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the name and one point, (3,), of each light that is not infinitely far away, at a time in seconds."""
    for number, light in enumerate(scene.lights, 1):
        corners = light.extent().corners
        if corners is not None:
            yield light.name or f"light {number}", np.mean(corners, axis=0, dtype=np.float64)
    for number, shape in enumerate(scene.shapes, 1):
        if shape.emits:
            mesh = shape.mesh_at(time)
            points = mesh.bounds if isinstance(mesh, Analytic) else mesh.vertices[mesh.faces[0]]
            yield shape.name or f"shape {number}", points.mean(axis=0, dtype=np.float64)


def _padded(low: NDArray[Any], high: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    margin = _MARGIN * norm(high - low)
    return low - margin, high + margin


def _areas(mesh: Mesh) -> NDArray[np.float64]:
    """Return (T,) float64 areas of triangles or exact shapes, square metres."""
    if isinstance(mesh, Analytic):
        return mesh.areas
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas: NDArray[np.float64] = 0.5 * np.linalg.norm(across, axis=1)
    return areas
