"""Colours that vary over a surface."""

import warp as wp

from wrt.kernels.core.scene_data import (
    FIRST_PROCEDURE,
    VERTEX_ALPHA,
    WRAP_CLAMP,
    WRAP_MIRROR,
    WRAP_REPEAT,
    ColorSlot,
    ImageRecord,
    SceneData,
)
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.textures.footprint import texels_across
from wrt.kernels.textures.procedures import make_procedure

VALUES = ("textured", "uv2_alpha", "mipmapped", "procedures")
"""The features on which values of materials depend."""


@wp.func
def mixed(a: wp.vec3, b: wp.vec3, c: wp.vec3, d: wp.vec3, share: wp.vec2) -> wp.vec3:
    """Return the mean of the corners of a square, where b and d have the weight share[0], c and d share[1]."""
    upper = a * (1.0 - share[0]) + b * share[0]
    lower = c * (1.0 - share[0]) + d * share[0]
    return upper * (1.0 - share[1]) + lower * share[1]


@wp.func
def bilinear(
    texels: wp.array(dtype=wp.vec3),
    first: int,
    width: int,
    columns: wp.vec2i,
    rows: wp.vec2i,
    share: wp.vec2,
) -> wp.vec3:
    """Return the interpolation of the texels in two columns and two rows; `share` weights the second ones."""
    top = first + rows[0] * width
    bottom = first + rows[1] * width
    return mixed(
        texels[top + columns[0]],
        texels[top + columns[1]],
        texels[bottom + columns[0]],
        texels[bottom + columns[1]],
        share,
    )


@wp.func
def decoded(code: wp.uint32, palettes: wp.array(dtype=float), palette: int) -> wp.vec3:
    """Return the colour of a code.

    Evaluating the sRGB curve instead takes ten times as long as reading four texels.
    """
    c = int(code)
    return wp.vec3(
        palettes[palette + (c & 255)],
        palettes[palette + 256 + ((c >> 8) & 255)],
        palettes[palette + 512 + ((c >> 16) & 255)],
    )


@wp.func
def bilinear_of_codes(
    scene: SceneData, image: ImageRecord, columns: wp.vec2i, rows: wp.vec2i, share: wp.vec2
) -> wp.vec3:
    """Return the same as `bilinear` for an image with a palette."""
    top = image.first + rows[0] * image.width
    bottom = image.first + rows[1] * image.width
    a = decoded(scene.texel_codes[top + columns[0]], scene.palettes, image.palette)
    b = decoded(scene.texel_codes[top + columns[1]], scene.palettes, image.palette)
    c = decoded(scene.texel_codes[bottom + columns[0]], scene.palettes, image.palette)
    d = decoded(scene.texel_codes[bottom + columns[1]], scene.palettes, image.palette)
    return mixed(a, b, c, d, share)


@wp.func
def wrapped(t: float, mode: int) -> float:
    """Return a texture coordinate brought into [0, 1] by its wrap mode."""
    if mode == WRAP_CLAMP:
        return wp.clamp(t, 0.0, 1.0)
    if mode == WRAP_MIRROR:
        # The mirrored pattern has a period of 2.
        return 1.0 - wp.abs(2.0 * (0.5 * t - wp.floor(0.5 * t)) - 1.0)
    return t - wp.floor(t)


@wp.func
def wrapped_slope(t: float, mode: int) -> float:
    """Return the sign with which a wrapped coordinate follows t: −1 where the pattern is mirrored."""
    if mode == WRAP_MIRROR and 0.5 * t - wp.floor(0.5 * t) > 0.5:
        return -1.0
    return 1.0


@wp.func
def neighbors(i: int, size: int, mode: int) -> wp.vec2i:
    """Return texel i, from −1 to `size`, and the next one along an axis, wrapped at the image's edge."""
    # At the edge, mirrored and clamped images repeat the last texel.
    last = size - 1
    first = wp.clamp(i, 0, last)
    second = wp.clamp(i + 1, 0, last)
    if mode == WRAP_REPEAT:
        # Without a remainder, which is an integer division.
        first = wp.where(i < 0, last, wp.where(i > last, 0, first))
        second = wp.where(i >= last, 0, second)
    return wp.vec2i(first, second)


@wp.func
def place_in_image(image: ImageRecord, uv: wp.vec2) -> wp.vec2:
    """Return column and row of the texel centre at texture coordinates; v points up, row 0 is the top."""
    u = image.to_u[0] * uv[0] + image.to_u[1] * uv[1] + image.to_u[2]
    v = image.to_v[0] * uv[0] + image.to_v[1] * uv[1] + image.to_v[2]
    # Wrap first: large coordinates would overflow an int.
    x = wrapped(u, image.wrap_u) * float(image.width) - 0.5
    y = (1.0 - wrapped(v, image.wrap_v)) * float(image.height) - 0.5
    return wp.vec2(x, y)


@wp.func
def filtered_place(image: ImageRecord, uv: wp.vec2) -> wp.vec2:
    """Return the same, and for an image without a filter the nearest texel's."""
    place = place_in_image(image, uv)
    if image.nearest != 0:
        return wp.vec2(wp.floor(place[0] + 0.5), wp.floor(place[1] + 0.5))
    return place


@wp.func
def image_color(scene: SceneData, image: ImageRecord, uv: wp.vec2) -> wp.vec3:
    """Return the filtered colour at texture coordinates."""
    place = filtered_place(image, uv)
    x = place[0]
    y = place[1]
    first_column = wp.floor(x)
    first_row = wp.floor(y)
    columns = neighbors(int(first_column), image.width, image.wrap_u)
    rows = neighbors(int(first_row), image.height, image.wrap_v)
    share = wp.vec2(x - first_column, y - first_row)
    if image.palette >= 0:
        return bilinear_of_codes(scene, image, columns, rows, share)
    return bilinear(scene.texels, image.first, image.width, columns, rows, share)


@wp.func
def image_gradient(scene: SceneData, image: ImageRecord, uv: wp.vec2, weight: wp.vec3) -> wp.vec2:
    """Return how the sum of the channels of `image_color`, by weights, changes along u and along v."""
    place = place_in_image(image, uv)
    x = place[0]
    y = place[1]
    first_column = wp.floor(x)
    first_row = wp.floor(y)
    columns = neighbors(int(first_column), image.width, image.wrap_u)
    rows = neighbors(int(first_row), image.height, image.wrap_v)
    # The interpolation is linear along each axis, so differences of its ends are exact.
    change = wp.vec2(0.0)
    for k in range(2):
        end = float(k)
        share = wp.vec2(end, y - first_row)
        across = wp.vec2(x - first_column, end)
        if image.palette >= 0:
            along_x = bilinear_of_codes(scene, image, columns, rows, share)
            along_y = bilinear_of_codes(scene, image, columns, rows, across)
        else:
            along_x = bilinear(scene.texels, image.first, image.width, columns, rows, share)
            along_y = bilinear(scene.texels, image.first, image.width, columns, rows, across)
        sign = 2.0 * end - 1.0
        change += wp.vec2(wp.dot(along_x, weight), -wp.dot(along_y, weight)) * sign  # rows run down, v runs up
    u = image.to_u[0] * uv[0] + image.to_u[1] * uv[1] + image.to_u[2]
    v = image.to_v[0] * uv[0] + image.to_v[1] * uv[1] + image.to_v[2]
    size = wp.vec2(float(image.width), float(image.height))
    change = wp.cw_mul(change, wp.cw_mul(size, wp.vec2(wrapped_slope(u, image.wrap_u), wrapped_slope(v, image.wrap_v))))
    return wp.vec2(
        image.to_u[0] * change[0] + image.to_v[0] * change[1], image.to_u[1] * change[0] + image.to_v[1] * change[1]
    )


@wp.func
def mip_height(image: ImageRecord, footprint: wp.vec4) -> float:
    """Return the mip level for a footprint, 0 for the image itself; between two levels it is not whole."""
    if image.levels > 0:
        texels = texels_across(footprint, image)
        if texels > 1.0:
            return wp.min(wp.log2(texels), float(image.levels))
    return 0.0


@wp.func
def filtered_color(scene: SceneData, image: ImageRecord, uv: wp.vec2, footprint: wp.vec4) -> wp.vec3:
    """Return the colour around texture coordinates, between the two mip levels nearest to the footprint.

    Williams (1983), "Pyramidal parametrics". If a texel is wider than the footprint it is `image_color`.
    """
    height = mip_height(image, footprint)
    level = int(height)
    share = height - float(level)
    # A loop, so that the kernel contains the lookup once: two copies cost more, by code size, than the lookup.
    color = wp.vec3(0.0)
    weight = 1.0 - share
    while weight > 0.0:
        record = image
        if level > 0:
            record = scene.images[image.next_level + level - 1]
        color += image_color(scene, record, uv) * weight
        level += 1
        weight = share
        share = 0.0
    return color


@specialised()
def make_slot_color(mipmapped: bool = False) -> wp.Function:
    """Return the device function (scene, slot, uv, footprint, vertex_color) -> a material slot's value at a point."""

    @wp.func
    def slot_color(
        scene: SceneData, slot: ColorSlot, uv: wp.vec2, footprint: wp.vec4, vertex_color: wp.vec3
    ) -> wp.vec3:
        value = slot.value
        if slot.image >= 0:
            texel = wp.vec3()
            if wp.static(mipmapped):
                texel = filtered_color(scene, scene.images[slot.image], uv, footprint)
            else:
                texel = image_color(scene, scene.images[slot.image], uv)
            if slot.channel >= 0:
                texel = wp.vec3(texel[slot.channel])
            value = wp.cw_mul(value, texel)
        if slot.vertex_color != 0:
            value = wp.cw_mul(value, vertex_color)
        if slot.cutoff >= 0.0:
            value = wp.vec3(wp.where(value[0] >= slot.cutoff, 1.0, 0.0))
        return value

    return slot_color


@specialised()
def make_slot_value(uv2_alpha: bool = False, mipmapped: bool = False, procedures: tuple[str, ...] = ()) -> wp.Function:
    """Return the device function (scene, slot, surface) -> vec3: the value of a material's slot at a point."""
    if procedures:
        otherwise, procedure = make_slot_value(uv2_alpha, mipmapped, ()), make_procedure(procedures)

        @wp.func
        def slot_or_procedure(scene: SceneData, slot: int, surface: Surface) -> wp.vec3:
            record = scene.slots[slot]
            if record.image > FIRST_PROCEDURE:
                return otherwise(scene, slot, surface)
            return procedure(scene, record.second, FIRST_PROCEDURE - record.image, surface)

        return slot_or_procedure
    slot_color = make_slot_color(mipmapped)

    @wp.func
    def slot_value(scene: SceneData, slot: int, surface: Surface) -> wp.vec3:
        return slot_color(scene, scene.slots[slot], surface.uv, surface.footprint, surface.color)

    @wp.func
    def slot_value_uv2_alpha(scene: SceneData, slot: int, surface: Surface) -> wp.vec3:
        record = scene.slots[slot]
        uv = surface.uv
        footprint = surface.footprint
        if record.second != 0:
            uv = surface.second_uv
            footprint = wp.vec4()  # the footprint belongs to the first coordinates
        color = surface.color
        if record.vertex_color == VERTEX_ALPHA:
            color = wp.vec3(surface.alpha)
        return slot_color(scene, record, uv, footprint, color)

    return slot_value_uv2_alpha if uv2_alpha else slot_value
