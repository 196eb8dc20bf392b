"""Compute the mean emission of each triangle of a shape whose emission varies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrt.linalg import product, weighted_sum
from wrt.scene.exact.analytic import Analytic
from wrt.scene.mesh import Mesh, columns
from wrt.scene.scene import Shape
from wrt.scene.textures import CHANNELS, ImageTexture, VertexColor
from wrt.upload.lights.environment import LUMINANCE

_MOST_PARTS = 64
"""Most subdivisions of an edge in the quadrature over a triangle."""

_LEAST_SHARE = 0.01
"""The weight of a triangle is at least this fraction of the image's mean over its bounding box. The quadrature points
may all miss a bright texel, which must be sampled nevertheless."""

_BATCH = 2**20


def mean_emissions(shape: Shape) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean radiance of each triangle, (T, 3), and its weight in sampling, (T,) luminance.

    The weight is the luminance of the mean, but never 0 if any point of the triangle emits.
    """
    count = len(shape.mesh.faces)
    emission = shape.emission
    if isinstance(emission, ImageTexture):
        return _of_analytic(shape, emission) if isinstance(shape.mesh, Analytic) else _of_image(shape, emission)
    if isinstance(emission, VertexColor):
        values = _vertex_colors(shape, alpha=emission.alpha) * emission.factor
        if emission.cutoff is not None:
            values = _masked(values, emission.cutoff)
        means = values.mean(axis=1)
    else:
        means = np.broadcast_to(np.asarray(emission, np.float64), (count, 3))
    return means, weighted_sum(means, LUMINANCE)


def _of_analytic(shape: Shape, texture: ImageTexture) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the means over both halves of the square of texture coordinates; its stretch is left out."""
    mesh = shape.mesh
    halves = []
    for corner in (0.0, 1.0):
        uvs = np.tile(np.array([[corner, corner], [1.0, 0.0], [0.0, 1.0]], np.float32), (len(mesh.faces), 1))
        triangles = Mesh(mesh.vertices, mesh.faces, None, uvs, mesh.colors, mesh.name)
        halves.append(_of_image(replace(shape, mesh=triangles, transform=None), texture))
    return 0.5 * (halves[0][0] + halves[1][0]), 0.5 * (halves[0][1] + halves[1][1])


def _vertex_colors(shape: Shape, *, alpha: bool) -> NDArray[np.float64]:
    """Return (T, 3, 3) colours of the triangles' corners, or their alpha three times."""
    first, stop = (3, 4) if alpha else (0, 3)
    values = columns(shape.mesh, "colors", first, stop, 1.0)[shape.mesh.faces].astype(np.float64)
    return np.repeat(values, 3, axis=2) if alpha else values


def _of_image(shape: Shape, texture: ImageTexture) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    faces = shape.mesh.faces
    pixels = texture.pixels
    if texture.channel is not None:
        pixels = np.repeat(pixels[..., [CHANNELS.index(texture.channel)]], 3, axis=2)
    height, width = pixels.shape[:2]
    laid_by = columns(shape.mesh, "uvs", 2 * texture.uv_set, 2 * texture.uv_set + 2, 0.0)
    corners = product(laid_by[faces].astype(np.float64), texture.placement[:, :2].T) + texture.placement[:, 2]
    colors = np.ones((len(faces), 3, 3))
    if texture.vertex_colors or texture.vertex_alpha:
        colors = _vertex_colors(shape, alpha=texture.vertex_alpha)
    reach = (np.ptp(corners, axis=1) * [width, height]).max(axis=1)
    parts = np.minimum(2 ** np.ceil(np.log2(np.maximum(reach, 1.0))), _MOST_PARTS).astype(np.int64)
    means = np.zeros((len(faces), 3))
    for n in np.unique(parts):
        weights = _lattice(int(n))
        members = np.flatnonzero(parts == n)
        for chunk in np.array_split(members, -(-len(members) * len(weights) // _BATCH)):
            values = _look_up(texture, pixels, np.einsum("pk,tkc->tpc", weights, corners[chunk]))
            values = values * np.einsum("pk,tkc->tpc", weights, colors[chunk]) * texture.factor
            if texture.cutoff is not None:
                values = _masked(values, texture.cutoff)
            means[chunk] = values.mean(axis=1)
    luminance = weighted_sum(pixels.astype(np.float64), LUMINANCE)
    if texture.cutoff is not None:
        luminance = np.where(luminance > 0.0, 1.0, 0.0)
    around = _means_around(texture, luminance, corners) * (colors.max(axis=1) * texture.factor).max(axis=1)
    return means, np.maximum(weighted_sum(means, LUMINANCE), _LEAST_SHARE * around)


def _masked(values: NDArray[np.float64], cutoff: float) -> NDArray[np.float64]:
    return np.repeat((values[..., :1] >= cutoff).astype(np.float64), 3, axis=-1)


def _look_up(texture: ImageTexture, pixels: NDArray[np.float32], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the colours of an image at texture coordinates, as `kernels.textures.image_color` does."""
    height, width = pixels.shape[:2]
    u, v = (_inside(t, wrap) for t, wrap in zip(np.moveaxis(uv, -1, 0), texture.wrap, strict=True))
    x, y = u * width - 0.5, (1.0 - v) * height - 0.5
    if texture.filter == "nearest":
        x, y = np.floor(x + 0.5), np.floor(y + 0.5)
    column, row = np.floor(x), np.floor(y)
    fx, fy = (x - column)[..., None], (y - row)[..., None]
    columns, rows = _neighbors(column, width, texture.wrap[0]), _neighbors(row, height, texture.wrap[1])
    upper = pixels[rows[0], columns[0]] * (1.0 - fx) + pixels[rows[0], columns[1]] * fx
    lower = pixels[rows[1], columns[0]] * (1.0 - fx) + pixels[rows[1], columns[1]] * fx
    result: NDArray[np.float64] = upper * (1.0 - fy) + lower * fy
    return result


def _inside(t: NDArray[np.float64], wrap: str) -> NDArray[np.float64]:
    if wrap == "clamp":
        return np.clip(t, 0.0, 1.0)
    if wrap == "mirror":
        return np.asarray(1.0 - np.abs(2.0 * (0.5 * t - np.floor(0.5 * t)) - 1.0))
    return np.asarray(t - np.floor(t))


def _neighbors(first: NDArray[np.float64], size: int, wrap: str) -> list[NDArray[np.int64]]:
    pair = [first.astype(np.int64), first.astype(np.int64) + 1]
    return [i % size if wrap == "repeat" else np.clip(i, 0, size - 1) for i in pair]


def _means_around(
    texture: ImageTexture, values: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the means of an image over the bounding box of each triangle's texture coordinates."""
    mirrored = [wrap == "mirror" for wrap in texture.wrap]
    if mirrored[0]:
        values = np.concatenate([values, values[:, ::-1]], axis=1)
    if mirrored[1]:
        values = np.concatenate([values, values[::-1]], axis=0)
    # Coordinates in texels of the repeating image, x to the right and y down, with two more texels on every side.
    size = np.array(values.shape[::-1])
    across, down = (np.array(texture.pixels.shape[1::-1]) * [1, -1]).tolist()
    points = np.where([wrap == "clamp" for wrap in texture.wrap], np.clip(corners, 0.0, 1.0), corners)
    points = points * [across, down] + [0.0, -down]
    low, high = np.floor(points.min(axis=1)) - 2.0, np.floor(points.max(axis=1)) + 3.0
    return _box_means(values, low, np.minimum(high, low + size))


def _lattice(n: int) -> NDArray[np.float64]:
    """Return (n², 3) barycentric weights of the centroids of n² equal parts of a triangle."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    up = i + j < n
    down = i + j < n - 1
    b = np.concatenate([np.stack([i[up], j[up]], 1) + 1.0 / 3.0, np.stack([i[down], j[down]], 1) + 2.0 / 3.0]) / n
    return np.concatenate([1.0 - b.sum(axis=1, keepdims=True), b], axis=1)


def _box_means(values: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means of a repeating image over boxes [low, high) of texels, from a summed-area table."""
    height, width = values.shape
    sums = np.zeros((height + 1, width + 1))
    sums[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)

    def sum_to(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        a, b = np.floor(x / width), np.floor(y / height)
        i, j = (x - a * width).astype(np.int64), (y - b * height).astype(np.int64)
        result: NDArray[np.float64] = a * b * sums[-1, -1] + a * sums[j, -1] + b * sums[-1, i] + sums[j, i]
        return result

    # Move boxes to the origin: differences of large sums lose digits.
    moved = np.floor(low / [width, height]) * [width, height]
    (x0, y0), (x1, y1) = (low - moved).T, (high - moved).T
    total = sum_to(x1, y1) - sum_to(x0, y1) - sum_to(x1, y0) + sum_to(x0, y0)
    result: NDArray[np.float64] = np.maximum(total, 0.0) / ((x1 - x0) * (y1 - y0))
    return result
