"""Random numbers as a function of (seed, pixel, sample, dimension).

No state is carried from one number to the next, so an image cannot depend on threads, on the order of pixels or on the
split into passes. docs/sampling.md compares the samplers.
"""

import warp as wp

from wrt.kernels.core.features import EITHER
from wrt.kernels.core.specialise import specialised
from wrt.kernels.sampling.low_discrepancy import (
    further_dimension,
    jittered_point,
    morton_code,
    reverse_bits,
    scramble,
    shuffle,
    sobol_point,
)

# Dimensions come in blocks of four numbers. The camera takes the first blocks, every path vertex BLOCKS_PER_VERTEX
# more.
BLOCK_FILM_AND_LENS = wp.constant(wp.uint32(0))
BLOCK_TIME = wp.constant(wp.uint32(1))
BLOCK_VERTICES = wp.constant(wp.uint32(2))
BLOCKS_PER_VERTEX = wp.constant(wp.uint32(4))
BLOCKS_PER_PATH = wp.constant(wp.uint32(2**19 + 1))  # enough for 65536 vertices; odd, to change all bits
BLOCK_LIGHT = wp.constant(wp.uint32(0))
BLOCK_BSDF = wp.constant(wp.uint32(2))
BLOCK_MATERIAL = wp.constant(wp.uint32(3))

NO_PIXEL = wp.constant(wp.uint32(2**32 - 1))
"""The pixel of random numbers that all pixels share."""

# The sample index of hashes that do not depend on the sample: no pixel has this many.
_NO_INDEX = wp.constant(wp.uint32(2**32 - 1))


@wp.struct
class Sampler:
    """Identifies one sample of one pixel; `is_sobol` is the choice of the sampler EITHER."""

    seed: wp.uint32
    pixel: wp.uint32
    index: wp.uint32
    is_sobol: int


@wp.func
def unit_float(bits: wp.uint32) -> float:
    """Return the top 24 bits as a float in [0, 1)."""
    return float(bits >> wp.uint32(8)) * float(5.9604644775390625e-08)


@wp.func
def hash_4d(a: wp.uint32, b: wp.uint32, c: wp.uint32, d: wp.uint32) -> wp.vec4ui:
    """Return four numbers that depend on four: the hash pcg4d of Jarzynski and Olano (2020)."""
    m = wp.uint32(1664525)
    n = wp.uint32(1013904223)
    x = a * m + n
    y = b * m + n
    z = c * m + n
    w = d * m + n
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
    return wp.vec4ui(x, y, z, w)


@wp.func
def _unit_floats(bits: wp.vec4ui) -> wp.vec4:
    return wp.vec4(unit_float(bits[0]), unit_float(bits[1]), unit_float(bits[2]), unit_float(bits[3]))


@wp.func
def _independent(sampler: Sampler, block: wp.uint32) -> wp.vec4:
    return _unit_floats(hash_4d(sampler.pixel, sampler.index, block, sampler.seed))


@wp.func
def _stratified(sampler: Sampler, block: wp.uint32) -> wp.vec4:
    seeds = hash_4d(sampler.pixel, _NO_INDEX, block, sampler.seed)
    jitter = hash_4d(sampler.pixel, sampler.index, block, sampler.seed)
    a = jittered_point(shuffle(sampler.index, seeds[0]), seeds[1], jitter[0], jitter[1])
    b = jittered_point(shuffle(sampler.index, seeds[2]), seeds[3], jitter[2], jitter[3])
    return _unit_floats(wp.vec4ui(a[0], a[1], b[0], b[1]))


@wp.func
def swap_halves(bits: wp.uint32) -> wp.uint32:
    """Return the bits with the two halves swapped."""
    return (bits << wp.uint32(16)) | (bits >> wp.uint32(16))


@wp.func
def _camera_point(index: wp.uint32, block: wp.uint32, seeds: wp.vec4ui) -> wp.vec4ui:
    # All camera dimensions come from one five-dimensional point. Other pairs are shuffled, so this need not be.
    if block == BLOCK_TIME:
        time = scramble(further_dimension(index, 4), seeds[0])
        return wp.vec4ui(reverse_bits(time), seeds[1], seeds[2], seeds[3])
    film = sobol_point(index, seeds[0], seeds[1])
    lens_x = scramble(further_dimension(index, 2), seeds[2])
    lens_y = scramble(further_dimension(index, 3), seeds[3])
    return wp.vec4ui(film[0], film[1], reverse_bits(lens_x), reverse_bits(lens_y))


@wp.func
def _two_pairs(index: wp.uint32, seeds: wp.vec4ui) -> wp.vec4ui:
    a = sobol_point(shuffle(index, seeds[0]), seeds[1], seeds[2])
    # Six seeds out of four: the first 16 digits use the lower half of a seed.
    b = sobol_point(shuffle(index, seeds[3]), swap_halves(seeds[1]), swap_halves(seeds[2]))
    return wp.vec4ui(a[0], a[1], b[0], b[1])


@wp.func
def _sobol(sampler: Sampler, block: wp.uint32) -> wp.vec4:
    return _unit_floats(_two_pairs(sampler.index, hash_4d(sampler.pixel, _NO_INDEX, block, sampler.seed)))


@wp.func
def _sobol_camera(sampler: Sampler, block: wp.uint32) -> wp.vec4:
    return _unit_floats(_camera_point(sampler.index, block, hash_4d(sampler.pixel, _NO_INDEX, block, sampler.seed)))


@wp.func
def _pixel_shift(sampler: Sampler, block: wp.uint32) -> wp.vec4ui:
    # Points in Morton order: they are stratified over any aligned square of 2^m x 2^m pixels, for every m.
    return _two_pairs(sampler.pixel, hash_4d(wp.uint32(1), _NO_INDEX, block, sampler.seed))


@wp.func
def _blue_noise(sampler: Sampler, block: wp.uint32) -> wp.vec4:
    shared = _two_pairs(sampler.index, hash_4d(wp.uint32(0), _NO_INDEX, block, sampler.seed))
    return _unit_floats(shared + _pixel_shift(sampler, block))


@wp.func
def _blue_noise_camera(sampler: Sampler, block: wp.uint32) -> wp.vec4:
    shared = _camera_point(sampler.index, block, hash_4d(wp.uint32(0), _NO_INDEX, block, sampler.seed))
    return _unit_floats(shared + _pixel_shift(sampler, block))


@wp.func
def _pixel_in_row(x: int, y: int, width: int) -> wp.uint32:
    return wp.uint32(y * width + x)


@wp.func
def _pixel_in_morton_order(x: int, y: int, width: int) -> wp.uint32:
    return morton_code(wp.uint32(x), wp.uint32(y))


@wp.func
def _either(sampler: Sampler, block: wp.uint32) -> wp.vec4:
    if sampler.is_sobol != 0:
        return _sobol(sampler, block)
    return _independent(sampler, block)


@wp.func
def _either_camera(sampler: Sampler, block: wp.uint32) -> wp.vec4:
    if sampler.is_sobol != 0:
        return _sobol_camera(sampler, block)
    return _independent(sampler, block)


_SAMPLERS = {
    "independent": _independent,
    "stratified": _stratified,
    "sobol": _sobol,
    "blue-noise": _blue_noise,
    EITHER: _either,
}
_CAMERAS = {"sobol": _sobol_camera, "blue-noise": _blue_noise_camera, EITHER: _either_camera}


@specialised()
def make_sample_4d(name: str) -> wp.Function:
    """Return the device function (sampler, block) -> vec4 of a sampler: four numbers in [0, 1).

    Numbers 0 and 1 are a pair that is stratified over the samples of a pixel, numbers 2 and 3 another. Pairs, blocks
    and pixels are independent, except for the pixels of "blue-noise".
    """
    return _SAMPLERS[name]


@specialised()
def make_sample_camera(name: str) -> wp.Function:
    """Return the same for the camera's blocks: film and lens, and the time.

    Low-discrepancy samplers use one five-dimensional point, because edges out of focus or in motion are edges across
    several dimensions.
    """
    return _CAMERAS.get(name, _SAMPLERS[name])


@specialised()
def make_sampler_of_pixel(name: str) -> wp.Function:
    """Return the device function (seed, is_sobol, x, y, picture's width) -> Sampler of a pixel.

    It is to be given a sample's index.
    """
    pixel_name = _pixel_in_morton_order if name == "blue-noise" else _pixel_in_row

    @wp.func
    def sampler_of_pixel(seed: wp.uint32, is_sobol: int, x: int, y: int, width: int) -> Sampler:
        sampler = Sampler()
        sampler.seed = seed
        sampler.is_sobol = is_sobol
        sampler.pixel = pixel_name(x, y, width)
        return sampler

    return sampler_of_pixel


@wp.func
def vertex_block(depth: int, block: wp.uint32) -> wp.uint32:
    """Return the index, among all blocks of a path, of block `block` (such as BLOCK_LIGHT) of the vertex at `depth`."""
    return BLOCK_VERTICES + wp.uint32(depth) * BLOCKS_PER_VERTEX + block


@wp.func
def passed_block(depth: int, passed: int) -> wp.uint32:
    """Return the index of the block that chooses the material after `passed` surfaces were passed through.

    All other blocks are those of a path without these surfaces, so passing them changes no other number.
    """
    return vertex_block(depth, BLOCK_MATERIAL) + wp.uint32(passed) * BLOCKS_PER_PATH


@wp.func
def stream_key(u: wp.vec4, number: int) -> wp.vec4ui:
    """Return the key of a sequence of further random numbers, whose length is not known in advance.

    It is a hash of the four numbers in [0, 1) of a block, so it depends on what they depend on. Different `number`s
    give different sequences.
    """
    scale = float(16777216.0)
    x, y, z, w = wp.uint32(u[0] * scale), wp.uint32(u[1] * scale), wp.uint32(u[2] * scale), wp.uint32(u[3] * scale)
    return hash_4d(x, y, z, w + (wp.uint32(number) << wp.uint32(24)))


@wp.func
def stream_4d(key: wp.vec4ui, number: int) -> wp.vec4:
    """Return the four independent numbers at a place in the sequence of a key."""
    return _unit_floats(hash_4d(key[0], key[1], key[2], key[3] + wp.uint32(number)))
