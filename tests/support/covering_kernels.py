"""Render many scenes with few kernels: with ones that cover what the scenes use.

`Features.covers` says when a kernel leaves the bits of a scene's own one, and test_general_kernels.py that it is right.
For files whose claims are about scenes, and whose kernels would take longer to compile than their pictures to render.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from wrt.kernels.core.features import Features
from wrt.kernels.lights.shapes import BUILT_IN
from wrt.rendering.render_kernel import RenderKernel

MATT_AND_METAL = Features(("conductor", "diffuse"), False, "image")
"""Features of a kernel for plain scenes, by the sampler "independent"."""


def covering(*models: str, **fields: Any) -> Features:
    """Return the features of a kernel that has everything a scene of some reflection models may do without."""
    return Features(
        tuple(sorted(models)),
        textured=True,
        environment="image",
        tangents=True,
        light_shapes=BUILT_IN,
        light_tree=True,
        uv2_alpha=True,
        mipmapped=True,
        single_sided=True,
        **{"composite": "sides", **fields},
    )


OF_PICTURES = covering(
    *("conductor", "dielectric", "diffuse", "mirror", "oren_nayar", "plastic"),
    *("rough_conductor:ggx:smith:conductor", "rough_plastic:ggx:smith"),
    sampler="sobol",
)
"""One kernel for the many pictures and examples of the documentation that differ in a model, a light or a texture."""


def render_with(kernels: Sequence[Features], monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the first kernel that covers a scene render it; a scene that none covers gets its own."""
    render_by(lambda features: next((kernel for kernel in kernels if kernel.covers(features)), features), monkeypatch)


def rendering_with(*kernels: Features) -> Any:
    """Return a fixture by which all tests of a file `render_with` these kernels."""

    @pytest.fixture(autouse=True)
    def kernels_of_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
        render_with(kernels, monkeypatch)

    return kernels_of_the_file


def render_by(kernel_for: Callable[[Features], Features], monkeypatch: pytest.MonkeyPatch) -> None:
    """Render each scene with the kernel that a function of the scene's own features chooses."""
    make = RenderKernel.__init__

    def init(self: RenderKernel, device: Any, features: Features, *arguments: Any, **options: Any) -> None:
        kernel = kernel_for(features)
        assert kernel == features or (kernel.covers(features) and features.integrator == "path")
        make(self, device, kernel, *arguments, **options)

    monkeypatch.setattr(RenderKernel, "__init__", init)
