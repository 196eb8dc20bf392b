"""Numbers shared by kernels written in Python and the C++ headers of this folder.

Each name in capitals becomes a constant of the same name in the generated header `constants.h`.
"""

WIDTH = 8
"""Children of a node of the ray tree."""

NODE_FLOATS = 7 * WIDTH
"""Floats of a node: the lower x, y, z and the upper x, y, z of its boxes, then its children as integers."""

LEAF_SIZE = 8
"""Triangles of a leaf."""

LEAF_FLOATS = 10 * LEAF_SIZE
"""Floats of a leaf: x, y, z of the first, second and third corners, then the triangles' numbers as integers."""

MAX_DEPTH = 36
"""Levels of the deepest tree. The builder refuses to make a deeper one, so the stack cannot overflow."""

STACK_SIZE = 7 * MAX_DEPTH + 8
"""Entries of a traversal stack: seven children wait for each level above the current node."""

NOTHING_HIT = 0x7FFFFFFF
"""The triangle number of a ray that has hit nothing yet. It is above all others, so the lower number wins."""

BOX_PAD = 1.00002
"""The factor by which the far distance of a box is enlarged.

It covers the rounding of both distances (after Ize 2013), and more: rounding may put a large triangle a little before
its box, and all triangles at the same distance must be found.
"""

LONGEST = 3.4028235e38
"""The longest distance along a ray. It is finite, so that a distance that overflows is not a hit."""

PACKET = 8
"""Rays in a packet of `Intersector`: the size of a vector."""

LONE_RAYS, LONE_MIXED_RAYS = 4, 8
"""A group of one octant, and one of several, follows its rays one by one when fewer than this remain; measured."""

RAYS_PER_THREAD = 64
"""Rays that a thread traces in turn."""

RAYS_IN_TURN = 16
"""Rays that `Intersector` interleaves, a step of each in turn; measured."""

IN_TURN, IN_TURN_IF_LARGE = 8, 24
"""Rays that the wide kernel interleaves; measured.

A large tree does not fit any cache: a read takes several hundred cycles, in which more rays can take a step.
"""

FEW_RAYS, FEW_RAYS_IF_LARGE = 6, 8
"""Rays of a group of sixteen from which a common descent of the tree pays; measured."""

LARGE_TREE = 1 << 21
"""Floats in the leaves of a large tree: 8 MB."""

TILE = 16
"""Pixels along each side of the square that a thread of the wide kernel renders."""

PATHS = 1024
"""Paths that the wide kernel follows at a time; measured.

The data of all, 13 KB for sixteen in simple scenes, fit into a second-level cache of 1 MB.
"""

POINTS_IN_CACHE = 200_000
"""Vertices of a mesh above which prefetching them pays.

It makes the Cornell box 3 % slower, and paths among 10 million triangles 5 % faster.
"""

BINS = 16
"""Bins along an axis in which the builder of the tree counts triangles."""

LIGHT_NODE_FLOATS = 128
"""Floats of a node of the light tree: 15 rows of eight numbers, then its children as integers."""

LIGHT_CHILDREN = 120
"""Offset of the children in a node of the light tree."""

LEAST_SHARE = 0.2
"""The least probability of choosing the lights with a position, and of choosing those at infinity.

A point chooses between the two by the irradiance that each could give it; occlusion is not known.
"""

RECEIVES_ANYWHERE, RECEIVES_FRONT, RECEIVES_BOTH = 0, 1, 2
"""The directions from which a point receives light: all, in a medium; the side of the normal; both sides."""


# Sobol dimensions 2 to 4, counted from 0, by Joe and Kuo (2008): the inner coefficients of the primitive polynomial,
# and the first direction numbers, as many as its degree.
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


SOBOL_COLUMNS = tuple(tuple(_columns(*polynomial)) for polynomial in _POLYNOMIALS)
"""The generator matrices of these dimensions, 32 columns each."""

SET_BITS = tuple(tuple(k for k in range(8) if m >> k & 1) + (0,) * (8 - m.bit_count()) for m in range(256))
"""For each number of eight bits the positions of its set bits, padded to eight with zeros."""

RANKS_OF_BITS = tuple(tuple((m & (1 << k) - 1).bit_count() for k in range(8)) for m in range(256))
"""For each number of eight bits and each of its places how many bits are set below."""
