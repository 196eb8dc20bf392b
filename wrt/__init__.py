"""wrt: a progressive, physically based ray tracer for triangle meshes.

The public names below are imported on first use, so that ``import wrt`` stays instant.
"""

from __future__ import annotations

import os

from wrt._version import __version__

TYPE_CHECKING = False  # instead of importing `typing`, which would double the import time; type checkers know the name

# Kernels and sample meshes live beside this package in the source tree and inside it in an
# installed one (see package-dir in pyproject.toml). In a checkout, `wrt` may be found here even
# though another copy is installed, so both layouts must resolve `wrt.kernels` and `wrt.meshes`.
_here = os.path.dirname(os.path.realpath(__file__))
if not os.path.isdir(os.path.join(_here, "kernels")) and os.path.isdir(os.path.join(_here, "..", "kernels")):
    __path__.append(os.path.dirname(_here))

if TYPE_CHECKING:
    from typing import Any

    from wrt.api import load, render
    from wrt.camera import Camera, FisheyeCamera, OrthographicCamera, PanoramaCamera, PerspectiveCamera
    from wrt.deformation import Deformation
    from wrt.environment import (
        ConstantEnvironment,
        ImageEnvironment,
        SphericalHarmonicsEnvironment,
        SunSkyEnvironment,
    )
    from wrt.errors import InputError
    from wrt.formats.images import load_image, save_image
    from wrt.formats.meshes import load_mesh
    from wrt.formats.scene_writer import save_scene
    from wrt.intersector import Hits, Intersector
    from wrt.lights import DirectionalLight, DiskLight, PointLight, RectangleLight, SphereLight, SpotLight
    from wrt.materials import (
        Conductor,
        Dielectric,
        Diffuse,
        Emissive,
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
        register_material,
    )
    from wrt.medium import Medium
    from wrt.mesh import Mesh
    from wrt.motion import Motion
    from wrt.renderer import Progress, Renderer
    from wrt.scene import RenderSettings, Scene, Shape
    from wrt.shapes import box, polygon, quad, sphere
    from wrt.textures import ImageTexture, NormalMap, VertexColor

_EXPORTS = {
    "Camera": "wrt.camera",
    "ConstantEnvironment": "wrt.environment",
    "Conductor": "wrt.materials",
    "Dielectric": "wrt.materials",
    "Diffuse": "wrt.materials",
    "Deformation": "wrt.deformation",
    "DirectionalLight": "wrt.lights",
    "DiskLight": "wrt.lights",
    "FisheyeCamera": "wrt.camera",
    "ImageEnvironment": "wrt.environment",
    "ImageTexture": "wrt.textures",
    "Emissive": "wrt.materials",
    "Glossy": "wrt.materials",
    "Hits": "wrt.intersector",
    "InputError": "wrt.errors",
    "Intersector": "wrt.intersector",
    "Material": "wrt.materials",
    "Medium": "wrt.medium",
    "Mesh": "wrt.mesh",
    "Mirror": "wrt.materials",
    "Mix": "wrt.materials",
    "Motion": "wrt.motion",
    "NormalMap": "wrt.textures",
    "Null": "wrt.materials",
    "OrenNayar": "wrt.materials",
    "OrthographicCamera": "wrt.camera",
    "PanoramaCamera": "wrt.camera",
    "PerspectiveCamera": "wrt.camera",
    "Plastic": "wrt.materials",
    "PointLight": "wrt.lights",
    "Principled": "wrt.materials",
    "Progress": "wrt.renderer",
    "Renderer": "wrt.renderer",
    "RectangleLight": "wrt.lights",
    "RenderSettings": "wrt.scene",
    "RoughConductor": "wrt.materials",
    "RoughDielectric": "wrt.materials",
    "RoughPlastic": "wrt.materials",
    "Scene": "wrt.scene",
    "Shape": "wrt.scene",
    "SphereLight": "wrt.lights",
    "SphericalHarmonicsEnvironment": "wrt.environment",
    "SpotLight": "wrt.lights",
    "SunSkyEnvironment": "wrt.environment",
    "ThinDielectric": "wrt.materials",
    "TwoSided": "wrt.materials",
    "VertexColor": "wrt.textures",
    "box": "wrt.shapes",
    "load": "wrt.api",
    "load_image": "wrt.formats.images",
    "load_mesh": "wrt.formats.meshes",
    "polygon": "wrt.shapes",
    "quad": "wrt.shapes",
    "register_material": "wrt.materials",
    "render": "wrt.api",
    "save_image": "wrt.formats.images",
    "save_scene": "wrt.formats.scene_writer",
    "sphere": "wrt.shapes",
}

__all__ = [
    "Camera",
    "Conductor",
    "ConstantEnvironment",
    "Deformation",
    "Dielectric",
    "Diffuse",
    "DirectionalLight",
    "DiskLight",
    "Emissive",
    "FisheyeCamera",
    "Glossy",
    "Hits",
    "ImageEnvironment",
    "ImageTexture",
    "InputError",
    "Intersector",
    "Material",
    "Medium",
    "Mesh",
    "Mirror",
    "Mix",
    "Motion",
    "NormalMap",
    "Null",
    "OrenNayar",
    "OrthographicCamera",
    "PanoramaCamera",
    "PerspectiveCamera",
    "Plastic",
    "PointLight",
    "Principled",
    "Progress",
    "RectangleLight",
    "RenderSettings",
    "Renderer",
    "RoughConductor",
    "RoughDielectric",
    "RoughPlastic",
    "Scene",
    "Shape",
    "SphereLight",
    "SphericalHarmonicsEnvironment",
    "SpotLight",
    "SunSkyEnvironment",
    "ThinDielectric",
    "TwoSided",
    "VertexColor",
    "__version__",
    "box",
    "load",
    "load_image",
    "load_mesh",
    "polygon",
    "quad",
    "register_material",
    "render",
    "save_image",
    "save_scene",
    "sphere",
]


def __getattr__(name: str) -> Any:
    module = _EXPORTS.get(name)
    if module is None:
        raise AttributeError(f"module 'wrt' has no attribute {name!r}")
    import importlib

    value = getattr(importlib.import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
