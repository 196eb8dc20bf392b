"""Derivatives of a loss by the values of a scene, from the derivative of the loss by the picture.

The kernel is in `kernels/gradients`. Sums are in fixed point, so that their bits depend neither on threads nor on how
the samples are split into launches.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrt.errors import InputError
from wrt.gradients.kernels import By, GradientKernels
from wrt.upload.materials import vary_by_place
from wrt.values import array, integer

KEYS = (
    *("slots", "texels", "emission", "lights", "environment", "environment_texels"),
    *("media_absorption", "media_scattering", "media_emission", "vertices", "normals", "index"),
)
"""What has derivatives: arrays of colours parallel to those of SceneData; see `kernels/gradients/sums.py`."""

REASONS = {
    "vertices": ("by vertices and normals", "wrt.kernels.gradients.vertices"),
    "index": ("by the index of smooth glass", "wrt.kernels.gradients.tangents"),
}
"""What there are derivatives by in some scenes only, in words, and where the reasons against are."""

LARGEST = 2.0**42
"""The largest sum in units, as the first sample of each pixel foretells it: a 500,000th of what fits."""

PILOT = (0, -20, -40, 20)
"""Powers of two by which the unit of the first try is changed until nothing overflows."""


def require_gradients(renderer: Any) -> None:
    """Raise InputError unless the renderer's integrator and settings have derivatives."""
    if renderer.integrator not in ("path", "volpath", "direct"):
        raise InputError(f"integrator {renderer.integrator!r} has no gradients; use 'path' or 'volpath'")
    if renderer.settings.clamp_indirect is not None:
        raise InputError("clamped indirect light has no gradients; render without clamp_indirect")
    if renderer.settings.caustics:
        raise InputError("pictures with caustics by photons have no derivatives; render without caustics")
    if renderer._kernel.features.distances:
        raise InputError("pictures of shapes by distance functions have no derivatives")
    if renderer._kernel.features.procedures:
        raise InputError("pictures with procedural textures have no derivatives; render them to images")
    if own := vary_by_place(renderer._kernel.features.models):
        raise InputError(f"model {own[0].split(':')[0]!r} has no derivatives: it makes its values from places")


class Backward:
    """The derivatives of a renderer's picture.

    Attributes:
        rejected: summands of the last run that were not finite and were left out.
    """

    def __init__(self, renderer: Any, by: By = "values") -> None:
        """Take a renderer, and declare the kernels for its scene; see `By`.

        Raises:
            InputError: for an integrator other than "path", "volpath" and "direct", with clamped indirect light, or
                with caustics by photons; and of more than values, for scenes with what has no such derivatives.
        """
        require_gradients(renderer)
        self._renderer, self._device = renderer, renderer.device
        features = dataclasses.replace(
            renderer._kernel.features, aovs=False, guides=False, edges="none", light_groups=False
        )
        if by in REASONS:
            words, module = REASONS[by]
            if reason := self._device.backend.call(module, "reason_against", features):
                raise InputError(f"there are no derivatives {words} in scenes with {reason}")
        kernel, self._by = renderer._kernel, by
        if by not in kernel.gradients:
            kernel.gradients[by] = GradientKernels(self._device, features, kernel.records, by)
        self._kernels: GradientKernels = kernel.gradients[by]
        self.rejected = 0

    def compile(self) -> None:
        """Compile the wide kernels if necessary, and load them if possible."""
        self._kernels.wait()

    def run(self, d_image: ArrayLike, spp: int, seed: int, material: int = -1) -> dict[str, NDArray[np.float64]]:
        """Return the derivatives of a loss by the values of the scene.

        Args:
            d_image: (H, W, 3), the derivative of the loss by the mean radiance of each pixel.
            spp: samples per pixel.
            seed: 0 to 2³² − 1. With the picture's own seed and samples the random numbers are those of the picture.
            material: the number of the material whose index has a derivative.

        Returns:
            Arrays (N, 3) by the names in KEYS, each parallel to an array of the scene on the device. A value that is
            one number has it in each channel, and its derivative is the sum of the three.

        Raises:
            InputError: on arrays of other sizes, values that are not finite, or sums that are too large.
        """
        spp = integer(spp, "spp", minimum=1, maximum=2**31 - 1)
        seed = integer(seed, "seed", minimum=0, maximum=2**32 - 1)
        film = self._renderer.film
        upstream: NDArray[np.float32] = np.ascontiguousarray(array(d_image, "d_image", np.float32))
        width, height = film.picture_size
        if upstream.shape != (height, width, 3):
            raise InputError(f"d_image must have the shape ({height}, {width}, 3), not {upstream.shape}")
        if not np.isfinite(upstream).all():
            raise InputError("d_image must be finite")
        upstream = film.reading.spread(upstream)
        total = float(np.abs(upstream).sum(dtype=np.float64))
        if total == 0.0:
            return {key: np.zeros((count, 3)) for key, count in self._counts().items()}
        upstream = upstream.reshape(-1, 3) / np.float32(spp)
        scales = self._choose_scales(upstream, total, spp, seed, material)
        sums, overflowed = self._sum(upstream, spp, seed, scales, material)
        if overflowed:
            raise InputError("the derivatives are too large for their sums: single samples are far above the mean")
        return sums

    def _choose_scales(
        self, upstream: NDArray[np.float32], total: float, spp: int, seed: int, material: int
    ) -> dict[str, float]:
        """Return a scale for each array, a power of two, from one sample per pixel."""
        for change in PILOT:
            unit = 2.0 ** (math.floor(math.log2(LARGEST / total)) + change)
            scales = dict.fromkeys(KEYS, unit)
            first, overflowed = self._sum(upstream, 1, seed, scales, material)
            if not overflowed:
                break
        largest = {key: float(np.abs(values).max(initial=0.0)) * spp for key, values in first.items()}
        return {
            key: 2.0 ** math.floor(math.log2(LARGEST / value)) if value > 0.0 else unit
            for key, value in largest.items()
        }

    def _counts(self) -> dict[str, int]:
        """Return the number of colours of each array."""
        data = self._renderer._built.data
        environment = data.environment
        arrays = {
            "slots": data.slots,
            "texels": data.texels,
            "emission": data.shapes,
            "lights": data.lights,
            "environment_texels": environment.texels,
            "media_absorption": data.media,
            "media_scattering": data.media,
            "media_emission": data.media,
            "vertices": data.points if self._by == "vertices" else None,
            "normals": data.normals if self._by == "vertices" else None,
        }
        counts = {key: 0 if array is None else len(array) for key, array in arrays.items()}
        return {key: counts.get(key, 1) for key in KEYS}

    def _sum(
        self, upstream: NDArray[np.float32], spp: int, seed: int, scales: dict[str, float], material: int
    ) -> tuple[dict[str, NDArray[np.float64]], bool]:
        """Run the kernel; return the sums, and whether any overflowed."""
        backend, name = self._device.backend, self._device.name
        sums = backend.kernels("wrt.kernels.gradients.sums").GradientSums()
        faults = backend.zeros(2, int, name)
        counts = self._counts()
        self._device.require_memory(24 * sum(counts.values()) + upstream.nbytes, "adding up derivatives")
        arrays = {key: backend.zeros(max(1, 3 * count), "int64", name) for key, count in counts.items()}
        for key, integers in arrays.items():
            each = getattr(sums, key)
            each.sums, each.faults, each.scale = integers, faults, scales[key]
        sums.material = material
        weights = backend.array(upstream, "vec3", name)
        shared = self._renderer.arguments_for(self._renderer.film)[1:5]
        film = self._renderer.film
        self._kernels.run(spp, seed, shared, weights, sums, film.width, film.height)
        self.rejected, overflowed = (int(count) for count in backend.fetch(faults))
        found = {
            key: backend.fetch(integers)[: 3 * counts[key]].astype(np.float64).reshape(-1, 3) / scales[key]
            for key, integers in arrays.items()
        }
        return found, overflowed > 0
