"""General kernels: they render most scenes whose own kernels are not compiled yet.

Those of pictures are wide, those of a denoiser's guides scalar. They decide at run time what the kernel of a scene
knows beforehand (`Features.covers`), so they are slower, with the same bits. Each is compiled in the background when a
render meets the first scene that it covers, for scenes to come.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

from wrt.backend import current_backend
from wrt.compiling.kernel import SCALAR, UNLIKE_PATHS, is_compiled

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


TIERS_OF_GUIDES = TIERS[0], TIERS[-1]
"""Of the kernels for a denoiser's guides, which take few samples. Compiling takes 5 and 15 s of CPU."""


def general_features(features: Any) -> list[Any]:
    """Return the features of the general kernels that cover a scene, the fastest first.

    There are none for scenes with media, and for options that few use.
    """
    if not features.guides and (features.aovs or features.integrator in UNLIKE_PATHS):
        return []
    if features.media != "none" or features.clamped or features.regularized or features.cameras:
        return []
    own: dict[str, Any] = {"textured": True, "mipmapped": True, "tangents": True, "light_tree": True, "uv2_alpha": True}
    if not features.guides:
        shapes = current_backend().kernels("wrt.kernels.lights.shapes").BUILT_IN
        own |= {"environment": "image", "light_shapes": shapes}
    kernels = [
        dataclasses.replace(features, models=tier.models, composite="holes" if tier.passes else "sides", **own)
        for tier in (TIERS_OF_GUIDES if features.guides else TIERS)
    ]
    return [kernel for kernel in kernels if kernel.covers(features)]


def is_general(features: Any) -> bool:
    """Return whether a kernel with these features is one of the general ones."""
    return any(features == kernel for kernel in general_features(dataclasses.replace(features, models=())))


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
