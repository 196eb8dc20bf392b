"""The parts of a mixture: choosing one at random, or visiting all."""

import warp as wp

from wrt.kernels.core.scene_data import MATERIAL_MIX, MATERIAL_MODEL, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.sampling.warps import BELOW_ONE
from wrt.kernels.textures.textures import make_slot_value

PASSED_THROUGH = wp.constant(-1)

MOST_PASSED = wp.constant(4096)
"""Limit on the surfaces that a ray passes because they are not opaque; no scene has that many in a row."""

MAX_NESTING = 7
"""The greatest depth of mixtures within mixtures."""

_numbers = wp.types.vector(length=MAX_NESTING + 1, dtype=int)
_shares = wp.types.vector(length=MAX_NESTING + 1, dtype=float)


@specialised()
def make_choose_material(
    uv2_alpha: bool = False, mipmapped: bool = False, procedures: tuple[str, ...] = ()
) -> wp.Function:
    """Return the device function (scene, material, surface, u) -> the chosen material, or PASSED_THROUGH.

    Choosing one part of a mixture with the probability of its weight has the right mean; likewise opacity. The random
    number is rescaled after each choice and reused for the next.
    """
    slot_value = make_slot_value(uv2_alpha, mipmapped, procedures)

    @wp.func
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


@wp.func
def material_of_side(scene: SceneData, material: int, surface: Surface) -> int:
    """Return the material on the side of a surface that is seen; there must be no mixtures, and no holes."""
    number = int(material)
    while scene.materials[number].kind != MATERIAL_MODEL:
        number = wp.where(surface.front, scene.materials[number].first, scene.materials[number].second)
    return number


@wp.struct
class Leaves:
    """A traversal of a material's parts: the number `remaining` to visit, and the current one.

    `leaf` is a material without parts and `share` its weight in the whole, 0 if there are no more; `passed` is the
    share of light that goes straight through.
    """

    numbers: _numbers
    shares: _shares
    remaining: int
    leaf: int
    share: float
    passed: float


@wp.func
def leaves_of(material: int) -> Leaves:
    """Return the start of a traversal; a material without parts is its only leaf."""
    leaves = Leaves()
    leaves.numbers[0] = material
    leaves.shares[0] = 1.0
    leaves.remaining = 1
    leaves.leaf = material
    leaves.share = 1.0
    leaves.passed = 0.0
    return leaves


@specialised()
def make_next_leaf(uv2_alpha: bool = False, mipmapped: bool = False, procedures: tuple[str, ...] = ()) -> wp.Function:
    """Return the device function (scene, leaves, surface) -> Leaves, moved on to the next leaf.

    The leaf's share may be 0, and is 0 if no leaf was left.
    """
    slot_value = make_slot_value(uv2_alpha, mipmapped, procedures)

    @wp.func
    def next_leaf(scene: SceneData, leaves: Leaves, surface: Surface) -> Leaves:
        found = leaves
        found.share = 0.0
        while found.remaining > 0:
            found.remaining = found.remaining - 1
            number = found.numbers[found.remaining]
            record = scene.materials[number]
            share = found.shares[found.remaining]
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
                found.numbers[found.remaining] = record.first
                found.shares[found.remaining] = share * (1.0 - weight)
                found.numbers[found.remaining + 1] = record.second
                found.shares[found.remaining + 1] = share * weight
                found.remaining = found.remaining + 2
            else:
                found.numbers[found.remaining] = wp.where(surface.front, record.first, record.second)
                found.shares[found.remaining] = share
                found.remaining = found.remaining + 1
        return found

    return next_leaf
