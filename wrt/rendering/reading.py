"""How a film is read: as it is, or through a small kernel that shares samples between neighbouring pixels.

A sample counts for the pixel that it was taken for, so that one thread owns a pixel. A filter may then give each of the
four neighbours a share of a pixel's mean, and of those at the corners the square of it: along each axis the picture's
filter is s ⊗ (a, 1 - 2a, a), of the density s of the samples and of the share a. The mean of the picture stays, and
independent noise falls to (1 - 2a)² + 2a² of its standard error.

At the border of the whole picture pixels keep the shares that would leave it, so that the kernel is symmetric. A crop
has the pixels beside it in its film.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene.scene import RenderSettings
from wrt.upload.camera import CropWindow

SHARES = {"shared": 0.075}
"""Share of a pixel's mean for each neighbour, for filters that share samples; docs/notes/filters.md compares others."""


def crop_of(settings: RenderSettings) -> CropWindow:
    """Return the window of the whole picture that is rendered."""
    return settings.crop or (0, 0, settings.width, settings.height)


def window_of(settings: RenderSettings) -> CropWindow:
    """Return the window of a picture's film: `crop_of`, and the pixels beside it that the filter reads."""
    x0, y0, x1, y1 = crop_of(settings)
    beside = int(settings.filter in SHARES)
    return (
        max(x0 - beside, 0),
        max(y0 - beside, 0),
        min(x1 + beside, settings.width),
        min(y1 + beside, settings.height),
    )


@dataclass(frozen=True)
class Reading:
    """How means per pixel of a film become a picture.

    Attributes:
        share: share of a pixel's mean for each neighbour; 0 for none.
        margins: pixels of the film left of the picture, above it, right of it and below it.
    """

    share: float = 0.0
    margins: tuple[int, int, int, int] = (0, 0, 0, 0)

    @classmethod
    def of(cls, settings: RenderSettings) -> Reading:
        """Return how the film of a picture with these settings is read."""
        (x0, y0, x1, y1), (left, top, right, bottom) = crop_of(settings), window_of(settings)
        return cls(SHARES.get(settings.filter, 0.0), (x0 - left, y0 - top, right - x1, bottom - y1))

    def picture(self, means: NDArray[Any]) -> NDArray[Any]:
        """Return the picture of (H, W, ...) means of a film, in their type; (H, W, ...) without margins."""
        return self.cut(self.blended(means))

    def cut(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return (H, W, ...) values of a film without its margins."""
        left, top, right, bottom = self.margins
        return values[top : values.shape[0] - bottom, left : values.shape[1] - right]

    def blended(self, means: NDArray[Any], *, squared: bool = False) -> NDArray[Any]:
        """Return (H, W, ...) means of a film blended with their neighbours', or variances, by the `squared` shares."""
        if not self.share:
            return means
        values = np.asarray(means, np.float64)
        for axis in (0, 1):
            rows = np.moveaxis(values, axis, 0)
            kept_shares = np.full((len(rows), *(1,) * (rows.ndim - 1)), 1.0)
            blended = np.zeros_like(rows)
            blended[1:] += rows[:-1]
            kept_shares[1:] -= self.share
            blended[:-1] += rows[1:]
            kept_shares[:-1] -= self.share
            blended *= self.share**2 if squared else self.share
            blended += (kept_shares**2 if squared else kept_shares) * rows
            values = np.moveaxis(blended, 0, axis)
        return values.astype(means.dtype, copy=False)

    def spread(self, d_image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the derivative by the means of a film, from (H, W, 3), that by its picture: `picture` transposed."""
        left, top, right, bottom = self.margins
        return np.asarray(self.blended(np.pad(d_image, ((top, bottom), (left, right), (0, 0)))))


PLAIN = Reading()
"""Reads a film as it is."""
