"""Colours that vary over a surface."""

import warp as wp

from wrt.kernels.scene_data import SLOT_IMAGE, SLOT_VERTEX_COLOR, ColorSlot, ImageRecord, SceneData


@wp.func
def wrap(i: int, n: int) -> int:
    """Return i modulo n, in [0, n)."""
    r = i % n
    return wp.where(r < 0, r + n, r)


@wp.func
def bilinear(
    texels: wp.array(dtype=wp.vec3), first: int, width: int, top: int, bottom: int, x: float, fy: float
) -> wp.vec3:
    """Return the mean of four texels around column x of two rows, of which `bottom` weighs fy; columns repeat."""
    x0 = int(wp.floor(x))
    fx = x - float(x0)
    left = wrap(x0, width)
    right = wrap(x0 + 1, width)
    top = first + top * width
    bottom = first + bottom * width
    upper = texels[top + left] * (1.0 - fx) + texels[top + right] * fx
    lower = texels[bottom + left] * (1.0 - fx) + texels[bottom + right] * fx
    return upper * (1.0 - fy) + lower * fy


@wp.func
def image_color(texels: wp.array(dtype=wp.vec3), image: ImageRecord, uv: wp.vec2) -> wp.vec3:
    """Return the bilinearly interpolated colour; the image repeats, v points up, row 0 is the top."""
    # Only the fraction matters; taking it first keeps large coordinates within an int.
    x = (uv[0] - wp.floor(uv[0])) * float(image.width) - 0.5
    y = (1.0 - (uv[1] - wp.floor(uv[1]))) * float(image.height) - 0.5
    y0 = int(wp.floor(y))
    top = wrap(y0, image.height)
    bottom = wrap(y0 + 1, image.height)
    return bilinear(texels, image.first, image.width, top, bottom, x, y - float(y0))


@wp.func
def slot_color(scene: SceneData, slot: ColorSlot, uv: wp.vec2, vertex_color: wp.vec3) -> wp.vec3:
    """Return a material slot's value at a point."""
    value = slot.value
    if slot.source == SLOT_IMAGE:
        texel = image_color(scene.texels, scene.images[slot.image], uv)
        if slot.channel >= 0:
            texel = wp.vec3(texel[slot.channel])
        value = wp.cw_mul(value, texel)
    elif slot.source == SLOT_VERTEX_COLOR:
        value = wp.cw_mul(value, vertex_color)
    return value
