"""A small scene with everything that a general kernel covers.

Uploading it uses all functions of `kernels/` that uploads of such scenes need, so that they are noted with the kernel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wrt.backend.device import Device
from wrt.scene.camera import FisheyeCamera, OrthographicCamera, PanoramaCamera, PerspectiveCamera
from wrt.scene.environment import ImageEnvironment
from wrt.scene.lights import (
    DirectionalLight,
    DiskLight,
    Light,
    PointLight,
    ProjectorLight,
    RectangleLight,
    SphereLight,
    SpotLight,
)
from wrt.scene.materials import (
    Burley,
    Conductor,
    Dielectric,
    Diffuse,
    Glossy,
    Material,
    Mirror,
    Mix,
    Null,
    OrenNayar,
    Plastic,
    Principled,
    RoughConductor,
    RoughDielectric,
    RoughPlastic,
    ThinDielectric,
    TwoSided,
)
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Scene, Shape
from wrt.scene.textures import ImageTexture, NormalMap, VertexColor
from wrt.upload.camera import build_camera
from wrt.upload.scene_data import build_scene

_FACETS: tuple[dict[str, Any], ...] = (
    {"distribution": "beckmann", "masking": "walter"},
    {"distribution": "ggx", "masking": "smith"},
    {"distribution": "ggx", "masking": "smith-separable"},
)


def materials() -> list[Material]:
    """Return a material for each reflection model of the general kernels, and those that have no model of their own."""
    image = ImageTexture(np.full((4, 4, 3), 0.5, np.float32))
    normals = NormalMap(np.full((4, 4, 3), (0.5, 0.5, 1.0), np.float32), filter=False)
    diffuse, two_colors = Diffuse(image), Diffuse(VertexColor())
    return [
        *(diffuse, Principled(base_color=image, normal_map=normals, opacity=image), Principled(transmission=1.0)),
        *(Burley(), Conductor(), Dielectric(), Glossy(), Mirror(), Null(), OrenNayar(), Plastic(), ThinDielectric()),
        *(material(**facets) for material in (RoughConductor, RoughDielectric, RoughPlastic) for facets in _FACETS),
        *(Mix(diffuse, two_colors, 0.5), TwoSided(diffuse, two_colors)),
    ]


def lights() -> list[Light]:
    """Return a light of each kind."""
    above, down = (0.0, 9.0, 0.0), (0.0, -1.0, 0.0)
    return [
        PointLight(above, 1.0),
        SpotLight(above, down, 1.0),
        ProjectorLight(above, down, (1.0, 0.0, 0.0)),
        DirectionalLight(down, 1.0),
        DirectionalLight(down, 1.0, angle_degrees=0.5),
        RectangleLight(above, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0),
        DiskLight(above, down, 1.0, 1.0),
        SphereLight(above, 1.0, 1.0),
    ]


def scene() -> Scene:
    """Return a scene of a triangle for each material, all lights, and an image around."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    normals = np.array([[0.0, 0.0, 1.0]] * 3)
    mesh = Mesh(corners, np.array([[0, 1, 2]]), normals=normals, uvs=corners[:, :2], colors=np.ones((3, 4)))
    shapes = [Shape(mesh, material) for material in materials()]
    shapes.append(Shape(mesh, Diffuse(), emission=1.0))
    return Scene(
        shapes=shapes, lights=lights(), environment=ImageEnvironment(np.full((2, 4, 3), 0.5, np.float32)), camera=None
    )


def exercise(device: Device) -> None:
    """Upload the scene and the cameras to a device, which compiles what that needs."""
    build_scene(scene(), device)
    for camera in (PerspectiveCamera, OrthographicCamera, PanoramaCamera, FisheyeCamera):
        build_camera(camera(), 8, 8, (0, 0, 8, 8), device=device.name)
