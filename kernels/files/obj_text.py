"""The text of OBJ files, parsed: C++ (`kernels/native/obj_text.h`), as its loops are over letters."""

import warp as wp

from wrt.kernels.native import include

obj_text_h = include("obj_text.h")


@wp.struct
class Text:
    """The lines of an OBJ file.

    Attributes:
        letters: The text; it ends with a newline.
        starts: (K + 1,) where chunks of whole lines begin, and the end.
        counts: (K, 9) of chunks, lines of each kind ("v", "vt", "vn", "f", others), corners of faces, and words of the
            first line of "v", "vt" and "vn"; `read_text` takes how many lines and corners are before the chunk.
        columns: Numbers of each line of "v", "vt" and "vn" that are kept.
        most: The largest number that is kept; lines may have more, otherwise none.
        v: Numbers of "v", line by line.
        vt: Numbers of "vt".
        vn: Numbers of "vn".
        corners: (C, 3) indices of each kind that corners name, -1 for none.
        sizes: (F,) corners of each face.
        others: (L, 2) where other lines begin, and how many faces are before them.
        is_read: (K,) 1 for a chunk that is read, 0 for one with something that this parser leaves to the host.
    """

    letters: wp.array(dtype=wp.uint8)
    starts: wp.array(dtype=int)
    counts: wp.array(dtype=int)
    columns: wp.vec3i
    most: wp.vec3i
    v: wp.array(dtype=wp.float64)
    vt: wp.array(dtype=float)
    vn: wp.array(dtype=float)
    corners: wp.array(dtype=int)
    sizes: wp.array(dtype=int)
    others: wp.array(dtype=int)
    is_read: wp.array(dtype=int)


@wp.func_native("wrt::count_obj(text, chunk);")
def _count(text: Text, chunk: int):
    obj_text_h()


@wp.func_native("return wrt::read_obj(text, chunk);")
def _read(text: Text, chunk: int) -> bool:
    obj_text_h()


@wp.kernel(enable_backward=False)
def count_text(first: int, text: Text):
    """Count the lines of a chunk."""
    _count(text, first + wp.tid())


@wp.kernel(enable_backward=False)
def read_text(first: int, text: Text):
    """Read the lines of a chunk."""
    chunk = first + wp.tid()
    text.is_read[chunk] = wp.where(_read(text, chunk), 1, 0)
