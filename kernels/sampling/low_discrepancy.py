"""Low-discrepancy points in the unit square, by 32-bit integer arithmetic without tables.

A coordinate is a binary fraction in 32 bits. Most functions take and return fractions *reversed*, with the first digit
in bit 0: a sample's index is then its own van der Corput number, and carries run from the most to the least significant
digit, as Owen scrambling requires.
"""

import warp as wp

from wrt.kernels.native import include

low_discrepancy_h = include("low_discrepancy.h")


@wp.func_native("return wrt::reverse_bits(bits);")
def reverse_bits(bits: wp.uint32) -> wp.uint32:
    """Return the 32 bits in the opposite order."""
    low_discrepancy_h()


@wp.func
def scramble(digits: wp.uint32, seed: wp.uint32) -> wp.uint32:
    """Return a scrambled reversed fraction: all digits before a digit decide whether it is flipped (Owen 1995).

    The flips come from a hash in which no bit depends on a higher one (Laine and Karras 2011), with the constants
    of Vegdahl (2021).
    """
    x = digits
    x = x ^ (x * wp.uint32(0x3D20ADEA))
    x += seed
    x *= (seed >> wp.uint32(16)) | wp.uint32(1)
    x = x ^ (x * wp.uint32(0x05526C56))
    return x ^ (x * wp.uint32(0x53A22864))


@wp.func
def second_dimension(digits: wp.uint32) -> wp.uint32:
    """Return the reversed second coordinate of the Sobol point with this reversed first coordinate.

    Its generator matrix is Pascal's triangle modulo 2, which by Lucas's theorem has a one in row k and column j if the
    bits of j contain those of k. So digit k is the sum of all digits j that contain it, and the sum over supersets
    takes one step for each of the five bits of an index (Ahmed 2024).
    """
    x = digits
    x = x ^ (x >> wp.uint32(16))
    x = x ^ ((x >> wp.uint32(8)) & wp.uint32(0x00FF00FF))
    x = x ^ ((x >> wp.uint32(4)) & wp.uint32(0x0F0F0F0F))
    x = x ^ ((x >> wp.uint32(2)) & wp.uint32(0x33333333))
    return x ^ ((x >> wp.uint32(1)) & wp.uint32(0x55555555))


@wp.func
def shuffle(index: wp.uint32, seed: wp.uint32) -> wp.uint32:
    """Return an index shuffled so that aligned runs of 2^m indices stay together, for every m (Burley 2020)."""
    return reverse_bits(scramble(reverse_bits(index), seed))


@wp.func
def sobol_point(index: wp.uint32, seed_x: wp.uint32, seed_y: wp.uint32) -> wp.vec2ui:
    """Return a point of the (0, 2)-sequence of Sobol (1967), Owen-scrambled.

    Any aligned run of 2^m points has exactly one point in each of the 2^m equal rectangles that tile the square,
    whatever their shape.
    """
    x = reverse_bits(scramble(index, seed_x))
    return wp.vec2ui(x, reverse_bits(scramble(second_dimension(index), seed_y)))


@wp.func_native("return wrt::further_dimension(index, dimension);")
def further_dimension(index: wp.uint32, dimension: int) -> wp.uint32:
    """Return the reversed coordinate 2, 3 or 4 of a Sobol point, in one step for each set bit of the index."""
    low_discrepancy_h()


@wp.func
def spread_bits(bits: wp.uint32) -> wp.uint32:
    """Return the low 16 bits in the even places."""
    x = bits & wp.uint32(0x0000FFFF)
    x = (x | (x << wp.uint32(8))) & wp.uint32(0x00FF00FF)
    x = (x | (x << wp.uint32(4))) & wp.uint32(0x0F0F0F0F)
    x = (x | (x << wp.uint32(2))) & wp.uint32(0x33333333)
    return (x | (x << wp.uint32(1))) & wp.uint32(0x55555555)


@wp.func
def gather_bits(bits: wp.uint32) -> wp.uint32:
    """Return the bits in the even places as the low 16, the reverse of `spread_bits`."""
    x = bits & wp.uint32(0x55555555)
    x = (x | (x >> wp.uint32(1))) & wp.uint32(0x33333333)
    x = (x | (x >> wp.uint32(2))) & wp.uint32(0x0F0F0F0F)
    x = (x | (x >> wp.uint32(4))) & wp.uint32(0x00FF00FF)
    return (x | (x >> wp.uint32(8))) & wp.uint32(0x0000FFFF)


@wp.func
def morton_code(x: wp.uint32, y: wp.uint32) -> wp.uint32:
    """Return the Morton code (1966) of a grid point, with alternating bits of x and y, both below 2^16."""
    return spread_bits(x) | (spread_bits(y) << wp.uint32(1))


@wp.func
def jittered_point(index: wp.uint32, seed: wp.uint32, jitter_x: wp.uint32, jitter_y: wp.uint32) -> wp.vec2ui:
    """Return a jittered point of a quadtree cell, in an order that is scrambled at each level.

    The scrambled van der Corput number of the index is read as a Morton code. So the first 4^k points lie one in each
    cell of a grid of 2^k x 2^k. It has sixteen levels; `jitter` fills the bits below.
    """
    code = reverse_bits(scramble(index, seed))
    low = wp.uint32(16)
    x = (gather_bits(code) << low) | (jitter_x >> low)
    y = (gather_bits(code >> wp.uint32(1)) << low) | (jitter_y >> low)
    return wp.vec2ui(x, y)
