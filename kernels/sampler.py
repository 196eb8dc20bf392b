"""Random numbers as a function of (seed, pixel, sample, dimension).

Nothing is carried from one number to the next, so an image cannot depend on threads, on the
order of pixels or on how the samples were split into passes.
"""

import warp as wp

# Dimensions come in blocks of four numbers. The camera takes the first blocks; every path
# vertex then takes BLOCKS_PER_VERTEX more.
BLOCK_FILM_AND_LENS = wp.constant(wp.uint32(0))
BLOCK_TIME = wp.constant(wp.uint32(1))
BLOCK_VERTICES = wp.constant(wp.uint32(2))
BLOCKS_PER_VERTEX = wp.constant(wp.uint32(4))
BLOCKS_PER_PATH = wp.constant(wp.uint32(2**19 + 1))  # more than 65536 vertices have; odd, to change all bits
BLOCK_LIGHT = wp.constant(wp.uint32(0))
BLOCK_ENVIRONMENT = wp.constant(wp.uint32(1))
BLOCK_BSDF = wp.constant(wp.uint32(2))
BLOCK_MATERIAL = wp.constant(wp.uint32(3))


@wp.struct
class Sampler:
    """Names one sample of one pixel."""

    seed: wp.uint32
    pixel: wp.uint32
    index: wp.uint32


@wp.func
def unit_float(bits: wp.uint32) -> float:
    """Return the top 24 bits as a float in [0, 1)."""
    return float(bits >> wp.uint32(8)) * float(5.9604644775390625e-08)


@wp.func
def sample_4d(sampler: Sampler, block: wp.uint32) -> wp.vec4:
    """Return four independent numbers in [0, 1): the hash pcg4d of Jarzynski and Olano (2020)."""
    m = wp.uint32(1664525)
    c = wp.uint32(1013904223)
    x = sampler.pixel * m + c
    y = sampler.index * m + c
    z = block * m + c
    w = sampler.seed * m + c
    x += y * w
    y += z * x
    z += x * y
    w += y * z
    x = x ^ (x >> wp.uint32(16))
    y = y ^ (y >> wp.uint32(16))
    z = z ^ (z >> wp.uint32(16))
    w = w ^ (w >> wp.uint32(16))
    x += y * w
    y += z * x
    z += x * y
    w += y * z
    return wp.vec4(unit_float(x), unit_float(y), unit_float(z), unit_float(w))


@wp.func
def vertex_block(depth: int, block: wp.uint32) -> wp.uint32:
    """Return the number of a block that belongs to the path vertex at `depth`."""
    return BLOCK_VERTICES + wp.uint32(depth) * BLOCKS_PER_VERTEX + block


@wp.func
def passed_block(depth: int, passed: int) -> wp.uint32:
    """Return the number of the block for the material met after `passed` surfaces that let the path through.

    All other blocks are those that a path has without these surfaces, so that what is not there changes nothing.
    """
    return vertex_block(depth, BLOCK_MATERIAL) + wp.uint32(passed) * BLOCKS_PER_PATH
