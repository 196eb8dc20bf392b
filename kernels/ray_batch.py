"""Many rays given as arrays: putting neighbours together, and tracing them."""

import warp as wp

from wrt.kernels.bvh import Bvh, bvh_any_hit, bvh_closest_hit

# A key has 24 bits: four levels of (direction, place), three bits each, sorted twelve at a time.
KEY_LEVELS = 4
DIGIT_BITS = 12
DIGITS = 1 << DIGIT_BITS


@wp.func
def ray_key(origin: wp.vec3, direction: wp.vec3, low: wp.vec3, inverse_extent: wp.vec3) -> int:
    """Return a number that is near for rays that take much the same way.

    The bits of the direction and of where the ray enters the box of the scene, interleaved: a curve
    through five dimensions (the sixth is lost where the origin is moved along the ray).
    """
    place = wp.cw_mul(origin - low, inverse_extent)
    heading = wp.cw_mul(direction, inverse_extent)
    enter = float(0.0)
    for k in range(3):
        if heading[k] != 0.0:
            enter = wp.max(enter, wp.min(-place[k] / heading[k], (1.0 - place[k]) / heading[k]))
    place += heading * enter
    unit = wp.normalize(direction)
    levels = wp.static(1 << KEY_LEVELS)
    key = int(0)
    for k in range(3):
        p = wp.clamp(int(place[k] * float(levels)), 0, levels - 1)
        d = wp.clamp(int((0.5 * unit[k] + 0.5) * float(levels)), 0, levels - 1)
        for level in range(wp.static(KEY_LEVELS)):
            key = key | (((p >> level) & 1) << (6 * level + k)) | (((d >> level) & 1) << (6 * level + 3 + k))
    return key


@wp.kernel(enable_backward=False)
def order_rays(
    first: int,
    block: int,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    low: wp.vec3,
    inverse_extent: wp.vec3,
    keys: wp.array(dtype=int),
    spare: wp.array(dtype=int),
    counts: wp.array(dtype=int),
    order_out: wp.array(dtype=int),
):
    """Sort the numbers of the rays of one block of `block` rays a thread by `ray_key` (radix sort).

    `keys` and `spare` are working space as long as the rays, `counts` DIGITS for each block.
    """
    i = first + wp.tid()
    begin = i * block
    end = wp.min(begin + block, origins.shape[0])
    for ray in range(begin, end):
        keys[ray] = ray_key(origins[ray], directions[ray], low, inverse_extent)
    base = i * wp.static(DIGITS)
    for turn in range(2):
        shift = turn * wp.static(DIGIT_BITS)
        for digit in range(wp.static(DIGITS)):
            counts[base + digit] = 0
        for ray in range(begin, end):
            digit = (keys[ray] >> shift) & wp.static(DIGITS - 1)
            counts[base + digit] = counts[base + digit] + 1
        start = begin
        for digit in range(wp.static(DIGITS)):
            n = counts[base + digit]
            counts[base + digit] = start
            start += n
        for k in range(begin, end):
            ray = k
            if turn == 1:
                ray = spare[k]
            digit = (keys[ray] >> shift) & wp.static(DIGITS - 1)
            place = counts[base + digit]
            counts[base + digit] = place + 1
            if turn == 0:
                spare[place] = ray
            else:
                order_out[place] = ray


@wp.kernel(enable_backward=False)
def gather_rays(
    first: int,
    order: wp.array(dtype=int),
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    t_max: wp.array(dtype=float),
    origins_out: wp.array(dtype=wp.vec3),
    directions_out: wp.array(dtype=wp.vec3),
    t_max_out: wp.array(dtype=float),
):
    """Copy rays into an order. Apart from the tracing, so that many of its cache misses overlap."""
    i = first + wp.tid()
    ray = order[i]
    origins_out[i] = origins[ray]
    directions_out[i] = directions[ray]
    if t_max.shape[0] > 1:
        t_max_out[i] = t_max[ray]


@wp.kernel(enable_backward=False)
def scatter_hits(
    first: int,
    order: wp.array(dtype=int),
    any_hit: bool,
    triangle: wp.array(dtype=int),
    t: wp.array(dtype=float),
    uv: wp.array(dtype=wp.vec2),
    triangle_out: wp.array(dtype=int),
    t_out: wp.array(dtype=float),
    uv_out: wp.array(dtype=wp.vec2),
):
    """Copy the answers to ordered rays back to where the rays were."""
    i = first + wp.tid()
    ray = order[i]
    triangle_out[ray] = triangle[i]
    if not any_hit:
        t_out[ray] = t[i]
        uv_out[ray] = uv[i]


@wp.kernel(enable_backward=False)
def trace_rays(
    first: int,
    bvh: Bvh,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    t_min: float,
    t_max: wp.array(dtype=float),
    any_hit: bool,
    triangle_out: wp.array(dtype=int),
    t_out: wp.array(dtype=float),
    uv_out: wp.array(dtype=wp.vec2),
):
    """Trace rays one a thread; `t_max` has one entry or one a ray.

    `triangle_out` is −1 where nothing is hit, t then infinite. With `any_hit` it is 0 where anything
    is hit, and the other two are left alone. A direction of zero or NaN hits nothing.
    """
    ray = first + wp.tid()
    direction = directions[ray]
    reach = t_max[0]
    if t_max.shape[0] > 1:
        reach = t_max[ray]
    if not (wp.abs(direction[0]) + wp.abs(direction[1]) + wp.abs(direction[2]) > 0.0):
        reach = -1.0
    triangle = int(-1)
    if reach >= t_min:
        if any_hit:
            if bvh_any_hit(bvh, origins[ray], direction, t_min, reach):
                triangle = 0
        else:
            hit = bvh_closest_hit(bvh, origins[ray], direction, t_min, reach)
            triangle = hit.triangle
            uv_out[ray] = wp.vec2(hit.u, hit.v)
            t_out[ray] = wp.where(triangle >= 0, hit.t, wp.inf)
    elif not any_hit:
        uv_out[ray] = wp.vec2(0.0, 0.0)
        t_out[ray] = wp.inf
    triangle_out[ray] = triangle


@wp.kernel(enable_backward=False)
def is_hit(first: int, triangle: wp.array(dtype=int), hit_out: wp.array(dtype=wp.bool)):
    """Tell which of `trace_rays`' answers are hits."""
    i = first + wp.tid()
    hit_out[i] = triangle[i] >= 0
