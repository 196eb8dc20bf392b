"""Sums of derivatives in fixed point, whose bits do not depend on the order of the summands.

Integers of 64 bits are added atomically. A summand is rounded up or down at random, by a hash of its bits, so that its
mean stays and summands far below the unit are not lost.
"""

import warp as wp

NOT_FINITE = wp.constant(0)
OVERFLOWED = wp.constant(1)
"""Sums beyond the limit, and summands that are not finite, which are left out: what `faults` counts."""

# Odd numbers without a pattern: the golden ratio, and one of MurmurHash3 (Appleby 2011).
_FIRST = wp.constant(wp.uint32(0x9E3779B9))
_SECOND = wp.constant(wp.uint32(0x85EBCA6B))
_PART = wp.constant(wp.float64(2.0**-32))
_LIMIT = wp.constant(wp.float64(2.0**61))


@wp.struct
class ExactSums:
    """Sums for an array of colours, three integers each, in units of 1 / `scale`, a power of two."""

    sums: wp.array(dtype=wp.int64)
    faults: wp.array(dtype=int)
    scale: wp.float64


@wp.struct
class GradientSums:
    """Derivatives of a loss by the values of a scene: arrays parallel to those of SceneData.

    `emission` belongs to `shapes`; `lights` to the values of lights that are no triangles; `environment` has one entry,
    for a constant one, and `environment_texels` is for an image. `vertices` belongs to `points`; both it and `normals`
    are read by kernels of derivatives by vertices alone. `index` has one number, the derivative by the index of the
    smooth glass with the number `material`, of kernels for that alone.
    """

    slots: ExactSums
    texels: ExactSums
    emission: ExactSums
    lights: ExactSums
    environment: ExactSums
    environment_texels: ExactSums
    media_absorption: ExactSums
    media_scattering: ExactSums
    media_emission: ExactSums
    vertices: ExactSums
    normals: ExactSums
    index: ExactSums
    material: int


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return static_cast<wp::int64>(atomicAdd(
        reinterpret_cast<unsigned long long*>(&sums.data[i]), static_cast<unsigned long long>(value)));
#else
    return __atomic_fetch_add(&sums.data[i], value, __ATOMIC_RELAXED);
#endif
""")
def add_exactly(sums: wp.array(dtype=wp.int64), i: int, value: wp.int64) -> wp.int64:
    """Add to a sum and return what it was. On the CPU `wp.atomic_add` is a plain addition, which threads may lose."""
    ...


@wp.func
def fixed_point(x: wp.float64, bits: int) -> wp.int64:
    """Return x rounded up or down by a hash of `bits`."""
    hashed = wp.uint32(bits) * _FIRST
    hashed = (hashed ^ (hashed >> wp.uint32(15))) * _SECOND
    hashed = hashed ^ (hashed >> wp.uint32(13))
    return wp.int64(wp.floor(x + wp.float64(hashed) * _PART))


@wp.func
def add_number(to: ExactSums, i: int, x: float):
    """Add x to the sum i."""
    scaled = wp.float64(x) * to.scale
    if not wp.isfinite(x):
        wp.atomic_add(to.faults, NOT_FINITE, 1)
    elif wp.abs(scaled) >= _LIMIT:
        wp.atomic_add(to.faults, OVERFLOWED, 1)
    elif x != 0.0:
        # A sum cannot leave the range of integers without a summand that finds it beyond the limit.
        before = add_exactly(to.sums, i, fixed_point(scaled, wp.cast(x, wp.int32)))
        if wp.abs(wp.float64(before)) >= _LIMIT:
            wp.atomic_add(to.faults, OVERFLOWED, 1)


@wp.func
def add_color(to: ExactSums, i: int, color: wp.vec3):
    """Add a colour to the one with number i."""
    for c in range(3):
        add_number(to, 3 * i + c, color[c])
