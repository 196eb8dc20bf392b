"""How a pass is cut into windows for workers: large ones first, and smaller ones towards its end."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from wrt.parts.cut import grid
from wrt.upload.camera import CropWindow

SHARES = 2
"""A window is this part of a worker's even share of the pixels that are left (Polychronopoulos and Kuck 1987)."""

ROWS_PER_WORKER = 8
"""Pictures with fewer rows for each worker are cut into columns, too."""

LONGEST_SECONDS, SHORTEST_SECONDS = 8.0, 0.3
"""Seconds that a window should take at most, since it is lost with its worker, and at least, since each costs the head
node, Dask and the worker some ten milliseconds."""


def windows_of_pass(
    crop: CropWindow, workers: Callable[[], int], seconds_of_pixel: Callable[[], float]
) -> Iterator[CropWindow]:
    """Yield windows that cover `crop` once.

    Args:
        crop: the picture.
        workers: returns the number of workers, which may change meanwhile.
        seconds_of_pixel: returns the seconds that a pixel takes in this pass, 0 while they are unknown.
    """
    rows = crop[3] - crop[1]
    columns = min(-(-ROWS_PER_WORKER * max(workers(), 1) // rows), crop[2] - crop[0])
    left = rows * (crop[2] - crop[0])
    for x0, y0, x1, y1 in grid(crop, columns, 1):
        y, width = y0, x1 - x0
        while y < y1:
            pixels = left / (SHARES * max(workers(), 1))
            if seconds := seconds_of_pixel():
                pixels = min(max(pixels, SHORTEST_SECONDS / seconds), LONGEST_SECONDS / seconds)
            end = min(y + max(int(pixels / width), 1), y1)
            yield x0, y, x1, end
            left -= width * (end - y)
            y = end
