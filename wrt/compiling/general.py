"""General kernels: wide kernels that render most scenes whose own kernels are not compiled yet.

They decide at run time what the kernel of a scene knows beforehand (`Features.covers`), so they are slower, with the
same bits. Each is compiled in the background when a render meets the first scene that it covers, for scenes to come.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

from wrt.backend import current_backend
from wrt.backend.builds import Builds
from wrt.backend.recording import call_name
from wrt.compiling.wide import name_of_wide

MAKE = "wrt.kernels.render", "make_render_kernel"
"""Module and name of the function that declares the scalar kernel for some features."""

MAKE_REGENERATING = "wrt.kernels.regeneration", "make_gpu_render_kernel"
"""Those of the function that declares a kernel for GPUs that begins the next path as soon as one has ended."""

_OF_MESHES = ("diffuse", "principled")
_WITHOUT_HOLES = (
    *("burley", "conductor", "dielectric", "diffuse", "glossy", "mirror", "oren_nayar", "plastic", "principled"),
    "principled:transmission",
    "rough_conductor:beckmann:walter:conductor",
    *("rough_conductor:ggx:smith-separable:conductor", "rough_conductor:ggx:smith:conductor"),
    *("rough_dielectric:beckmann:walter", "rough_dielectric:ggx:smith", "rough_dielectric:ggx:smith-separable"),
    *("rough_plastic:beckmann:walter", "rough_plastic:ggx:smith", "rough_plastic:ggx:smith-separable"),
)


class Tier(NamedTuple):
    """What a general kernel has: reflection models by name, and whether rays may pass surfaces."""

    models: tuple[str, ...]
    passes: bool


TIERS = (
    Tier(_OF_MESHES, passes=False),
    Tier(_WITHOUT_HOLES, passes=False),
    Tier(tuple(sorted((*_WITHOUT_HOLES, "null", "thin_dielectric"))), passes=True),
)
"""The general kernels, from the one that is compiled and runs fastest: files of meshes, other files, surfaces with
holes. Compiling takes 20, 50 and 60 s of CPU; the second has three quarters of the speed of a scene's own wide kernel,
the third half of it."""


def general_features(features: Any) -> list[Any]:
    """Return the features of the general kernels that cover a scene, the fastest first.

    There are none for scenes with media, and for options that few use.
    """
    if features.media != "none" or features.aovs or features.clamped or features.regularized or features.cameras:
        return []
    own = {"textured": True, "mipmapped": True, "environment": "image", "tangents": True, "light_tree": True}
    own |= {"uv2_alpha": True, "light_shapes": current_backend().kernels("wrt.kernels.lights.shapes").BUILT_IN}
    kernels = [
        dataclasses.replace(
            features, models=tier.models, opacity=tier.passes, composite="none" if tier.passes else "sides", **own
        )
        for tier in TIERS
    ]
    return [kernel for kernel in kernels if kernel.covers(features)]


def is_general(features: Any) -> bool:
    """Return whether a kernel with these features is one of the general ones."""
    return any(features == kernel for kernel in general_features(dataclasses.replace(features, models=())))


def compiled_for(features: Any, lanes: int, builds: Builds) -> Any:
    """Return the features of the best wide kernel that is compiled for a scene: its own, or a general one.

    Return None if there is none, and if both of the scene's own kernels are compiled, so that none need stand in.
    """
    if lanes == 0:
        return None
    if builds.has(name_of_wide(features, lanes)):
        return None if builds.has(call_name(*MAKE, (features,))) else features
    return next((kernel for kernel in general_features(features) if builds.has(name_of_wide(kernel, lanes))), None)
