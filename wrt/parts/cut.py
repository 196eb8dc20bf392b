"""Cut a picture into parts of nearly equal work.

A part is a few bands of rows from different heights of the picture: a sky costs less than the ground below it, and
every part gets some of both.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.upload.camera import CropWindow
from wrt.values import integer

BANDS = 4
"""Most bands of a part; docs/clusters.md has the seconds of parts with one band and with four."""

LEAST_ROWS = 8
"""Rows of a band, where the picture suffices for several bands a part: the wide kernel renders squares of pixels."""


def windows_of_part(crop: CropWindow, number: int, of: int) -> tuple[CropWindow, ...]:
    """Return the windows of part `number` of `of`, counted from 1.

    The windows of all parts cover `crop` once.

    Raises:
        InputError: if there is no such part, or there are more parts than pixels.
    """
    of = integer(of, "the number of parts", minimum=1, maximum=2**31 - 1)
    number = integer(number, "the number of a part", minimum=1, maximum=of)
    x0, y0, x1, y1 = crop
    width, height = x1 - x0, y1 - y0
    if of > width * height:
        raise InputError(f"{of} parts of {width}x{height} pixels: there are more parts than pixels")
    if of > height:  # single rows, cut into pieces
        columns, rows = -(-of // height), height
    else:
        columns, rows = 1, of * min(max(height // (of * LEAST_ROWS), 1), BANDS)
    # Not by `grid`: a small file may claim a billion parts.
    return tuple(_cell(crop, columns, rows, index) for index in range(number - 1, columns * rows, of))


def grid(crop: CropWindow, columns: int, rows: int) -> list[CropWindow]:
    """Return the windows of a grid row after row; their sides differ by one pixel at most."""
    return [_cell(crop, columns, rows, index) for index in range(columns * rows)]


def _cell(crop: CropWindow, columns: int, rows: int, index: int) -> CropWindow:
    x0, y0, x1, y1 = crop
    row, column = divmod(index, columns)
    x_begin, x_end = (x0 + (x1 - x0) * i // columns for i in (column, column + 1))
    y_begin, y_end = (y0 + (y1 - y0) * i // rows for i in (row, row + 1))
    return x_begin, y_begin, x_end, y_end


def pixels_of(windows: Sequence[CropWindow]) -> int:
    """Return the number of pixels in windows."""
    return sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in windows)


def in_picture(windows: Sequence[CropWindow], crop: CropWindow) -> Iterator[tuple[slice, slice, slice]]:
    """Yield for each window the slice of its pixels among those of all windows in turn, and its rows and columns.

    Rows and columns count in a picture of `crop`.
    """
    first = 0
    for x0, y0, x1, y1 in windows:
        count = (x1 - x0) * (y1 - y0)
        yield slice(first, first + count), slice(y0 - crop[1], y1 - crop[1]), slice(x0 - crop[0], x1 - crop[0])
        first += count


def put(picture: NDArray[np.generic], crop: CropWindow, windows: Sequence[CropWindow], pixels: object) -> None:
    """Set the pixels of windows in an array of a film, whose first axis counts the pixels of `crop`."""
    values = np.asarray(pixels)
    rows = picture.reshape(crop[3] - crop[1], crop[2] - crop[0], *picture.shape[1:])
    for part, y, x in in_picture(windows, crop):
        rows[y, x] = values[part].reshape(y.stop - y.start, x.stop - x.start, *picture.shape[1:])


def take(picture: NDArray[np.generic], crop: CropWindow, windows: Sequence[CropWindow]) -> NDArray[np.generic]:
    """Return the pixels of windows from an array of a film, whose first axis counts the pixels of `crop`."""
    rows = picture.reshape(crop[3] - crop[1], crop[2] - crop[0], *picture.shape[1:])
    return np.concatenate([rows[y, x].reshape(-1, *picture.shape[1:]) for _, y, x in in_picture(windows, crop)])
