"""What ray trees need from a reflection model: jitter, and all delta directions at once. Paths sample one of them."""

import warp as wp

from wrt.kernels.bsdf import model_of
from wrt.kernels.bsdf.record import Bsdf, SpecularLobes, no_lobes
from wrt.kernels.registry import model_number
from wrt.kernels.specialise import specialised


@specialised()
def make_specular(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, wo) -> SpecularLobes for the models `names`, a chain as in `make_bsdf`."""
    if not names:
        return no_lobes
    number = model_number(names[0])
    model_lobes = model_of(names[0]).specular or no_lobes
    next_lobes = make_specular(names[1:])

    @wp.func
    def lobes(bsdf: Bsdf, wo: wp.vec3) -> SpecularLobes:
        if bsdf.model == wp.static(number):
            return model_lobes(bsdf, wo)
        return next_lobes(bsdf, wo)

    return lobes


@specialised()
def make_jitters(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf) -> bool: whether ray trees send rays of the model's `sample` on."""
    if not names:
        return _never
    number = model_number(names[0])
    model_jitters = model_of(names[0]).jitters
    next_jitters = make_jitters(names[1:])

    @wp.func
    def jitters(bsdf: Bsdf) -> bool:
        if bsdf.model == wp.static(number):
            return wp.static(model_jitters)
        return next_jitters(bsdf)

    return jitters


@wp.func
def _never(bsdf: Bsdf) -> bool:
    return False
