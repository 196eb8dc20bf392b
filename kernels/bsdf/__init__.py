"""Reflection models by name, and the dispatch among those that a scene uses.

A model is a file with a `MODEL` (see `kernels/bsdf/record.py`), or with a factory that makes one from parts:
`make_rough_conductor` in `rough_conductor.py` makes "rough_conductor:ggx:smith" from "ggx" and "smith". To add one,
write the file, name it in `BSDFS`, and describe it in `wrt/scene/materials/`; `register_model` adds one from outside
the package.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf.record import MAX_SLOTS, Bsdf, BsdfSample, Model, no_sample, zero_evaluate, zero_pdf
from wrt.kernels.registry import Registry, model_number
from wrt.kernels.specialise import specialised


def _check(name: str, model: Model) -> None:
    if not 0 <= model.slots <= MAX_SLOTS:
        raise ValueError(f"{name}: a model reads 0 to {MAX_SLOTS} values, not {model.slots}")


BSDFS: Registry[Model] = Registry(
    __name__,
    (
        *("diffuse", "mirror", "conductor", "rough_conductor", "dielectric", "glossy", "null", "oren_nayar"),
        *("plastic", "principled", "burley", "rough_dielectric", "rough_plastic", "thin_dielectric"),
        "measured",
    ),
    _check,
)
register_model = BSDFS.register
current_name = BSDFS.current_name
model_of = BSDFS.model_of


def filtered_name(name: str) -> str:
    """Return the name of a model under a filtered normal map: GGX facets on bumps are no GGX (`bumpy_ggx.py`).

    Models of multiple bounces keep GGX, whose lost energy is tabulated: that of the mixture is not, and differs by up
    to 8 %.
    """
    family, *parts = name.split(":")
    if "multiple" in parts or "bounces" in parts:
        return name
    if family == "principled":
        return ":".join((name, "bumpy"))
    if family.startswith("rough_"):
        return ":".join((family, *("bumpy-ggx" if part == "ggx" else part for part in parts)))
    return name


class BsdfFunctions(NamedTuple):
    """The device functions that dispatch on `Bsdf.model`."""

    evaluate: wp.Function
    pdf: wp.Function
    sample: wp.Function
    is_delta: wp.Function
    transmits: wp.Function


@specialised()
def make_bsdf(names: tuple[str, ...]) -> BsdfFunctions:
    """Return device functions that dispatch among the models `names` by their `model_number`."""
    if not names:
        return BsdfFunctions(zero_evaluate, zero_pdf, _no_sample, _no_is_delta, _no_transmits)
    model = model_of(names[0])
    number = model_number(names[0])
    delta, model_transmits = model.delta, model.transmits
    model_evaluate, model_pdf, model_sample = model.evaluate, model.pdf, model.sample
    following = make_bsdf(names[1:])
    next_evaluate, next_pdf, next_sample = following.evaluate, following.pdf, following.sample
    next_is_delta, next_transmits = following.is_delta, following.transmits

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        if bsdf.model == wp.static(number):
            return model_evaluate(bsdf, wo, wi)
        return next_evaluate(bsdf, wo, wi)

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        if bsdf.model == wp.static(number):
            return model_pdf(bsdf, wo, wi)
        return next_pdf(bsdf, wo, wi)

    @wp.func
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        if bsdf.model == wp.static(number):
            return model_sample(bsdf, wo, u, u_lobe)
        return next_sample(bsdf, wo, u, u_lobe)

    @wp.func
    def is_delta(bsdf: Bsdf) -> bool:
        if bsdf.model == wp.static(number):
            return wp.static(delta)
        return next_is_delta(bsdf)

    @wp.func
    def transmits(bsdf: Bsdf) -> bool:
        if bsdf.model == wp.static(number):
            return wp.static(model_transmits)
        return next_transmits(bsdf)

    return BsdfFunctions(evaluate, pdf, sample, is_delta, transmits)


@wp.func
def _no_sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    return no_sample()


@wp.func
def _no_is_delta(bsdf: Bsdf) -> bool:
    return True


@wp.func
def _no_transmits(bsdf: Bsdf) -> bool:
    return False
