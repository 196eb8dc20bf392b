"""Windows of a picture: those of a part, and their pixels in the arrays of a film.

A part is a few bands of rows from different heights of the picture: a sky costs less than the ground below it, and
every part gets some of both.
"""

from __future__ import annotations

from collections.abc import Sequence

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
    # Only the cells of this part: a small file may claim a billion parts.
    return tuple(grid_cell(crop, columns, rows, index) for index in range(number - 1, columns * rows, of))


def grid_cell(crop: CropWindow, columns: int, rows: int, index: int) -> CropWindow:
    """Return a window of a grid over `crop`, counted row after row; their sides differ by one pixel at most."""
    x0, y0, x1, y1 = crop
    row, column = divmod(index, columns)
    x_begin, x_end = (x0 + (x1 - x0) * i // columns for i in (column, column + 1))
    y_begin, y_end = (y0 + (y1 - y0) * i // rows for i in (row, row + 1))
    return x_begin, y_begin, x_end, y_end


def pixels_of(windows: Sequence[CropWindow]) -> int:
    """Return the number of pixels in windows."""
    return sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in windows)


def _view(picture: NDArray[np.generic], crop: CropWindow, window: CropWindow) -> NDArray[np.generic]:
    """Return the rows and columns of a window in an array of a film, whose first axis counts the pixels of `crop`."""
    rows = picture.reshape(crop[3] - crop[1], crop[2] - crop[0], *picture.shape[1:])
    return rows[window[1] - crop[1] : window[3] - crop[1], window[0] - crop[0] : window[2] - crop[0]]


def write_windows(
    picture: NDArray[np.generic], crop: CropWindow, windows: Sequence[CropWindow], pixels: NDArray[np.generic]
) -> None:
    """Write `pixels`, those of each window in turn, to their places in `picture`, an array over the film of `crop`."""
    first = 0
    for window in windows:
        view, count = _view(picture, crop, window), pixels_of((window,))
        view[...] = pixels[first : first + count].reshape(view.shape)
        first += count


def read_windows(picture: NDArray[np.generic], crop: CropWindow, windows: Sequence[CropWindow]) -> NDArray[np.generic]:
    """Return the pixels of each window in turn from `picture`, an array over the film of `crop`."""
    shapes = [(pixels_of((window,)), *picture.shape[1:]) for window in windows]
    views = (_view(picture, crop, window) for window in windows)
    return np.concatenate([view.reshape(shape) for view, shape in zip(views, shapes, strict=True)])
