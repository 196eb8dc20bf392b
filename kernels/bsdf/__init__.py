"""Reflection models by name, and the dispatch among the models of a scene.

A model is a `Model` (see `kernels/core/bsdf.py`), or a factory that makes one from parts: `make_rough_conductor` makes
"rough_conductor:ggx:smith" from "ggx" and "smith". To add one, write its file, name it in `_FILES`, and describe it in
`wrt/scene/materials/`; `register_model` adds one from outside the package.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.core.bsdf import (
    MAX_SLOTS,
    Bsdf,
    BsdfSample,
    Model,
    no_sample,
    zero_evaluate,
    zero_pdf,
)
from wrt.kernels.core.registry import Registry, model_number
from wrt.kernels.core.specialise import specialised


def _check(name: str, model: Model) -> None:
    if not 0 <= model.slots <= MAX_SLOTS:
        raise ValueError(f"{name}: a model reads 0 to {MAX_SLOTS} values, not {model.slots}")


_FILES = {
    **{
        name: name
        for name in ("diffuse", "oren_nayar", "glossy", "principled", "burley", "rough_dielectric", "measured")
    },
    **{name: "conductor" for name in ("mirror", "conductor", "rough_conductor")},
    **{name: "dielectric" for name in ("dielectric", "thin_dielectric", "null")},
    **{name: "plastic" for name in ("plastic", "rough_plastic")},
}
BSDFS: Registry[Model] = Registry({name: f"{__name__}.{file}" for name, file in _FILES.items()}, _check)
register_model = BSDFS.register
current_name = BSDFS.current_name

_CASTER = ":caster"


def caster_name(name: str) -> str:
    """Return the name of a model for surfaces that are nearly smooth, and throw caustics as smooth ones do."""
    return name + _CASTER


def model_of(name: str) -> Model:
    """Return the model of a name; see `Registry.model_of` and `caster_name`."""
    plain = name.removesuffix(_CASTER)
    model = BSDFS.model_of(plain)
    return model if plain == name else model._replace(is_caster=True)


def filtered_name(name: str) -> str:
    """Return the name of a model under a filtered normal map: GGX facets on bumps are no GGX (`bumpy_ggx.py`).

    Models of multiple bounces keep GGX: only its lost energy is tabulated, and the mixture's differs by up to 8 %.
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
    """The device functions of a `Model`, which dispatch on `Bsdf.model`."""

    evaluate: wp.Function
    pdf: wp.Function
    sample: wp.Function


@specialised()
def make_bsdf(names: tuple[str, ...]) -> BsdfFunctions:
    """Return device functions that dispatch among the models `names` by their `model_number`."""
    if not names:
        return BsdfFunctions(zero_evaluate, zero_pdf, _no_sample)
    model, number, following = model_of(names[0]), model_number(names[0]), make_bsdf(names[1:])

    @wp.func
    def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
        if bsdf.model == wp.static(number):
            return model.evaluate(bsdf, wo, wi)
        return following.evaluate(bsdf, wo, wi)

    @wp.func
    def pdf(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> float:
        if bsdf.model == wp.static(number):
            return model.pdf(bsdf, wo, wi)
        return following.pdf(bsdf, wo, wi)

    @wp.func
    def sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
        if bsdf.model == wp.static(number):
            return model.sample(bsdf, wo, u, u_lobe)
        return following.sample(bsdf, wo, u, u_lobe)

    return BsdfFunctions(evaluate, pdf, sample)


@wp.func
def _no_sample(bsdf: Bsdf, wo: wp.vec3, u: wp.vec2, u_lobe: float) -> BsdfSample:
    return no_sample()


@specialised()
def make_by_viewer(names: tuple[str, ...], attribute: str, otherwise: wp.Function) -> wp.Function:
    """Return the device function (bsdf, wo) that is this attribute of the BSDF's model, `otherwise` if it has none."""
    if not names:
        return otherwise
    function, number = getattr(model_of(names[0]), attribute), model_number(names[0])
    following = make_by_viewer(names[1:], attribute, otherwise)
    if function is None:
        return following

    @wp.func
    def by_viewer(bsdf: Bsdf, wo: wp.vec3):
        if bsdf.model == wp.static(number):
            return function(bsdf, wo)
        return following(bsdf, wo)

    return by_viewer


def models_with(names: tuple[str, ...], attribute: str) -> tuple[str, ...]:
    """Return those of the models `names` with this attribute of `Model`, such as "transmits"."""
    return tuple(name for name in names if getattr(model_of(name), attribute))


@specialised()
def make_is_any(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf) -> bool: whether its model is one of `names`."""
    if not names:
        return _is_none
    number = model_number(names[0])
    is_another = make_is_any(names[1:])

    @wp.func
    def is_any(bsdf: Bsdf) -> bool:
        return bsdf.model == wp.static(number) or is_another(bsdf)

    return is_any


@wp.func
def _is_none(bsdf: Bsdf) -> bool:
    return False


@specialised()
def make_receives_light(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf) -> bool: whether it scatters light from lamps, and has not only delta lobes."""
    return make_is_any(tuple(name for name in names if not model_of(name).delta))


@specialised()
def make_is_caster(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf) -> bool: whether it is nearly smooth, and throws caustics."""
    return make_is_any(models_with(names, "is_caster"))


@specialised()
def make_gathers(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf) -> bool: whether it scatters the light of photons, which casters do not."""
    return make_receives_light(tuple(name for name in names if not model_of(name).is_caster))


@specialised()
def make_is_matt(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf) -> bool: whether its model has matt lobes, and delta lobes at most beside."""
    models = {name: model_of(name) for name in names}
    return make_is_any(tuple(k for k, m in models.items() if m.matt or (m.specular is not None and not m.delta)))


def smooth_lobes(name: str) -> str:
    """Return which lobes of a model reflect or refract light in one direction only: "all", "some" or "none".

    Models of panes, which let light straight through, do not count.
    """
    model = model_of(name)
    if model.specular is None and (not model.delta or model.straight is not None):
        return "none"
    return "all" if model.delta else "some"
