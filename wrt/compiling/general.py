"""General kernels: they render most scenes whose own kernels are not compiled yet.

Those of pictures are wide, those of a denoiser's guides scalar. They decide at run time what the kernel of a scene
knows beforehand (`Features.covers`), so they are slower, with the same bits. They come compiled with the package (see
`wrt.prebuilding`), or `wrt compile --general` compiles them.
"""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from wrt.backend import current_backend
from wrt.backend.device import Device
from wrt.compiling.kernel import SCALAR, is_compiled
from wrt.scene.camera import FisheyeCamera, OrthographicCamera, PanoramaCamera, PerspectiveCamera
from wrt.scene.environment import ImageEnvironment
from wrt.scene.exact.quadrics import disk
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
    MATERIALS,
    Diffuse,
    Material,
    Measured,
    Null,
    Principled,
    RoughConductor,
    RoughDielectric,
    RoughPlastic,
)
from wrt.scene.medium import DensityGrid, Medium
from wrt.scene.mesh import Mesh
from wrt.scene.scene import Scene, Shape
from wrt.scene.shapes import sphere
from wrt.scene.textures import ImageTexture, NormalMap, VertexColor

_FACETS: tuple[dict[str, Any], ...] = (
    {"distribution": "beckmann", "masking": "walter"},
    {"distribution": "ggx", "masking": "smith-separable"},
)
"""What rough materials may have other than their defaults."""

_GENERAL = ("textured", "mipmapped", "tangents", "light_tree", "uv2_alpha", "single_sided")
_OF_MESHES = ("diffuse", "principled")


class Tier(NamedTuple):
    """What a general kernel has: reflection models by name, whether rays may pass surfaces, media and exact shapes."""

    models: tuple[str, ...]
    passes: bool = False
    has_all: bool = False


def materials() -> list[Material]:
    """Return a material for each reflection model of the general kernels, and the composite materials."""
    image = ImageTexture(np.full((4, 4, 3), 0.5, np.float32))
    normals = NormalMap(np.full((4, 4, 3), (0.5, 0.5, 1.0), np.float32), filter=False)
    return [
        *(cls.example() for cls in MATERIALS.values() if cls is not Measured and cls.__module__.startswith("wrt.")),
        *(cls(**facets) for cls in (RoughConductor, RoughDielectric, RoughPlastic) for facets in _FACETS),
        Principled(transmission=1.0),
        Principled(base_color=image, normal_map=normals, opacity=image),
        Diffuse(VertexColor()),
    ]


@cache
def tiers() -> tuple[Tier, ...]:
    """Return what the general kernels have, from the one that is compiled and runs fastest.

    They are for files of meshes, for nearly all other scenes, and for media, exact shapes and clamped light as well.
    Compiling takes 21, 42 and 49 s of CPU; they have 0.88 to 0.90, 0.79 to 0.94 and 0.68 to 0.82 of the speed of a
    scene's own wide kernel. A denoiser's guides take few samples, so they have the first and the last.
    """
    models = {material.model for material in materials() if not material.parts}
    every = tuple(sorted(models))
    return Tier(_OF_MESHES), Tier(every, True), Tier(every, True, True)


def general_features(features: Any) -> list[Any]:
    """Return the features of the general kernels that cover a scene, the fastest first.

    There are none for options that few use.
    """
    from wrt.kernels.core.features import EITHER, OF_EITHER

    if not features.guides and features.integrator != "path":
        return []
    if features.regularized or features.cameras or features.caustics:
        return []
    general: dict[str, Any] = dict.fromkeys(_GENERAL, True)
    everything: dict[str, Any] = {"exact": "quadrics", "clamped": not features.guides}
    if not features.guides:
        shapes = current_backend().kernels("wrt.kernels.lights.shapes").BUILT_IN
        general |= {"environment": "image", "light_shapes": shapes}
        everything |= {"media": "scattering", "grid_media": True}
    sampler = EITHER if features.sampler in OF_EITHER else features.sampler
    least: dict[str, Any] = {"media": "none", "grid_media": False, "exact": "none", "clamped": False}
    plain = dataclasses.replace(features, sampler=sampler, **least)
    kernels = [
        dataclasses.replace(
            plain,
            models=tier.models,
            composite="holes" if tier.passes else "sides",
            **general,
            **(everything if tier.has_all else {}),
        )
        for tier in tiers()
    ]
    return [kernel for kernel in (kernels[::2] if features.guides else kernels) if kernel.covers(features)]


def compiled_for(features: Any, lanes: int) -> Any:
    """Return the features of the best wide kernel that is compiled for a scene: its own, or a general one.

    Return None if there is none, and if both of the scene's own kernels are compiled, so that none need stand in. For
    a denoiser's guides the same holds with scalar kernels; they have no others.
    """
    if lanes == 0:
        return None
    if features.guides:
        lanes = SCALAR
    if is_compiled(features, lanes):
        return None if is_compiled(features, SCALAR) else features
    return next((kernel for kernel in general_features(features) if is_compiled(kernel, lanes)), None)


# --- What they are compiled with ----------------------------------------------------------------------


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


def exercise(device: Device) -> None:
    """Upload a scene with everything that general kernels cover, and each camera.

    That uses all functions of `kernels/` that uploads of such scenes need, so that they are compiled and in the table.
    """
    from wrt.upload.camera import build_camera
    from wrt.upload.scene_data import SceneUpload

    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    normals = np.array([[0.0, 0.0, 1.0]] * 3)
    mesh = Mesh(corners, np.array([[0, 1, 2]]), normals=normals, uvs=corners[:, :2], colors=np.ones((3, 4)))
    shapes = [*(Shape(mesh, material) for material in materials()), Shape(mesh, Diffuse(), emission=1.0)]
    around = ImageEnvironment(np.full((2, 4, 3), 0.5, np.float32))
    SceneUpload(Scene(shapes=shapes, lights=lights(), environment=around, camera=None), device).finish()
    smoke = Null(interior=Medium(scattering=(1.0, 1.0, 1.0), density=DensityGrid(np.ones((2, 2, 2), np.float32))))
    for exact in (), (sphere(exact=True),), (disk(),):
        filled = [Shape(each, smoke) for each in (mesh, *exact)]
        SceneUpload(Scene(shapes=filled, camera=PerspectiveCamera()), device).finish()
    for camera in (PerspectiveCamera, OrthographicCamera, PanoramaCamera, FisheyeCamera):
        build_camera(camera(), 8, 8, (0, 0, 8, 8), device=device.name)
