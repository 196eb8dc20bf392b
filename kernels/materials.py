"""From a surface to the reflection model there: which material, and its values at the point."""

import functools

import warp as wp

from wrt.kernels.bsdf import identifier, model_number, model_of
from wrt.kernels.bsdf.record import Bsdf, slot_values
from wrt.kernels.features import Features
from wrt.kernels.scene_data import MATERIAL_MIX, MATERIAL_MODEL, SceneData
from wrt.kernels.surface import Surface
from wrt.kernels.textures import make_slot_value
from wrt.kernels.warps import BELOW_ONE

PASSED_THROUGH = wp.constant(-1)

MOST_PASSED = wp.constant(4096)
"""Surfaces that a ray may pass for not being opaque: no scene has so many in a row, and a ray must come to an end."""

MAX_NESTING = 7
"""How deep mixtures may lie within one another."""

_numbers = wp.types.vector(length=MAX_NESTING + 1, dtype=int)
_shares = wp.types.vector(length=MAX_NESTING + 1, dtype=float)


@functools.cache
def make_choose_material(extras: bool = False, mipmapped: bool = False) -> wp.Function:
    """Return the device function (scene, material, surface, u) -> the material that answers, or PASSED_THROUGH.

    A mixture is its parts in the proportion of their weights, so choosing one of them by a random
    number has the right mean; likewise opacity. The rest of the number chooses again further in.
    """
    slot_value = make_slot_value(extras, mipmapped)

    @wp.func(name=f"choose_material{'_extras' * extras}{'_mipmapped' * mipmapped}")
    def choose_material(scene: SceneData, material: int, surface: Surface, u: float) -> int:
        number = int(material)
        while number != PASSED_THROUGH:
            record = scene.materials[number]
            if record.opacity_slot >= 0:
                opacity = wp.clamp(slot_value(scene, record.opacity_slot, surface)[0], 0.0, 1.0)
                if u >= opacity:
                    return PASSED_THROUGH
                u = wp.min(u / opacity, BELOW_ONE)
            if record.kind == MATERIAL_MODEL:
                return number
            if record.kind == MATERIAL_MIX:
                weight = wp.clamp(slot_value(scene, record.first_slot, surface)[0], 0.0, 1.0)
                if u < weight:
                    number = record.second
                    u = wp.min(u / weight, BELOW_ONE)
                else:
                    number = record.first
                    u = wp.min((u - weight) / (1.0 - weight), BELOW_ONE)
            else:
                number = wp.where(surface.front, record.first, record.second)
        return PASSED_THROUGH

    return choose_material


@wp.struct
class Leaves:
    """A material taken apart: what of it is `left` to look at, and what was found so far.

    `leaf` is a material that is made of no others and `share` how much of the whole it is, 0 where there is no further
    one; `passed` is the share that lets light straight through.
    """

    numbers: _numbers
    shares: _shares
    left: int
    leaf: int
    share: float
    passed: float


@wp.func
def leaves_of(material: int) -> Leaves:
    """Return a material that is still whole: as long as there are no others in it, it is its only leaf."""
    leaves = Leaves()
    leaves.numbers[0] = material
    leaves.shares[0] = 1.0
    leaves.left = 1
    leaves.leaf = material
    leaves.share = 1.0
    leaves.passed = 0.0
    return leaves


@functools.cache
def make_next_leaf(extras: bool = False, mipmapped: bool = False) -> wp.Function:
    """Return the device function (scene, leaves, surface) -> the same with the next leaf.

    The last one may come with others left that turn out to be none.
    """
    slot_value = make_slot_value(extras, mipmapped)

    @wp.func(name=f"next_leaf{'_extras' * extras}{'_mipmapped' * mipmapped}")
    def next_leaf(scene: SceneData, leaves: Leaves, surface: Surface) -> Leaves:
        found = leaves
        found.share = 0.0
        while found.left > 0:
            found.left = found.left - 1
            number = found.numbers[found.left]
            record = scene.materials[number]
            share = found.shares[found.left]
            if record.opacity_slot >= 0:
                opacity = wp.clamp(slot_value(scene, record.opacity_slot, surface)[0], 0.0, 1.0)
                found.passed = found.passed + share * (1.0 - opacity)
                share *= opacity
            if record.kind == MATERIAL_MODEL:
                found.leaf = number
                found.share = share
                return found
            if record.kind == MATERIAL_MIX:
                weight = wp.clamp(slot_value(scene, record.first_slot, surface)[0], 0.0, 1.0)
                found.numbers[found.left] = record.first
                found.shares[found.left] = share * (1.0 - weight)
                found.numbers[found.left + 1] = record.second
                found.shares[found.left + 1] = share * weight
                found.left = found.left + 2
            else:
                found.numbers[found.left] = wp.where(surface.front, record.first, record.second)
                found.shares[found.left] = share
                found.left = found.left + 1
        return found

    return next_leaf


@functools.cache
def make_straight(names: tuple[str, ...]) -> wp.Function:
    """Return the device function bsdf, wo -> vec3: the share of light that comes straight through from −wo."""
    if not names:
        return _nothing_straight
    model = model_of(names[0])
    number = model_number(names[0], names)
    next_straight = make_straight(names[1:])
    if model.straight is None:
        return next_straight
    straight = model.straight

    @wp.func(name=f"straight_{identifier(names)}")
    def chain(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
        if bsdf.model == wp.static(number):
            return straight(bsdf, wo)
        return next_straight(bsdf, wo)

    return chain


@functools.cache
def make_is_pane(names: tuple[str, ...]) -> wp.Function:
    """Return the device function bsdf -> bool: whether what comes through goes straight, and shadow rays pass."""
    if not names:
        return _no_pane
    number = model_number(names[0], names)
    next_is_pane = make_is_pane(names[1:])
    if model_of(names[0]).straight is None:
        return next_is_pane

    @wp.func(name=f"is_pane_{identifier(names)}")
    def chain(bsdf: Bsdf) -> bool:
        return bsdf.model == wp.static(number) or next_is_pane(bsdf)

    return chain


@functools.cache
def make_with_index(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, index) -> Bsdf: with another refractive index inside over outside."""
    if not names:
        return _same_bsdf
    number = model_number(names[0], names)
    slot = model_of(names[0]).index_slot
    next_with_index = make_with_index(names[1:])
    if slot < 0:
        return next_with_index

    @wp.func(name=f"with_index_{identifier(names)}")
    def chain(bsdf: Bsdf, index: float) -> Bsdf:
        if bsdf.model == wp.static(number):
            # Some models ask that the index be lower in front; what is behind then changes places with that.
            if index < 1.0:
                bsdf.front = not bsdf.front
                index = 1.0 / index
            bsdf.slots[wp.static(slot)] = wp.vec3(index)
            return bsdf
        return next_with_index(bsdf, index)

    return chain


@wp.func
def _nothing_straight(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
    return wp.vec3(0.0)


@wp.func
def _no_pane(bsdf: Bsdf) -> bool:
    return False


@wp.func
def _same_bsdf(bsdf: Bsdf, index: float) -> Bsdf:
    return bsdf


def has_panes(names: tuple[str, ...]) -> bool:
    """Return whether any of these models lets light through, and only straight on."""
    return any(model_of(name).straight is not None for name in names)


@functools.cache
def make_share_passed(features: Features, *, holes_only: bool = False) -> wp.Function:
    """Return the device function (scene, material, surface, wo) -> vec3: the share of light that goes straight through.

    The mean of what `choose_material` passes and, unless `holes_only`, of what panes do. `wo`, in the surface's frame,
    is where it goes.
    """
    panes = has_panes(features.models) and not holes_only
    bsdf_at = make_bsdf_at(features)
    straight = make_straight(features.models)
    next_leaf = make_next_leaf(features.extras)  # shadow rays are no cones

    @wp.func(name=f"share_{'not_there' if holes_only else 'passed'}_{identifier(features.models)}")
    def share_passed(scene: SceneData, material: int, surface: Surface, wo: wp.vec3) -> wp.vec3:
        leaves = leaves_of(material)
        through = wp.vec3(0.0)
        while leaves.left > 0:
            leaves = next_leaf(scene, leaves, surface)
            if wp.static(panes):
                if leaves.share > 0.0:
                    through += straight(bsdf_at(scene, leaves.leaf, surface), wo) * leaves.share
        return through + wp.vec3(leaves.passed)

    return share_passed


@functools.cache
def make_bsdf_at(features: Features) -> wp.Function:
    """Return the device function (scene, material, surface) -> Bsdf for the models of `features`."""
    return _make_load(features.models, features.textured, features.extras, features.mipmapped)


@functools.cache
def _make_load(names: tuple[str, ...], textured: bool, extras: bool, mipmapped: bool) -> wp.Function:
    """Return a chain of one link a model, as in `kernels.bsdf.make_bsdf`: each knows how many values it reads."""
    if not names:
        return _no_bsdf
    number = model_number(names[0], names)
    count = model_of(names[0]).slots
    next_load = _make_load(names[1:], textured, extras, mipmapped)
    slot_value = make_slot_value(extras, mipmapped)

    @wp.func
    def load(scene: SceneData, material: int, surface: Surface) -> Bsdf:
        record = scene.materials[material]
        if record.model == wp.static(number):
            values = slot_values()
            for k in range(wp.static(count)):
                if wp.static(textured):
                    values[k] = slot_value(scene, record.first_slot + k, surface)
                else:
                    values[k] = scene.slots[record.first_slot + k].value
            bsdf = Bsdf()
            bsdf.model = record.model
            bsdf.front = surface.front
            bsdf.slots = values
            bsdf.tables = scene.tables
            bsdf.table = record.table
            bsdf.normal_variance = surface.normal_variance
            return bsdf
        return next_load(scene, material, surface)

    return load


@wp.func
def _no_bsdf(scene: SceneData, material: int, surface: Surface) -> Bsdf:
    bsdf = Bsdf()
    bsdf.model = -1
    return bsdf
