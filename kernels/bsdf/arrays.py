"""The functions of one reflection model over arrays, for checks."""

import functools
from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf import make_bsdf, model_of
from wrt.kernels.core.bsdf import Bsdf, BsdfSample
from wrt.kernels.core.features import identifier


class Kernels(NamedTuple):
    """A model's functions over arrays."""

    evaluate: wp.Kernel
    sample: wp.Kernel


@functools.cache
def kernels_of(model: str) -> Kernels:
    """Return kernels that hold one model alone, in a module of its own."""
    bsdf_evaluate, bsdf_pdf, bsdf_sample = make_bsdf((model,))
    is_delta = int(model_of(model).delta)
    module = wp.get_module(f"wrt.checking.{identifier((model,))}")

    @wp.kernel(module=module, enable_backward=False)
    def evaluate_kernel(
        bsdf: Bsdf,
        wo: wp.array(dtype=wp.vec3),
        wi: wp.array(dtype=wp.vec3),
        value_out: wp.array(dtype=wp.vec3),
        pdf_out: wp.array(dtype=float),
        delta_out: wp.array(dtype=int),
    ):
        i = wp.tid()
        value_out[i] = bsdf_evaluate(bsdf, wo[i], wi[i])
        pdf_out[i] = bsdf_pdf(bsdf, wo[i], wi[i])
        delta_out[i] = wp.static(is_delta)

    @wp.kernel(module=module, enable_backward=False)
    def sample_kernel(
        bsdf: Bsdf, wo: wp.array(dtype=wp.vec3), u: wp.array(dtype=wp.vec3), sample_out: wp.array(dtype=BsdfSample)
    ):
        i = wp.tid()
        sample_out[i] = bsdf_sample(bsdf, wo[i], wp.vec2(u[i][0], u[i][1]), u[i][2])

    return Kernels(evaluate_kernel, sample_kernel)
