"""Mip pyramids of images, and of the slopes of normal maps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.scene.textures import NormalMap

FloatArray = NDArray[np.float32]

STEEPEST = 50.0
"""Limit of slopes, at 89 degrees: a normal in the surface has an infinite slope."""


def pyramid(pixels: FloatArray) -> list[FloatArray]:
    """Return (H, W, 3) linear pixels at 1/2, 1/4, ... of their size, down to one texel, with the same mean."""
    levels = []
    while pixels.shape[:2] != (1, 1):
        pixels = halved(pixels)
        levels.append(pixels)
    return levels


def halved(pixels: FloatArray) -> FloatArray:
    """Return the image at half the width and height, rounded up, with the same mean."""
    for axis in (0, 1):
        pixels = _resized(pixels, axis, (pixels.shape[axis] + 1) // 2)
    return pixels


def _resized(pixels: NDArray[Any], axis: int, size: int) -> NDArray[Any]:
    """Return the means over `size` equal pieces of an axis, which may cut texels."""
    old = pixels.shape[axis]
    if old == 2 * size:
        even, odd = (np.take(pixels, range(start, old, 2), axis) for start in (0, 1))
        return np.asarray(np.float32(0.5) * (even + odd))
    # Take differences of the cumulative integral.
    first = np.moveaxis(pixels.astype(np.float64), axis, 0)
    integral = np.concatenate([np.zeros_like(first[:1]), np.cumsum(first, axis=0)])
    edges = np.arange(size + 1) * (old / size)
    texels = np.minimum(edges.astype(int), old - 1)
    at_edges = integral[texels] + (edges - texels)[:, None, None] * first[texels]
    return np.asarray(np.moveaxis(np.diff(at_edges, axis=0) * (size / old), 0, axis).astype(pixels.dtype))


def summed_levels(levels: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the derivative by pixels of what has these derivatives by them, the first, and by the levels of `pyramid`.

    The transpose of `halved`: mean values over n pieces of an axis of m texels have the transpose n / m times the means
    over m pieces of the axis of n.
    """
    total = levels[-1]
    for level in reversed(levels[:-1]):
        for axis in (1, 0):
            old = level.shape[axis]
            total = _resized(total, axis, old) * (total.shape[axis] / old)
        total = level + total
    return total


class DerivedImages:
    """Images that are made of a scene's images and normal maps, so that a later upload need not make them again."""

    def __init__(self) -> None:
        self._made: dict[tuple[int, str], tuple[Any, list[FloatArray]]] = {}
        self._before = self._made

    def begin(self) -> None:
        """Begin an upload: forget the images that the one before has not used."""
        self._before, self._made = self._made, {}

    def levels(self, pixels: FloatArray) -> list[FloatArray]:
        """Return `pyramid` of pixels."""
        return self._kept(pixels, "levels", lambda: pyramid(pixels))

    def of_normal_map(self, normal_map: NormalMap, filtered: bool) -> list[FloatArray]:
        """Return `normals_of` a normal map; if it is filtered, then the images of its `slope_pyramid`."""

        def images() -> list[FloatArray]:
            normals = normals_of(normal_map)
            return [normals, *(image for level in slope_pyramid(normals) for image in level)]

        if not filtered:
            return self._kept(normal_map, "normals", lambda: [normals_of(normal_map)])
        return self._kept(normal_map, "slopes", images)

    def _kept(self, source: Any, kind: str, make: Callable[[], list[FloatArray]]) -> list[FloatArray]:
        key = id(source), kind
        found = self._made.get(key) or self._before.get(key)
        self._made[key] = (source, make()) if found is None else found
        return self._made[key][1]


# --- Normal maps -----------------------------------------------------------------------------------


def normals_of(normal_map: NormalMap) -> FloatArray:
    """Return (H, W, 3) normals in tangent space, not of unit length: 2c − 1, x and y scaled (glTF 2.0, 3.9.3).

    Of a map of heights, return these, three times.
    """
    pixels = np.asarray(normal_map.pixels, np.float32)
    if normal_map.heights:
        return np.repeat(pixels[..., :1] * np.float32(normal_map.scale), 3, axis=2)
    normals: FloatArray = np.float32(2.0) * pixels - np.float32(1.0)
    normals[..., :2] *= np.float32(normal_map.scale)
    steep = np.hypot(normals[..., 0], normals[..., 1]) / np.float32(STEEPEST)
    normals[..., 2] = np.maximum(normals[..., 2], np.maximum(steep, np.float32(1e-3)))
    return normals


def slope_pyramid(normals: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield, from fine to coarse, mean slopes (H, W, 3) as (x, y, 0) and means of their products (xx, yy, xy).

    The moments are those of Olano and Baker (2010), "LEAN mapping", section 3. The average is over the interpolated
    surface of `kernels/textures/textures.py`, not over texels: its slopes vary less.
    """
    means, products = _texel_moments(normals)
    yield means, products
    while means.shape[:2] != (1, 1):
        means, products = halved(means), halved(products)
        yield means, products


def _texel_moments(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the moments over the square of each texel, with two Gauss points in each half of a side.

    Normals are bilinear within a quarter of the square, so the rule is exact for small slopes.
    """
    node = 0.25 / np.sqrt(3.0)
    places = [side * (0.25 + offset) for side in (-1, 1) for offset in (-node, node)]
    means, products = np.zeros_like(normals), np.zeros_like(normals)
    for y in places:
        row = _shifted(normals, y, 0)
        for x in places:
            n = _shifted(row, x, 1)
            a, b = n[..., 0] / n[..., 2], n[..., 1] / n[..., 2]
            means[..., 0] += a
            means[..., 1] += b
            products[..., 0] += a * a
            products[..., 1] += b * b
            products[..., 2] += a * b
    return means / np.float32(len(places) ** 2), products / np.float32(len(places) ** 2)


def _shifted(pixels: FloatArray, place: float, axis: int) -> FloatArray:
    """Interpolate a repeating image at an offset of `place` texels along an axis, at most 1/2."""
    neighbour = np.roll(pixels, -1 if place > 0.0 else 1, axis)
    result: FloatArray = pixels + (neighbour - pixels) * np.float32(abs(place))
    return result
