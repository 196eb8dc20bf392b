"""The general kernel: compiled once on a machine, it renders most scenes whose own kernel is not compiled yet.

It decides at run time what a scene's own kernel need not decide (`Features.covers`), so it is slower, with the same bits.
"""

from __future__ import annotations

from typing import Any

from wrt.backend import current_backend
from wrt.backend.builds import Builds
from wrt.backend.recording import call_name

MAKE = "wrt.kernels.render", "make_render_kernel"
"""Module and name of the function that declares the scalar kernel for some features."""

MODELS = (
    "burley",
    "conductor",
    "dielectric",
    "diffuse",
    "glossy",
    "mirror",
    "null",
    "oren_nayar",
    "plastic",
    "principled",
    "principled:transmission",
    "rough_conductor:beckmann:walter:conductor",
    "rough_conductor:ggx:smith:conductor",
    "rough_dielectric:beckmann:walter",
    "rough_dielectric:ggx:smith",
    "rough_plastic:beckmann:walter",
    "rough_plastic:ggx:smith",
    "thin_dielectric",
)
"""Its reflection models: those that files from elsewhere name most."""


def general_features(features: Any) -> Any:
    """Return the features of the general kernel, with those of `features` that are fixed when a kernel is compiled."""
    import dataclasses

    return dataclasses.replace(
        features,
        models=MODELS,
        textured=True,
        mipmapped=True,
        environment="image",
        opacity=True,
        composite="none",
        tangents=True,
        light_shapes=current_backend().kernels("wrt.kernels.lights.shapes").BUILT_IN,
        light_tree=True,
        uv2_alpha=True,
    )


def name_of(features: Any) -> str:
    """Return the name in the notes of the scalar kernel with these features."""
    return call_name(*MAKE, (features,))


def readiest(features: Any, builds: Builds | None) -> Any:
    """Return the features of the kernel with which a scene can be rendered at once: its own, or the general one's.

    Its own is taken if it is compiled, if the general one is not, and if that does not cover the scene.
    """
    if builds is None or builds.has(name_of(features)):
        return features
    general = general_features(features)
    return general if general.covers(features) and builds.has(name_of(general)) else features
