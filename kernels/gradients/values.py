"""Adjoints of values that vary over a surface: from a slot's value to its factor and to the texels.

A value is linear in its factor and in the texels, so the adjoint of a lookup adds to each texel by its weight. The mip
levels are other texels, which the host derives from those of the image.
"""

import warp as wp

from wrt.kernels.core.features import Features
from wrt.kernels.core.ray_tree import Hit
from wrt.kernels.core.scene_data import VERTEX_ALPHA, ColorSlot, ImageRecord, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface, uv_edges
from wrt.kernels.gradients.sums import ExactSums, GradientSums, add_color
from wrt.kernels.textures.textures import filtered_place, image_gradient, make_slot_color, mip_height, neighbors


@wp.func
def add_bilinear(
    to: ExactSums, first: int, width: int, columns: wp.vec2i, rows: wp.vec2i, share: wp.vec2, gradient: wp.vec3
):
    """Add to four texels; the adjoint of `bilinear` in `kernels/textures/textures.py`."""
    top = first + rows[0] * width
    bottom = first + rows[1] * width
    upper = gradient * (1.0 - share[1])
    lower = gradient * share[1]
    add_color(to, top + columns[0], upper * (1.0 - share[0]))
    add_color(to, top + columns[1], upper * share[0])
    add_color(to, bottom + columns[0], lower * (1.0 - share[0]))
    add_color(to, bottom + columns[1], lower * share[0])


@wp.func
def add_image_color(to: ExactSums, image: ImageRecord, uv: wp.vec2, gradient: wp.vec3):
    """Add to the texels of a lookup; the adjoint of `image_color`. Texels with a palette have no derivative."""
    if image.palette < 0:
        place = filtered_place(image, uv)
        column = wp.floor(place[0])
        row = wp.floor(place[1])
        columns = neighbors(int(column), image.width, image.wrap_u)
        rows = neighbors(int(row), image.height, image.wrap_v)
        add_bilinear(to, image.first, image.width, columns, rows, wp.vec2(place[0] - column, place[1] - row), gradient)


@wp.func
def add_filtered_color(
    to: ExactSums, scene: SceneData, image: ImageRecord, uv: wp.vec2, footprint: wp.vec4, gradient: wp.vec3
):
    """Add to the texels of a lookup in one mip level or two; the adjoint of `filtered_color`."""
    height = mip_height(image, footprint)
    level = int(height)
    share = height - float(level)
    weight = 1.0 - share
    while weight > 0.0:
        record = image
        if level > 0:
            record = scene.images[image.next_level + level - 1]
        add_image_color(to, record, uv, gradient * weight)
        level += 1
        weight = share
        share = 0.0


@wp.func
def by_texel(slot: ColorSlot, color: wp.vec3, gradient: wp.vec3) -> wp.vec3:
    """Return the derivative by the colour of a slot's image, from that by the slot's value."""
    inner = wp.cw_mul(gradient, slot.value)
    if slot.vertex_color != 0:
        inner = wp.cw_mul(inner, color)
    if slot.channel >= 0:
        total = inner[0] + inner[1] + inner[2]
        inner = wp.vec3(0.0)
        inner[slot.channel] = total
    return inner


@specialised("textured", "uv2_alpha", "mipmapped")
def make_add_to_slot(features: Features) -> wp.Function:
    """Return the device function (sums, scene, slot, surface, gradient): from a slot's value at a point to its inputs.

    `gradient` is the derivative by the value; the result is added to `sums.slots` and `sums.texels`. A value with a
    cutoff is a step, whose derivative is 0.
    """
    slot_color = make_slot_color(features.mipmapped)

    @wp.func
    def add_to_textured(sums: GradientSums, scene: SceneData, number: int, surface: Surface, gradient: wp.vec3):
        slot = scene.slots[number]
        if slot.cutoff < 0.0:
            uv = surface.uv
            footprint = surface.footprint
            color = surface.color
            if wp.static(features.uv2_alpha):
                if slot.second != 0:
                    uv = surface.second_uv
                    footprint = wp.vec4()
                if slot.vertex_color == VERTEX_ALPHA:
                    color = wp.vec3(surface.alpha)
            factor = slot
            factor.value = wp.vec3(1.0)
            add_color(sums.slots, number, wp.cw_mul(gradient, slot_color(scene, factor, uv, footprint, color)))
            if slot.image >= 0:
                inner = by_texel(slot, color, gradient)
                image = scene.images[slot.image]
                if wp.static(features.mipmapped):
                    add_filtered_color(sums.texels, scene, image, uv, footprint, inner)
                else:
                    add_image_color(sums.texels, image, uv, inner)

    @wp.func
    def add_to_constant(sums: GradientSums, scene: SceneData, number: int, surface: Surface, gradient: wp.vec3):
        add_color(sums.slots, number, gradient)

    return add_to_textured if features.textured else add_to_constant


@specialised()
def make_by_place(mipmapped: bool) -> wp.Function:
    """Return (scene, slot, triangle, surface, gradient) -> vec2, the derivative by the weights of two corners.

    `gradient` is the derivative by the slot's value at the point. Footprints, and so mip levels, have none.
    """
    slot_color = make_slot_color(mipmapped)

    @wp.func
    def by_place(scene: SceneData, number: int, triangle: int, surface: Surface, gradient: wp.vec3) -> wp.vec2:
        found = wp.vec2(0.0)
        slot = scene.slots[number]
        if slot.cutoff < 0.0:
            if slot.image >= 0:
                image = scene.images[slot.image]
                weight = by_texel(slot, surface.color, gradient)
                by_uv = wp.vec2(0.0)
                if image.nearest == 0:
                    height = float(0.0)
                    if wp.static(mipmapped):
                        height = mip_height(image, surface.footprint)
                    level = int(height)
                    share = height - float(level)
                    by_uv = image_gradient(scene, _level(scene, image, level), surface.uv, weight * (1.0 - share))
                    if share > 0.0:
                        by_uv += image_gradient(scene, _level(scene, image, level + 1), surface.uv, weight * share)
                hit = Hit()
                hit.triangle = triangle
                found += uv_edges(scene, hit) * by_uv
            if slot.vertex_color != 0:
                white = slot_color(scene, slot, surface.uv, surface.footprint, wp.vec3(1.0))
                by_color = wp.cw_mul(gradient, white)
                i = scene.corners[triangle]
                color = scene.colors[i[0]]
                found += wp.vec2(
                    wp.dot(by_color, scene.colors[i[1]] - color), wp.dot(by_color, scene.colors[i[2]] - color)
                )
        return found

    return by_place


@wp.func
def _level(scene: SceneData, image: ImageRecord, level: int) -> ImageRecord:
    record = image
    if level > 0:
        record = scene.images[image.next_level + level - 1]
    return record
