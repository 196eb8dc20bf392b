"""A reflection model over arrays of directions, for one material seen from one side."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from wrt.backend.device import Device
from wrt.backend.warp_start import initialize_warp
from wrt.kernels.bsdf import current_name, model_of
from wrt.kernels.bsdf.arrays import kernels_of
from wrt.kernels.core.bsdf import Bsdf, BsdfSample, Model, slot_values
from wrt.kernels.core.registry import model_number
from wrt.scene.materials import Material
from wrt.upload.tables.material_tables import pack_tables
from wrt.values import Vec3


@dataclasses.dataclass(frozen=True)
class Case:
    """A material of constant values, seen from the front or the back, at a place on the surface."""

    material: Material
    front: bool = True
    _: dataclasses.KW_ONLY
    position: Vec3 = (0.3, 0.4, 0.5)
    uv: tuple[float, float] = (0.3, 0.4)

    @property
    def model(self) -> Model:
        """The model."""
        return model_of(self.name)

    @property
    def name(self) -> str:
        """The model's name in kernels."""
        return str(current_name(self.material.model))

    @property
    def values(self) -> NDArray[np.float32]:
        """The rows of `Bsdf.slots`."""
        values = np.zeros(slot_values._shape_, np.float32)
        for k, value in enumerate(self.material.slots):
            values[k] = value
        return values

    def record(self, device: str) -> Any:
        """Return the material at a point, as device functions get it."""
        bsdf = Bsdf()
        bsdf.model, bsdf.front = model_number(self.name), self.front
        bsdf.slots = slot_values(*self.values.ravel().tolist())
        # Where a table begins is not 0, lest a model forget to ask.
        values, places = pack_tables([self.material.table_key], Device(device))
        bsdf.tables = wp.array(np.concatenate([np.full(3, np.nan, np.float32), values]), dtype=float, device=device)
        bsdf.table = 3 + places.get(self.material.table_key or (), 0)
        return bsdf

    def _place(self, device: str) -> list[Any]:
        return [self.record(device), wp.vec3(*self.position), wp.vec2(*self.uv)]

    def evaluate(
        self, wo: NDArray[Any], wi: NDArray[Any], device: str
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return (N, 3) f |cosθi|, (N,) the density, and (N,) whether the model calls itself a delta."""
        wo, wi = np.broadcast_arrays(wo, wi)
        out = [wp.empty(len(wi), dtype=dtype, device=device) for dtype in (wp.vec3, wp.float32, wp.int32)]
        inputs = [*self._place(device), upload(wo, wp.vec3, device), upload(wi, wp.vec3, device)]
        wp.launch(kernels_of(self.name).evaluate, len(wi), inputs, out, device=device)
        value, pdf, delta = (array.numpy() for array in out)
        return value.astype(np.float64), pdf.astype(np.float64), delta.astype(bool)

    def sample(self, wo: NDArray[Any], u: NDArray[Any], device: str) -> NDArray[Any]:
        """Return (N,) structured samples with the fields of BsdfSample, for (N, 3) random numbers."""
        out = wp.empty(len(u), dtype=BsdfSample, device=device)
        wo = np.broadcast_to(wo, (len(u), 3))
        inputs = [*self._place(device), upload(wo, wp.vec3, device), upload(u, wp.vec3, device)]
        wp.launch(kernels_of(self.name).sample, len(u), inputs, [out], device=device)
        found: NDArray[Any] = out.numpy()
        return found


def upload(values: ArrayLike, dtype: Any, device: str) -> wp.array:
    """Return a device array."""
    initialize_warp()
    return wp.array(np.asarray(values), dtype=dtype, device=device)


def uniforms(n: int, width: int, seed: int) -> NDArray[np.float32]:
    """Return (n, width) numbers in [0, 1) from a generator that has nothing to do with the renderer's."""
    return np.random.default_rng(seed).random((n, width), dtype=np.float32)


def viewer(degrees: float, azimuth: float = 0.7) -> NDArray[np.float64]:
    """Return the unit vector at an angle from the normal."""
    theta = np.radians(degrees)
    return np.array([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)])


def hemisphere(n: int, seed: int) -> NDArray[np.float64]:
    """Return (n, 3) uniform directions above the surface."""
    d = np.random.default_rng(seed).normal(size=(n, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    d[:, 2] = np.abs(d[:, 2])
    return d


def sphere(n: int, seed: int) -> NDArray[np.float64]:
    """Return (n, 3) uniform directions."""
    d = np.random.default_rng(seed).normal(size=(n, 3))
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))
