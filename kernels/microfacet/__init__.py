"""Microfacet theory: distributions of normals D and masking-shadowing G, in all valid combinations.

A distribution is a file with device functions of a unit normal m in the local frame and a `shape`, which the file's
docstring explains:

    d(m, shape)     normal_pdf(wo, m, shape)     sample_normal(wo, shape, u)     smith_lambda(w, shape), where known

∫ d cosθ dω = 1, and normal_pdf is the density of sample_normal per solid angle. wo has z > 0. Roughnesses must be at
least LEAST_ALPHA.
"""

from types import ModuleType
from typing import NamedTuple

import warp as wp

from wrt.kernels.core.specialise import specialised
from wrt.kernels.microfacet import abc, beckmann, blinn_phong, ggx, sgd
from wrt.kernels.microfacet.masking import GENERAL, SMITH, WALTER, make_masking

DISTRIBUTIONS: dict[str, ModuleType] = {
    "ggx": ggx,
    "beckmann": beckmann,
    "blinn-phong": blinn_phong,
    "abc": abc,
    "sgd": sgd,
}
BUMPY = "bumpy-ggx"
"""GGX under a filtered normal map: its functions take a `BumpyShape` in place of a vec3 (`bumpy_ggx.py`)."""

MASKINGS = (*SMITH, *WALTER, *GENERAL)
LEAST_ALPHA = wp.constant(1.0e-4)
"""The least roughness of ggx, beckmann and blinn-phong at which these functions are accurate in float32."""


class Microfacet(NamedTuple):
    """A distribution of normals with its masking-shadowing function.

    Attributes:
        d: (m, shape) -> float, the density of normals per area and solid angle.
        g: (wo, wi, m, shape) -> float, the share of microfacets with normal m that both directions see.
        sample_normal: (wo, shape, u: vec2) -> vec3.
        normal_pdf: (wo, m, shape) -> float, per solid angle of m.
    """

    d: wp.Function
    g: wp.Function
    sample_normal: wp.Function
    normal_pdf: wp.Function


@specialised()
def make_microfacet(distribution: str, masking: str) -> Microfacet:
    """Return the device functions of a distribution in DISTRIBUTIONS, or BUMPY, and a masking in MASKINGS.

    Raises:
        ValueError: if either name is unknown, or the two cannot be combined.
    """
    if distribution == BUMPY:
        from wrt.kernels.microfacet import bumpy_ggx

        g = bumpy_ggx.make_bumpy_masking(masking)
        return Microfacet(bumpy_ggx.d, g, bumpy_ggx.sample_normal, bumpy_ggx.normal_pdf)
    if distribution not in DISTRIBUTIONS:
        raise ValueError(f"no distribution {distribution!r}: there are {', '.join(DISTRIBUTIONS)}")
    parts = DISTRIBUTIONS[distribution]
    smith_lambda = getattr(parts, "smith_lambda", None)
    g = make_masking(masking, distribution, smith_lambda, smith_lambda is beckmann.smith_lambda)
    return Microfacet(parts.d, g, parts.sample_normal, parts.normal_pdf)


def maskings_of(distribution: str) -> tuple[str, ...]:
    """Return the names of the maskings that a distribution can be combined with."""
    smith_lambda = getattr(DISTRIBUTIONS[distribution], "smith_lambda", None)
    smith = tuple(SMITH) if smith_lambda is not None else ()
    walter = tuple(WALTER) if smith_lambda is beckmann.smith_lambda else ()
    return (*smith, *walter, *GENERAL)
