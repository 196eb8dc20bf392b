"""The table of all lights and how often each is chosen."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.build.environment import LUMINANCE
from wrt.lights import DirectionalLight, PointLight
from wrt.scene import Scene


def light_table(
    scene: Scene, first_triangles: NDArray[np.int64], environment_flux: float, dtype: Any
) -> tuple[NDArray[Any], NDArray[np.int32], NDArray[np.float64]]:
    """Return the light records, each shape's first light (−1: none), and the weights of the records.

    Lights that are somewhere are chosen by power, lights infinitely far away by the irradiance they
    give; where a scene has both, each group gets half, since no length compares the two.

    Args:
        scene: the description.
        first_triangles: (shapes,) number of each shape's first triangle.
        environment_flux: luminance of the environment integrated over directions; 0 leaves it out.
        dtype: numpy dtype of a LightRecord.
    """
    from wrt.kernels.scene_data import LIGHT_DIRECTIONAL, LIGHT_ENVIRONMENT, LIGHT_POINT, LIGHT_TRIANGLE

    near, near_weights = [np.zeros(0, dtype)], [np.zeros(0)]
    first_lights = np.full(len(scene.shapes), -1, np.int32)
    count = 0
    for i, shape in enumerate(scene.shapes):
        if not shape.emits:
            continue
        corners = shape.mesh.vertices[shape.mesh.faces].astype(np.float64)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        exitance = np.pi * float(np.dot(shape.emission, LUMINANCE)) * (2.0 if shape.two_sided_emission else 1.0)
        records = np.zeros(len(corners), dtype)
        records["kind"] = LIGHT_TRIANGLE
        records["triangle"] = first_triangles[i] + np.arange(len(corners))
        records["value"] = shape.emission
        records["two_sided"] = shape.two_sided_emission
        near.append(records)
        near_weights.append(0.5 * np.linalg.norm(cross, axis=1) * exitance)
        first_lights[i] = count
        count += len(corners)

    far, far_weights = [np.zeros(0, dtype)], [np.zeros(0)]
    for light in scene.lights:
        record = np.zeros(1, dtype)
        if isinstance(light, PointLight):
            record["kind"], record["place"], record["value"] = LIGHT_POINT, light.position, light.intensity
            near.append(record)
            near_weights.append(np.array([4.0 * np.pi * float(np.dot(record["value"][0], LUMINANCE))]))
        elif isinstance(light, DirectionalLight):
            record["kind"], record["value"] = LIGHT_DIRECTIONAL, light.irradiance
            record["place"] = np.negative(light.direction)
            far.append(record)
            far_weights.append(np.array([float(np.dot(record["value"][0], LUMINANCE))]))
    if environment_flux > 0.0:
        record = np.zeros(1, dtype)
        record["kind"] = LIGHT_ENVIRONMENT
        far.append(record)
        far_weights.append(np.array([environment_flux]))

    records = np.concatenate(near + far)
    groups = [np.concatenate(near_weights), np.concatenate(far_weights)]
    weights = np.concatenate([g / g.sum() if g.sum() > 0.0 else g for g in groups])
    return records, first_lights, weights
