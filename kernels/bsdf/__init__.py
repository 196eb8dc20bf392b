"""Reflection models, and the dispatch among those that a scene uses.

A model is a file with three device functions in the local frame whose z faces the viewer:

    evaluate(bsdf, wo, wi) -> f |cosθi|     pdf(bsdf, wo, wi)     sample(bsdf, wo, u, u_lobe)

To add one, write the file, name it in MODELS, and give it a description in `wrt/materials.py`.
"""

import functools
from types import ModuleType
from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf import conductor, dielectric, diffuse, mirror
from wrt.kernels.bsdf.record import Bsdf, BsdfSample, zero_evaluate, zero_pdf

MODELS: dict[str, ModuleType] = {
    "diffuse": diffuse,
    "mirror": mirror,
    "conductor": conductor,
    "dielectric": dielectric,
}
MODEL_NUMBERS = {name: number for number, name in enumerate(MODELS)}
DELTA_ONLY = frozenset({"mirror", "conductor", "dielectric"})
"""Models whose `evaluate` is zero everywhere, so that sampling lights for them is useless."""


class BsdfFunctions(NamedTuple):
    """The device functions that dispatch on `Bsdf.model`."""

    evaluate: wp.Function
    pdf: wp.Function
    sample: wp.Function
    is_delta: wp.Function


@functools.cache
def make_bsdf(names: tuple[str, ...]) -> BsdfFunctions:
    """Return device functions that know the models `names` alone.

    One link a model, each calling the next. Not a static loop over the models: Warp's hash of a
    function leaves out a `wp.static` that depends on a loop variable, so kernels of different
    scenes would be taken for one another.
    """
    if not names:
        return BsdfFunctions(zero_evaluate, zero_pdf, _no_sample, _no_is_delta)
    model = MODELS[names[0]]
    number = MODEL_NUMBERS[names[0]]
    delta = names[0] in DELTA_ONLY
    model_evaluate, model_pdf, model_sample = model.evaluate, model.pdf, model.sample
    next_evaluate, next_pdf, next_sample, next_is_delta = make_bsdf(names[1:])
    suffix = "_".join(names)

    @wp.func(name=f"bsdf_evaluate_{suffix}")
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        if bsdf.model == wp.static(number):
            return model_evaluate(bsdf, wo, wi)
        return next_evaluate(bsdf, wo, wi)

    @wp.func(name=f"bsdf_pdf_{suffix}")
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        if bsdf.model == wp.static(number):
            return model_pdf(bsdf, wo, wi)
        return next_pdf(bsdf, wo, wi)

    @wp.func(name=f"bsdf_sample_{suffix}")
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        if bsdf.model == wp.static(number):
            return model_sample(bsdf, wo, u, u_lobe)
        return next_sample(bsdf, wo, u, u_lobe)

    @wp.func(name=f"bsdf_is_delta_{suffix}")
    def is_delta(bsdf: Bsdf) -> bool:
        if bsdf.model == wp.static(number):
            return wp.static(delta)
        return next_is_delta(bsdf)

    return BsdfFunctions(evaluate, pdf, sample, is_delta)


@wp.func
def _no_sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    return BsdfSample()


@wp.func
def _no_is_delta(bsdf: Bsdf) -> bool:
    return True
