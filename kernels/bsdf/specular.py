"""The single directions of smooth surfaces, all at once: what ray trees follow, where a path draws one of them."""

import functools

import warp as wp

from wrt.kernels.bsdf import identifier, model_number, model_of
from wrt.kernels.bsdf.record import Bsdf, SpecularLobes, no_lobes


@functools.cache
def make_specular(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, wo) -> SpecularLobes for the models `names`, a chain as in `make_bsdf`."""
    if not names:
        return no_lobes
    number = model_number(names[0], names)
    model_lobes = model_of(names[0]).specular or no_lobes
    next_lobes = make_specular(names[1:])

    @wp.func(name=f"bsdf_specular_{identifier(names)}")
    def lobes(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
        if bsdf.model == wp.static(number):
            return model_lobes(bsdf, wo)
        return next_lobes(bsdf, wo)

    return lobes
