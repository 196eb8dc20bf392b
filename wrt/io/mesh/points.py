"""Points without faces, which are drawn as exact spheres of one radius."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError, warn
from wrt.io import memory_limits
from wrt.io.mesh.parts import FloatArray, Part
from wrt.scene.exact.spheres import Spheres, spheres

_NEIGHBOR, _SHARE = 4, 0.75
"""The radius is this share of the typical distance to this neighbour. On a square grid, whose points have four nearest
ones, spheres close the surface from a share of 0.71 on; of a surface sampled at random they cover 83 %."""

_GROUP, _GROUPS = 512, 32
"""Most points of a group, whose points lie together, and most groups: neighbours are searched within each."""

_BYTES = 160  # memory of a sphere with its colour: the corners, vectors, coordinates and colours of a triangle


def is_cloud(part: Part) -> bool:
    """Return whether a part is points, not triangles."""
    return bool(part.faces.shape[1] == 1)


def with_radii(path: str, parts: list[Part], extent: float, radius: float | None) -> list[Part]:
    """Return the parts, those of points with a radius, and print a radius that the file does not give in a warning.

    Args:
        path: the file, for messages.
        parts: repaired parts.
        extent: the size of all, for a point without a neighbour: its radius is a hundredth of it, or 1.
        radius: the radius of all points in the file's units; by default the file's, or else by their distances.

    Raises:
        InputError: if the radius is not positive, or there are no points for it.
    """
    clouds = [part for part in parts if is_cloud(part) and (radius is not None or not np.any(part.radius))]
    if radius is not None and not 0.0 < radius < np.inf:
        raise InputError(f"{path}: the radius of points must be a positive number, not {radius:g}")
    if not clouds:
        if radius is not None:
            raise InputError(f"{path}: it has no points that a radius is for")
        return parts
    alone = 0.01 * extent or 1.0
    found = {id(part): radius or _radius(part.vertices) or alone for part in clouds}
    radii = sorted(set(found.values()))
    size = f"{radii[0]:.3g}" if len(radii) == 1 else f"{radii[0]:.3g} to {radii[-1]:.3g}"
    count = sum(len(part.faces) for part in clouds)
    other = "" if radius else "; --point-radius, or point_radius of wrt.load, sets another"
    warn(f"{path}: its {count} points are drawn as spheres of radius {size}{other}", UserWarning)
    return [replace(part, radius=found.get(id(part), part.radius)) for part in parts]


def spheres_of(part: Part, name: str) -> Spheres:
    """Return the spheres of a repaired part of points."""
    memory_limits.take(memory_limits.MESHES, _BYTES * len(part.faces))
    chosen = part.faces[:, 0]
    radii = part.radius[chosen] if isinstance(part.radius, np.ndarray) else part.radius
    colors = None if part.colors is None else part.colors[chosen]
    return spheres(part.vertices[chosen], radii, colors=colors, name=name)


def _radius(points: FloatArray) -> float:
    """Return a share of the median distance of points to a near neighbour, or 0 if all are in one place.

    The points are halved again and again along the longest side of their box (k-d tree, Bentley 1975); of more than
    _GROUPS groups, some are chosen at random. So the time is linear in the points.
    """
    rng = np.random.default_rng(0)
    groups: list[NDArray[Any]] = [points]
    while len(groups[0]) > _GROUP:
        halves = []
        for group in groups:
            axis = int(np.argmax(np.ptp(group, axis=0)))
            order = np.argpartition(group[:, axis], len(group) // 2)
            halves += np.array_split(group[order], [len(group) // 2])
        chosen = rng.permutation(len(halves))[:_GROUPS] if len(halves) > _GROUPS else range(len(halves))
        groups = [halves[k] for k in chosen]
    found = []
    for group in groups:
        places = group.astype(np.float64)
        square = ((places[:, None] - places) ** 2).sum(axis=2)
        square[square == 0.0] = np.inf  # the point itself, and others in its place
        rank = min(_NEIGHBOR, len(group) - 1) - 1
        nearest = np.partition(square, rank, axis=1)[:, rank] if rank >= 0 else np.zeros(0)
        found.append(nearest[np.isfinite(nearest)])
    distances = np.concatenate(found)
    return _SHARE * float(np.sqrt(np.median(distances))) if len(distances) else 0.0
