"""Reflection models, and the dispatch among those that a scene uses.

A model is a file with three device functions in the local frame whose z faces the viewer:

    evaluate(bsdf, wo, wi) -> f |cosθi|     pdf(bsdf, wo, wi)     sample(bsdf, wo, u, u_lobe)

To add one, write the file, name it in MODELS, and give it a description in `wrt/materials.py`.
"""

import functools
from types import ModuleType

import warp as wp

from wrt.kernels.bsdf import conductor, dielectric, diffuse, mirror
from wrt.kernels.bsdf.record import Bsdf, BsdfSample

MODELS: dict[str, ModuleType] = {
    "diffuse": diffuse,
    "mirror": mirror,
    "conductor": conductor,
    "dielectric": dielectric,
}
MODEL_NUMBERS = {name: number for number, name in enumerate(MODELS)}
DELTA_ONLY = frozenset({"mirror", "conductor", "dielectric"})
"""Models whose `evaluate` is zero everywhere, so that sampling lights for them is useless."""


@functools.cache
def make_bsdf(names: tuple[str, ...]) -> tuple[wp.Function, wp.Function, wp.Function, wp.Function]:
    """Return device functions (evaluate, pdf, sample, is_delta) that know the models `names` alone."""
    models = tuple(MODELS[name] for name in names)
    numbers = tuple(MODEL_NUMBERS[name] for name in names)
    delta = tuple(name in DELTA_ONLY for name in names)
    count = len(models)

    @wp.func
    def bsdf_evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        value = wp.vec3(0.0)
        for k in range(wp.static(count)):
            if bsdf.model == wp.static(numbers[k]):
                value = wp.static(models[k].evaluate)(bsdf, wo, wi)
        return value

    @wp.func
    def bsdf_pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        value = float(0.0)
        for k in range(wp.static(count)):
            if bsdf.model == wp.static(numbers[k]):
                value = wp.static(models[k].pdf)(bsdf, wo, wi)
        return value

    @wp.func
    def bsdf_sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        value = BsdfSample()
        for k in range(wp.static(count)):
            if bsdf.model == wp.static(numbers[k]):
                value = wp.static(models[k].sample)(bsdf, wo, u, u_lobe)
        return value

    @wp.func
    def bsdf_is_delta(bsdf: Bsdf) -> bool:
        value = bool(False)
        for k in range(wp.static(count)):
            if bsdf.model == wp.static(numbers[k]):
                value = wp.static(delta[k])
        return value

    return bsdf_evaluate, bsdf_pdf, bsdf_sample, bsdf_is_delta
