"""Sets of features that together have all that a render kernel can have, and all other kernels."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator, Sequence
from types import ModuleType

import warp as wp

import wrt.kernels
from wrt.kernels.core.features import Features
from wrt.kernels.integrators.registry import INTEGRATORS
from wrt.kernels.lights.shapes import BUILT_IN as LIGHT_SHAPES
from wrt.kernels.microfacet import DISTRIBUTIONS, maskings_of
from wrt.scene.materials import MATERIALS
from wrt.scene.scene import SAMPLERS

MODELS = sorted({material.model for material in (cls.example() for cls in MATERIALS.values()) if not material.parts})
"""The reflection model of each material as it comes."""


def other_models(sets: Sequence[Features]) -> Features:
    """Return a set of each material's model as it comes, where none of `sets` has it."""
    included = {name for features in sets for name in features.models}
    return Features(tuple(name for name in MODELS if name not in included), False, "none")


SHADING = [
    # Under filtered normal maps.
    Features(
        ("principled:anisotropic:transmission:coat:bumpy", "rough_plastic:bumpy-ggx:smith"),
        False,
        "none",
        tangents=True,
    ),
    # Each channel in its own way: dispersion, among bodies within bodies too, and thin films.
    Features(("conductor:film", "dielectric:dispersive", "rough_conductor:ggx:smith:conductor:film"), False, "none"),
    Features(("principled:transmission:dispersion:film:coat",), False, "none", media="absorbing", nested=True),
    Features(("burley", "burley:thin", "burley:transmission"), False, "none", composite="sides"),
    # Each distribution of normals, and each masking with one of them.
    Features(
        tuple(sorted(f"rough_conductor:{name}:{maskings_of(name)[-1]}:schlick" for name in DISTRIBUTIONS)),
        False,
        "none",
    ),
]
"""Reflection models that no film of films_of_devices.py has."""

FEATURES = [
    Features(("diffuse",), False, "none"),
    Features(("conductor", "dielectric"), False, "image", light_tree=True),
    # Each kind of instances, and each sampler.
    *(
        Features(("diffuse",), False, "none", instances=instances, sampler=sampler)
        for instances, sampler in zip(("still", "moving", "deforming"), SAMPLERS[1:], strict=True)
    ),
    Features(("diffuse",), True, "none", instances="moving", exact="spheres", aovs=True, edges="wires"),
    Features(("diffuse",), True, "none", instances="moving", exact="quadrics", aovs=True, edges="surfaces"),
    Features(("diffuse",), False, "none", exact="quadrics"),
    Features(("diffuse",), False, "none", composite="mixed", aovs=True),
    # Two models with all that a scene can have besides.
    Features(
        ("diffuse", "rough_dielectric:ggx:smith"),
        True,
        "image",
        composite="holes",
        tangents=True,
        uv2_alpha=True,
        light_shapes=(*LIGHT_SHAPES, "projector", "projector:spot"),
        single_sided=True,
    ),
    Features(("principled:anisotropic:transmission:coat:sheen:bounces", "principled:thin"), False, "none"),
    *SHADING,
    *(
        Features(("conductor", "dielectric"), True, "image", tangents=True, composite="holes", integrator=name)
        for name in INTEGRATORS
        if name != "path"
    ),
    Features(
        ("dielectric", "diffuse"),
        True,
        "image",
        tangents=True,
        composite="holes",
        mipmapped=True,
        clamped=True,
        regularized=True,
        aovs=True,
    ),
    Features(("dielectric", "null", "thin_dielectric"), False, "constant", media="absorbing"),
    Features(
        ("dielectric", "null", "principled:transmission", "rough_dielectric:ggx:smith"),
        False,
        "none",
        media="scattering",
        nested=True,
        instances="still",
    ),
    Features(("diffuse", "null"), False, "constant", media="scattering", grid_media=True),
]
FEATURES.append(other_models(FEATURES))


def kernel_modules() -> Iterator[ModuleType]:
    yield wrt.kernels
    for found in pkgutil.walk_packages(wrt.kernels.__path__, "wrt.kernels."):
        yield importlib.import_module(found.name)


def declared_kernels() -> dict[str, wp.Kernel]:
    """Return every kernel at the top level of a module of the package, by name."""
    return {
        f"{module.__name__}.{name}": value
        for module in kernel_modules()
        for name, value in vars(module).items()
        if isinstance(value, wp.Kernel) and value.func.__module__ == module.__name__
    }
