"""Points that fill the unit square evenly, made of 32-bit integers without tables.

A coordinate is a binary fraction in 32 bits. Most functions here take and return fractions *reversed*, their
first digit in bit 0: so the digits of a sample's index are those of its van der Corput number, and carries of
additions run from the digits that weigh most to those that weigh least, as Owen's scrambling wants it.
"""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __brev(bits);
#else
    return __builtin_bitreverse32(bits);
#endif
""")
def reverse_bits(bits: wp.uint32) -> wp.uint32:
    """Return the 32 bits in the opposite order."""
    ...


@wp.func
def scramble(digits: wp.uint32, seed: wp.uint32) -> wp.uint32:
    """Return a reversed fraction scrambled: each digit flipped, or not, by all digits before it (Owen 1995).

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
    """Return the reversed second coordinate of the Sobol point whose reversed first one is given.

    Its generator matrix is Pascal's triangle modulo 2, which by Lucas's theorem has a one in row k and column j
    where the bits of j contain those of k. So digit k is the sum of all digits j that contain it, and the sum over
    supersets takes one step for each of their five bits (Ahmed 2024).
    """
    x = digits
    x = x ^ (x >> wp.uint32(16))
    x = x ^ ((x >> wp.uint32(8)) & wp.uint32(0x00FF00FF))
    x = x ^ ((x >> wp.uint32(4)) & wp.uint32(0x0F0F0F0F))
    x = x ^ ((x >> wp.uint32(2)) & wp.uint32(0x33333333))
    return x ^ ((x >> wp.uint32(1)) & wp.uint32(0x55555555))


@wp.func
def shuffle(index: wp.uint32, seed: wp.uint32) -> wp.uint32:
    """Return an index in an order in which every aligned run of 2^m indices stays one, for every m (Burley 2020)."""
    return reverse_bits(scramble(reverse_bits(index), seed))


@wp.func
def sobol_point(index: wp.uint32, seed_x: wp.uint32, seed_y: wp.uint32) -> wp.vec2ui:
    """Return a point of the (0, 2)-sequence of Sobol (1967), Owen-scrambled.

    Any 2^m points from a multiple of 2^m on have exactly one in each of the 2^m rectangles of one shape that tile the
    square, whatever the shape.
    """
    x = reverse_bits(scramble(index, seed_x))
    return wp.vec2ui(x, reverse_bits(scramble(second_dimension(index), seed_y)))


# Of Sobol's dimensions 2 to 4, counted from 0, by Joe and Kuo (2008): the coefficients of the primitive polynomial
# between its first and its last, and the first direction numbers, as many as its degree.
_POLYNOMIALS = ((1, (1, 3)), (1, (1, 3, 1)), (2, (1, 1, 1)))


def _columns(coefficients: int, first: tuple[int, ...]) -> list[int]:
    """Return the 32 columns of a generator matrix, each a reversed fraction (Bratley and Fox 1988, eq. 2.2)."""
    degree = len(first)
    numbers = list(first)
    for k in range(degree, 32):
        number = numbers[k - degree] ^ (numbers[k - degree] << degree)
        for j in range(1, degree):
            number ^= (coefficients >> (degree - 1 - j) & 1) * (numbers[k - j] << j)
        numbers.append(number)
    # Number k has k + 1 digits, the last in bit 0.
    return [int(f"{number:0{k + 1}b}"[::-1], 2) for k, number in enumerate(numbers)]


COLUMNS = ", ".join("{" + ", ".join(f"{c}u" for c in _columns(*p)) + "}" for p in _POLYNOMIALS)
"""The three matrices as C++ writes an array of arrays, 32 columns each."""

_SUM_COLUMNS = """
    const unsigned columns[3][32] = {COLUMNS};
    unsigned digits = 0;
    for (unsigned rest = index; rest; rest &= rest - 1) {
#if defined(__CUDA_ARCH__)
        digits ^= columns[dimension - 2][__ffs(rest) - 1];
#else
        digits ^= columns[dimension - 2][__builtin_ctz(rest)];
#endif
    }
    return digits;
""".replace("COLUMNS", COLUMNS)


@wp.func_native(_SUM_COLUMNS)
def further_dimension(index: wp.uint32, dimension: int) -> wp.uint32:
    """Return the reversed coordinate 2, 3 or 4 of a Sobol point; a step for each bit that the index has set."""
    ...


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
    """Return a place on a grid as one number, its bits taken from x and y by turns (Morton 1966); below 2^16 each."""
    return spread_bits(x) | (spread_bits(y) << wp.uint32(1))


@wp.func
def jittered_point(index: wp.uint32, seed: wp.uint32, jitter_x: wp.uint32, jitter_y: wp.uint32) -> wp.vec2ui:
    """Return a point in a quarter of a quarter ... of the square, taken in an order that is scrambled at each level.

    The scrambled van der Corput number of the index, read as a Morton code. So the first 4^k points lie one in each
    cell of a grid of 2^k x 2^k. Sixteen levels; `jitter` fills the bits below.
    """
    code = reverse_bits(scramble(index, seed))
    low = wp.uint32(16)
    x = (gather_bits(code) << low) | (jitter_x >> low)
    y = (gather_bits(code >> wp.uint32(1)) << low) | (jitter_y >> low)
    return wp.vec2ui(x, y)
