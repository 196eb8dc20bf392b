"""Squares under normal maps, and materials that show what a reflection model is given there."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

import wrt
from support.covering_kernels import covering
from support.small_scenes import image_of
from wrt.kernels import bsdf as models
from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, no_sample, zero_pdf


@wp.func
def shown_direction(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return the direction to the light in the local frame, in [0, 1]."""
    return wi * 0.5 + wp.vec3(0.5)


@wp.func
def shown_variance(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Return the variance of normals along the frame's axes, and 1."""
    return wp.vec3(bsdf.normal_variance[0], bsdf.normal_variance[1], 1.0)


@wp.func
def never_sampled(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    return no_sample()


PROBES = {
    "probe_direction": Model(shown_direction, zero_pdf, never_sampled, slots=0),
    "probe_variance": Model(shown_variance, zero_pdf, never_sampled, slots=0, widens=True),
}


@dataclass(frozen=True)
class Probe(wrt.Material):
    """Shows what its model is given; with `tangents` it is a material that has axes."""

    shows: str = "probe_direction"
    tangents: bool = False

    type_name: ClassVar[str] = "probe"

    @property
    def model(self) -> str:
        return self.shows

    @property
    def needs_tangents(self) -> bool:
        return self.tangents


@contextlib.contextmanager
def registered() -> Iterator[list[str]]:
    """Register the probes, and yield their names in kernels."""
    for name, model in PROBES.items():
        models.register_model(name, model)
    yield [models.current_name(name) for name in PROBES]
    for name in PROBES:
        models.BSDFS.forget(name)


@pytest.fixture(scope="module", autouse=True)
def registered_probes() -> Iterator[None]:
    """Register the probes for the tests of a file that imports this fixture."""
    with registered():
        yield


with registered() as _names:
    WITH_PROBES = covering(
        "diffuse", "mirror", wrt.RoughConductor(f0=1.0, distribution="beckmann").model, *_names, composite="mixed"
    )
"""Features of a kernel for anything made of these models, by the sampler "independent"."""


FRONT = wrt.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov_degrees=30.0)
SQUARE = ((-2.0, -2.0, 0.0), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0))


def unit(*v: float) -> NDArray[np.float64]:
    return np.array(v) / np.linalg.norm(v)


def encoded(normals: NDArray) -> NDArray[np.float32]:
    """Return the colours c of unit normals 2c − 1."""
    return (0.5 * normals / np.linalg.norm(normals, axis=-1, keepdims=True) + 0.5).astype(np.float32)


def constant_map(*normal: float, **options: Any) -> wrt.NormalMap:
    return wrt.NormalMap(encoded(np.broadcast_to(np.array(normal), (4, 4, 3))), **options)


def with_uvs(mesh: wrt.Mesh, matrix: object) -> wrt.Mesh:
    return wrt.Mesh(mesh.vertices, mesh.faces, mesh.normals, mesh.uvs @ np.array(matrix, np.float32).T)


def lit(mesh: wrt.Mesh, material: wrt.Material, towards: NDArray, camera: wrt.PerspectiveCamera = FRONT) -> wrt.Scene:
    """Return a mesh under sunlight of irradiance 1 from a direction."""
    scene = wrt.Scene(camera=camera)
    scene.add(mesh, material=material)
    scene.add_light(wrt.DirectionalLight(tuple(-towards), irradiance=1.0))
    return scene


def rendered(scene: wrt.Scene, device: str, spp: int = 1, size: int = 4, **options: Any) -> NDArray[np.float64]:
    """Return a picture of the light that is reflected once."""
    options = {"max_depth": 2, "filter": "box", "sampler": "independent", **options}
    renderer = wrt.Renderer(scene, width=size, height=size, device=device, **options)
    return image_of(renderer, spp).astype(np.float64)
