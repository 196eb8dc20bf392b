"""The functions of one reflection model over arrays, for checks."""

import functools
from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf import make_bsdf, model_of
from wrt.kernels.core.bsdf import Bsdf, BsdfSample
from wrt.kernels.core.features import identifier
from wrt.kernels.core.rays import make_frame
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.materials.values import make_at


class Kernels(NamedTuple):
    """A model's functions over arrays."""

    evaluate: wp.Kernel
    sample: wp.Kernel


@functools.cache
def kernels_of(model: str) -> Kernels:
    """Return kernels that hold one model alone, in a module of its own."""
    bsdf_evaluate, bsdf_pdf, bsdf_sample = make_bsdf((model,))
    is_delta, varies, at = int(model_of(model).delta), model_of(model).at is not None, make_at((model,))
    module = wp.get_module(f"wrt.checking.{identifier((model,))}")

    @wp.func
    def at_place(bsdf: Bsdf, position: wp.vec3, uv: wp.vec2) -> Bsdf:
        if wp.static(varies):
            surface = Surface()
            surface.position = position
            surface.uv = uv
            surface.normal = wp.vec3(0.0, 0.0, 1.0)
            surface.frame = make_frame(surface.normal)
            surface.front = bsdf.front
            return at(bsdf, surface)
        return bsdf

    @wp.kernel(module=module, enable_backward=False)
    def evaluate_kernel(
        bsdf: Bsdf,
        position: wp.vec3,
        uv: wp.vec2,
        wo: wp.array(dtype=wp.vec3),
        wi: wp.array(dtype=wp.vec3),
        value_out: wp.array(dtype=wp.vec3),
        pdf_out: wp.array(dtype=float),
        delta_out: wp.array(dtype=int),
    ):
        i = wp.tid()
        here = at_place(bsdf, position, uv)
        value_out[i] = bsdf_evaluate(here, wo[i], wi[i])
        pdf_out[i] = bsdf_pdf(here, wo[i], wi[i])
        delta_out[i] = wp.static(is_delta)

    @wp.kernel(module=module, enable_backward=False)
    def sample_kernel(
        bsdf: Bsdf,
        position: wp.vec3,
        uv: wp.vec2,
        wo: wp.array(dtype=wp.vec3),
        u: wp.array(dtype=wp.vec3),
        sample_out: wp.array(dtype=BsdfSample),
    ):
        i = wp.tid()
        sample_out[i] = bsdf_sample(at_place(bsdf, position, uv), wo[i], wp.vec2(u[i][0], u[i][1]), u[i][2])

    return Kernels(evaluate_kernel, sample_kernel)
