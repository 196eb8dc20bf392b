"""Derivatives of reflection models by their values, through Warp's adjoints of the models' own functions.

Warp differentiates a function whose result is then weighted, as its adjoint starts from ones. A differentiated function
must not return a float, whose seed Warp 1.19 does not compile.
"""

from typing import NamedTuple

import warp as wp

from wrt.kernels.bsdf import make_bsdf, make_by_viewer, model_of
from wrt.kernels.core.bsdf import Bsdf, no_lobes, slot_values
from wrt.kernels.core.registry import model_number
from wrt.kernels.core.specialise import specialised
from wrt.kernels.materials.values import make_with_normals

pair_of_colors = wp.types.matrix(shape=(2, 3), dtype=float)


class WeightedBsdf(NamedTuple):
    """The functions that are differentiated.

    Attributes:
        value: (bsdf, wo, wi, weight) -> vec3, f |cosθi| times a weight for each channel.
        lobes: (bsdf, wo, weight, weight_through) -> vec3, the mirrored delta lobe and the one through the surface.
        straight: (bsdf, wo, weight) -> vec3, the light that passes straight on.
    """

    value: wp.Function
    lobes: wp.Function
    straight: wp.Function


@wp.func
def _nothing_straight(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
    return wp.vec3(0.0)


def differentiable(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return those of the models `names` that have derivatives by their slots.

    The film of "principled" changes little where it ends its sum of waves, and quotients do not prove its derivatives.
    """
    filmed = [name for name in names if name.startswith("principled:") and "film" in name.split(":")]
    return tuple(name for name in names if model_of(name).slots and name not in filmed)


def slots_without_derivative(name: str) -> tuple[int, ...]:
    """Return the slots of a model that have no derivative here.

    With dispersion a row of the slots is overwritten for each channel, whose adjoint Warp 1.19 gets wrong. For other
    indices of smooth boundaries see `bending_slot`.
    """
    model = model_of(name)
    if not differentiable((name,)):
        return tuple(range(model.slots))
    has_fixed_index = model.index_slot >= 0 and (model.delta or model.channels_slot >= 0) and bending_slot(name) < 0
    return (model.index_slot,) if has_fixed_index else ()


def bending_slot(name: str) -> int:
    """Return the slot of the index of a smooth boundary, −1 for other models.

    It decides where refracted light goes, and so all that a path finds from there on: see `tangents.py`. How that turns
    with the index is known of the directions of `Model.specular`.
    """
    model = model_of(name)
    return model.index_slot if model.delta and model.specular is not None and model.channels_slot < 0 else -1


@specialised()
def make_weighted(names: tuple[str, ...]) -> WeightedBsdf:
    """Return the functions for these models, which are `differentiable`."""
    evaluate = make_bsdf(names).evaluate
    specular = make_by_viewer(names, "specular", no_lobes)
    straight_share = make_by_viewer(names, "straight", _nothing_straight)

    @wp.func
    def value(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3, weight: wp.vec3) -> wp.vec3:
        return wp.cw_mul(evaluate(bsdf, wo, wi), weight)

    @wp.func
    def lobes(bsdf: Bsdf, wo: wp.vec3, weight: wp.vec3, weight_through: wp.vec3) -> wp.vec3:
        found = specular(bsdf, wo)
        return wp.cw_mul(found.reflected, weight) + wp.cw_mul(found.transmitted, weight_through)

    @wp.func
    def straight(bsdf: Bsdf, wo: wp.vec3, weight: wp.vec3) -> wp.vec3:
        return wp.cw_mul(straight_share(bsdf, wo), weight)

    return WeightedBsdf(value, lobes, straight)


@wp.func
def over(gradient: wp.vec3, value: wp.vec3) -> wp.vec3:
    """Return the quotient where the value is positive, else 0: a path that loses all light tells no derivative."""
    quotient = wp.vec3(0.0)
    for c in range(3):
        if value[c] > 0.0:
            quotient[c] = gradient[c] / value[c]
    return quotient


@specialised()
def make_lobe_weights(names: tuple[str, ...]) -> wp.Function:
    """Return (bsdf, wo, wi, gradient) -> mat23: weights of both delta lobes, for the log of the one towards wi."""
    specular = make_by_viewer(names, "specular", no_lobes)

    @wp.func
    def lobe_weights(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3, gradient: wp.vec3) -> pair_of_colors:
        lobes = specular(bsdf, wo)
        weights = pair_of_colors()
        if wi[2] > 0.0:
            weights[0] = over(gradient, lobes.reflected)
        else:
            weights[1] = over(gradient, lobes.transmitted)
        return weights

    return lobe_weights


@specialised()
def make_own_slots(names: tuple[str, ...]) -> wp.Function:
    """Return (bsdf, gradients, between_bodies, own_normals) -> slot_values, without what is not the material's.

    Between bodies the refractive index is theirs, with dispersion it has no derivative, and the probabilities of the
    channels are those of the path; and a coat's normals are those of its normal map.
    """
    without_index, with_normals = _make_without_index(names), make_with_normals(names)

    @wp.func
    def own_slots(bsdf: Bsdf, gradients: slot_values, between_bodies: bool, own_normals: bool) -> slot_values:
        own = Bsdf()
        own.model = bsdf.model
        own.slots = gradients
        if own_normals:
            own = with_normals(own, wp.vec4(0.0))
        own = without_index(own, between_bodies)
        return own.slots

    return own_slots


@wp.func
def _same(bsdf: Bsdf, between_bodies: bool) -> Bsdf:
    return bsdf


@specialised()
def _make_without_index(names: tuple[str, ...]) -> wp.Function:
    if not names:
        return _same
    model, number, following = model_of(names[0]), model_number(names[0]), _make_without_index(names[1:])
    if model.index_slot < 0:
        return following

    @wp.func
    def without_index(bsdf: Bsdf, between_bodies: bool) -> Bsdf:
        if bsdf.model == wp.static(number):
            if between_bodies or wp.static(model.channels_slot >= 0):
                bsdf.slots[wp.static(model.index_slot)] = wp.vec3(0.0)
            if wp.static(model.channels_slot >= 0):
                bsdf.slots[wp.static(model.channels_slot)] = wp.vec3(0.0)
            return bsdf
        return following(bsdf, between_bodies)

    return without_index
