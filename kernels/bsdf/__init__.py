"""Reflection models by name, and the dispatch among those that a scene uses.

A model is a file that ends in a `MODEL` (see `kernels/bsdf/record.py`), or has a factory that makes one for
each choice of its parts: "rough_conductor:ggx:smith" is what `make_rough_conductor` in `rough_conductor.py` makes of
"ggx" and "smith". To add one, write the file, name it in `_BUILT_IN`, and describe it in `wrt/materials/`;
`register_model` adds one from outside.
"""

import functools
import importlib
from collections.abc import Callable
from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf.record import MAX_SLOTS, Bsdf, BsdfSample, Model, no_sample, zero_evaluate, zero_pdf

_BUILT_IN = (
    *("diffuse", "mirror", "conductor", "rough_conductor", "dielectric", "glossy", "null", "oren_nayar", "plastic"),
    *("principled", "rough_dielectric", "rough_plastic", "thin_dielectric"),
)


def _model_in(file: str, *parts: str) -> Model:
    """Return the model in a file of this folder, which is read when a scene uses it: all take a tenth of a start."""
    found = importlib.import_module(f"wrt.kernels.bsdf.{file}")
    make = getattr(found, f"make_{file}", None)
    model: Model = found.MODEL if make is None else make(*parts)
    return model


FAMILIES: dict[str, Callable[..., Model]] = {name: functools.partial(_model_in, name) for name in _BUILT_IN}
"""What makes the models of each family, of the parts in their names."""


class _Registered(NamedTuple):
    """A model from outside: whose it is, and what it has been, with what it is now last."""

    owner: str
    revisions: list[Model]


_REGISTERED: dict[str, _Registered] = {}


def register_model(name: str, model: Model, owner: str = "") -> None:
    """Let materials name a model of one's own, in place of what its owner registered by that name before.

    Args:
        name: what a material's `model` says; letters, digits and underscores.
        model: its device functions.
        owner: whose it is; nobody else can replace it.

    Raises:
        ValueError: where the name is another's or not an identifier, or the model reads too many values.
    """
    if not name.isidentifier():
        raise ValueError(f"a model's name must be an identifier, not {name!r}")
    known = _REGISTERED.get(name, _Registered(owner, []))
    if name in _BUILT_IN or known.owner != owner:
        raise ValueError(f"there is a model {name!r} already")
    if not 0 <= model.slots <= MAX_SLOTS:
        raise ValueError(f"{name}: a model reads 0 to {MAX_SLOTS} values, not {model.slots}")
    if known.revisions[-1:] != [model]:
        known.revisions.append(model)
    _REGISTERED[name] = known
    FAMILIES[name] = lambda revision="revision0": known.revisions[int(revision.removeprefix("revision"))]


def current_name(name: str) -> str:
    """Return the name by which kernels know what a material's `model` is now.

    A model that was registered again has another one than before: whatever is kept by name, from dispatch to compiled
    kernels, is then never that of older functions.
    """
    revision = len(_REGISTERED[name].revisions) - 1 if name in _REGISTERED else 0
    return f"{name}:revision{revision}" if revision else name


@functools.cache
def model_of(name: str) -> Model:
    """Return the model that a name such as "diffuse" or "rough_conductor:ggx:smith" stands for."""
    family, *parts = name.split(":")
    return FAMILIES[family](*parts)


def model_number(name: str, names: tuple[str, ...]) -> int:
    """Return the number that stands for a model in kernels made for `names`."""
    return len(names) - 1 - names.index(name)


class BsdfFunctions(NamedTuple):
    """The device functions that dispatch on `Bsdf.model`."""

    evaluate: wp.Function
    pdf: wp.Function
    sample: wp.Function
    is_delta: wp.Function
    transmits: wp.Function


@functools.cache
def make_bsdf(names: tuple[str, ...]) -> BsdfFunctions:
    """Return device functions that know the models `names` alone, by their `model_number`.

    One link a model, each calling the next. Not a static loop over the models: Warp's hash of a
    function leaves out a `wp.static` that depends on a loop variable, so kernels of different
    scenes would be taken for one another.
    """
    if not names:
        return BsdfFunctions(zero_evaluate, zero_pdf, _no_sample, _no_is_delta, _no_transmits)
    model = model_of(names[0])
    number = model_number(names[0], names)
    delta, model_transmits = model.delta, model.transmits
    model_evaluate, model_pdf, model_sample = model.evaluate, model.pdf, model.sample
    next_evaluate, next_pdf, next_sample, next_is_delta, next_transmits = make_bsdf(names[1:])
    suffix = identifier(names)

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

    @wp.func(name=f"bsdf_transmits_{suffix}")
    def transmits(bsdf: Bsdf) -> bool:
        if bsdf.model == wp.static(number):
            return wp.static(model_transmits)
        return next_transmits(bsdf)

    return BsdfFunctions(evaluate, pdf, sample, is_delta, transmits)


def identifier(names: tuple[str, ...]) -> str:
    """Return one identifier for several model names."""
    return "_".join(names).replace(":", "_").replace("-", "_")


@wp.func
def _no_sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    return no_sample()


@wp.func
def _no_is_delta(bsdf: Bsdf) -> bool:
    return True


@wp.func
def _no_transmits(bsdf: Bsdf) -> bool:
    return False
